"""The clock of the system."""

from threading import Event

import pytest

from hapscene.wall_clock import CLOCK


def test_waiting_returns_whether_the_event_is_set() -> None:
    event, start_s = Event(), CLOCK.now_s()
    assert not CLOCK.wait(event, 0.0)
    event.set()
    assert CLOCK.wait(event, 60.0) and CLOCK.now_s() >= start_s


def test_it_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr("time.sleep", slept.append)
    CLOCK.sleep_s(0.25)
    assert slept == [0.25]
