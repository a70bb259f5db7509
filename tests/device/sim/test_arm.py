"""A connected device as the arm of a loop: position, orientation and force between its frame D and W."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hapscene.device.driver import Connection
from hapscene.device.sim.arm import (
    CONNECTED,
    drive_arm,
    find_tip,
    find_tip_velocity,
    new_arm,
    read_arm,
    simulated_device,
    write_orientation,
)
from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError


def test_a_connected_device_is_placed_by_its_pose() -> None:
    R_WD, R_DT = Rotation.from_rotvec([(0.3, -1.2, 0.8), (1.0, 0.4, -0.7)]).as_matrix()
    X_WD, connection, R_WT = np.eye(4), Connection(), np.zeros((3, 3))
    X_WD[:3, :3], X_WD[:3, 3] = R_WD, (0.1, -0.2, 0.3)
    state = connection.state
    state.p_DT_m, state.R_DT, state.v_DT_m_s = (0.01, 0.02, -0.03), R_DT, 1.0
    arm = new_arm(connection, (7.0, 8.0, 9.0), X_WD)
    tip_m = R_WD @ (0.01, 0.02, -0.03) + X_WD[:3, 3]
    np.testing.assert_allclose([read_arm(arm), find_tip(arm)], [tip_m, tip_m], rtol=1e-14)
    assert arm.kind == CONNECTED and find_tip_velocity(arm) == (0.0, 0.0, 0.0)
    write_orientation(arm, R_WT)
    np.testing.assert_allclose(R_WT, R_WD @ R_DT, atol=1e-15)
    drive_arm(arm, (1.0, -2.0, 3.0))
    np.testing.assert_allclose(state.f_D_N[0], R_WD.T @ (1.0, -2.0, 3.0), rtol=1e-14)
    by_default = new_arm(connection, (7.0, 8.0, 9.0))
    np.testing.assert_allclose(read_arm(by_default), (7.01, 8.02, 8.97), rtol=1e-14)


def test_devices_without_mass_cannot_be_simulated() -> None:
    assert isinstance(simulated_device("omni"), Omni)
    with pytest.raises(HapsceneError, match=r"ideal.*premium"):
        simulated_device("ideal")
