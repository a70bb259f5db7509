"""`hapscene device try`: the first run with a device, in steps of increasing risk.

The steps check the position, then movement, then a small force. The force is limited to `FORCE_N`, and the safety
functions of the servo apply.
"""

import time
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import trimesh
from numpy.typing import NDArray

from hapscene.device.driver import Driver, OptionValue
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.errors import DeviceError
from hapscene.flags import Flag
from hapscene.loop import Servo
from hapscene.play.monitor import FLAG_TEXTS
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

__all__ = ["FORCE_N", "try_device"]

FORCE_N: Final = 0.5
"""Force limit [N]: the weight of 50 g."""

PUSH_N: Final = 0.3
"""Force of the first push [N]: twice what a hand on a device notices (assumed)."""

READY_S: Final = 60.0
"""Time limit for calibration or homing [s]."""

LOOK_S: Final = 4.0
"""Duration of a measurement of movement [s]."""

PUSH_S: Final = 15.0
"""Longest time until the full force of the push is sent [s]. The ramp takes 2 s, and starts again after each delay of a
busy computer."""

REST_S: Final = 1.0
"""Time for the handle to come to rest under the full force [s]."""

MOVED_MM: Final = 1.0
"""Smallest movement of the handle that counts [mm]: above encoder noise."""

MISSED_MAX: Final = 0.01
"""Fraction of missed ticks from which on the computer counts as busy [1]."""

GRAVITY_M_S2: Final = 9.81


def try_device(name: str, options: Mapping[str, OptionValue], say: Callable[[str], None], wait: bool = True) -> int:
    """Try a device; returns 0 if all checks passed, else 1.

    Args:
        name: name of the driver.
        options: options of the driver.
        say: called with output; a prompt has no newline at the end.
        wait: wait for Enter before each step.

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
        _await_ready(servo, driver, pause, say)
        pause("Move the handle slowly through its whole workspace: left and right, near and far, up and down.")
        report += _look_at_moves(servo, driver, say)
        if driver.force:
            weight_g = 1e3 * PUSH_N / GRAVITY_M_S2
            pause(f"Hold the handle loosely in the middle. A weight of {weight_g:.0f} g will slowly pull it down.")
            report += _look_at_push(servo, say)
            servo.pause()
            report.append(("no force while paused", not np.any(servo.device_state().f_D_N)))
    for words, good in report:
        say(f"  {'ok' if good else 'FAILED'}: {words}\n")
    return 0 if all(good for _, good in report) else 1


def _plate() -> Scene:
    """A scene with a plate below any workspace, so that there is no contact."""
    scene = Scene()
    pose = np.eye(4)
    pose[2, 3] = -1.0
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.3, 0.3, 0.02)), "m"), name="plate", pose=pose)
    return scene


def _await_ready(servo: Servo, driver: Driver, pause: Callable[[str], None], say: Callable[[str], None]) -> None:
    end_s = time.monotonic() + READY_S
    shown = ""
    while servo.device_state().ready == 0:
        if driver.home and servo.device_state().trouble:
            pause(f"Calibration: {driver.home}.")
            servo.home()
            end_s = time.monotonic() + READY_S
        notice = servo.notice or "waiting for calibration"
        if notice != shown:
            say(f"{notice}\n")
            shown = notice
        if time.monotonic() > end_s:
            hint = f"; the device requires {driver.needs}" if driver.needs else ""
            raise DeviceError(f"the device is not ready after {READY_S:g} s: {notice}{hint}")
        time.sleep(0.05)
    say("ready\n")


def _look_at_moves(servo: Servo, driver: Driver, say: Callable[[str], None]) -> list[tuple[str, bool]]:
    first = servo.state().tick
    late = servo.timing()
    count, begin_s = int(servo.device_state().count), time.monotonic()
    time.sleep(LOOK_S)
    count, elapsed_s = int(servo.device_state().count) - count, time.monotonic() - begin_s
    log = servo.read(first)
    p = log.rows["p_WT_m"]
    way_mm = 1e3 * (p.max(axis=0) - p.min(axis=0))
    rate_Hz = count / elapsed_s
    missed = servo.timing().since(late).missed
    if missed > MISSED_MAX * len(p):
        say(f"the computer is busy: {missed} of {len(p)} ticks missed their deadline; close other programs\n")
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
    ]
    return checks + _problems(log.rows["flags"])


def _look_at_push(servo: Servo, say: Callable[[str], None]) -> list[tuple[str, bool]]:
    servo.tune_field("weight", mass_kg=PUSH_N / GRAVITY_M_S2)
    first = servo.state().tick
    sent_N, end_s = 0.0, time.monotonic() + PUSH_S
    while abs(sent_N - PUSH_N) > 0.01 and time.monotonic() < end_s:
        time.sleep(0.1)
        sent_N = -float(servo.device_state().f_D_N[2])
    time.sleep(REST_S)
    log = servo.read(first)
    p = log.rows["p_WT_m"]
    sank_mm = 1e3 * float(p[0, 2] - p[-1, 2])
    servo.tune_field("weight", mass_kg=0.0)
    say(f"the handle moved down by {sank_mm:.1f} mm\n")
    checks = [(f"commanded {PUSH_N} N, sent {sent_N:.2f} N downwards", abs(sent_N - PUSH_N) < 0.05)]
    return checks + _problems(log.rows["flags"][-100:])


def _problems(flags: NDArray[np.integer]) -> list[tuple[str, bool]]:
    """Flags of the device in some ticks, without those of a ramp and of a busy computer."""
    seen = int(np.bitwise_or.reduce(flags)) & ~int(Flag.RAMPED | Flag.STALLED | Flag.APPLICATION_SILENT)
    return [(text, False) for flag, text in FLAG_TEXTS.items() if seen & flag]


def _enter(say: Callable[[str], None], words: str) -> None:
    say(f"{words} Press Enter to continue … ")
    _input()


def _input() -> str:
    try:
        return input()
    except EOFError:
        raise DeviceError("standard input is closed: run the command in a terminal, or use --yes") from None
