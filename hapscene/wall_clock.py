"""The time outside the tick: what waits, times out or measures an age takes a `Clock`, which a test can replace."""

import threading
import time
from typing import Final

__all__ = ["CLOCK", "Clock"]


class Clock:
    """The system's monotonic clock. A test derives a virtual one, whose time only passes as the test says."""

    def now_s(self) -> float:
        """Time since any fixed moment [s]."""
        return time.monotonic()

    def sleep_s(self, span_s: float) -> None:
        """Return after so long [s]."""
        time.sleep(span_s)

    def wait(self, event: threading.Event, timeout_s: float) -> bool:
        """Wait for an event, for so long at most [s]; return whether it is set."""
        return event.wait(timeout_s)


CLOCK: Final = Clock()
"""The system's."""
