"""The watchdog and the heartbeat, which end the force when the servo or the application ends; on a virtual clock."""

import os
import signal
import threading
from collections.abc import Callable
from multiprocessing import Pipe
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.device.driver import Driver
from hapscene.device.driver_registry import DeviceChoice
from hapscene.loop import heartbeat, watchdog
from hapscene.loop.driver import BLOCKING, ENDED
from hapscene.loop.heartbeat import HEARTBEAT_NS
from hapscene.loop.timing import PRIORITY
from hapscene.loop.watchdog import BUSY_S, LOOK_S, RELEASE_S, STILL_S, WAITING_S, release, release_all, until_needed
from tests.virtual_clock import VirtualClock

TICK_S = 1e-3


class Life:
    """Connection to a servo. `lives` maps the elapsed time to the number of complete ticks.

    If it returns a text, that is the last message of the servo; an exception class closes the connection, as on Linux
    (EOFError) or as on Windows (BrokenPipeError).
    """

    def __init__(self, clock: VirtualClock, row: Any, lives: Callable[[float], Any]) -> None:
        self.clock, self.row, self.lives, self.begin_s = clock, row, lives, clock.now_s()

    def poll(self, timeout_s: float) -> bool:
        self.clock.sleep_s(timeout_s)
        self.said = self.lives(self.age_s)
        if self.said is BrokenPipeError:
            raise BrokenPipeError
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


def watch(
    lives: Callable[[float], Any], send_zeros: Callable[[float], object] | None = None, **row: int
) -> tuple[bool, float]:
    """Return the result of the watchdog, and the time until it [s]; `send_zeros` is called with the time."""
    clock, shared = VirtualClock(), SimpleNamespace(**({"done": 0, "waiting": 0} | row))
    life = Life(clock, shared, lives)
    zeros = None if send_zeros is None else lambda: send_zeros(life.age_s)
    closed = until_needed(life, SimpleNamespace(channel=[shared]), 1, zeros, clock)  # type: ignore[arg-type]
    return closed, life.age_s


def stands_after(moment_s: float) -> Callable[[float], int]:
    return lambda age_s: round(min(age_s, moment_s) / TICK_S)


@pytest.mark.parametrize(("waiting", "patience_s"), [(0, BUSY_S), (BLOCKING, WAITING_S)])
def test_stopped_ticks_are_detected(waiting: int, patience_s: float) -> None:
    closed, after_s = watch(stands_after(1.0), waiting=waiting)
    assert not closed and patience_s < after_s - 1.0 <= patience_s + 2.5 * LOOK_S


def test_force_of_a_starved_servo_is_removed_and_the_servo_goes_on() -> None:
    """It does not tick for 0.8 s, twice, then for ever."""
    times_s: list[float] = []

    def lives(age_s: float) -> int:
        return 0 if age_s % 2.0 < 0.8 or age_s > 4.0 else round(age_s / TICK_S)

    closed, after_s = watch(lives, times_s.append)
    assert not closed and after_s == pytest.approx(4.0 + WAITING_S, abs=3.0 * LOOK_S)
    assert times_s == pytest.approx([start_s + BUSY_S for start_s in (0.0, 2.0, 4.0)], abs=3.0 * LOOK_S)


@pytest.mark.parametrize(("state", "patience_s"), [("stopped", STILL_S), ("ending", 0.0)])
def test_stopped_or_ending_process_is_detected_sooner(
    state: str, patience_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "state_of", lambda pid: state)
    closed, after_s = watch(stands_after(1.0))
    assert not closed and patience_s < after_s - 1.0 <= patience_s + 2.5 * LOOK_S


NO_SIGNAL, SIGTERM_PENDING, OTHER_FLAGS = 0, 0x4000, 0x400140


