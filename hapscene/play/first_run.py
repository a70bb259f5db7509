"""`hapscene device try`: the first run with a device. Each step is safe before the next one begins.

The user moves the device, then feels a small force. The force is at most `FORCE_N` until the user confirms more, and
the servo's safety layer is active.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import trimesh
from numpy.typing import NDArray

from hapscene.device.driver import Driver
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.errors import DeviceError
from hapscene.flags import Flag
from hapscene.loop import Servo
from hapscene.play.monitor import WHY
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

__all__ = ["FORCE_N", "try_device"]

FORCE_N: Final = 0.5
"""Largest force before the user confirms more [N]: the weight of 50 g, which a light grip holds."""

PUSH_N: Final = 0.3
"""Force of the first push [N]: twice the noticeable force."""

READY_S: Final = 60.0
"""Longest time until a device is calibrated or homed [s]."""

MOVE_S: Final = 4.0
"""Time for which a movement is measured [s]."""

PUSH_S: Final = 15.0
"""Longest time until the full force of the push is sent [s]. The ramp takes 2 s, and starts again after each delay of a
busy computer."""

MOVED_MM: Final = 1.0
"""Shortest path of a device that the user moves [mm]: more than encoder noise."""

MISSED_MAX: Final = 0.01
"""Share of missed deadlines from which on the computer counts as busy [1]."""

RATE_MIN_HZ: Final = 100.0
"""Lowest rate of samples for a stable contact [Hz]."""

GRAVITY_M_S2: Final = 9.81

Line = tuple[str, bool]
"""A result, and whether it is as expected."""


def try_device(name: str, options: Mapping[str, Any], say: Callable[[str], None], wait: bool = True) -> int:
    """Guide the user through the first run with a device. Returns 0 if all results are as expected, else 1.

    Args:
        name: name of the driver.
        options: options of the driver.
        say: prints a text. A text that waits for an answer does not end with a newline.
        wait: whether each step waits for the Enter key. Without it, the force stays below `FORCE_N`.

    Raises:
        DeviceError: the device cannot be opened, is not ready in time, or is disconnected.
    """
    driver = DRIVERS.load(name)
    say(f"{driver.name}: {driver.summary}\n")
    for assumption in driver.assumptions:
        say(f"  assumed, not confirmed on hardware: {assumption}\n")
    choice = DeviceChoice(name, dict(options))
    lines: list[Line] = []

    def pause(words: str) -> None:
        _enter(say, words) if wait else say(f"{words}\n")

    effects = ["wall", "weight"]
    with Servo(_plate(), choice, effects=effects, settings={"weight": {"mass_kg": 0.0}}, force_N=FORCE_N) as servo:
        servo.start((0.0, 0.0, 0.0))
        _await_ready(servo, driver.needs, say)
        pause("Move the handle slowly through its whole workspace: left and right, near and far, up and down.")
        lines += _measure_motion(servo, driver, say)
        if driver.force:
            weight_g = 1e3 * PUSH_N / GRAVITY_M_S2
            pause(f"Hold the handle loosely in the middle. Its weight increases slowly by {weight_g:.0f} g.")
            lines += _measure_push(servo, say)
            servo.pause()
            lines.append(("no force in a pause", not np.any(servo.device_state().f_D_N)))
    if driver.force and wait and _confirmed(say, "Did all steps work? Then feel a wall, with the device's full force"):
        _feel_wall(choice, say)
    for words, good in lines:
        say(f"  {'ok' if good else 'failed'}: {words}\n")
    return 0 if all(good for _, good in lines) else 1


def _plate() -> Scene:
    """A scene with a plate far below the workspace, so that the tool touches nothing."""
    scene = Scene()
    pose = np.eye(4)
    pose[2, 3] = -10.0
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.3, 0.3, 0.02)), "m"), name="plate", pose=pose)
    return scene


def _await_ready(servo: Servo, needs: str, say: Callable[[str], None]) -> None:
    end_s = time.monotonic() + READY_S
    printed = ""
    while servo.device_state().ready == 0:
        notice = servo.notice or "waiting until the device is calibrated"
        if notice != printed:
            say(f"{notice}\n")
            printed = notice
        if time.monotonic() > end_s:
            raise DeviceError(f"not ready after {READY_S:g} s: {notice}" + (f"; it needs {needs}" if needs else ""))
        time.sleep(0.05)
    say("ready\n")


def _measure_motion(servo: Servo, driver: Driver, say: Callable[[str], None]) -> list[Line]:
    """Rate, path and largest step while the user moves the device."""
    first, timing = servo.state().tick, servo.timing()
    count, begin_s = int(servo.device_state().count), time.monotonic()
    time.sleep(MOVE_S)
    count, elapsed_s = int(servo.device_state().count) - count, time.monotonic() - begin_s
    log = servo.read(first)
    p = log.rows["p_WT_m"]
    way_mm = 1e3 * (p.max(axis=0) - p.min(axis=0))
    rate_Hz, missed = count / elapsed_s, servo.timing().since(timing).missed
    step_mm = 1e3 * np.abs(np.diff(p, axis=0)).max()
    if missed > MISSED_MAX * len(p):
        say(f"the computer is busy: {missed} of {len(p)} ticks missed their deadline; close other programs\n")
    lines = [
        (f"{rate_Hz:.0f} samples a second", rate_Hz > RATE_MIN_HZ),
        (
            "moved {:.0f} mm along x, {:.0f} along y, {:.0f} along z".format(*way_mm),
            bool(driver.simulated or way_mm.max() > MOVED_MM),  # nobody moves a simulated device
        ),
        (f"largest step {step_mm:.2f} mm in a tick", bool(step_mm < 1e3 * driver.speed_m_s * servo.tick_s)),
    ]
    return lines + _problems(log.rows["flags"])


def _measure_push(servo: Servo, say: Callable[[str], None]) -> list[Line]:
    """Increase the weight of the device, and compare the requested and the sent force."""
    servo.tune_field("weight", mass_kg=PUSH_N / GRAVITY_M_S2)
    first, end_s = servo.state().tick, time.monotonic() + PUSH_S
    sent_N = 0.0
    while abs(sent_N - PUSH_N) > 0.01 and time.monotonic() < end_s:
        time.sleep(0.1)
        sent_N = -float(servo.device_state().f_D_N[2])
    time.sleep(1.0)  # until the hand and the device are at rest
    log = servo.read(first)
    p = log.rows["p_WT_m"]
    servo.tune_field("weight", mass_kg=0.0)
    say(f"the handle sank by {1e3 * float(p[0, 2] - p[-1, 2]):.1f} mm\n")
    lines = [(f"{PUSH_N} N requested, {sent_N:.2f} N sent, downwards", abs(sent_N - PUSH_N) < 0.05)]
    return lines + _problems(log.rows["flags"][-100:])


def _problems(flags: NDArray[np.integer[Any]]) -> list[Line]:
    """The safety layer's reports in some ticks, without those of a force that changes and of a busy computer."""
    seen = int(np.bitwise_or.reduce(flags)) & ~int(Flag.RAMPED | Flag.STALLED | Flag.APPLICATION_SILENT)
    return [(reason, False) for flag, reason in WHY.items() if seen & flag]


def _feel_wall(choice: DeviceChoice, say: Callable[[str], None]) -> None:
    scene = _plate()
    scene.pose("plate", np.eye(4))
    with Servo(scene, choice, effects=["wall"]) as servo:
        servo.start((0.0, 0.0, 0.03))
        _enter(say, "A plate lies 20 mm below the middle of the workspace. Feel it.")


def _enter(say: Callable[[str], None], words: str) -> None:
    say(f"{words} Then press Enter … ")
    _input()


def _confirmed(say: Callable[[str], None], words: str) -> bool:
    say(f"{words}: y and Enter … ")
    return _input().strip().lower().startswith("y")


def _input() -> str:
    try:
        return input()
    except EOFError:
        raise DeviceError("no terminal to read the Enter key from; use --yes to run without waiting") from None
