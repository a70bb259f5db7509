"""WoodenHaptics: times on the bus."""

import time

from hapscene_plugins.devices.woodenhaptics import DRIVER
from tests.until import until


def turn(device, count: int, *f_D_N: float) -> None:
    for _ in range(count):
        device.read()
        device.state.f_D_N = f_D_N
        device.write()
        time.sleep(1e-3)


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
