"""The 2DIY's driver: bytes as published, and its pantograph."""

import struct

import numpy as np
import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.haply2diy import DRIVER, HARDWARE, run_message, setup_message
from hapscene_plugins.devices.haply2diy_kinematics import TORQUE_MAX_N_m, arm_torques, forward


def test_setup_is_by_port() -> None:
    assert setup_message(HARDWARE["v3"]) == bytes.fromhex("01 05 03 01 01 03 01 01 00 00") + struct.pack(
        "<4f", 12, 4880, 168, 4880
    )
    assert setup_message(HARDWARE["v2"]) == bytes.fromhex("01 05 03 00 01 03 00 01 00 00") + struct.pack(
        "<4f", -61, 10752, 241, 10752
    )
    assert run_message((0.0, 0.0)) == bytes((2, 5)) + bytes(8)
    assert run_message((0.5, -0.25)) == bytes.fromhex("02 05 00 00 80 be 00 00 00 3f")


def test_pantograph_as_published() -> None:
    np.testing.assert_allclose(forward(np.radians((12.0, 168.0)), 0.038), (0.019, -0.0606), atol=5e-5)
    np.testing.assert_allclose(forward(np.radians((168.0, 12.0)), 0.038), (0.019, 0.03574), atol=5e-5)
    assert forward((1.0, 1.0), 0.0) is None  # elbow on elbow: anywhere


@pytest.mark.parametrize("hardware", HARDWARE)
def test_force_and_motors_do_the_same_work(hardware: str) -> None:
    rng, base = np.random.default_rng(1), HARDWARE[hardware].base_m
    for theta in rng.uniform((1.9, 0.3), (2.8, 1.2), (50, 2)):
        p, f, step = np.array(forward(theta, base)), rng.uniform(-0.2, 0.2, 2), rng.uniform(-1e-6, 1e-6, 2)
        moved = np.array(forward(theta + step, base)) - p
        assert np.dot(arm_torques(f, p, theta, base), step) == pytest.approx(moved @ f, rel=1e-3, abs=1e-10)
        large = arm_torques(1000.0 * f, p, theta, base)
        assert np.abs(large).max() == pytest.approx(TORQUE_MAX_N_m)


def test_a_missing_port_is_an_error(tmp_path) -> None:
    with pytest.raises(DeviceError, match="haply2diy: /nowhere: cannot be opened"):
        DRIVER.open(port="/nowhere")
    (found,) = DRIVER.find(port="/nowhere")
    assert "no such port" in found.trouble and "--option port" in found.remedy
