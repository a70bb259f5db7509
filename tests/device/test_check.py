"""`check_driver` on an emulator in the same thread, and on drivers that break one rule each."""

import math
import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapscene.cli import main
from hapscene.device.check import check_driver
from hapscene.device.driver import Connection, Driver, Option, clip_force
from hapscene.device.emulator import Emulator
from hapscene.device.model import Device, Limits
from hapscene.device.response_timeout import ResponseTimeout
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from tests.virtual_clock import VirtualClock

MESSAGE = struct.Struct("<3f")


class Board(Emulator):
    def message_size(self, data: bytes) -> int:
        return MESSAGE.size

    def force_N(self, message: bytes) -> tuple[float, float, float]:
        x, y, z = MESSAGE.unpack(message)
        return x, y, z

    def answer(self, message: bytes, position_m: tuple[float, float, float]) -> bytes:
        return MESSAGE.pack(*position_m)


class SlowBoard(Board):
    """A board that messages reach after 30 ms."""

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__()
        self._clock, self._sleep_s, self._answers = clock, clock.sleep_s, b""
        self._way: list[tuple[float, bytes]] = []
        clock.sleep_s = self.sleep_s  # type: ignore[method-assign]

    def receive(self, data: bytes) -> bytes:
        self._way.append((self._clock.now_s() + 0.03, data))
        answers, self._answers = self._answers, b""
        return answers

    def sleep_s(self, span_s: float) -> None:
        self._sleep_s(span_s)
        while self._way and self._way[0][0] <= self._clock.now_s():
            self._answers += super().receive(self._way.pop(0)[1])


CONNECTIONS: list["BoardConnection"] = []
"""All that were opened, in order."""


class BoardConnection(Connection):
    """A driver that keeps the contract, but for the rule `broken`."""

    def __init__(self, board: Board, clock: VirtualClock, broken: str) -> None:
        super().__init__()
        self._board, self._clock, self._broken, self._data = board, clock, broken, b""
        self._timeout, self.closed = ResponseTimeout(clock), 0
        self._homed = self._compiled = self._stopped = False
        self.state.ready = broken == "compiles"
        CONNECTIONS.append(self)

    def home(self) -> None:
        if not self.state.count[0]:
            raise DeviceError("board: no position yet")
        self._homed = True

    def read(self) -> None:
        state, data, self._data = self.state[0], self._data, b""
        p = MESSAGE.unpack(data) if len(data) == MESSAGE.size else (np.nan,)
        good = bool(np.isfinite(p).all() and np.abs(p).max() < 1.0)
        if self._broken == "waits" or (self._broken == "waits in silence" and not data):
            self._clock.sleep_s(0.0008)
        if self._broken == "compiles":
            self._clock.sleep_s(0.1 * (not self._compiled))
            self._compiled = True
        if self._broken == "counts ticks" or (good and self._broken != "counts nothing"):
            state.count += 1
        if good or (self._broken == "position" and len(p) == 3):
            state.p_DT_m, state.ready = p, self._broken != "never ready"
            self._timeout.received()
        if self._broken == "is homed":
            state.ready = self._homed
        state.trouble = 42 * (self._broken == "never ready")
        self._stopped |= self._broken == "stops" and float(state.p_DT_m[0]) > 0.05
        state.ready *= not self._stopped
        state.buttons = 2 * (self._broken == "buttons")
        state.R_DT = ORIENTATIONS.get(self._broken, np.eye(3))
        self._timeout.check(self, "board", "reconnect it")

    def write(self) -> None:
        state = self.state[0]
        force = clip_force(state.f_D_N, 3.0) if self._broken != "not finite" else tuple(state.f_D_N)
        if self._broken in FORCES and any(force):
            force = FORCES[self._broken](self._board.last_N[0] == 0.0)
        if state.ready == 0 and self._broken != "not ready":
            force = (0.0, 0.0, 0.0)
        self._data = self._board.receive(MESSAGE.pack(*force))

    def close(self) -> None:
        self.closed += 1
        if self._broken == "close twice" and self.closed > 1:
            raise DeviceError("board: is closed")
        if self._broken != "close":
            self._board.receive(MESSAGE.pack(0.0, 0.0, 0.0))


ORIENTATIONS = {
    "orientation": np.ones((3, 3)),
    "scale": 2.0 * np.eye(3),
    "reflection": np.diag((1.0, 1.0, -1.0)),
    "no orientation": np.full((3, 3), np.nan),
}

FORCES: dict[str, Callable[[bool], tuple[float, float, float]]] = {
    "unit": lambda first: (300.0, 0.0, 0.0),
    "sign": lambda first: (-0.3, 0.0, 0.0),
    "axes": lambda first: (0.3, 0.1, 0.0),
    "overshoot": lambda first: (0.6 if first else 0.3, 0.0, 0.0),
}
"""Forces in place of the one requested, in the first tick and later."""


def driver_of(board: Board, clock: VirtualClock, broken: str = "") -> Driver:
    return Driver(
        name="board",
        summary="A board in the same thread.",
        open=lambda port: BoardConnection(board, clock, broken),
        find=lambda port: [],
        model=MODEL,
        options=(Option("port", "here", "port"),),
        release=lambda port: broken == "release" or board.receive(MESSAGE.pack(0.0, 0.0, 0.0)),
        imports=("no_such_module",) if broken == "imports" else (),
    )


MODEL = Device("board", PointMass(0.1, 0.5, 0.1, 1e-6), Limits(3.0))


