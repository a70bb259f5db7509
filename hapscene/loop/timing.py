"""When a tick of a real-time loop begins, how late it was, and the priority of its thread."""

import ctypes
import math
import os
import sys
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns, sleep_ns
from hapscene.compiled.native import INTERPRETED, native

__all__ = [
    "BIN_COUNT",
    "TIMING",
    "Timer",
    "TimingStatistics",
    "count_in_bin",
    "percentile_us",
    "request_realtime_priority",
    "start_timer",
    "wait_for_tick",
]

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


class TimingStatistics(NamedTuple):
    """How well a loop kept time.

    Attributes:
        delay, busy: (BIN_COUNT,) histograms of how late ticks began and how long they took, as `count_in_bin` fills
            them.
        missed: deadline misses: ticks that were left out since the loop was too late for them.
    """

    delay: NDArray[np.int64]
    busy: NDArray[np.int64]
    missed: int

    def __repr__(self) -> str:
        return (
            f"<TimingStatistics: {int(self.delay.sum()):,} ticks, {self.missed} missed; delay {self.delay_us():.3g} µs "
            f"at the median, {self.delay_us(0.99):.3g} at p99>"
        )

    def since(self, earlier: "TimingStatistics") -> "TimingStatistics":
        """The part after an earlier reading of the same loop."""
        return TimingStatistics(self.delay - earlier.delay, self.busy - earlier.busy, self.missed - earlier.missed)

    def delay_us(self, share: float = 0.5) -> float:
        """Delay that this share of the ticks did not exceed, to 9 % [µs]."""
        return percentile_us(self.delay, share)

    def busy_us(self, share: float = 0.5) -> float:
        """Duration that this share of the ticks did not exceed, to 9 % [µs]."""
        return percentile_us(self.busy, share)


LATE_MAX: Final = 20
"""How many ticks the loop may be behind before it leaves them out [count]."""

EARLY_NS: Final = 50_000
"""How long before a tick is due the loop wakes, to poll the clock until then [ns]: what a wake takes in 99 of 100
cases where nothing is in its way. Without, the tick is 10 to 20 µs late, and later than an empty loop, whose code is
still in the caches. Costs 5 % of a core."""

TIMING: Final = np.dtype(
    [
        ("due_ns", "i8"),  # time at which the tick was due
        ("began_ns", "i8"),  # time at which it began
        ("elapsed_ns", "i8"),  # time since the tick before it began
        ("late", "i8"),  # 1: it began more than one period after it was due
        ("stalled", "i8"),  # 1: ticks before it were skipped
    ],
    align=True,
)
"""Timing of the current tick."""


class Timer(NamedTuple):
    """What a loop waits by."""

    channel: Any  # CHANNEL: counts of delays and of ticks that were left out
    clock: NDArray[np.int64]  # of `new_clock`
    timing: Any  # TIMING
    tick_ns: int


def start_timer(timer: Timer) -> None:
    """The first tick is due one tick from now."""
    timer.timing.due_ns = timer.timing.began_ns = now_ns(timer.clock)
    timer.timing.elapsed_ns = timer.timing.late = timer.timing.stalled = 0


@native
def wait_for_tick(timer: Timer) -> None:
    """Wait until the next tick is due, and count its delay; ticks that it is much too late for are left out."""
    channel, clock, timing, tick_ns = timer.channel, timer.clock, timer.timing, timer.tick_ns
    due = timing.due_ns + tick_ns
    start = now_ns(clock)
    if start < due - EARLY_NS:
        sleep_ns(clock, due - EARLY_NS - start)
    while start < due:
        start = now_ns(clock)
    count_in_bin(channel.late, start - due)
    timing.stalled = 0
    if start - due > LATE_MAX * tick_ns:
        missed = (start - due) // tick_ns
        channel.missed += missed
        due += missed * tick_ns
        timing.stalled = 1
    timing.elapsed_ns = start - timing.began_ns
    timing.due_ns, timing.began_ns = due, start
    timing.late = int(start - due > tick_ns)


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
