"""The servo's loop, compiled and without the GIL: wait until the tick is due, read the aim, tick, publish."""

import ctypes
import math
import os
import sys
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.bound_call import loaded
from hapscene.clock import now_ns, sleep_ns
from hapscene.compiled.entry import call_flags
from hapscene.constants import TINY
from hapscene.contact.prediction import predict_bodies
from hapscene.device.safety import STALL_S
from hapscene.native import INTERPRETED, native
from hapscene.servo.tick_memory import keep_memory
from hapscene.surface.surface_arrays import PLACE
from hapscene.twin.twin_loop import beat, take_grip

# How late ticks begin and how long they take: histograms, which the tick fills without allocating.


BIN_NS: Final = 100.0
"""Upper edge of the first bin [ns]: what the clock tells apart is less."""

BINS_PER_OCTAVE: Final = 8
"""Bins until a time has doubled [count]: each is 9 % wide, less than two runs differ by."""

BIN_COUNT: Final = 24 * BINS_PER_OCTAVE + 1
"""Bins of a histogram [count]: the last ends at 1.7 s, and holds what is longer."""


@native
def count_in_bin(histogram: Any, span_ns: int) -> None:
    """One more in the bin of this time."""
    at = 1 + int(BINS_PER_OCTAVE * math.log2(span_ns / BIN_NS)) if span_ns > BIN_NS else 0
    histogram[min(at, BIN_COUNT - 1)] += 1


def percentile_us(histogram: NDArray[np.int64], share: float) -> float:
    """Upper edge of the bin in which that share of the counts is reached [µs]; 0 without any."""
    total = int(histogram.sum())
    if total == 0:
        return 0.0
    at = int(np.searchsorted(np.cumsum(histogram), share * total))
    return float(BIN_NS * 2.0 ** (at / BINS_PER_OCTAVE) / 1e3)


class Lateness(NamedTuple):
    """How well a loop kept time.

    Attributes:
        late, busy: (BIN_COUNT,) how many ticks began so late, and took so long, by bins as `count_in_bin` has them.
        missed: ticks that were left out, since the loop was too late for them.
    """

    late: NDArray[np.int64]
    busy: NDArray[np.int64]
    missed: int

    def __repr__(self) -> str:
        return (
            f"<Lateness: {int(self.late.sum()):,} ticks, {self.missed} missed; late by {self.late_us():.3g} µs at the "
            f"median, {self.late_us(0.99):.3g} at p99>"
        )

    def since(self, earlier: "Lateness") -> "Lateness":
        """What came after an earlier look at the same loop."""
        return Lateness(self.late - earlier.late, self.busy - earlier.busy, self.missed - earlier.missed)

    def late_us(self, share: float = 0.5) -> float:
        """How late, at most, that share of the ticks began: to 9 % [µs]."""
        return percentile_us(self.late, share)

    def busy_us(self, share: float = 0.5) -> float:
        """How long, at most, that share of them took: to 9 % [µs]."""
        return percentile_us(self.busy, share)


FOLLOW_RAD_S: Final = 60.0
"""How fast the hand's target follows the aim, critically damped [rad/s]: a mouse moves in steps at 60 Hz, a hand does
not; 17 ms is half of what is noticed between seeing and feeling (45 ms, Adelstein et al. 2003)."""

LATE_MAX: Final = 20
"""How many ticks the loop may be behind before it gives them up [count]."""

EARLY_NS: Final = 50_000
"""How long before a tick is due the loop wakes, to look at the clock until it is [ns]: what a wake takes in 99 of 100
cases where nothing is in its way. Without, the tick is 10 to 20 µs late, and later than an empty loop, whose code is
still in the caches. Costs 5 % of a core."""


