"""The 2DIY's port between programs."""

import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.haply2diy import DRIVER


def test_board_is_exclusive_but_can_be_released_by_another_program(emulate) -> None:
    board = emulate("haply2diy")
    with DRIVER.open(port=board.place) as device:
        with pytest.raises(DeviceError, match="in use"):
            DRIVER.open(port=board.place)
        device.read()
        DRIVER.release(port=board.place)  # a servo that is dying may still hold it
