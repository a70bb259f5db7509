"""WoodenHaptics: reports as published, its geometry, its watchdog."""

import struct

import numpy as np
import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.woodenhaptics import (
    DRIVER,
    GEAR,
    REPORT,
    CURRENT_MAX_mA,
    TORQUE_N_m_A,
    body_angles,
    currents,
    forward,
)
from tests.until import until


def test_reports_are_eight_bytes_little_endian() -> None:
    assert REPORT.pack(1, -2, 3000, 0) == bytes.fromhex("01 00 fe ff b8 0b 00 00")


def test_geometry_as_published() -> None:
    np.testing.assert_allclose(forward(body_angles((0, 0, 0))), (0.245 - 0.22, 0.0, 0.08 + 0.205 - 0.08), atol=1e-12)
    # a quarter of the upper arm forwards, the lower one hanging: twelve turns of a capstan are one of the arm
    np.testing.assert_allclose(forward(body_angles((0, -6000, 6000))), (0.205 - 0.22, 0.0, -0.245), atol=1e-12)


def test_force_and_motors_do_the_same_work() -> None:
    """Torques of the bodies by the currents, against a place that moves with their angles."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        angles, f, step = (
            rng.uniform((-0.5, 0.5, 0.5), (0.5, 1.5, 1.5)),
            rng.uniform(-1, 1, 3),
            rng.uniform(-1e-6, 1e-6, 3),
        )
        moved = np.array(forward(tuple(angles + step))) - forward(tuple(angles))
        torques = np.array(currents(tuple(f), tuple(angles), "+++")) / 1000.0 * TORQUE_N_m_A / GEAR
        assert torques @ step == pytest.approx(moved @ f, rel=1e-2, abs=1e-9)
        large = np.array(currents(tuple(1000.0 * f), tuple(angles), "+--"))
        assert np.abs(large).max() == CURRENT_MAX_mA


def test_place_current_and_watchdog_on_the_wire(emulate) -> None:
    woody = emulate("woodenhaptics")
    with DRIVER.open(homed=True, backend="usb_wire") as device:
        for _ in range(20):
            device.read()
            device.state.f_D_N = (0.0, 0.0, 2.0)
            device.write()
        x, y, z = forward(body_angles((500, -4000, 1000)))
        np.testing.assert_allclose(device.state.p_DT_m[0], (y, -x, z))
        last = woody.rows()[-1]
        assert tuple(last[1:4]) == currents((0.0, 0.0, 2.0), body_angles((500, -4000, 1000)), "+--")
        until(lambda: not any(woody.rows()[-1][1:4]))
        assert 0.45e9 < woody.rows()[-1][0] - last[0] < 0.7e9


@pytest.mark.parametrize("f_D_N", [(0.0, 0.0, 2.0), (0.0, 0.0, 0.0)])
def test_a_tick_waits_for_the_bus_once_at_most(f_D_N: tuple[float, ...], emulate) -> None:
    """Two reports in a tick of 1 ms take two: the servo would be late in each, and never give a force."""
    woody = emulate("woodenhaptics")
    with DRIVER.open(homed=True, backend="usb_wire") as device:
        for _ in range(100):
            count, sent = int(device.state.count[0]), len(woody.rows())
            device.read()
            device.state.f_D_N = f_D_N
            device.write()
            assert (int(device.state.count[0]) - count) + (len(woody.rows()) - sent) <= 1
        assert device.state.count[0] > 40 and len(woody.rows()) > 40


@pytest.mark.parametrize("turns", [60, 61])
def test_a_force_that_ends_does_not_wait_for_its_turn(turns: int, emulate) -> None:
    woody = emulate("woodenhaptics")
    with DRIVER.open(homed=True, backend="usb_wire") as device:
        for turn in range(turns):
            device.read()
            device.state.f_D_N = (0.0, 0.0, 2.0 if turn + 1 < turns else 0.0)
            device.write()
        assert tuple(woody.rows()[-1][1:4]) == (0, 0, 0) and any(woody.rows()[-2][1:4])


def test_signs_that_are_none_are_told() -> None:
    with pytest.raises(DeviceError, match="expected three of"):
        DRIVER.open(signs="+-")
    assert struct.calcsize("<3hH") == REPORT.size == 8
