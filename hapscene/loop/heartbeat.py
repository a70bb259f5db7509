"""The application's pulse, by which the servo knows that it lives: a thread without the GIL, so a busy one has it too.

It stops when the application does: killed, stopped, suspended with the machine. Where the application says how long it
may be silent, it stops also when for so long nothing was asked of the servo: a program that hangs.
"""

import threading
import weakref
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import new_clock, now_ns, sleep_ns
from hapscene.compiled.native import native
from hapscene.loop.timing import request_realtime_priority

__all__ = ["PULSE_NS", "Heartbeat"]

PULSE_NS: Final = 2_000_000
"""Time between two pulses [ns]: five are missed before the force ends (`hapscene.device.safety.HEARTBEAT_AGE_S`)."""


class Heartbeat:
    """A thread that counts `pulse` (1,) up.

    Attributes:
        asked: (1,) to be counted up with whatever is asked of the servo.
    """

    def __init__(self, pulse: NDArray[np.int64], patience_s: float) -> None:
        """`patience_s`: after how long without a question the pulse stops; infinite: never."""
        self.asked = np.zeros(1, np.int64)
        self._stop = np.zeros(1, np.int64)
        patience_ns = int(min(patience_s, 1e9) * 1e9)
        arguments = pulse, self.asked, self._stop, new_clock(), patience_ns
        self._thread = threading.Thread(target=_run, args=arguments, name="hapscene pulse", daemon=True)
        self._thread.start()
        # the memory must not go before the thread: at the end of the program, too
        self._end = weakref.finalize(self, _end, self._stop, self._thread)

    def stop(self) -> None:
        """Beat no more."""
        self._end()


def _end(stop: NDArray[np.int64], thread: threading.Thread) -> None:
    stop[0] = 1
    thread.join()


def _run(*arguments: Any) -> None:
    request_realtime_priority()
    _beat(*arguments)


@native
def _beat(
    pulse: NDArray[np.int64],
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
            pulse[0] += 1
        sleep_ns(clock, PULSE_NS)
