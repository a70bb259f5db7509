"""A thousand ticks a second from a process that sleeps in between, and how late they were."""

import time
from collections import deque
from collections.abc import Collection
from typing import Final

import numpy as np

from hapscene.constants import TICK_S

BEHIND_MAX: Final = 50
"""Most ticks that are made up for at once [count]. A process that was held up for longer has lost the time for good:
its clock moves back."""

BASE_COUNT: Final = 250
"""Ticks of an empty loop by which the machine's own lateness is measured [count]."""

KEPT_COUNT: Final = 60_000
"""Ticks whose times are kept for the summary [count]: the last minute."""

_TICK_NS: Final = round(TICK_S * 1e9)


class Pace:
    """Due times of a 1 kHz loop; measures first how late an empty one is.

    Attributes:
        slipped: ticks that were lost because the process was held up [count].
    """

    def __init__(self) -> None:
        self.slipped = 0
        self._late_ns: deque[int] = deque(maxlen=KEPT_COUNT)
        self._work_ns: deque[int] = deque(maxlen=KEPT_COUNT)
        self._base_ns = self._sleep_idly()
        self._due_ns = self._woke_ns = 0

    def start(self) -> None:
        """The first tick is due a tick from now."""
        self._due_ns = self._woke_ns = time.perf_counter_ns()

    def await_tick(self) -> None:
        """Sleep until the next tick is due."""
        now_ns = time.perf_counter_ns()
        if self._late_ns:
            self._work_ns.append(now_ns - self._woke_ns)
        self._due_ns += _TICK_NS
        behind = (now_ns - self._due_ns) // _TICK_NS
        if behind > BEHIND_MAX:
            self.slipped += behind
            self._due_ns += behind * _TICK_NS
        self._woke_ns = _sleep_until(self._due_ns)
        self._late_ns.append(self._woke_ns - self._due_ns)

    def summary(self) -> dict[str, object]:
        """Lateness of the last minute and of an empty loop before it, and the time of a tick's work, in µs."""
        return {
            "late_us": _spread(self._late_ns),
            "late_of_empty_loop_us": _spread(self._base_ns),
            "work_us": _spread(self._work_ns),
            "slipped_ticks": self.slipped,
        }

    @staticmethod
    def _sleep_idly() -> list[int]:
        late_ns = []
        due_ns = time.perf_counter_ns()
        for _ in range(BASE_COUNT):
            due_ns += _TICK_NS
            late_ns.append(_sleep_until(due_ns) - due_ns)
        return late_ns


def _sleep_until(due_ns: int) -> int:
    """Sleep until a time of `perf_counter_ns`; return when it woke."""
    left_ns = due_ns - time.perf_counter_ns()
    if left_ns > 0:
        time.sleep(left_ns * 1e-9)
    return time.perf_counter_ns()


def _spread(time_ns: Collection[int]) -> dict[str, float]:
    """Median, p99, p99.9 and maximum [µs]."""
    if not time_ns:
        return {}
    points = np.percentile(list(time_ns), (50, 99, 99.9, 100)) / 1e3
    return {name: round(float(us), 1) for name, us in zip(("median", "p99", "p99_9", "max"), points, strict=True)}