class ServoBodies(NamedTuple):
    """The scene's bodies as the application moves them. b bodies, t tools."""

    frames: Any  # (b,) FRAME
    predicted: Any  # (b,) PREDICTED
    moving: NDArray[np.int64]  # (b,) those that move, as many as the channel says
    given: NDArray[np.float64]  # (b, 6) what all tools have given them
    X_WB: NDArray[np.float64]  # (1, b, 4, 4) where they are
    teleported: NDArray[np.int64]  # (b,)
    jumps: NDArray[np.int64]  # (t, b) the same, until each tool has seen it


class Loop(NamedTuple):
    """All that a tick of t tools acts on."""

    worlds: Any  # (t,) `hapscene.contact.world.World`
    surfaces: Any  # (t,) `hapscene.surface.surface_arrays.Surface`
    twins: Any  # (t,) `hapscene.twin.twin_loop.TwinBody`
    bodies: ServoBodies
    channel: Any  # CHANNEL
    aims: Any  # (t,) AIM
    rows: Any  # (t, length) ROW
    felt: Any  # (t, length) FELT
    a_m_s2: NDArray[np.float64]  # (t, length, block) asked for
    a_handle_m_s2: NDArray[np.float64]  # (t, length, block) of the handle
    hands: NDArray[np.float64]  # (t, 5, 3) the aim of each, its target, its velocity, grip and push, as last read
    clock: NDArray[np.int64]  # of `new_clock`
    memory: Any  # what the ticks of all tools remember, a tuple of bytes
    checkpoints: Any  # (CHECKPOINT_COUNT, room) bytes
    checkpoint_ticks: NDArray[np.int64]  # (CHECKPOINT_COUNT,)
    timing: NDArray[np.int64]  # (4,) when the tick was due, and began [ns]; whether it was late, the loop stood still


@native
def serve(loop: Loop) -> None:
    """Tick in real time until `channel.pause`, all tools being simulated."""
    begin_timing(loop)
    while loop.channel.pause == 0:
        wait_for_tick(loop)
        serve_tick(loop)


@native
def begin_timing(loop: Loop) -> None:
    """From now on ticks are due."""
    loop.timing[0] = loop.timing[1] = now_ns(loop.clock)
    loop.timing[2] = loop.timing[3] = 0


@native
def wait_for_tick(loop: Loop) -> None:
    """Wait until the next tick is due."""
    channel, timing = loop.channel, loop.timing
    tick_ns = round(loop.surfaces[0].touch[0].tick_s * 1e9)
    missed = channel.missed
    timing[0], timing[1] = await_tick(channel, loop.clock, timing[0] + tick_ns, tick_ns)
    timing[2] = int(timing[1] - timing[0] > tick_ns)
    timing[3] = int(channel.missed > missed)


@native
def serve_scheduled(loop: Loop) -> None:
    """A tick that a vendor's thread calls: that keeps the time, and how late it is after the last one is noted."""
    channel, timing = loop.channel, loop.timing
    tick_ns = round(loop.surfaces[0].touch[0].tick_s * 1e9)
    start = now_ns(loop.clock)
    late = max(start - timing[1] - tick_ns, 0)
    timing[0] = timing[1] = start
    timing[2], timing[3] = 0, int(late > STALL_S * 1e9)
    channel.missed += late // tick_ns
    count_in_bin(channel.late, late)
    serve_tick(loop)


