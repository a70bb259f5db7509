"""A simulated device in a simulated hand, as a driver."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hapscene.device
from hapscene.constants import TICK_S
from hapscene.device.sim.arm import advance_arm, read_arm
from hapscene.device.sim.hand import GRIPS


def test_a_force_moves_the_device_on_the_spring_of_the_grip_until_it_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    at_exit: list[Any] = []
    monkeypatch.setattr("hapscene.device.driver_registry.atexit", SimpleNamespace(register=at_exit.append))
    device: Any = hapscene.device.open("simulated")
    assert at_exit == [device.close]
    k_N_m = GRIPS["light"].k_N_m
    friction_m = 0.3 / k_N_m
    device.state.f_D_N = 2.0, -1.5, 1.0
    for _ in range(1000):
        device.write()
        device.read()
    np.testing.assert_allclose(device.state.p_DT_m[0], np.array((2.0, -1.5, 1.0)) / k_N_m, atol=friction_m)
    assert device.state.count[0] == 1000 and device.state.ready[0] == 1
    device.close()
    advance_arm(device._arm, TICK_S, 1000)
    np.testing.assert_allclose(read_arm(device._arm), 0.0, atol=friction_m)
