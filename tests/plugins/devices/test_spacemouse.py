"""A SpaceMouse: reports of both layouts, and a point that they move. hidapi is stood in for."""

import random
import struct
import sys
from collections import deque
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.spacemouse import DRIVER

CALLS: list[Any] = []
"""Of the device: paths that were opened, modes, and closings."""


@pytest.fixture
def reports(monkeypatch: pytest.MonkeyPatch) -> deque[Any]:
    """What the device is going to send; an error is raised."""
    queue: deque[Any] = deque()
    CALLS.clear()

    def read(size: int) -> list[int]:
        report = queue.popleft() if queue else b""
        if isinstance(report, Exception):
            raise report
        return list(report)

    def open_path(path: bytes) -> None:
        CALLS.append(path)
        if "refused" in queue:
            raise OSError("open failed")

    device = SimpleNamespace(
        open_path=open_path, set_nonblocking=CALLS.append, read=read, close=lambda: CALLS.append("close")
    )
    plugged = {"vendor_id": 0x256F, "product_id": 0xC635, "path": b"1", "product_string": "SpaceMouse Compact"}
    others = [plugged | {"product_id": 1}, plugged | {"usage_page": 1, "usage": 6}]
    nameless = {"vendor_id": 0x046D, "product_id": 0xC62B, "path": b"2", "usage_page": 1, "usage": 8}
    hid = SimpleNamespace(enumerate=lambda: [*others, plugged, nameless], device=lambda: device)
    monkeypatch.setitem(sys.modules, "pretended_hid", hid)  # type: ignore[arg-type]
    return queue


def opened(**options: str) -> Any:
    return DRIVER.open(**DRIVER.read_options({"backend": "pretended_hid"} | options))


@pytest.mark.parametrize("rest", [b"", bytes(6)], ids=["rotation apart", "rotation in it"])
def test_deflection_moves_the_point_at_a_speed(rest: bytes, reports: deque[Any]) -> None:
    reports.append(bytes([1]) + struct.pack("<3h", 350, 175, -350) + rest)
    reports.append(bytes([2]) + bytes(6))
    with opened(speed_m_s="0.2", reach_m="0.05") as device:
        for _ in range(100):
            device.read()
            device.write()
        np.testing.assert_allclose(device.state.p_DT_m[0], (0.02, -0.01, 0.02), atol=1e-12)
        for _ in range(1000):
            device.read()
        np.testing.assert_allclose(device.state.p_DT_m[0], (0.05, -0.05, 0.05))
        reports.append(bytes([1]) + struct.pack("<3h", 3, -5, 0) + rest)  # within the dead zone
        device.read()
        before = device.state.p_DT_m[0].copy()
        device.read()
        np.testing.assert_array_equal(device.state.p_DT_m[0], before)


def test_buttons(reports: deque[Any]) -> None:
    long = b"\x03" + 8 * b"\x01"
    with opened() as device:
        for report, buttons in (
            (b"\x03\x02", 2),
            (b"\x03\x01\x01\x00\x00", 257),
            *((invalid, 257) for invalid in (b"\x03", long, b"\x02\x05")),
            (long[:-1], 0x01010101),
            (b"\x03\x00", 0),
        ):
            reports.append(report)
            device.read()
            assert device.state.buttons[0] == buttons


def test_invalid_reports_do_not_move_it_beyond_its_reach(reports: deque[Any]) -> None:
    rng = random.Random(1)
    with opened() as device:
        for _ in range(2_000):
            reports.append(bytes([rng.randrange(5)]) + rng.randbytes(rng.choice((0, 1, 5, 6, 7, 12, 40))))
            device.read()
            assert np.abs(device.state.p_DT_m[0]).max() <= 0.1


def test_disconnected_refused_and_missing_devices_are_errors(
    reports: deque[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    places = [found.where for found in DRIVER.find(backend="pretended_hid")]
    assert places == ["SpaceMouse Compact", "SpaceNavigator"] and CALLS == [b"1", "close", b"2", "close"]
    with opened() as device:
        reports.append(OSError("read error"))
        with pytest.raises(DeviceError, match="spacemouse: disconnected"):
            device.read()
    assert CALLS[4:] == [b"1", 1, "close"]
    reports.append("refused")
    with pytest.raises(DeviceError, match=r"cannot be opened.*udev"):
        opened()
    for found in DRIVER.find(backend="pretended_hid"):
        assert found.trouble and "uaccess" in found.remedy
    monkeypatch.setitem(sys.modules, "hid", None)
    with pytest.raises(DeviceError, match=r"pip install 'hapscene\[hid\]'"):
        DRIVER.open()
    (found,) = DRIVER.find()
    assert found.remedy == "pip install 'hapscene[hid]'"


def test_another_package_with_the_same_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pretended_hid", SimpleNamespace(enumerate=list, Device=object))
    with pytest.raises(DeviceError, match="pretended_hid"):
        opened()
    (found,) = DRIVER.find(backend="pretended_hid")
    assert "not hidapi" in found.trouble and "pip uninstall hid" in found.remedy
