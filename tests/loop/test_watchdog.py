"""What ends the force when the servo or the application is gone: the watchdog and the heartbeat, at a virtual time."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.device.driver import Driver
from hapscene.device.driver_registry import DeviceChoice
from hapscene.loop import heartbeat, watchdog
from hapscene.loop.heartbeat import HEARTBEAT_NS
from hapscene.loop.watchdog import BUSY_S, LOOK_S, RELEASE_S, STILL_S, WAITING_S, release, until_needed
from tests.virtual_clock import VirtualClock

TICK_S = 1e-3


class Life:
    """The servo's end of the line: `lives` is asked with the time that has passed, and says how many ticks are done.

    A text is what the servo sends at its end; an error ends the line.
    """

    def __init__(self, clock: VirtualClock, row: Any, lives: Callable[[float], Any]) -> None:
        self.clock, self.row, self.lives, self.begin_s = clock, row, lives, clock.now_s()

    def poll(self, timeout_s: float) -> bool:
        self.clock.sleep_s(timeout_s)
        self.said = self.lives(self.age_s)
        if isinstance(self.said, str | type):
            return True
        self.row.done = self.said
        return False

    def recv(self) -> Any:
        if isinstance(self.said, type):
            raise self.said
        return self.said

    @property
    def age_s(self) -> float:
        return self.clock.now_s() - self.begin_s


def watch(lives: Callable[[float], Any], **row: int) -> tuple[bool, float]:
    """What the watchdog finds of a servo, and after how long [s]."""
    clock, shared = VirtualClock(), SimpleNamespace(**({"done": 0, "pause": 0, "waiting": 0} | row))
    life = Life(clock, shared, lives)
    closed = until_needed(life, SimpleNamespace(channel=[shared]), 1, clock)  # type: ignore[arg-type]
    return closed, life.age_s


def stands_after(moment_s: float) -> Callable[[float], int]:
    return lambda age_s: round(min(age_s, moment_s) / TICK_S)


@pytest.mark.parametrize(("waiting", "patience_s"), [(0, BUSY_S), (1, WAITING_S)])
def test_a_servo_that_stands_still_is_noticed(waiting: int, patience_s: float) -> None:
    closed, after_s = watch(stands_after(1.0), waiting=waiting)
    assert not closed and patience_s < after_s - 1.0 <= patience_s + 2.5 * LOOK_S


def test_one_that_was_stopped_by_a_signal_is_noticed_sooner(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "_is_stopped", lambda pid: True)
    closed, after_s = watch(stands_after(1.0))
    assert not closed and STILL_S < after_s - 1.0 <= STILL_S + 2.5 * LOOK_S


def test_one_that_closes_its_devices_says_so() -> None:
    assert watch(lambda age_s: "closed" if age_s > 3.0 else round(age_s / TICK_S))[0]


def test_one_that_dies_does_not() -> None:
    assert not watch(lambda age_s: EOFError if age_s > 3.0 else round(age_s / TICK_S))[0]


def test_one_that_rests_may_stand_as_long_as_it_likes() -> None:
    closed, after_s = watch(lambda age_s: "closed" if age_s > 60.0 else 0, pause=1)
    assert closed and after_s > 60.0


def test_a_watchdog_that_itself_had_no_time_has_seen_nothing() -> None:
    """It is stopped with the servo for a minute: of that it counts two looks."""
    clock, row = VirtualClock(), SimpleNamespace(done=0, pause=0, waiting=0)

    def lives(age_s: float) -> int | str:
        if 1.0 < age_s < 2.0:
            clock.sleep_s(60.0)
        return "closed" if age_s > 65.0 else round(min(age_s, 1.0) / TICK_S) + round(max(age_s - 61.0, 0.0) / TICK_S)

    life = Life(clock, row, lives)
    assert until_needed(life, SimpleNamespace(channel=[row]), 1, clock)  # type: ignore[arg-type]


@pytest.mark.parametrize(("free_s", "released"), [(0.5, True), (2.0 * RELEASE_S, False)])
def test_a_device_that_is_still_held_is_tried_again(free_s: float, released: bool) -> None:
    clock, begin_s, zeros = VirtualClock(), VirtualClock().now_s(), []

    def write_zero() -> None:
        if clock.now_s() - begin_s < free_s:
            raise OSError("busy")
        zeros.append(clock.now_s())

    release(Driver("held", "a device", force=False, release=write_zero), DeviceChoice("held"), clock)
    assert bool(zeros) == released and clock.now_s() - begin_s <= min(free_s, RELEASE_S) + 0.01


@pytest.mark.parametrize(("patience_ns", "beats"), [(10**18, 200), (50 * HEARTBEAT_NS, 50)])
def test_the_heartbeat_stops_where_nothing_is_asked_for_too_long(patience_ns: int, beats: int) -> None:
    class Stop:
        looks = 0

        def __getitem__(self, index: int) -> int:
            self.looks += 1
            return int(self.looks > 200)

    pulse, asked = np.zeros(1, np.int64), np.zeros(1, np.int64)
    beat = getattr(heartbeat._beat, "py_func", heartbeat._beat)
    beat(pulse, asked, Stop(), VirtualClock().buffer, patience_ns)
    assert pulse[0] == pytest.approx(beats, abs=1)
