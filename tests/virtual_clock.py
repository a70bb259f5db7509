"""Clocks that tests control, for compiled code and for Python."""

import threading
from collections.abc import Callable
from typing import Any

from hapscene.clock import VIRTUAL, new_clock
from hapscene.wall_clock import Clock

BEGIN_NS = 1_000_000_000_000

PATIENCE_S = 180.0
"""Longest wait for another thread on a busy machine [s]."""


class VirtualClock(Clock):
    """Clock that starts at 1000 s; each sleep, and each wait that times out, advances it without waiting.

    Attributes:
        buffer: the same time for compiled code; see `hapscene.clock.new_clock`.
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
    """Clock that only a test advances, so that a slow thread causes no timeout. `sleep_s` also waits in real time.

    Attributes:
        at_s: present time of the clock [s].
        runs: whether `sleep_s` advances the clock.
    """

    at_s, runs = BEGIN_NS * 1e-9, False

    def now_s(self) -> float:
        return self.at_s

    def sleep_s(self, span_s: float) -> None:
        super().sleep_s(span_s)
        self.at_s += span_s if self.runs else 0.0


class DrivenClock(Clock):
    """Clock that one thread advances, such as a simulated network; the other threads wait for it."""

    def __init__(self) -> None:
        self._now_s, self._moved = BEGIN_NS * 1e-9, threading.Condition()

    def now_s(self) -> float:
        return self._now_s

    def move(self, span_s: float) -> None:
        """Advance the clock and wake the waiting threads."""
        with self._moved:
            self._now_s += span_s
            self._moved.notify_all()

    def until(self, true: Callable[[], Any]) -> None:
        """Wait until a condition holds; it is checked each time the clock advances."""
        with self._moved:
            assert self._moved.wait_for(true, PATIENCE_S), f"the condition did not hold within {PATIENCE_S:g} s"

    def sleep_s(self, span_s: float) -> None:
        end_s = self._now_s + span_s
        self.until(lambda: self._now_s >= end_s)
