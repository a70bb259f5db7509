"""Heartbeat of the application, by which the servo detects that it runs. The thread needs no GIL.

The heartbeat ends with the application: when it is killed, stopped, or suspended with the machine. With `patience_s` it
also ends when the application has not called the servo for that time, which detects a program that hangs.
"""

import threading
import weakref
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import new_clock, now_ns, sleep_ns
from hapscene.compiled.native import native
from hapscene.loop.timing import request_realtime_priority

__all__ = ["HEARTBEAT_NS", "Heartbeat"]

HEARTBEAT_NS: Final = 2_000_000
"""Time between two heartbeats [ns]. The force ends after five missed ones (`device.safety.HEARTBEAT_AGE_S`)."""


class Heartbeat:
    """A thread that increments a counter.

    Attributes:
        asked: (1,) counter of calls of the application, which the servo increments.
    """

    def __init__(self, counter: NDArray[np.int64], patience_s: float) -> None:
        """Increment `counter` (1,) from now on.

        It stops when the application makes no call for `patience_s`, which may be infinite.
        """
        self.asked = np.zeros(1, np.int64)
        self._stop = np.zeros(1, np.int64)
        beat = partial(_beat, counter, self.asked, self._stop, new_clock(), int(min(patience_s, 1e9) * 1e9))
        self._thread = threading.Thread(target=_run, args=(beat,), name="hapscene heartbeat", daemon=True)
        self._thread.start()
        # the thread must end before its memory is released, also at the exit of the program
        self._end = weakref.finalize(self, _end, self._stop, self._thread)

    def stop(self) -> None:
        """Stop the heartbeat."""
        self._end()


def _end(stop: NDArray[np.int64], thread: threading.Thread) -> None:
    stop[0] = 1
    thread.join()


def _run(beat: Callable[[], None]) -> None:
    request_realtime_priority()
    beat()


@native
def _beat(
    counter: NDArray[np.int64],
    asked: NDArray[np.int64],
    stop: NDArray[np.int64],
    clock: NDArray[np.int64],
    patience_ns: int,
) -> None:
    last, since = asked[0], now_ns(clock)
    while stop[0] == 0:
        now = now_ns(clock)
        if asked[0] != last:
            last, since = asked[0], now
        if now - since <= patience_ns:
            counter[0] += 1
        sleep_ns(clock, HEARTBEAT_NS)
