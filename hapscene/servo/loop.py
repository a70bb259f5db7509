"""The servo's loop, compiled and without the GIL: sleep until the tick is due, read the aim, tick, publish."""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns, sleep_ns
from hapscene.constants import TINY
from hapscene.native import native
from hapscene.servo.channel import BIN_COUNT, BIN_NS
from hapscene.twin.loop import beat, take_grip

FOLLOW_RAD_S: Final = 60.0
"""How fast the hand's target follows the aim, critically damped [rad/s]: a mouse moves in steps at 60 Hz, a hand does
not; 17 ms is half of what is noticed between seeing and feeling (45 ms, Adelstein et al. 2003)."""

LATE_MAX: Final = 20
"""How many ticks the loop may be behind before it gives them up [count]."""


@native
def serve(
    world: Any,
    surface: Any,
    body: Any,
    channel: Any,
    rows: Any,
    felt: Any,
    a_m_s2: NDArray[np.float64],
    a_handle_m_s2: NDArray[np.float64],
    aim: NDArray[np.float64],
    clock: NDArray[np.int64],
) -> None:
    """Tick in real time until `channel.pause`. `aim` (5, 3): aim, target, its velocity, grip and push, as last read."""
    tick_ns = round(surface.touch[0].tick_s * 1e9)
    due = now_ns(clock)
    while channel.pause == 0:
        due += tick_ns
        before = now_ns(clock)
        if before < due:
            sleep_ns(clock, due - before)
        start = now_ns(clock)
        if start - due > LATE_MAX * tick_ns:
            missed = (start - due) // tick_ns
            channel.missed += missed
            due += missed * tick_ns
        _count(channel.late, start - due)
        _read_aim(channel, aim, clock)
        _follow(body, aim, surface.touch[0].tick_s)
        slot = channel.done % len(rows)
        beat(world, surface, body, rows[slot], a_m_s2[slot], felt[slot], a_handle_m_s2[slot])
        _count(channel.busy, now_ns(clock) - start)  # a call the compiler knows nothing of: what is above stays above
        channel.done += 1


@native
def _read_aim(channel: Any, aim: NDArray[np.float64], clock: NDArray[np.int64]) -> None:
    """Take over the application's aim, unless it is being written."""
    count = channel.aim_count
    now_ns(clock)  # keeps the two looks at the count apart
    p, grip, push = channel.aim_W_m, channel.grip, channel.push_W_N
    x, y, z = p[0], p[1], p[2]
    k, b, m = grip[0], grip[1], grip[2]
    u, v, w = push[0], push[1], push[2]
    now_ns(clock)
    if count % 2 == 1 or count != channel.aim_count:
        return
    aim[0, 0], aim[0, 1], aim[0, 2] = x, y, z
    aim[3, 0], aim[3, 1], aim[3, 2] = k, b, m
    aim[4, 0], aim[4, 1], aim[4, 2] = u, v, w


@native
def _follow(body: Any, aim: NDArray[np.float64], tick_s: float) -> None:
    """Move the hand's target after the aim, smoothly."""
    take_grip(body, aim[3, 0], aim[3, 1], aim[3, 2])
    hand = body.arm.hand[0]
    fade = math.exp(-FOLLOW_RAD_S * tick_s)
    for i in range(3):
        ahead = aim[1, i] - aim[0, i]
        pull = (aim[2, i] + FOLLOW_RAD_S * ahead) * tick_s
        after = aim[0, i] + (ahead + pull) * fade
        aim[2, i] = (aim[2, i] - FOLLOW_RAD_S * pull) * fade
        if abs(ahead) < TINY and abs(aim[2, i]) < TINY:
            after, aim[2, i] = aim[0, i], 0.0
        hand.target_m[i] = aim[1, i]
        hand.target_m_s[i] = (after - aim[1, i]) / tick_s
        hand.push_N[i] = aim[4, i]
        aim[1, i] = after


@native
def _count(histogram: Any, span_ns: int) -> None:
    """One more in the bin of this time."""
    at = int(math.log2(max(span_ns, 1) / BIN_NS)) if span_ns > BIN_NS else 0
    histogram[min(at, BIN_COUNT - 1)] += 1