@native
def serve_tick(loop: Loop) -> None:
    """A tick of all tools, one after the other."""
    worlds, surfaces, twins, bodies, channel = loop.worlds, loop.surfaces, loop.twins, loop.bodies, loop.channel
    rows, a_m_s2, felt, a_handle_m_s2 = loop.rows, loop.a_m_s2, loop.felt, loop.a_handle_m_s2
    clock, timing, hands = loop.clock, loop.timing, loop.hands
    tick_s, count = surfaces[0].touch[0].tick_s, channel.moving_count
    keep_memory(channel, loop.memory, loop.checkpoints, loop.checkpoint_ticks, rows.shape[1])
    _predict(worlds, bodies, count, timing[1], clock, tick_s)
    slot = channel.done % rows.shape[1]
    for t in range(len(worlds)):
        safety = twins[t].safety[0]
        safety.pulse_now, safety.late, safety.stalled = channel.pulse, timing[2], timing[3]
        _read_aim(loop.aims[t], hands[t], clock)
        _follow(twins[t], hands[t], tick_s)
        entries, moving, X_WB, jumps = surfaces[t].entries, bodies.moving, bodies.X_WB, bodies.jumps[t]
        call_flags(entries[PLACE], (worlds[t], surfaces[t], moving, X_WB, jumps, count, 0))
        beat(worlds[t], surfaces[t], twins[t], rows[t, slot], a_m_s2[t, slot], felt[t, slot], a_handle_m_s2[t, slot])
    # the clock is a call the compiler knows nothing of: what is above stays above
    end = now_ns(clock)
    count_in_bin(channel.busy, end - timing[1])
    channel.done_ns = end
    channel.done += 1


# The same as `BoundCall` takes them: from where compiled code does not drive the loop.


def wait_at(address: Any, kind: Any) -> None:
    wait_for_tick(loaded(address, kind))


def tick_at(address: Any, kind: Any) -> None:
    serve_tick(loaded(address, kind))


def scheduled_at(address: Any, kind: Any) -> None:
    serve_scheduled(loaded(address, kind))


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
    count_in_bin(channel.late, start - due)
    if start - due > LATE_MAX * tick_ns:
        missed = (start - due) // tick_ns
        channel.missed += missed
        due += missed * tick_ns
    return due, start


@native
def _predict(worlds: Any, bodies: ServoBodies, count: int, now: int, clock: NDArray[np.int64], tick_s: float) -> None:
    """Where the bodies are by now that the application moves, pushed by all tools."""
    for m in range(count):
        index = bodies.moving[m]
        for i in range(6):
            total = 0.0
            for t in range(len(worlds)):
                total += worlds[t].impulse[index, i]
            bodies.given[index, i] = total
    frames, moving, X_WB, jump = bodies.frames, bodies.moving[:count], bodies.X_WB[:, :count], bodies.teleported[:count]
    predict_bodies(frames, bodies.predicted, moving, bodies.given, X_WB, jump, now, clock, tick_s)
    for m in range(count):
        for t in range(len(worlds)):
            bodies.jumps[t, m] |= jump[m]
        jump[m] = 0


@native
def _read_aim(told: Any, hand: NDArray[np.float64], clock: NDArray[np.int64]) -> None:
    """Take over the application's aim, unless it is being written."""
    count = told.count
    now_ns(clock)  # keeps the two looks at the count apart
    p, grip, push = told.aim[0], told.aim[1], told.aim[2]
    x, y, z = p[0], p[1], p[2]
    k, b, m = grip[0], grip[1], grip[2]
    u, v, w = push[0], push[1], push[2]
    now_ns(clock)
    if count % 2 == 1 or count != told.count:
        return
    hand[0, 0], hand[0, 1], hand[0, 2] = x, y, z
    hand[3, 0], hand[3, 1], hand[3, 2] = k, b, m
    hand[4, 0], hand[4, 1], hand[4, 2] = u, v, w


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


# Being woken on time, as far as the system lets a thread ask for it.


_PR_SET_TIMERSLACK: Final = 29

SLACK_NS: Final = 1
"""How much later than asked the system may wake the thread so as to wake others with it [ns]: 50,000 by default."""

PRIORITY: Final = 1
"""Least of the real-time priorities [1]: before all that is not real-time, behind sound and interrupts."""


def request_realtime_priority() -> bool:
    """Have the calling thread woken promptly; whether it then runs before all that is not real-time.

    Real-time priority is given to root, to who has CAP_SYS_NICE, and where `ulimit -r` is not 0; without it the thread
    waits for its turn among the others. On Linux only: elsewhere nothing is changed.
    """
    if sys.platform != "linux":
        return False
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(SLACK_NS))
    if INTERPRETED:  # holds Python's lock and never sleeps: nothing may have to wait for that
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    return True
