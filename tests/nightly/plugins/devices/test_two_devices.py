"""Two devices in one servo: a Touch with the thread of its vendor's library, and another device."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device import choose
from hapscene.loop import Servo
from tests.nightly.plugins.devices.conftest import Emulated
from tests.nightly.plugins.devices.vendor_desk import Desk, desk, emulator
from tests.until import until

__all__ = ["desk"]


@pytest.fixture
def wall() -> Iterator[hapscene.Scene]:
    """Its front is at x = 0, and fills the space behind."""
    box = trimesh.creation.box((0.1, 0.2, 0.2))
    box.apply_translation((0.05, 0.0, 0.0))
    scene = hapscene.Scene()
    scene.add(box, name="wall", unit="m")
    yield scene


def lay(desk: Desk, **more: Any) -> None:
    values = {"name": b"Left", "calibration": 0x5000, "style": 4, "transform": np.eye(4).ravel(), "most_force": 3.4}
    desk.set(**values | {"workspace": (-80, -60, -35, 80, 60, 35), "position": (-5.0, 0.0, 0.0)} | more)


def pushed_N(desk: Desk, device: int = 0) -> float:
    """Force of the newest frame of a device along x."""
    rows = desk.rows()
    return float(rows["force"][rows["device"] == device][-1, 0])


def press(desk: Desk) -> None:
    """5 mm into the wall, at the speed of a hand."""
    for x_mm in np.linspace(-5.0, 5.0, 60):
        desk.set(position=(x_mm, 0.0, 0.0))
        until(lambda count=desk.count: desk.count > count + 10)


def test_two_touches_in_one_servo(desk: Desk, wall: hapscene.Scene) -> None:
    lay(desk, second=b"Right")
    options = {"library": emulator("hd"), "rate": 1003}  # the vendor's thread drifts past the loop
    with Servo(wall, [choose("openhaptics", name=name, **options) for name in ("Left", "Right")]) as servo:
        servo.start([(0.0, 0.0, 0.0)] * 2)
        until(lambda: servo.state(tool=1).tick > 3000)
        press(desk)
        for tool in range(2):
            until(lambda tool=tool: servo.state(tool=tool).touching and pushed_N(desk, tool) < -0.3)
        servo.pause()
        assert pushed_N(desk, 0) == pushed_N(desk, 1) == 0.0
        servo.resume()
        until(lambda: pushed_N(desk, 0) < -0.3 and pushed_N(desk, 1) < -0.3)
    assert pushed_N(desk, 0) == pushed_N(desk, 1) == 0.0


def test_a_touch_beside_a_serial_device(desk: Desk, wall: hapscene.Scene, tmp_path: Path) -> None:
    lay(desk)
    board = Emulated("haply2diy", tmp_path)
    try:
        devices = [choose("haply2diy", port=board.place), choose("openhaptics", library=emulator("hd"), name="Left")]
        with Servo(wall, devices) as servo:
            servo.start([(-0.03, 0.0, 0.0), (0.0, 0.0, 0.0)])
            until(lambda: servo.state(tool=1).tick > 3000)
            assert servo.mode == "stopped" and "not calibrated" in servo.notice
            servo.home()
            until(lambda: servo.device_state(tool=0).ready == 1)
            press(desk)
            until(lambda: pushed_N(desk) < -0.3)
            board.set(silent=1)  # it stops answering: the other device must not keep its force either
            until(lambda: servo.mode == "error")
            until(lambda: pushed_N(desk) == 0.0)
            board.set(silent=0)
            servo.recover()
            assert servo.mode == "paused"
            servo.home()
            servo.resume()
            until(lambda: servo.device_state(tool=0).ready == 1 and pushed_N(desk) < -0.3)
    finally:
        board.end()
