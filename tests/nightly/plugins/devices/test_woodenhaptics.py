"""WoodenHaptics: reports as published, its geometry, its watchdog."""

import time

import numpy as np

from hapscene_plugins.devices.woodenhaptics import (
    DRIVER,
    body_angles,
    currents,
    forward,
)
from tests.until import until


def turn(device, count: int, *f_D_N: float) -> None:
    for _ in range(count):
        device.read()
        device.state.f_D_N = f_D_N
        device.write()
        time.sleep(1e-3)


def test_place_current_and_watchdog_on_the_wire(emulate) -> None:
    woody = emulate("woodenhaptics")
    with DRIVER.open(homed=True, backend="usb_wire") as device:
        turn(device, 20, 0.0, 0.0, 2.0)
        x, y, z = forward(body_angles((500, -4000, 1000)))
        np.testing.assert_allclose(device.state.p_DT_m[0], (y, -x, z))
        last = woody.rows()[-1]
        assert tuple(last[1:4]) == currents((0.0, 0.0, 2.0), body_angles((500, -4000, 1000)), (1.0, -1.0, -1.0))
        until(lambda: not any(woody.rows()[-1][1:4]))
        assert 0.45e9 < woody.rows()[-1][0] - last[0] < 0.7e9


def test_ticks_do_not_wait_for_the_bus(emulate) -> None:
    """Compiled reads and writes take no time, even though the device sends a report in 1 ms."""
    emulate("woodenhaptics")
    with DRIVER.open(homed=True, backend="usb_wire") as device:
        turn(device, 20, 0.0, 0.0, 2.0)
        read, write = device.compiled()
        start_s = time.monotonic()
        for _ in range(1000):
            read()
            write()
        assert time.monotonic() - start_s < 0.3


def test_zero_force_is_sent_immediately(emulate) -> None:
    """Also if the device has not yet accepted the report before."""
    woody = emulate("woodenhaptics")
    with DRIVER.open(homed=True, backend="usb_wire") as device:
        turn(device, 60, 0.0, 0.0, 2.0)
        device.write()
        device.state.f_D_N = 0.0
        device.write()
        until(lambda: not any(woody.rows()[-1][1:4]))
        assert any(woody.rows()[-2][1:4])