def failures(lines: list[str]) -> list[str]:
    return [line.split(":")[0].split(maxsplit=1)[1] for line in lines if line.startswith("failed")]


def run(broken: str = "", slow: bool = False, **changes: Any) -> list[str]:
    """The lines of a check; its result agrees with them, and every connection is closed."""
    CONNECTIONS.clear()
    clock, lines = VirtualClock(), []
    board = SlowBoard(clock) if slow else Board()
    driver = replace(driver_of(board, clock, broken), **changes)
    good = check_driver(driver, {}, lines.append, board, clock)
    assert good != any(failures(lines)) and all(line.endswith("\n") for line in lines)
    assert all(connection.closed for connection in CONNECTIONS)
    return lines


@pytest.mark.parametrize("slow", [False, True])
def test_a_driver_that_keeps_the_contract_passes_every_check(slow: bool) -> None:
    lines = run(slow=slow)
    assert len(lines) == 16 and all(line.startswith("ok ") for line in lines), lines
    assert any("1000 a second" in line for line in lines)
    *before, last = CONNECTIONS  # opened again after each disconnection
    assert {connection.closed for connection in before} == {1} and last.closed == 3 and len(before) > 1


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks of a driver that fails: no faults, and a short wait."""
    monkeypatch.setattr("hapscene.device.check.FAULTS", ())
    monkeypatch.setattr("hapscene.device.check.READY_S", 0.1)


@pytest.mark.parametrize(
    ("broken", "check"),
    [
        ("waits in silence", "fault: silence"),
        ("counts ticks", "fault: silence"),
        ("position", "fault: nan"),
        ("stops", "fault: jump"),
        ("waits", "samples"),
        ("counts nothing", "samples"),
        *((name, "open") for name in ORIENTATIONS),
        ("never ready", "open"),
        ("buttons", "open"),
        ("not finite", "invalid force"),
        *((name, "force") for name in FORCES),
        ("not ready", "no force while not ready"),
        ("close", "close"),
        ("close twice", "close"),
        ("release", "release"),
        ("imports", "imports"),
    ],
)
def test_each_broken_rule_fails_its_check(
    broken: str, check: str, brief: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    check, _, fault = check.partition(": ")
    monkeypatch.setattr("hapscene.device.check.FAULTS", (fault,) if fault else ())
    lines = run(broken)
    assert check in failures(lines)
    assert broken != "never ready" or any("code 42" in line for line in lines)


@pytest.mark.parametrize(
    ("check", "changes"),
    [
        ("limits", {"low_D_m": (0.0, 0.0, 0.1), "high_D_m": (0.1, 0.1, 0.1)}),
        ("limits", {"model": replace(MODEL, limits=replace(MODEL.limits, force_N=math.inf))}),
        ("options", {"find": lambda: []}),
        ("options", {"release": lambda: None}),
        ("find", {"find": lambda port: ["somewhere"]}),
    ],
)
def test_each_wrong_property_fails_its_check(check: str, changes: dict[str, Any], brief: None) -> None:
    assert check in failures(run(**changes))


def test_properties_that_a_driver_may_lack(brief: None) -> None:
    for watchdog_s, reason in ((0.02, "0.02 s"), (math.inf, "suffices")):
        lines = run(release=None, watchdog_s=watchdog_s)
        assert not failures(lines) and lines[-1].startswith("skipped") and reason in lines[-1]
    silent = run(force=False, model=replace(MODEL, limits=replace(MODEL.limits, force_N=math.inf)))
    assert not failures(silent) and sum("no force output" in line for line in silent) == 3
    assert run(force=False, model=None)[0].startswith("skipped")


def test_a_device_is_homed_where_its_position_is_known(brief: None) -> None:
    assert not failures(run("is homed", home="put it down"))
    assert "open" in failures(run("is homed"))


def test_the_first_read_may_compile(brief: None) -> None:
    (line,) = (line for line in run("compiles") if "samples" in line)
    assert line.startswith("ok") and "1000 a second" in line


def test_a_driver_without_its_device_fails_to_open_and_skips_the_rest() -> None:
    def refuse(port: str) -> Connection:
        raise DeviceError("board: not connected")

    lines = run(open=refuse)
    assert failures(lines) == ["open"]
    assert sum(line.startswith("skipped") and "not open" in line for line in lines) > 7


def test_a_connected_device_receives_no_force() -> None:
    board, clock, lines = Board(), VirtualClock(), []
    assert check_driver(driver_of(board, clock), {}, lines.append, None, clock)
    assert board.message_count > 500 and board.largest_N == 0.0
    assert sum(line.startswith("skipped") for line in lines) == 5


def test_an_unknown_option_is_refused() -> None:
    with pytest.raises(DeviceError, match="colour"):
        check_driver(driver_of(Board(), VirtualClock()), {"colour": "red"}, print)


@pytest.mark.parametrize("good", [True, False])
def test_as_typed_on_an_emulator_behind_a_port(good: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("tty", reason="this system has no pseudo-terminals")
    given: list[Any] = []
    monkeypatch.setattr("hapscene.device.check.check_driver", lambda *words: given.extend(words) or good)
    assert main(["device", "check", f"{__name__}:DRIVER", "--emulator", f"{__name__}:Board"]) == 1 - good
    driver, options, _, emulator = given
    assert driver is DRIVER and options["port"].startswith("/dev/") and type(emulator) is Board


DRIVER = driver_of(Board(), VirtualClock())
