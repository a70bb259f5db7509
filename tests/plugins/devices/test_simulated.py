"""A simulated device in a simulated hand, as a driver."""

import numpy as np

from hapscene.constants import TICK_S
from hapscene.device.sim.arm import advance_arm, read_arm
from hapscene.device.sim.hand import GRIPS
from hapscene_plugins.devices.simulated import DRIVER


def test_a_force_moves_the_device_on_the_spring_of_the_grip_until_it_is_closed() -> None:
    device, k_N_m = DRIVER.open(**DRIVER.read_options({})), GRIPS["light"].k_N_m
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
