"""Contract of all drivers: force only while the device is ready, and zero force however the driver ends."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import serial  # noqa: F401  # it keeps the clock that it finds as it is imported: the real one

from hapscene.errors import DeviceError
from tests.plugins.devices.test_drivers import CASES, Case
from tests.until import until

GONE_S = 5.0  # until a force is gone, on a machine that does much else besides


case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)


def forces(emulated: Any) -> np.ndarray:
    """All received forces (n, 3) or (n, 2), in the units of the device."""
    return np.array([row[1:4] for row in emulated.rows() if row[1] != -1])


def turn(device: Any, count: int, f_D_N: tuple[float, ...] = (0.3, -0.4, 0.2)) -> None:
    for _ in range(count):
        device.read()
        device.state.f_D_N = f_D_N
        device.write()
        time.sleep(1e-3)  # no read waits for the device


def turn_until(device: Any, true: Callable[[], Any]) -> None:
    """Turn until a condition holds: orders reach the emulator with a delay."""
    until(lambda: turn(device, 5) or true())


@case
def test_force_is_zero_unless_the_device_is_ready(case: Case, emulate) -> None:
    emulated = emulate(case.name)
    with case.driver.open(**case.filled(emulated.place, ready=False)) as device:
        turn_until(device, lambda: device.state.trouble[0])
        assert device.state.ready[0] == 0 and device.reason(int(device.state.trouble[0]))
        assert not forces(emulated).any()
    with case.driver.open(**case.filled(emulated.place)) as device:
        emulated.set(ready=1)
        turn_until(device, lambda: forces(emulated)[-1:].any())
        assert device.state.ready[0] == 1 and device.state.trouble[0] == 0 and device.reason(0) == ""
        if not case.homed:
            emulated.set(ready=0)
            turn_until(device, lambda: device.state.ready[0] == 0 and not forces(emulated)[-1].any())
            count = len(forces(emulated))
            turn_until(device, lambda: len(forces(emulated)) > count + 5)
            assert not forces(emulated)[count:].any()


@case
@pytest.mark.parametrize("way", ["close", "close after it is torn out", "an exception"])
def test_closing_leaves_no_force(case: Case, way: str, emulate) -> None:
    emulated = emulate(case.name)
    emulated.set(ready=1)
    device = case.driver.open(**case.filled(emulated.place))
    turn_until(device, lambda: forces(emulated)[-1:].any())
    if way == "an exception":
        with pytest.raises(ZeroDivisionError), device:
            _ = 1 / 0
    elif way == "close":
        device.close()
    else:
        emulated.set(gone=1)
    device.close()
    if way != "close after it is torn out":
        until(lambda: not forces(emulated)[-1].any(), GONE_S)


@case
def test_a_disconnected_device_is_an_error_with_its_name(case: Case, emulate) -> None:
    emulated = emulate(case.name)
    emulated.set(ready=1)
    with case.driver.open(**case.filled(emulated.place)) as device:
        turn(device, 30)
        emulated.set(gone=1)
        with pytest.raises(DeviceError, match=f"^{case.name}: .*(disconnected|no valid data)"):
            turn(device, 20)  # ticks


@case
def test_a_pause_is_no_timeout(case: Case, emulate, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not polled for a minute, and its arms have moved since."""
    emulated, start_s, ahead = emulate(case.name), time.monotonic(), [0.0]
    monkeypatch.setattr(time, "monotonic", lambda real=time.monotonic: real() + ahead[0])
    with case.driver.open(**case.filled(emulated.place)) as device:

        def pause() -> None:
            ahead[0] += 60.0
            if hasattr(device, "_board"):  # compiled code reads another clock
                device._board.polled_ns -= 60_000_000_000

        pause()
        turn(device, 60)
        pause()
        emulated.set(**case.elsewhere)
        before, count = device.state.p_DT_m[0].copy(), int(device.state.count[0])
        turn(device, 80)
        assert device.state.count[0] > count + 30 and (device.state.p_DT_m[0] != before).any()
    assert time.monotonic() - start_s > 120.0


