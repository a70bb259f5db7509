"""What `hapscene play` prints about a servo."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene.flags import Flag
from hapscene.loop import TimingStatistics
from hapscene.loop.timing import BIN_COUNT
from hapscene.play import monitor as play_monitor
from hapscene.play.monitor import Monitor, deadline_misses

ROW = [("f_W_N", "f8", (3,)), ("flags", "i8")]


def timing(counts: dict[int, int], missed: int = 0) -> TimingStatistics:
    """Delays by bin; bin k ends at 100 ns · 2^(k/8)."""
    delay = np.zeros(BIN_COUNT, np.int64)
    delay[list(counts)] = list(counts.values())
    return TimingStatistics(delay, np.zeros_like(delay), missed)


class FakeServo:
    """A servo that has run four ticks, and whose handle is disconnected."""

    body_names, notice, tick_s = ("cup",), "calibrate the device", 1e-3

    def __init__(self) -> None:
        self.asked, self.late, self.first, self.read_from = 0, timing({}), 1, list[int]()
        self.rows = np.zeros(4, ROW).view(np.recarray)
        self.rows.f_W_N[:2] = (0.0, 3.0, 4.0), (0.0, 0.0, 12.0)
        self.rows["flags"][:2] = Flag.HEAT_LIMITED, Flag.PEAK_LIMITED

    def state(self) -> Any:
        return SimpleNamespace(tick=self.first - 1, f_W_N=(0.0, 3.0, 4.0), touching=True, body=0)

    def timing(self) -> TimingStatistics:
        return self.late

    def read(self, since: int) -> Any:
        self.read_from.append(since)
        return SimpleNamespace(first=self.first, rows=self.rows)

    def handle_report(self) -> dict[str, float]:
        self.asked += 1
        raise HandleError("dualsense: was it unplugged?" if self.asked == 1 else "has ended")


def test_lines_of_a_monitor(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter((10.0, 12.0, 12.0))
    monkeypatch.setattr(play_monitor, "time", SimpleNamespace(monotonic=lambda: next(times)))
    servo: Any = FakeServo()
    monitor = Monitor(servo)
    servo.late = timing({0: 97, 8: 1, 27: 1, 28: 1, 108: 1}, 3)
    problems = ["calibrate the device", "handle stopped: dualsense: was it unplugged?"]
    assert monitor.lines() == [
        "    2 ticks/s    5.00 N, max 12.00 N   touching cup",
        "force limited to the peak force",
        "force reduced: motors are warm",
        *problems,
    ]
    servo.rows, servo.first = servo.rows[:1], 5
    servo.rows["flags"] = 0
    servo.state = lambda: SimpleNamespace(tick=5, f_W_N=(0.0, 0.0, 0.0), touching=False, body=-1)
    assert monitor.lines() == [
        "1000000000 ticks/s    0.00 N, max 5.00 N   no contact",
        *problems,
    ]
    assert servo.read_from == [1, 5] and servo.asked == 1
    count, misses, latency = monitor.summary()
    assert count == "101 ticks, 3 missed" and misses.endswith(": 4") and "p99 1.13 µs" in latency
    assert deadline_misses(timing({107: 7, 108: 1}, 2), 1e-3) == 3  # bin 107 ends at 1.06 ms
