"""WoodenHaptics: reports as published, geometry, endpoints."""

import threading
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.usb_transfers import TRANSFER
from hapscene_plugins.devices.woodenhaptics import (
    DRIVER,
    GEAR,
    PRODUCT,
    REPORT,
    VENDOR,
    CURRENT_MAX_mA,
    TORQUE_N_m_A,
    body_angles,
    currents,
    forward,
)
from tests.nightly.plugins.devices.conftest import EMULATORS
from tests.until import PATIENCE_S, until

SIGNS = (1.0, -1.0, -1.0)
"""Directions of the motors by default."""


def test_reports_are_eight_bytes_little_endian() -> None:
    assert REPORT.pack(1, -2, 3000, 0) == bytes.fromhex("01 00 fe ff b8 0b 00 00")


def test_geometry_as_published() -> None:
    np.testing.assert_allclose(forward(body_angles((0, 0, 0))), (0.245 - 0.22, 0.0, 0.08 + 0.205 - 0.08), atol=1e-12)
    # upper arm horizontal, lower arm hanging; twelve turns of a capstan are one turn of the arm
    np.testing.assert_allclose(forward(body_angles((0, -6000, 6000))), (0.205 - 0.22, 0.0, -0.245), atol=1e-12)


def test_force_and_motors_do_the_same_work() -> None:
    """The torques of the currents do the same work as the force along a small movement."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        angles, f, step = (
            rng.uniform((-0.5, 0.5, 0.5), (0.5, 1.5, 1.5)),
            rng.uniform(-1, 1, 3),
            rng.uniform(-1e-6, 1e-6, 3),
        )
        moved = np.array(forward(tuple(angles + step))) - forward(tuple(angles))
        torques = np.array(currents(tuple(f), tuple(angles), (1.0, 1.0, 1.0))) / 1000.0 * TORQUE_N_m_A / GEAR
        assert torques @ step == pytest.approx(moved @ f, rel=1e-2, abs=1e-9)
        large = np.array(currents(tuple(1000.0 * f), tuple(angles), SIGNS))
        assert np.abs(large).max() == CURRENT_MAX_mA


def test_invalid_signs_are_an_error() -> None:
    with pytest.raises(DeviceError, match=r"signs=\+-"):
        DRIVER.open(signs="+-")


class Board:
    """A WoodenHaptics with distinct endpoints: it sends one report and records the reports that it receives."""

    ids, kind, ends = (VENDOR, PRODUCT), 3, (0x02, 0x81)
    gone = silent = 0.0

    def __init__(self) -> None:
        self.written: list[tuple[int, bytes]] = []
        self.read_from: set[int] = set()

    def obey(self) -> None:
        pass

    def write(self, endpoint: int, data: bytes) -> None:
        self.written.append((endpoint, data))

    def read(self, endpoint: int, wait_s: float) -> bytes:
        self.read_from.add(endpoint)
        return REPORT.pack(100, -200, 300, 0)


def test_reads_and_writes_use_their_own_endpoints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("usb", reason="no pyusb: extra `usb`")
    monkeypatch.syspath_prepend(EMULATORS)
    monkeypatch.setenv("HAPSCENE_USB", str(tmp_path / "wire"))
    wire, board = pytest.importorskip("usb_wire"), Board()
    threading.Thread(target=wire.serve, args=(board, str(tmp_path / "wire")), daemon=True).start()
    until(lambda: (tmp_path / "wire").exists())
    x, y, z = forward(body_angles((100, -200, 300)))
    with DRIVER.open(homed=True, backend="usb_wire") as device:
        until(lambda: device.read() or device.state.count[0])
        np.testing.assert_allclose(device.state.p_DT_m[0], (y, -x, z))
        device.state.f_D_N = 0.0, 0.0, 1.0
        zero = REPORT.pack(0, 0, 0, 0)  # also sent while it waits for a position after a pause
        until(lambda: device.write() or any(report != zero for _, report in board.written))
        count = int(device.state.count[0])
        monkeypatch.setattr("hapscene_plugins.devices.usb_connection.WRITE_S", PATIENCE_S)
        device._board.polled_ns -= 10**9
        device.read()  # waits for a position from after the pause
        assert device.state.count[0] > count and device.state.f_D_N[0].tolist() == [0.0, 0.0, 1.0]
    with DRIVER.open(backend="usb_wire") as device:
        until(lambda: device.read() or device.state.count[0])
        assert (device.state.ready[0], device.state.trouble[0]) == (0, 1) and "calibrated" in device.reason(1)
        device.home()
        until(lambda: device.read() or device.state.ready[0])
        np.testing.assert_allclose(device.state.p_DT_m[0], (0.0, -0.025, 0.205), atol=1e-12)
        assert device.state.trouble[0] == 0 and device.reason(0) == ""
    count = len(board.written)
    DRIVER.release(backend="usb_wire")
    assert {*board.written[count:]} == {(0x02, zero)}
    assert board.read_from == {0x81}
    assert {endpoint for endpoint, _ in board.written} == {0x02} and board.written[-1][1] == zero
    forces = {REPORT.unpack(report)[:3] for _, report in board.written if report != zero}
    assert forces == {currents((0.0, 0.0, 1.0), body_angles((100, -200, 300)), SIGNS)}


def test_transfers_have_the_layout_of_pyusb() -> None:
    libusb1 = pytest.importorskip("usb.backend.libusb1", reason="no pyusb: extra `usb`")
    theirs = libusb1._libusb_transfer
    offsets = [getattr(theirs, name).offset for name, *_ in theirs._fields_]
    assert offsets[:-1] == [TRANSFER.fields[name][1] for name in TRANSFER.names]
