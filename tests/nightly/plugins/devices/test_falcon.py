"""The Falcon's driver against a Falcon at the wire, and its geometry against another way to solve it."""

import time

import numpy as np
import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.falcon import (
    DRIVER,
)


def turn(device, count: int) -> None:
    for _ in range(count):
        device.read()
        device.write()
        time.sleep(1e-3)


def test_boot_handshake_upload_and_run(emulate, tmp_path) -> None:
    falcon = emulate("falcon")
    falcon.set(loaded=0)
    with pytest.raises(DeviceError, match="firmware=FILE"):
        DRIVER.open(backend="usb_wire")
    file = tmp_path / "firmware.bin"
    file.write_bytes(np.random.default_rng(0).bytes(7_914))
    falcon.set(broken_echo=1)
    with pytest.raises(DeviceError, match="byte 0"):
        DRIVER.open(firmware=str(file), backend="usb_wire")
    falcon.set(broken_echo=0)
    before = len(falcon.rows())
    with DRIVER.open(**DRIVER.read_options({"firmware": str(file), "backend": "usb_wire"})) as device:
        turn(device, 30)
        assert device.state.p_DT_m[0, 1] == pytest.approx(0.015, abs=1e-4)  # 11 cm out of the machine: 15 mm away
    asked = [tuple(row[2:]) for row in falcon.rows()[before:] if row[1] == -1]
    boot = [(0, 1), (0, 2), (9, 16), (3, 0x4138), (4, 8), (2, 0), (1, 0x200), (1, 0x100), (1, 0x101)]
    run = [(9, 1), (3, 2), (0, 1), (0, 2)]
    assert asked[: -len(run)][-len(boot) - 2 :] == [*boot, (1, 0x100), (3, 0x15)]
    assert asked[-len(run) :] == run


def test_split_and_short_transfers_are_put_together(emulate) -> None:
    falcon = emulate("falcon")
    falcon.set(split=1, buttons=5)
    with DRIVER.open(backend="usb_wire") as device:
        before = int(device.state.count[0])
        turn(device, 60)
        assert device.state.count[0] > before + 20
        assert device.state.buttons[0] == 5


def test_an_invalid_firmware_file_is_refused(emulate, tmp_path) -> None:
    emulate("falcon").set(loaded=0)
    (tmp_path / "empty").write_bytes(b"")
    for name, message in (("none", "cannot be read"), ("empty", "0 bytes")):
        with pytest.raises(DeviceError, match=message):
            DRIVER.open(firmware=str(tmp_path / name), backend="usb_wire")
