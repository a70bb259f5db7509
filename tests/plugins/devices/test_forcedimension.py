"""The driver of Force Dimension's devices, against an emulated library with a watchdog."""

import ctypes
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.forcedimension import DRIVER, WATCHDOG_S, ForceDimensionConnection
from tests.nightly.plugins.devices.vendor_desk import Desk, desk, emulator

__all__ = ["desk"]

POWER, CONNECTED, RESET, FORCE, BRAKE, ERROR, CAUSE = 0, 1, 3, 5, 6, 9, 14
WATCHDOG_STEPS = 160  # of 125 µs


def status(**more: int) -> np.ndarray:
    values = np.zeros(16, np.int64)
    values[[POWER, CONNECTED]] = 1
    for name, value in more.items():
        values[globals()[name]] = value
    return values


def lay(desk: Desk, **more: Any) -> None:
    """A connected, calibrated device with disabled force."""
    desk.set(**{"style": 1, "status": status()} | more)


def connect(**options: Any) -> ForceDimensionConnection:
    opened = DRIVER.open(**DRIVER.read_options({"library": emulator("dhd")} | options))
    assert isinstance(opened, ForceDimensionConnection)
    return opened


@pytest.fixture
def device(desk: Desk) -> Iterator[ForceDimensionConnection]:
    lay(desk)
    with connect() as opened:
        desk.set(watchdog=0)  # a busy machine may be silent for as long
        opened.read()  # switches the force on
        opened.write()
        opened.read()
        yield opened


def test_positions_turn_into_ours(desk, device):
    desk.set(position=(0.01, 0.02, 0.03), buttons=5)  # towards the user, to the right, up
    device.read()
    state = device.state[0]
    assert np.array_equal(state.p_DT_m, (0.02, -0.01, 0.03))
    assert (state.buttons, state.ready, state.trouble, state.count) == (5, 1, 0, 3)
    assert np.array_equal(state.R_DT, np.eye(3)) and math.isnan(state.heat) and math.isnan(state.gripper_rad)


def test_velocity_orientation_and_gripper(desk):
    R, turn = (
        np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0],
        np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    )
    R *= np.linalg.det(R)
    transform = np.eye(4)
    transform[:3, :3] = R
    lay(desk, transform=transform.T.ravel(), gripper=0.4, velocity=(0.1, 0.2, 0.3))
    with connect() as device:
        device.read()
        state = device.state[0]
        assert np.array_equal(state.v_DT_m_s, (0.2, -0.1, 0.3)) and state.gripper_rad == 0.4
        assert np.allclose(state.R_DT[:, 2], turn @ R[:, 0], atol=1e-15)  # the handle, towards the hand
        assert np.linalg.det(state.R_DT) == pytest.approx(1.0)
        before, desk.transform[1] = state.R_DT.copy(), 5.0
        device.read()
        assert np.array_equal(state.R_DT, before)


def test_forces_on_the_wire(desk, device):
    for f_D, sent in (((0.1, 0.2, 0.3), (-0.2, 0.1, 0.3)), ((0.0, 60.0, 80.0), (-4.8, 0.0, 6.4))):
        device.state.f_D_N = f_D
        device.write()
        assert np.allclose(desk.rows()[-1]["force"], sent, rtol=1e-15)
    for bad in (math.nan, math.inf):
        device.state.f_D_N = (0.1, bad, 0.1)
        device.write()
        assert not desk.rows()[-1]["force"].any()


def test_settings_on_opening(desk):
    lay(desk)
    with connect(gravity="no"):
        pass
    assert desk.tried.decode() == "weight;stop;" and (desk.watchdog, desk.most_force) == (WATCHDOG_STEPS, 8.0)
    assert len(desk.rows()) == 2 and (desk.started, desk.disabled) == (0, 1)


def test_closing_and_release_set_zero_force(desk, device):
    device.state.f_D_N = (1.0, 0.0, 0.0)
    device.write()
    device.write()
    assert desk.rows()["force"][-2:].any(axis=1).all()
    device.close()
    device.close()
    rows = desk.rows()
    assert not rows["force"][-1].any() and rows["force"][-2].any() and (desk.started, desk.disabled) == (0, 1)
    assert desk.tried.decode().endswith(";stop;")
    DRIVER.release(**DRIVER.read_options({"library": emulator("dhd")}))
    assert len(desk.rows()) == len(rows) + 2 and (desk.started, desk.disabled) == (0, 2)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"POWER": 0}, "switch it on"),
        ({"CONNECTED": 0}, "cable"),
        ({"RESET": 1}, "not calibrated"),
        ({"ERROR": 1}, "fault"),
        ({"FORCE": 1, "BRAKE": 1}, "force button"),
        ({"CAUSE": 1}, "by its button"),
        ({"CAUSE": 2}, "fast movement"),
        ({"CAUSE": 5}, "USB"),
        ({"CAUSE": 6}, "until the handle is held"),
        ({"CAUSE": 9}, "fault"),
    ],
)
def test_no_force_before_it_is_ready(desk, fault, message):
    lay(desk, status=status(**fault))
    with connect() as device:
        desk.set(watchdog=0)
        for _ in range(3):
            device.read()
            device.state.f_D_N = (1.0, 0.0, 0.0)
            device.write()
        assert device.state.ready == 0 and message in device.reason(int(device.state.trouble[0]))
        assert not desk.rows()["force"].any() and "force;" not in desk.tried.decode()
        desk.set(status=status())  # and now it is
        for _ in range(2):
            device.read()
            device.write()
        assert device.state.ready == 1 and desk.rows()["force"][-1].any()


