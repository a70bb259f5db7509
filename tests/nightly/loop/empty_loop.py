"""A real-time loop without a haptic tick, as a baseline: it measures the delays that the machine causes."""

import threading
import weakref

import numpy as np

from hapscene.clock import new_clock
from hapscene.compiled.native import native
from hapscene.constants import TICK_S
from hapscene.loop.driver import CHANNEL
from hapscene.loop.timing import (
    TIMING,
    Timer,
    TimingStatistics,
    request_realtime_priority,
    start_timer,
    wait_for_tick,
)
from hapscene.records import Records, records

__all__ = ["EmptyLoop", "loop_empty", "run_empty"]


class EmptyLoop:
    """Runs in a thread of this process, without the GIL, until it is stopped."""

    def __init__(self, tick_s: float = TICK_S) -> None:
        self._channel = records(1, CHANNEL)
        timer = Timer(self._channel[0], new_clock(), records(1, TIMING)[0], round(tick_s * 1e9))
        self._thread = threading.Thread(target=run_empty, args=(timer,), name="hapscene empty loop", daemon=True)
        self._thread.start()
        self._end = weakref.finalize(self, _end, self._channel, self._thread)

    def timing(self) -> TimingStatistics:
        """Return the timing statistics so far."""
        row = self._channel[0]
        return TimingStatistics(row.late.copy(), np.zeros_like(row.late), int(row.missed))

    def stop(self) -> None:
        """Stop the loop."""
        self._end()


def _end(channel: Records, thread: threading.Thread) -> None:
    channel.pause = 1
    thread.join()


def run_empty(timer: Timer) -> None:
    """Run the loop in its thread."""
    request_realtime_priority()
    start_timer(timer)
    loop_empty(timer)


@native
def loop_empty(timer: Timer) -> None:
    """Wait for ticks, without any work in them, until `channel.pause` is set."""
    while timer.channel.pause == 0:
        wait_for_tick(timer)
        timer.channel.done += 1
