"""The driver of Omni and Touch, against an emulated library with a scheduler, an error stack and calibration."""

import ctypes
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hapscene.compiled.bound_call import BoundCall
from hapscene.compiled.native import INTERPRETED, native
from hapscene.errors import DeviceError
from hapscene_plugins.devices.openhaptics import DRIVER, OpenHapticsConnection
from hapscene_plugins.devices.openhaptics_library import ERRORS
from tests.nightly.plugins.devices.vendor_desk import Desk, desk, emulator
from tests.virtual_clock import StillClock

__all__ = ["desk"]
pytestmark = pytest.mark.skipif(INTERPRETED, reason="the driver's callback is compiled")

TURN = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # x right, y up, z towards the user → x right, y away, z up


@native
def push(given: Any) -> None:
    """A tick: the force wanted, and a spring."""
    state, wanted = given
    for i in range(3):
        state[0].f_D_N[i] = wanted[i] - wanted[3] * state[0].p_DT_m[i]


def lay(desk: Desk, **more: Any) -> None:
    """A connected, calibrated Touch."""
    values = {"name": b"NULL", "calibration": 0x5000, "style": 4, "transform": np.eye(4).ravel(), "most_force": 3.4}
    desk.set(**values | {"workspace": (-80, -60, -35, 80, 60, 35)} | more)


def connect(runs: bool = True, **options: Any) -> OpenHapticsConnection:
    """Opens the device; its clock goes on with its sleeps, or stands still where not `runs`."""
    clock = StillClock()
    clock.runs = runs
    opened = DRIVER.open(**DRIVER.read_options({"library": emulator("hd")} | options), clock=clock)
    assert isinstance(opened, OpenHapticsConnection)
    return opened


@pytest.fixture
def device(desk: Desk) -> Iterator[OpenHapticsConnection]:
    lay(desk)
    with connect(runs=False) as opened:
        yield opened


def serve(device: OpenHapticsConnection, *wanted: float) -> None:
    """Schedule `push`; a force and a stiffness."""
    tick = BoundCall(push, (device.state, np.array([*wanted, 0.0, 0.0, 0.0, 0.0][:4])))
    device.tick = tick  # type: ignore[attr-defined]  # the library calls it as long as the device is open
    device.schedule(tick.address, tick.context)


def pass_frames(count: int, seed: int = 0) -> None:
    """Let frames pass in this thread; mutated ones with a seed."""
    library = ctypes.CDLL(emulator("hd"))
    library.run_mutated.argtypes = ctypes.c_int, ctypes.c_uint64
    library.run_mutated(count, seed)


def gone(desk: Desk) -> None:
    """Let two more frames pass."""
    pass_frames(2)


def turned(f_D: Any) -> Any:
    return TURN.T @ np.asarray(f_D)


def test_positions_turn_into_ours(desk, device):
    rng = np.random.default_rng(1)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = R, (11.0, 22.0, 33.0)
    lay(desk, position=(11.0, 22.0, 33.0), transform=transform.T.ravel(), buttons=2, warmth=0.7, velocity=(1, 2, 3))
    for _ in range(64):  # warmth is asked for now and then
        device.read()
    state = device.state[0]
    assert np.allclose(state.p_DT_m, TURN @ (0.011, 0.022, 0.033), rtol=0, atol=1e-15)
    assert np.allclose(state.v_DT_m_s, TURN @ (0.001, 0.002, 0.003), rtol=0, atol=1e-15)
    assert np.allclose(state.R_DT, TURN @ R, rtol=0, atol=1e-15)
    assert (state.buttons, state.ready, state.trouble, state.count, state.heat) == (2, 1, 0, 64, 0.7)


def test_the_origin_is_the_middle_of_the_workspace(desk):
    lay(desk, workspace=(-70, -60, -15, 90, 60, 45), position=(10.0, 0.0, 15.0))
    with connect() as device:
        device.read()
        assert np.allclose(device.state.p_DT_m, 0.0, atol=1e-15)


def test_forces_on_the_wire(desk, device):
    device.read()
    for f_D, sent in (((0.1, 0.2, 0.3), (0.1, 0.3, -0.2)), ((0.0, -3.0, 0.0), (0.0, 0.0, 3.0))):
        device.state.f_D_N = f_D
        device.write()
        assert np.array_equal(desk.rows()[-1]["force"], sent)
    device.state.f_D_N = (30.0, 0.0, 40.0)  # saturated, its direction kept
    device.write()
    assert np.allclose(desk.rows()[-1]["force"], (1.98, 2.64, 0.0), rtol=1e-12)
    for bad in (math.nan, math.inf, 1e200):
        device.state.f_D_N = (0.1, bad, 0.1)
        device.write()
        assert np.array_equal(desk.rows()[-1]["force"], (0.0, 0.0, 0.0))


