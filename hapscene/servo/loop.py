"""The servo's loop, compiled and without the GIL: wait until the tick is due, read the aim, tick, publish."""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns, sleep_ns
from hapscene.constants import TINY
from hapscene.native import native
from hapscene.servo.lateness import count
from hapscene.twin.loop import beat, take_grip

FOLLOW_RAD_S: Final = 60.0
"""How fast the hand's target follows the aim, critically damped [rad/s]: a mouse moves in steps at 60 Hz, a hand does
not; 17 ms is half of what is noticed between seeing and feeling (45 ms, Adelstein et al. 2003)."""

LATE_MAX: Final = 20
"""How many ticks the loop may be behind before it gives them up [count]."""

EARLY_NS: Final = 50_000
"""How long before a tick is due the loop wakes, to look at the clock until it is [ns]: what a wake takes in 99 of 100
cases where nothing is in its way. Without, the tick is 10 to 20 µs late, and later than an empty loop, whose code is
still in the caches. Costs 5 % of a core."""


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
        due, start = await_tick(channel, clock, due + tick_ns, tick_ns)
        _read_aim(channel, aim, clock)
        _follow(body, aim, surface.touch[0].tick_s)
        slot = channel.done % len(rows)
        beat(world, surface, body, rows[slot], a_m_s2[slot], felt[slot], a_handle_m_s2[slot])
        count(channel.busy, now_ns(clock) - start)  # a call the compiler knows nothing of: what is above stays above
        channel.done += 1


@native
def await_tick(channel: Any, clock: NDArray[np.int64], due: int, tick_ns: int) -> tuple[int, int]:
    """Wait until a tick is due, and count how late that was; ticks that it is much too late for are left out.

    Returns when the tick was due, after those, and when it began [ns].
    """
    start = now_ns(clock)
    if start < due - EARLY_NS:
        sleep_ns(clock, due - EARLY_NS - start)
    while start < due:
        start = now_ns(clock)
    count(channel.late, start - due)
    if start - due > LATE_MAX * tick_ns:
        missed = (start - due) // tick_ns
        channel.missed += missed
        due += missed * tick_ns
    return due, start


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
