"""Clock for waiting and time limits outside the haptic tick, which tests can replace."""

import threading
import time
from typing import Final

__all__ = ["CLOCK", "Clock"]


class Clock:
    """The monotonic clock of the system. Tests derive a virtual clock."""

    def now_s(self) -> float:
        """Time since any fixed moment [s]."""
        return time.monotonic()

    def sleep_s(self, span_s: float) -> None:
        """Sleep for a time span [s]."""
        time.sleep(span_s)

    def wait(self, event: threading.Event, timeout_s: float) -> bool:
        """Wait for an event, up to a time limit [s]; returns whether it is set."""
        return event.wait(timeout_s)


CLOCK: Final = Clock()
"""The clock of the system."""