@pytest.mark.parametrize(
    ("state", "flags", "pending", "found"),
    [
        *((state, OTHER_FLAGS, SIGTERM_PENDING, "running") for state in "RSD"),
        *((state, OTHER_FLAGS, NO_SIGNAL, "stopped") for state in "Tt"),
        *((state, OTHER_FLAGS, NO_SIGNAL, "ending") for state in "ZXx"),
        *(("S", OTHER_FLAGS | flag, NO_SIGNAL, "ending") for flag in (0x4, 0x200, 0x400)),
        *(("R", OTHER_FLAGS, 1 << number - 1, "ending") for number in (6, 7, 9, 11, 19)),
    ],
)
def test_state_of_a_process(
    state: str, flags: int, pending: int, found: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGABRT, SIGBUS, SIGKILL, SIGSEGV and SIGSTOP by their numbers on Linux; a name may contain brackets."""
    monkeypatch.setattr(watchdog, "Path", lambda place: tmp_path / place.lstrip("/"))
    place, ended = tmp_path / "proc/7", 0x604
    assert watchdog.state_of(7) == "running"  # no Linux
    place.mkdir(parents=True)
    (tmp_path / "proc/self").mkdir()
    (tmp_path / "proc/self/stat").touch()
    assert watchdog.state_of(7) == "ending"  # it is gone
    (place / "stat").write_text(f"7 (a) Z) {state} {ended} {ended} {ended} {ended} {ended} {flags} {ended} {ended}")
    for signals in ((pending, 0), (0, pending)):
        text = "Name:\ta\nSigPnd:\t{:016x}\nShdPnd:\t{:016x}\nSigBlk:\tffffffffffffffff\n".format(*signals)
        (place / "status").write_text(text)
        assert watchdog.state_of(7) == found
    (place / "status").write_text("")
    assert watchdog.state_of(7) == "running"  # not reported


def test_all_threads_of_a_process_are_hastened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []
    monkeypatch.setattr(watchdog, "Path", lambda place: tmp_path / place.lstrip("/"))
    for name, value in (("getscheduler", "policy"), ("getparam", "priority")):
        monkeypatch.setattr(os, f"sched_{name}", lambda pid, value=value: (value, pid), raising=False)
    monkeypatch.setattr(os, "sched_setscheduler", lambda *values: given.append(values), raising=False)
    watchdog._hasten(7)  # it has ended
    for number in ("7", "12"):
        (tmp_path / "proc/7/task" / number).mkdir(parents=True)
    watchdog._hasten(7)
    assert sorted(given) == [(number, ("policy", 0), ("priority", 0)) for number in (7, 12)]


def test_the_end_of_a_process_closes_its_connection() -> None:
    life, dying = Pipe(duplex=False)
    assert not watchdog._closed(life)
    dying.close()
    assert watchdog._closed(life)
    life.close()
    assert watchdog._closed(life)


def test_normal_end_is_reported() -> None:
    assert watch(lambda age_s: "closed" if age_s > 3.0 else round(age_s / TICK_S))[0]


@pytest.mark.parametrize("error", [EOFError, BrokenPipeError])
def test_dead_process_is_detected(error: type) -> None:
    assert not watch(lambda age_s: error if age_s > 3.0 else round(age_s / TICK_S))[0]


def test_paused_servo_is_not_killed() -> None:
    closed, after_s = watch(lambda age_s: "closed" if age_s > 60.0 else 0, waiting=ENDED)
    assert closed and after_s > 60.0


def test_loop_that_hangs_while_it_is_paused_is_detected() -> None:
    assert not watch(lambda age_s: "closed" if age_s > 60.0 else 0, pause=1)[0]


def test_time_in_which_the_watchdog_did_not_run_is_ignored() -> None:
    """The watchdog is stopped together with the servo for a minute."""
    clock, row = VirtualClock(), SimpleNamespace(done=0, waiting=0)

    def lives(age_s: float) -> int | str:
        if 1.0 < age_s < 2.0:
            clock.sleep_s(60.0)
        return "closed" if age_s > 65.0 else round(min(age_s, 1.0) / TICK_S) + round(max(age_s - 61.0, 0.0) / TICK_S)

    life = Life(clock, row, lives)
    assert until_needed(life, SimpleNamespace(channel=[row]), 1, None, clock)  # type: ignore[arg-type]


class Held:
    """A device that a dying process holds, and a clock on which it dies after a while."""

    def __init__(self, free_s: float = 0.0, ended_s: float = 0.0) -> None:
        self.clock, self.free_s, self.ended_s = VirtualClock(), free_s, ended_s
        self.begin_s, self.commands = self.clock.now_s(), [1.0]

    @property
    def age_s(self) -> float:
        return self.clock.now_s() - self.begin_s

    def write_zero(self) -> None:
        if self.age_s < self.free_s:
            raise OSError("busy")
        self.commands.append(0.0)

    def closed(self) -> bool:
        """The process ends; a thread of it has written its last force immediately before."""
        if self.age_s < self.ended_s:
            self.commands.append(1.0)
        return self.age_s >= self.ended_s

    def release(self) -> None:
        driver = Driver("held", "a device", force=False, release=self.write_zero)
        release(driver, DeviceChoice("held"), self.closed, self.clock)


@pytest.mark.parametrize(("free_s", "released"), [(0.0, True), (0.5, True), (5.0, True), (2.0 * RELEASE_S, False)])
def test_release_is_retried(free_s: float, released: bool) -> None:
    held = Held(free_s)
    held.release()
    assert held.commands == ([1.0, 0.0] if released else [1.0]) and held.age_s <= min(free_s, RELEASE_S) + 0.01


def test_force_that_a_dying_thread_writes_after_the_release_is_removed() -> None:
    held = Held(ended_s=0.06)
    held.release()
    assert held.commands[1] == 1.0 and held.commands.index(0.0) == 2  # at once
    assert held.commands[-1] == 0.0 and held.commands.count(0.0) == 2


def test_process_that_does_not_end_does_not_prevent_the_release() -> None:
    held = Held(ended_s=float("inf"))
    held.release()
    assert held.commands.count(0.0) == 1


def test_device_that_does_not_answer_does_not_delay_others() -> None:
    """The first release ends only after the second, as that of a device whose service does not answer."""
    second, order = threading.Event(), []

    def hang() -> None:
        order.append(second.wait(20.0))

    names = {"hangs": hang, "works": second.set}
    drivers = [Driver(name, "a device", force=False, release=function) for name, function in names.items()]
    release_all([(driver, DeviceChoice(driver.name)) for driver in drivers], lambda: True)
    assert order == [True]


@pytest.mark.parametrize(
    ("kinds", "closed", "acts"),
    [
        (["pen"], True, ["zero 0"]),
        (["stops", "prepared"], True, ["zero 1"]),
        *(([kind], True, []) for kind in ("holds", "slow", "held")),
        (["prepared", "holds"], True, []),  # the one cannot be set to zero while the servo has it
        (["prepared", "holds"], False, ["zero 1", "kill 7", "release 2"]),
    ],
)
def test_servo_goes_on_only_if_all_devices_lose_their_force(
    kinds: list[str], closed: bool, acts: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    done, zeros, begun = list[str](), list[int](), list[Any]()
    device = {"force": True, "release": print, "watchdog_s": 1.0, "prepare_release": None, "imports": ("no_module",)}
    device["read_options"] = dict
    more = {"pen": {"force": False}, "stops": {"release": None, "watchdog_s": 0.9 * BUSY_S}, "holds": {}}
    more |= {"slow": {"release": None, "watchdog_s": BUSY_S}, "held": {"watchdog_s": 0.9 * BUSY_S}}
    more["prepared"] = {"prepare_release": lambda: lambda: zeros.append(1)}

    def note(name: str) -> Callable[..., None]:
        return lambda *given: begun.append((name, *given))

    def look(name: str) -> None:
        begun.append(name)
        raise ImportError

    def open_channel(*place: Any, **shape: int) -> Any:
        begun.append((*place, shape))
        return SimpleNamespace(close=lambda unlink: begun.append(unlink))

    def until(life: Any, channel: Any, pid: int, send_zeros: Callable[[], object] | None) -> bool:
        begun.append(pid)
        if send_zeros is not None:
            send_zeros()
            done.append(f"zero {len(zeros)}")
        return closed

    monkeypatch.setattr(watchdog, "DRIVERS", SimpleNamespace(load=lambda name: SimpleNamespace(**device | more[name])))
    monkeypatch.setattr(watchdog, "until_needed", until)
    monkeypatch.setattr(watchdog, "open_channel", open_channel)
    monkeypatch.setattr(watchdog, "importlib", SimpleNamespace(import_module=look))
    for name in ("gc.freeze", "gc.disable", "signal.signal", "os.setsid", "request_realtime_priority", "_hasten"):
        monkeypatch.setattr(f"hapscene.loop.watchdog.{name}", note(name), raising=False)
    monkeypatch.setattr(watchdog, "release_all", lambda drivers, closed: done.append(f"release {len(drivers)}"))
    monkeypatch.setattr("os.kill", lambda pid, signum: done.extend([f"zero {len(zeros)}", f"kill {pid}"]))
    choices, ready = [DeviceChoice(kind) for kind in kinds], SimpleNamespace(send=note("ready"))
    watchdog.watch(None, ready, "name", (5, 4, 3, 2), 7, choices)  # type: ignore[arg-type]
    assert done == acts
    assert begun == [
        *(("signal.signal", kind, signal.SIG_IGN) for kind in (signal.SIGINT, signal.SIGTERM)),
        *(("os.setsid",), *["no_module"] * len(kinds), ("gc.freeze",), ("gc.disable",)),
        *(("request_realtime_priority", PRIORITY + 1), ("_hasten", os.getpid())),
        *((5, 4, "name", {"bodies": 3, "tools": 2}), ("ready", None), 7, False),
        *(() if closed else [("_hasten", 7)]),
    ]


@pytest.mark.parametrize(("patience_ns", "beats"), [(10**18, 200), (50 * HEARTBEAT_NS, 50)])
def test_heartbeat_stops_without_calls(patience_ns: int, beats: int) -> None:
    class Stop:
        looks = 0

        def __getitem__(self, index: int) -> int:
            self.looks += 1
            return int(self.looks > 200)

    counter, asked = np.zeros(1, np.int64), np.zeros(1, np.int64)
    beat = getattr(heartbeat._beat, "py_func", heartbeat._beat)
    beat(counter, asked, Stop(), VirtualClock().buffer, patience_ns)
    assert counter[0] == pytest.approx(beats, abs=1)


@pytest.mark.parametrize(("patience_s", "patience_ns"), [(0.05, 50_000_000), (float("inf"), 10**18)])
def test_heartbeat_ends_with_its_thread(patience_s: float, patience_ns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    acts: list[Any] = []

    def beat(counter: Any, asked: Any, stop: Any, clock: Any, patience_ns: int) -> None:
        acts.append(patience_ns)
        while not stop[0]:
            counter[0] = 1
        acts.append("end")

    monkeypatch.setattr(heartbeat, "request_realtime_priority", lambda: acts.append("priority"))
    monkeypatch.setattr(heartbeat, "_beat", beat)
    heartbeat.Heartbeat(np.zeros(1, np.int64), patience_s).stop()
    assert acts == ["priority", patience_ns, "end"]
