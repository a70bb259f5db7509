"""The 2DIY's driver: bytes as published, and its pantograph."""

import numpy as np
import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.haply2diy import DRIVER
from hapscene_plugins.devices.haply2diy_board import HARDWARE, setup_message


def test_place_and_force_on_the_wire(emulate) -> None:
    board = emulate("haply2diy")
    with DRIVER.open(port=board.place, homed=True) as device:
        known = 0
        while known < 10:  # on a busy machine the first answers come late
            device.read()
            device.state.f_D_N = (0.0, 1.0, 0.0)  # away from the hand
            device.write()
            known += bool(device.state.p_DT_m[0].any())
        np.testing.assert_allclose(device.state.p_DT_m[0], (0, 0.09 - 0.13262, 0), atol=1e-4)
    assert tuple(board.rows()[0][2:]) == tuple(setup_message(HARDWARE["v3"]))
    second, first = next(row[1:3] for row in reversed(board.rows()) if any(row[1:3]))
    assert first > 0.0 and second == pytest.approx(-first)  # both arms turn up and back, away from the hand


def test_board_is_exclusive_but_can_be_released_by_another_program(emulate) -> None:
    board = emulate("haply2diy")
    with DRIVER.open(port=board.place) as device:
        with pytest.raises(DeviceError, match="in use"):
            DRIVER.open(port=board.place)
        device.read()
        DRIVER.release(port=board.place)  # a servo that is dying may still hold it
