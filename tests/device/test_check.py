"""`check_driver` on an emulator in the same thread, and on drivers that break one rule each."""

import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

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


class BoardConnection(Connection):
    """A driver that keeps the contract, but for the rule `broken`."""

    def __init__(self, board: Board, clock: VirtualClock, broken: str) -> None:
        super().__init__()
        self._board, self._clock, self._broken, self._data = board, clock, broken, b""
        self._timeout = ResponseTimeout(clock)

    def read(self) -> None:
        state, data, self._data = self.state[0], self._data, b""
        p = MESSAGE.unpack(data) if len(data) == MESSAGE.size else (np.nan,)
        good = bool(np.isfinite(p).all() and np.abs(p).max() < 1.0)
        if self._broken == "waits" or (self._broken == "waits in silence" and not data):
            self._clock.sleep_s(0.0008)
        if self._broken == "counts ticks" or (good and self._broken != "counts nothing"):
            state.count += 1
        if good or (self._broken == "position" and len(p) == 3):
            state.p_DT_m, state.ready = p, 1
            self._timeout.received()
        if self._broken == "buttons":
            state.buttons = 2
        if self._broken == "orientation":
            state.R_DT = np.ones((3, 3))
        self._timeout.check(self, "board", "reconnect it")

    def write(self) -> None:
        state = self.state[0]
        force = clip_force(state.f_D_N, 3.0) if self._broken != "not finite" else tuple(state.f_D_N)
        if self._broken == "unit":
            force = tuple(1e3 * part for part in force)
        if state.ready == 0 and self._broken != "not ready":
            force = (0.0, 0.0, 0.0)
        self._data = self._board.receive(MESSAGE.pack(*force))

    def close(self) -> None:
        if self._broken == "close twice" and self._board is None:
            raise DeviceError("board: is closed")
        if self._broken != "close":
            self._board.receive(MESSAGE.pack(0.0, 0.0, 0.0))
        if self._broken == "close twice":
            self._board = None  # type: ignore[assignment]


def driver_of(board: Board, clock: VirtualClock, broken: str = "") -> Driver:
    return Driver(
        name="board",
        summary="A board in the same thread.",
        open=lambda port: BoardConnection(board, clock, broken),
        model=Device("board", PointMass(0.1, 0.5, 0.1, 1e-6), Limits(3.0)),
        options=(Option("port", "here", "port"),),
        release=lambda port: broken == "release" or board.receive(MESSAGE.pack(0.0, 0.0, 0.0)),
        imports=("no_such_module",) if broken == "imports" else (),
    )


def failures(lines: list[str]) -> Iterator[str]:
    return (line.split(":")[0].split(maxsplit=1)[1] for line in lines if line.startswith("failed"))


def run(broken: str = "", **changes: Any) -> list[str]:
    """The lines of a check; its result agrees with them."""
    board, clock, lines = Board(), VirtualClock(), []
    driver = replace(driver_of(board, clock, broken), **changes)
    good = check_driver(driver, {}, lines.append, board, clock)
    assert good != any(failures(lines)) and all(line.endswith("\n") for line in lines)
    return lines


def test_a_driver_that_keeps_the_contract_passes_every_check() -> None:
    lines = run()
    assert len(lines) == 16 and all(line.startswith("ok ") for line in lines), lines
    assert any("1000 a second" in line for line in lines)


@pytest.mark.parametrize(
    ("broken", "check"),
    [
        ("waits", "samples"),
        ("waits in silence", "fault"),
        ("counts ticks", "fault"),
        ("counts nothing", "samples"),
        ("position", "fault"),
        ("orientation", "open"),
        ("buttons", "open"),
        ("not finite", "invalid force"),
        ("unit", "force"),
        ("not ready", "no force while not ready"),
        ("close", "close"),
        ("close twice", "close"),
        ("release", "release"),
        ("imports", "imports"),
    ],
)
def test_each_broken_rule_fails_its_check(broken: str, check: str) -> None:
    assert check in failures(run(broken))


def test_a_driver_without_its_device_fails_to_open_and_skips_the_rest() -> None:
    def refuse(port: str) -> Connection:
        raise DeviceError("board: not connected")

    lines = run(open=refuse)
    assert list(failures(lines)) == ["open"]
    assert sum(line.startswith("skipped") and "not open" in line for line in lines) > 7


def test_a_connected_device_receives_no_force() -> None:
    board, clock, lines = Board(), VirtualClock(), []
    assert check_driver(driver_of(board, clock), {}, lines.append, None, clock)
    assert board.message_count > 500 and board.largest_N == 0.0
    assert sum(line.startswith("skipped") for line in lines) == 5


def test_an_unknown_option_is_refused() -> None:
    with pytest.raises(DeviceError, match="colour"):
        check_driver(driver_of(Board(), VirtualClock()), {"colour": "red"}, print)
