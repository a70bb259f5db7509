"""A clock whose time passes as a test says, for compiled code and for Python."""

import threading

from hapscene.clock import VIRTUAL, new_clock
from hapscene.wall_clock import Clock

BEGIN_NS = 1_000_000_000_000


class VirtualClock(Clock):
    """Begins at 1000 s. Who sleeps, or waits for an event in vain, moves it on.

    Attributes:
        buffer: the same time for compiled code, as `hapscene.clock.new_clock` has it.
    """

    def __init__(self) -> None:
        self.buffer = new_clock(BEGIN_NS)

    def now_ns(self) -> int:
        return int(self.buffer[VIRTUAL])

    def now_s(self) -> float:
        return self.now_ns() * 1e-9

    def sleep_s(self, span_s: float) -> None:
        self.buffer[VIRTUAL] += max(round(span_s * 1e9), 0)

    def wait(self, event: threading.Event, timeout_s: float) -> bool:
        if not event.is_set():
            self.sleep_s(timeout_s)
        return event.is_set()