def test_force_that_does_not_come_is_asked_for_seldom(desk):
    lay(desk, off=1)
    with connect() as device:
        for _ in range(1100):
            device.read()
        assert desk.tried.decode().count("force;") == 3 and device.state.ready == 0


def test_saturated_motors_are_reported(desk, device):
    desk.set(saturated=1)
    device.write()
    device.read()
    assert device.state.ready == 1 and "saturated" in device.reason(int(device.state.trouble[0]))
    desk.set(saturated=0)
    device.write()
    device.read()
    assert device.state.trouble == 0


def test_repeated_position_is_not_counted(desk, device):
    desk.set(end_error=1)
    device.read()
    assert device.state.count == 2 and device.state.ready == 1
    desk.set(end_error=0)
    device.read()
    assert device.state.count == 3


def test_the_watchdog_ends_the_force_of_a_silent_servo(desk, device):
    desk.set(watchdog=WATCHDOG_STEPS, at_s=1.0)
    device.state.f_D_N = (1.0, 0.0, 0.0)
    device.write()
    desk.set(at_s=1.0 + 2 * WATCHDOG_S)
    device.read()
    rows = desk.rows()
    ended = int(np.flatnonzero(rows["force"].any(axis=1))[-1]) + 1
    assert not rows["force"][ended].any()
    assert rows["t_s"][ended] - rows["t_s"][ended - 1] == pytest.approx(WATCHDOG_S, abs=1e-9)
    assert device.state.ready == 0 and "watchdog" in device.reason(int(device.state.trouble[0]))


def test_a_bad_position_gives_no_force_and_no_state(desk, device):
    device.state.f_D_N = (1.0, 0.0, 0.0)
    for bad in (math.nan, math.inf, 1e5):
        desk.set(position=(0.0, bad, 0.0))
        device.read()
        device.write()
        assert device.state.count == 2 and device.state.ready == 0 and not desk.rows()["force"][-1].any()
        assert not device.state.p_DT_m.any()
    with pytest.raises(DeviceError, match="invalid positions"):
        for _ in range(30):
            device.read()


@pytest.mark.parametrize(
    ("function", "act"), [("dhdGetPosition", "read"), ("dhdGetStatus", "read"), ("dhdSetForce", "write")]
)
def test_disconnected_device_is_reported(desk, device, function, act):
    """A moment is borne, without force; not more."""
    desk.set(refuse=function.encode(), refuse_code=2)
    getattr(device, act)()
    desk.set(refuse=b"")
    device.read()
    assert device.state.ready == 1
    desk.set(refuse=function.encode())
    with pytest.raises(DeviceError, match=r"error 2 of the library: communication"):
        for _ in range(30):
            getattr(device, act)()


@pytest.mark.nightly
def test_mutated_returns(desk, device):
    """10⁵ returns of NaN, infinite and huge numbers, failures, statuses: no force after a bad one."""
    library = ctypes.CDLL(emulator("dhd"))
    library.mutate.argtypes = (ctypes.c_uint64,)
    library.mutate(9)
    device.state.f_D_N = (1.0, 0.0, 0.0)
    raised = 0
    for _ in range(25_000):  # four returns each
        try:
            device.read()
            device.write()
        except DeviceError:
            raised += 1
    library.mutate(0)
    rows = desk.rows()
    bad = rows["bad"] == 1
    assert 0.1 < bad.mean() < 0.9 and raised == 0
    assert not rows["force"][bad].any() and np.isfinite(rows["force"]).all()
    assert rows["force"][~bad].any(axis=1).mean() > 0.3


def test_found(desk):
    lay(desk, style=2)
    found = DRIVER.find(**DRIVER.read_options({"library": emulator("dhd")}))
    assert [(one.where, dict(one.options), one.trouble) for one in found] == [
        ("device 0", {"device": 0}, ""),
        ("device 1", {"device": 1}, ""),
    ]
    connect(device="1").close()
    (found,) = DRIVER.find(library="nowhere/libdhd.so")
    assert "cannot be loaded" in found.trouble and "library=PATH" in found.remedy


def test_no_device(desk):
    lay(desk, style=0)
    with pytest.raises(DeviceError, match=r"device=0: error 5 of the library: no device; install"):
        connect()
    lay(desk, refuse=b"dhdSetGravityCompensation", refuse_code=33)
    with pytest.raises(DeviceError, match=r"gravity: error 33 of the library: unknown"):
        connect()
    assert (desk.started, desk.disabled) == (0, 1)


@pytest.mark.nightly
@pytest.mark.parametrize("way", ["raise ValueError('seen')", "sys.exit(3)", "os.kill(os.getpid(), signal.SIGKILL)"])
def test_force_is_zero_after_release(desk, way):
    """Seen by the desk, which outlives the process: by the driver, or by the device's watchdog."""
    lay(desk)
    desk.set(at_s=1.0)
    code = f"""
import os, signal, sys
import hapscene.device

device = hapscene.device.open("forcedimension", library={emulator("dhd")!r})
for _ in range(3):
    device.read()
    device.state.f_D_N = (1.0, 0.0, 0.0)
    device.write()
{way}
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    subprocess.run([sys.executable, "-c", code], env=environment, stderr=subprocess.DEVNULL, timeout=120)
    killed = "SIGKILL" in way
    assert desk.rows()["force"][-1].any() == killed
    if killed:
        desk.set(at_s=1.0 + WATCHDOG_S)
        ctypes.CDLL(emulator("dhd")).watch()
        row = desk.rows()[-1]
        assert not row["force"].any() and row["t_s"] == pytest.approx(1.0 + WATCHDOG_S, abs=1e-9)