@pytest.mark.parametrize(("most_N", "sent_N"), [(1.5, 1.5), (0.0, 3.3), (9.0, 3.3)])
def test_force_is_limited_to_the_maximum_of_the_device(desk, most_N, sent_N):
    lay(desk, most_force=most_N)
    with connect() as device:
        device.state.f_D_N = (5.0, 0.0, 0.0)
        device.write()
        assert np.allclose(desk.rows()[-1]["force"], (sent_N, 0.0, 0.0))


def test_two_devices_share_the_scheduler(desk):
    lay(desk, name=b"left", second=b"right")
    with connect(runs=False, name="left") as left:
        with connect(runs=False, name="right") as right:
            for device, f_x in ((left, 1.0), (right, 2.0), (left, 3.0)):
                device.state.f_D_N = (f_x, 0.0, 0.0)
                device.write()
        left.write()
        with pytest.raises(DeviceError, match="HD_COMM_ERROR"):
            connect(name="another")
        left.write()
        assert desk.disabled == 1
    rows = desk.rows()
    assert rows["device"].tolist() == [0, 1, 0, 1, 0, 0, 0] and (desk.started, desk.disabled) == (0, 2)
    assert rows["force"][:, 0].tolist() == [1.0, 2.0, 3.0, 0.0, 3.0, 3.0, 0.0]


def test_vendor_thread_runs_the_tick(desk, device):
    desk.set(position=(10.0, 20.0, 30.0))
    serve(device, 1.0, 0.5, -0.2, 20.0)
    gone(desk)
    f_D = np.array([1.0, 0.5, -0.2]) - 20.0 * (TURN @ (0.01, 0.02, 0.03))
    assert np.allclose(desk.rows()[-1]["force"], turned(f_D), atol=1e-15)
    pass_frames(200)
    device.unschedule()
    device.unschedule()
    rows = desk.rows()
    assert not rows["force"][-1].any() and rows["force"][-2].any()
    assert device.state.f_D_N.any() == np.False_
    device.read()  # and goes on by hand
    serve(device, 1.0)
    gone(desk)
    assert np.array_equal(desk.rows()["force"][-1], (1.0, 0.0, 0.0))


def test_no_force_before_calibration(desk):
    lay(desk, calibration=0x5002)
    with connect() as device:
        serve(device, 1.0)
        gone(desk)
        assert device.state.ready == 0
        assert "put the stylus into the inkwell" in device.reason(int(device.state.trouble[0]))
        assert not desk.rows()["force"].any()
        desk.set(calibration=0x5001)  # in the inkwell: the driver has it calibrated
        gone(desk)
        assert desk.calibration == 0x5000
        assert device.state.ready == 1
        rows = desk.rows()
        assert rows["force"][-1].any() and not rows["force"][rows["ready"] == 0].any()


def test_encoders_are_reset_only_on_request(desk):
    lay(desk, calibration=0x5001, style=1)
    with connect() as device:
        device.read()
        assert device.state.ready == 0 and desk.calibration == 0x5001
        assert "reset=yes" in device.reason(int(device.state.trouble[0]))
    with connect(reset="yes") as device:
        device.read()
        assert device.state.ready == 1
    desk.set(style=4)
    with pytest.raises(DeviceError, match="encoders: HD_INVALID_OPERATION"):
        connect(reset="yes")


@pytest.mark.parametrize("priority", ["-1", "65536"])
def test_invalid_priority_is_refused(desk, priority):
    with pytest.raises(DeviceError, match=f"priority={priority}"):
        connect(priority=priority)
    assert desk.tried == b""


@pytest.mark.parametrize("code", [*ERRORS, 0x0777])
def test_errors_end_the_force_and_have_a_name(desk, device, code):
    serve(device, 1.0)
    gone(desk)
    assert desk.rows()["force"][-1].any()
    desk.set(begin_error=code)
    gone(desk)
    assert device.state.trouble == code
    row = desk.rows()[-1]
    assert device.state.ready == 0 and not row["force"].any()
    reason = device.reason(code)
    assert (ERRORS[code][0] if code in ERRORS else "unknown error (0x0777)") in reason
    desk.set(begin_error=0)
    gone(desk)
    assert device.state.ready == 1 and device.state.trouble == 0


