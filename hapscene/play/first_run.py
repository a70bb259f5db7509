"""`hapscene device try`: the first run with a device, in steps of increasing risk.

The steps check the position, then movement, then a small force. The force is limited to `FORCE_N` until the user
confirms more, and the safety functions of the servo apply.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import trimesh

from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.errors import DeviceError
from hapscene.flags import Flag
from hapscene.loop import Servo
from hapscene.play.monitor import FLAG_TEXTS
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

__all__ = ["FORCE_N", "try_device"]

FORCE_N: Final = 0.5
"""Force limit until the user confirms more [N]: the weight of 50 g."""

PUSH_N: Final = 0.3
"""Force of the first push [N]: twice what a hand on a device notices (assumed)."""

READY_S: Final = 60.0
"""Time limit for calibration or homing [s]."""

LOOK_S: Final = 4.0
"""Duration of a measurement of movement or force [s]; the force ramp takes 2 s."""

MOVED_MM: Final = 1.0
"""Smallest movement of the handle that counts [mm]: above encoder noise."""

MISSED_MAX: Final = 0.01
"""Largest acceptable fraction of missed ticks [1]; a busy machine misses some."""

GRAVITY_M_S2: Final = 9.81


def try_device(name: str, options: Mapping[str, Any], say: Callable[[str], None], wait: bool = True) -> int:
    """Try a device; returns 0 if all checks passed, else 1.

    Args:
        name: name of the driver.
        options: options of the driver.
        say: called with output; a prompt has no newline at the end.
        wait: wait for Enter before each step; without, the force never exceeds `FORCE_N`.

    Raises:
        DeviceError: the device cannot be opened, is not ready in time, or is disconnected.
    """
    driver = DRIVERS.load(name)
    say(f"{driver.name}: {driver.summary}\n")
    for one in driver.assumptions:
        say(f"  assumed, not yet confirmed on a device: {one}\n")
    choice = DeviceChoice(name, dict(options))
    report: list[tuple[str, bool]] = []

    def pause(words: str) -> None:
        _enter(say, words) if wait else say(f"{words}\n")

    effects = ["wall", "weight"]
    with Servo(_plate(), choice, effects=effects, settings={"weight": {"mass_kg": 0.0}}, force_N=FORCE_N) as servo:
        servo.start((0.0, 0.0, 0.0))
        _await_ready(servo, driver.needs, say)
        pause("Move the handle slowly through its whole workspace: left and right, near and far, up and down.")
        report += _look_at_moves(servo, driver)
        if driver.force:
            weight_g = 1e3 * PUSH_N / GRAVITY_M_S2
            pause(f"Hold the handle loosely in the middle. A weight of {weight_g:.0f} g will slowly pull it down.")
            report += _look_at_push(servo, say)
            servo.pause()
            report.append(("no force while paused", not np.any(servo.device_state().f_D_N)))
    if driver.force and wait and _asks(say, "If all was correct, feel a wall with the full force of the device"):
        _feel_wall(choice, say)
    for words, good in report:
        say(f"  {'ok' if good else 'FAILED'}: {words}\n")
    return 0 if all(good for _, good in report) else 1


def _plate() -> Scene:
    """A scene with a plate far below, so that there is no contact."""
    scene = Scene()
    pose = np.eye(4)
    pose[2, 3] = -10.0
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.3, 0.3, 0.02)), "m"), name="plate", pose=pose)
    return scene


def _await_ready(servo: Servo, needs: str, say: Callable[[str], None]) -> None:
    end_s = time.monotonic() + READY_S
    shown = ""
    while servo.device_state().ready == 0:
        notice = servo.notice or "waiting for calibration"
        if notice != shown:
            say(f"{notice}\n")
            shown = notice
        if time.monotonic() > end_s:
            hint = f"; the device requires {needs}" if needs else ""
            raise DeviceError(f"the device is not ready after {READY_S:g} s: {notice}{hint}")
        time.sleep(0.05)
    say("ready\n")


def _look_at_moves(servo: Servo, driver: Any) -> list[tuple[str, bool]]:
    first = servo.state().tick
    late = servo.timing()
    count, begin_s = int(servo.device_state().count), time.monotonic()
    time.sleep(LOOK_S)
    count, elapsed_s = int(servo.device_state().count) - count, time.monotonic() - begin_s
    log = servo.read(first)
    p = log.rows["p_WT_m"]
    way_mm = 1e3 * (p.max(axis=0) - p.min(axis=0))
    rate_Hz = count / elapsed_s
    worst = servo.timing().since(late)
    flags = int(np.bitwise_or.reduce(log.rows["flags"]))
    steps_mm = 1e3 * np.abs(np.diff(p, axis=0)).max(axis=1)
    checks = [
        (f"{rate_Hz:.0f} positions per second", rate_Hz > 100.0),
        (
            "moved {:.0f} mm along x, {:.0f} mm along y, {:.0f} mm along z".format(*way_mm),
            bool(driver.simulated or way_mm.max() > MOVED_MM),
        ),
        (
            f"largest step {steps_mm.max():.2f} mm per tick",
            bool(steps_mm.max() < 1e3 * driver.speed_m_s * servo.tick_s),
        ),
        (f"{worst.missed} of {len(p)} ticks missed", worst.missed <= MISSED_MAX * len(p)),
    ]
    checks += [(text, False) for flag, text in FLAG_TEXTS.items() if flags & flag & ~int(Flag.RAMPED)]
    return checks


def _look_at_push(servo: Servo, say: Callable[[str], None]) -> list[tuple[str, bool]]:
    servo.tune_field("weight", mass_kg=PUSH_N / GRAVITY_M_S2)
    first = servo.state().tick
    time.sleep(LOOK_S)
    sent = servo.device_state().f_D_N
    log = servo.read(first)
    p = log.rows["p_WT_m"]
    sank_mm = 1e3 * float(p[0, 2] - p[-1, 2])
    servo.tune_field("weight", mass_kg=0.0)
    say(f"the handle moved down by {sank_mm:.1f} mm\n")
    flags = int(np.bitwise_or.reduce(log.rows["flags"][-100:]))
    checks = [(f"commanded {PUSH_N} N, sent {-sent[2]:.2f} N downwards", abs(-sent[2] - PUSH_N) < 0.05)]
    return checks + [(text, False) for flag, text in FLAG_TEXTS.items() if flags & flag]


def _feel_wall(choice: DeviceChoice, say: Callable[[str], None]) -> None:
    scene = _plate()
    scene.pose("plate", np.eye(4))
    with Servo(scene, choice, effects=["wall"]) as servo:
        servo.start((0.0, 0.0, 0.03))
        _enter(say, "A plate is 20 mm below the middle of the workspace.")


def _enter(say: Callable[[str], None], words: str) -> None:
    say(f"{words} Press Enter to continue … ")
    _input()


def _asks(say: Callable[[str], None], words: str) -> bool:
    say(f"{words}? Type y and press Enter … ")
    return _input().strip().lower().startswith("y")


def _input() -> str:
    try:
        return input()
    except EOFError:
        raise DeviceError("standard input is closed: run the command in a terminal, or use --yes") from None