@case
def test_zero_is_written_to_a_device_whose_driver_was_killed(case: Case, emulate) -> None:
    emulated = emulate(case.name)
    emulated.set(ready=1)
    options = case.filled(emulated.place)
    script = f"""
import sys, time
from hapscene_plugins.devices.{case.name} import DRIVER
device = DRIVER.open(**{options!r})
while True:
    device.read()
    device.state.f_D_N = 0.3, -0.4, 0.2
    device.write()
    time.sleep(1e-3)
"""
    driver = subprocess.Popen([sys.executable, "-c", script])
    try:
        until(lambda: bool(forces(emulated).size and forces(emulated)[-1].any()))
    finally:
        driver.send_signal(signal.SIGKILL)
        driver.wait()
    if case.driver.release is None:
        assert case.driver.watchdog_s < 1.0  # it stops by itself
        until(lambda: not forces(emulated)[-1].any(), GONE_S)
        return
    start_s = time.monotonic()
    case.driver.release(**options)
    until(lambda: not forces(emulated)[-1].any(), GONE_S)
    assert time.monotonic() - start_s < 2.0


@case
@pytest.mark.parametrize("end", ["", "raise KeyError"])
def test_force_is_zero_after_a_program_ends_without_closing(case: Case, end: str, emulate) -> None:
    emulated = emulate(case.name)
    emulated.set(ready=1)
    script = f"""
import time
import hapscene.device
device = hapscene.device.open({case.name!r}, **{case.filled(emulated.place)!r})
for _ in range(60):
    device.read()
    device.state.f_D_N = 0.3, -0.4, 0.2
    device.write()
    time.sleep(1e-3)
{end}
"""
    subprocess.run([sys.executable, "-c", script], stderr=subprocess.DEVNULL, timeout=60.0)
    assert forces(emulated).any()
    until(lambda: not forces(emulated)[-1].any(), GONE_S)


@case
def test_mangled_frames_give_neither_force_nor_hang(case: Case, emulate) -> None:
    """Half of the frames mangled: of a device that is not ready no force, of any a place that can be, and no hang.
    `test_mangled_frames.py` has 10⁵ frames without a wire."""
    emulated = emulate(case.name)
    options, device, reopened, worst_s = case.filled(emulated.place, ready=False), None, 0, 0.0
    for i in range(2_000):
        if device is None:
            emulated.set(mangled=0.0)
            device = case.driver.open(**options)
            emulated.set(mangled=0.5)
        start_s = time.monotonic()
        try:
            turn(device, 1, (1.0, 1.0, 1.0))
        except DeviceError as error:
            assert str(error).startswith(case.name)
            device.close()
            device, reopened = None, reopened + 1
            continue
        worst_s = max(worst_s, time.monotonic() - start_s)
        assert np.isfinite(device.state.p_DT_m).all() and np.abs(device.state.p_DT_m).max() < 1.0, i
        assert np.isfinite(device.state.R_DT).all()
    assert device is not None
    assert worst_s < GONE_S and reopened < 5
    device.close()
    assert not forces(emulated).any()


@case
def test_forces_that_are_none_are_not_sent(case: Case, emulate) -> None:
    emulated = emulate(case.name)
    emulated.set(ready=1)
    with case.driver.open(**case.filled(emulated.place)) as device:
        turn_until(device, lambda: forces(emulated)[-1:].any())
        for wrong in ((np.nan, 0.0, 0.0), (np.inf, 1.0, 0.0)):
            # polled continuously, so that the device's watchdog does not act
            until(lambda wrong=wrong: turn(device, 3, wrong) or not forces(emulated)[-1].any(), GONE_S)


@case
def test_find_lists_it(case: Case, emulate) -> None:
    emulated = emulate(case.name)
    found = case.driver.find(**case.filled(emulated.place))
    assert len(found) == 1 and found[0].where and found[0].trouble == found[0].remedy == ""
