"""A clock whose time passes as a test says, for compiled code and for Python."""

import threading
from collections.abc import Callable
from typing import Any

from hapscene.clock import VIRTUAL, new_clock
from hapscene.wall_clock import Clock

BEGIN_NS = 1_000_000_000_000

PATIENCE_S = 180.0
"""How long another thread may take on a machine that does much else besides [s]."""


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


class StillClock(Clock):
    """Stands still until a test puts it on, so that nobody who is slow counts as silent. Who sleeps does so really.

    Attributes:
        at_s: what it shows.
        runs: whether a sleep puts it on.
    """

    at_s, runs = BEGIN_NS * 1e-9, False

    def now_s(self) -> float:
        return self.at_s

    def sleep_s(self, span_s: float) -> None:
        super().sleep_s(span_s)
        self.at_s += span_s if self.runs else 0.0


class DrivenClock(Clock):
    """A clock that one thread moves on, as the one of a simulated wire; the others wait for it, however slow it is."""

    def __init__(self) -> None:
        self._now_s, self._moved = BEGIN_NS * 1e-9, threading.Condition()

    def now_s(self) -> float:
        return self._now_s

    def move(self, span_s: float) -> None:
        """Let time pass."""
        with self._moved:
            self._now_s += span_s
            self._moved.notify_all()

    def until(self, true: Callable[[], Any]) -> None:
        """Wait until something is true; it is looked at each time that the clock is moved on."""
        with self._moved:
            assert self._moved.wait_for(true, PATIENCE_S), "it does not come true"

    def sleep_s(self, span_s: float) -> None:
        end_s = self._now_s + span_s
        self.until(lambda: self._now_s >= end_s)