def test_error_at_the_end_of_a_frame_is_reported_in_the_next(desk, device):
    serve(device, 1.0)
    desk.set(end_error=0x0200)
    gone(desk)
    gone(desk)
    assert device.state.trouble == 0x0200 and not desk.rows()["force"][-1].any()
    assert "let them cool" in device.reason(0x0200)


@pytest.mark.parametrize(
    ("first", "later", "code"),
    [(0x0302, 0x0402, 0x0302), (0x0302, 0x0200, 0x0302), (0x0200, 0x0302, 0x0302), (0x0203, 0x0200, 0x0203)],
)
def test_the_first_error_is_reported(desk, device, first, later, code):
    """The library gives its newest error first: the oldest is the cause. Warm motors are less than what is gone."""
    serve(device, 1.0)
    desk.set(begin_error=first, refuse=b"hdGetIntegerv", refuse_code=later)
    gone(desk)
    gone(desk)
    assert device.state.trouble == code


def test_forces_that_the_library_switched_off_stay_off(desk, device):
    serve(device, 1.0)
    gone(desk)
    desk.set(off=1)
    gone(desk)
    gone(desk)
    assert device.state.ready == 0 and "disabled the force" in device.reason(int(device.state.trouble[0]))
    assert not desk.rows()["force"][-1].any()


def test_a_bad_frame_gives_no_force_and_no_state(desk, device):
    device.read()
    device.state.f_D_N = (1.0, 0.0, 0.0)
    before, desk.position[1] = device.state.copy(), math.nan
    device.read()
    assert np.array_equal(device.state.p_DT_m, before.p_DT_m)
    assert (device.state.count, device.state.ready) == (before.count, 0)
    assert not desk.rows()["force"][-1].any()
    with pytest.raises(DeviceError, match="invalid positions"):
        for _ in range(30):
            device.read()


@pytest.mark.nightly
def test_mutated_returns(desk, device):
    """10⁵ frames of NaN, infinite and huge numbers, unknown errors and calibrations: never a force."""
    tick = BoundCall(push, (device.state, np.array([1.0, 0.0, 0.0, 0.0])))
    device.schedule(tick.address, tick.context)
    pass_frames(100_000, 7)
    device.unschedule()
    rows = desk.rows()
    bad = rows["bad"] == 1
    assert len(rows) > 100_000 and 0.3 < bad.mean() < 0.99
    assert not rows["force"][bad].any()
    assert rows["force"][~bad].any() and np.isfinite(rows["force"]).all()


def test_disconnected_device_is_detected(desk, device):
    serve(device, 1.0)
    device.check()
    desk.set(begin_error=0x0302)
    gone(desk)
    with pytest.raises(DeviceError, match="HD_COMM_ERROR"):
        device.check()
    desk.set(begin_error=0)
    gone(desk)
    device.check()
    ctypes.CDLL(emulator("hd")).hdStopScheduler()
    device.check()
    device._clock.at_s += 1.0
    with pytest.raises(DeviceError, match="does not run"):
        device.check()
    device._clock.runs = True
    with pytest.raises(DeviceError, match="does not run"):
        device.unschedule()  # nothing takes the force away: the servo's process ends, and the watchdog does
    with pytest.raises(DeviceError, match="does not run"):
        device.read()


def test_names_are_tried_in_turn(desk):
    lay(desk, name=b"Phantom2")
    connect().close()
    assert desk.tried.decode().startswith("NULL;Default Device;Default PHANToM;Phantom2;force;clamp;")
    lay(desk, name=b"left", tried=b"")
    connect(name="left").close()
    assert desk.tried.decode() == "left;force;clamp;"


def test_device_in_use_is_reported(desk, device):
    with pytest.raises(DeviceError, match=r"HD_DEVICE_ALREADY_INITIATED"):
        connect()
    device.read()


def test_missing_device_error_lists_the_tried_names(desk, monkeypatch):
    lay(desk, name=b"another")
    monkeypatch.delenv("GTDD_HOME", raising=False)
    with pytest.raises(DeviceError, match=r"NULL: HD_COMM_ERROR.*Phantom4: HD_COMM_ERROR.*library=PATH.*GTDD_HOME"):
        connect()
    (found,) = DRIVER.find(**DRIVER.read_options({"library": emulator("hd")}))
    assert "Default PHANToM" in found.trouble and "GTDD_HOME" in found.remedy
    lay(desk)
    (found,) = DRIVER.find(**DRIVER.read_options({"library": emulator("hd")}))
    assert (found.where, found.trouble, int(desk.started)) == ("Touch 2007", "", 0)


