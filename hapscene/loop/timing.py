"""Timing of a real-time loop: waits for the next tick, counts delays, and requests real-time priority."""

import ctypes
import math
import os
import sys
from contextlib import suppress
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns, sleep_ns
from hapscene.compiled.native import INTERPRETED, native
from hapscene.records import Record

__all__ = [
    "BIN_COUNT",
    "PRIORITY",
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
"""Upper edge of the first bin [ns]: below the resolution of the clock."""

BINS_PER_OCTAVE: Final = 8
"""Bins per doubling of the time [count]: each is 9 % wide, less than the difference between two runs."""

BIN_COUNT: Final = 24 * BINS_PER_OCTAVE + 1
"""Number of bins of a histogram [count]: the last ends at 1.7 s and also holds longer times."""


@native
def count_in_bin(histogram: NDArray[np.int64], span_ns: int) -> None:
    """Count a time in its bin."""
    at = 1 + int(BINS_PER_OCTAVE * math.log2(span_ns / BIN_NS)) if span_ns > BIN_NS else 0
    histogram[min(at, BIN_COUNT - 1)] += 1


def percentile_us(histogram: NDArray[np.int64], share: float) -> float:
    """Return the upper edge of the bin in which a share of the counts is reached [µs]; 0 for an empty histogram."""
    total = int(histogram.sum())
    if total == 0:
        return 0.0
    at = int(np.searchsorted(np.cumsum(histogram), share * total))
    return float(BIN_NS * 2.0 ** (at / BINS_PER_OCTAVE) / 1e3)


class TimingStatistics(NamedTuple):
    """Timing statistics of a loop.

    Attributes:
        delay, busy: (BIN_COUNT,) histograms of the delay and the duration of ticks, see `count_in_bin`.
        missed: deadline misses: ticks that were skipped because the loop was too late.
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
        """Return the statistics since an earlier reading of the same loop."""
        return TimingStatistics(self.delay - earlier.delay, self.busy - earlier.busy, self.missed - earlier.missed)

    def delay_us(self, share: float = 0.5) -> float:
        """Return the delay that a share of the ticks did not exceed, to within 9 % [µs]."""
        return percentile_us(self.delay, share)

    def busy_us(self, share: float = 0.5) -> float:
        """Return the duration that a share of the ticks did not exceed, to within 9 % [µs]."""
        return percentile_us(self.busy, share)


LATE_MAX: Final = 20
"""Number of ticks that the loop may be behind before it skips them [count]."""

EARLY_NS: Final = 50_000
"""Time before a tick is due at which the loop wakes up and polls the clock [ns]. It covers 99 of 100 wake-ups on an
idle machine. Without it ticks begin 10 to 20 µs late, and later than those of an empty loop, whose code is still in the
caches. It costs 5 % of a core."""

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
    """What a loop needs to wait for its ticks."""

    channel: Record  # CHANNEL: histogram of delays, count of skipped ticks
    clock: NDArray[np.int64]  # of `new_clock`
    timing: Record  # TIMING
    tick_ns: int


def start_timer(timer: Timer) -> None:
    """Make the first tick due one period from now."""
    timer.timing.due_ns = timer.timing.began_ns = now_ns(timer.clock)
    timer.timing.elapsed_ns = timer.timing.late = timer.timing.stalled = 0


@native
def wait_for_tick(timer: Timer) -> None:
    """Wait until the next tick is due and count its delay; skip ticks if the loop is more than `LATE_MAX` behind."""
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
"""Timer slack of the thread [ns]: how much later the system may wake it up; 50,000 by default."""

PRIORITY: Final = 1
"""Lowest real-time priority [1]: above all normal threads, below audio and interrupts."""


def request_realtime_priority(priority: int = PRIORITY) -> bool:
    """Request prompt wake-ups and real-time priority for this thread; return whether it has real-time priority.

    It gets a lower one if `priority` is not permitted. Real-time priority needs root, CAP_SYS_NICE, or a non-zero
    `ulimit -r`. Without it the thread competes with all others. Only on Linux; other systems are not changed.
    """
    if sys.platform != "linux":
        return False
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(SLACK_NS))
    if INTERPRETED:  # interpreted code holds the GIL and never sleeps, and would block every other thread
        return False
    for permitted in range(priority, 0, -1):
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(permitted))
            return True
    return False
