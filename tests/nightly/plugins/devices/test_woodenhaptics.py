"""WoodenHaptics: reports as published, its geometry, its watchdog."""

import numpy as np
import pytest

from hapscene_plugins.devices.woodenhaptics import (
    DRIVER,
    body_angles,
    currents,
    forward,
)
from tests.until import until


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
def test_tick_waits_at_most_once_for_the_bus(f_D_N: tuple[float, ...], emulate) -> None:
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
def test_zero_force_is_sent_immediately(turns: int, emulate) -> None:
    woody = emulate("woodenhaptics")
    with DRIVER.open(homed=True, backend="usb_wire") as device:
        for turn in range(turns):
            device.read()
            device.state.f_D_N = (0.0, 0.0, 2.0 if turn + 1 < turns else 0.0)
            device.write()
        assert tuple(woody.rows()[-1][1:4]) == (0, 0, 0) and any(woody.rows()[-2][1:4])
