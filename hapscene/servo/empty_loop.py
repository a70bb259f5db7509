"""A loop like the servo's with nothing in it: what of the lateness is the machine's, and not the tick's."""

import threading
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import new_clock, now_ns
from hapscene.constants import TICK_S
from hapscene.native import native
from hapscene.records import records
from hapscene.servo.servo_loop import Lateness, await_tick, request_realtime_priority
from hapscene.servo.shared_memory import CHANNEL


class EmptyLoop:
    """Runs in a thread of this process, without the GIL, until it is stopped."""

    def __init__(self, tick_s: float = TICK_S) -> None:
        self._channel = records(1, CHANNEL)
        arguments = self._channel[0], new_clock(), round(tick_s * 1e9)
        self._thread = threading.Thread(target=_run, args=arguments, name="hapscene empty loop", daemon=True)
        self._thread.start()
        self._end = weakref.finalize(self, _end, self._channel, self._thread)

    def lateness(self) -> Lateness:
        """How well it has kept time."""
        row = self._channel[0]
        return Lateness(row.late.copy(), np.zeros_like(row.late), int(row.missed))

    def stop(self) -> None:
        """End it."""
        self._end()


def _end(channel: Any, thread: threading.Thread) -> None:
    channel.pause = 1
    thread.join()


def _run(*arguments: Any) -> None:
    request_realtime_priority()
    loop_empty(*arguments)


@native
def loop_empty(channel: Any, clock: NDArray[np.int64], tick_ns: int) -> None:
    """Wait for ticks until `channel.pause`, and do nothing in them."""
    due = now_ns(clock)
    while channel.pause == 0:
        due, _ = await_tick(channel, clock, due + tick_ns, tick_ns)
        channel.done += 1
