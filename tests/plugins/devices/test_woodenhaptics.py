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


def test_signs_that_are_none_are_told() -> None:
    with pytest.raises(DeviceError, match="expected three of"):
        DRIVER.open(signs="+-")
    assert struct.calcsize("<3hH") == REPORT.size == 8