@pytest.mark.parametrize(
    "function", ["hdGetIntegerv", "hdEnable", "hdSetSchedulerRate", "hdStartScheduler", "hdScheduleAsynchronous"]
)
def test_errors_of_the_library_are_reported(desk, function):
    lay(desk, refuse=function.encode(), refuse_code=0x0600)
    with pytest.raises(DeviceError, match="HD_INVALID_LICENSE"), connect() as device:
        serve(device, 1.0)
    assert desk.started == 0 and not desk.rows()["force"].any()


def test_library_is_searched_in_the_standard_locations(desk, monkeypatch, tmp_path):
    lay(desk)
    places = {"libHD.so": emulator("hd")}
    monkeypatch.setattr("hapscene.device.vendor_library.find_library", places.get)
    connect(library=None).close()
    broken = tmp_path / "libHD.so"
    broken.write_text("not a library")
    places["libHD.so"] = str(broken)
    with pytest.raises(DeviceError, match=r"tried HD, libHD\.so, HD\.dll\) \(.*libHD\.so: .*\); install OpenHaptics"):
        connect(library=None)


def test_no_library():
    with pytest.raises(
        DeviceError, match=r"tried nowhere/libHD\.so\) .*cannot open.*install OpenHaptics.*library=PATH"
    ):
        connect(library="nowhere/libHD.so")
    (found,) = DRIVER.find(library="nowhere/libHD.so")
    assert "cannot be loaded" in found.trouble
    with pytest.raises(DeviceError, match="no function hdInitDevice"):
        connect(library=emulator("dhd"))


WAYS_OUT = {
    "close": "device.close()",
    "exception": "raise ValueError('seen')",
    "exit": "sys.exit(3)",
    "interrupt": "os.kill(os.getpid(), signal.SIGINT); time.sleep(9)",
}


def end_by(way: str) -> None:
    """A process of its own, whose device gives 1 N, and its end."""
    code = f"""
import os, signal, sys, time
from hapscene.compiled.bound_call import BoundCall
from hapscene.compiled.native import native
import hapscene.device

@native
def push(given):
    given[0][0].f_D_N[0] = 1.0

device = hapscene.device.open("openhaptics", library={emulator("hd")!r})
tick = BoundCall(push, (device.state,))
device.schedule(tick.address, tick.context)
time.sleep(0.02)
{way}
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    subprocess.run([sys.executable, "-c", code], env=environment, stderr=subprocess.DEVNULL, timeout=120)


@pytest.mark.nightly
@pytest.mark.parametrize("way", WAYS_OUT)
def test_force_is_zero_after_release(desk, way):
    """Seen by the desk, which outlives the process."""
    lay(desk)
    end_by(WAYS_OUT[way])
    rows = desk.rows()
    assert rows["force"][:-1].any() and not rows["force"][-1].any()
    assert (desk.started, desk.disabled) == (0, 1)


@pytest.mark.nightly
def test_release_gives_zero_to_a_device_whose_driver_was_killed(desk):
    lay(desk)
    end_by("os.kill(os.getpid(), signal.SIGKILL)")
    assert np.array_equal(desk.rows()["force"][-1], (1.0, 0.0, 0.0))
    DRIVER.release(**DRIVER.read_options({"library": emulator("hd")}))
    assert not desk.rows()["force"][-1].any()


def test_release_gives_zero_force(desk):
    lay(desk)
    DRIVER.release(**DRIVER.read_options({"library": emulator("hd")}))
    rows = desk.rows()
    assert len(rows) == 1 and rows["ready"].all() and not rows["force"].any()
    assert (desk.started, desk.disabled, desk.tried) == (0, 1, b"NULL;force;")
    connect().close()  # nothing is left


def test_release_says_where_no_zero_was_given(desk):
    """The guard tries it again, then."""
    lay(desk, refuse=b"hdStartScheduler", refuse_code=0x0304)
    with pytest.raises(DeviceError, match="does not run"):
        DRIVER.release(**DRIVER.read_options({"library": emulator("hd")}))
    assert (desk.started, desk.disabled) == (0, 1)
