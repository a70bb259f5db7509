"""`hapscene device try`: the first run with a device, step by step, each before the next can hurt.

Looks, then moves, then pushes, never with more than `FORCE_N` until that is confirmed; the servo's safety is between.
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
from hapscene.play.monitor import WHY
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

__all__ = ["FORCE_N", "try_device"]

FORCE_N: Final = 0.5
"""Most force before more is confirmed [N]: a 50 g weight, which no grip loses."""

PUSH_N: Final = 0.3
"""Force of the first push [N]: twice what a hand on a device notices."""

READY_S: Final = 60.0
"""How long a device may take to be calibrated or homed [s]."""

LOOK_S: Final = 4.0
"""How long a movement, or a force, is looked at [s]: the ramp is 2."""

MOVED_MM: Final = 1.0
"""Least way of a handle that is moved [mm]: more than encoders flicker."""

MISSED_MAX: Final = 0.01
"""Largest share of ticks that may be missed [1]: some are on a machine that does much else."""

GRAVITY_M_S2: Final = 9.81


def try_device(name: str, options: Mapping[str, Any], say: Callable[[str], None], wait: bool = True) -> int:
    """Try a device; returns 0 where all was as it should be, else 1.

    Args:
        name: of its driver.
        options: of the driver.
        say: is given what is to be told; a line that waits for an answer has no end.
        wait: each step begins when Enter is pressed; without, nothing over `FORCE_N` is given.

    Raises:
        DeviceError: it cannot be opened, is not ready in time, or goes away.
    """
    driver = DRIVERS.load(name)
    say(f"{driver.name}: {driver.summary}\n")
    for one in driver.assumptions:
        say(f"  assumed, not yet seen on one: {one}\n")
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
            pause(f"Hold it loosely, in the middle. A weight of {weight_g:.0f} g comes onto it, slowly.")
            report += _look_at_push(servo, say)
            servo.pause()
            report.append(("no force in a pause", not np.any(servo.device_state().f_D_N)))
    if driver.force and wait and _asks(say, "All as it should be? Then feel a wall, with the device's own force"):
        _feel_wall(choice, say)
    for words, good in report:
        say(f"  {'good' if good else 'NOT AS IT SHOULD BE'}: {words}\n")
    return 0 if all(good for _, good in report) else 1


def _plate() -> Scene:
    """Something far below, so that nothing is touched."""
    scene = Scene()
    pose = np.eye(4)
    pose[2, 3] = -10.0
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.3, 0.3, 0.02)), "m"), name="plate", pose=pose)
    return scene


def _await_ready(servo: Servo, needs: str, say: Callable[[str], None]) -> None:
    end_s = time.monotonic() + READY_S
    said = ""
    while servo.device_state().ready == 0:
        notice = servo.notice or "waiting until it is calibrated"
        if notice != said:
            say(f"{notice}\n")
            said = notice
        if time.monotonic() > end_s:
            raise DeviceError(f"not ready after {READY_S:g} s: {notice}" + (f"; it needs {needs}" if needs else ""))
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
    told = [
        (f"{rate_Hz:.0f} positions a second", rate_Hz > 100.0),
        (
            "moved {:.0f} mm along x, {:.0f} along y, {:.0f} along z".format(*way_mm),
            bool(driver.simulated or way_mm.max() > MOVED_MM),  # where nobody moves it, nothing is known of it
        ),
        (f"largest step {steps_mm.max():.2f} mm a tick", bool(steps_mm.max() < 1e3 * driver.speed_m_s * servo.tick_s)),
        (f"{worst.missed} of {len(p)} ticks missed", worst.missed <= MISSED_MAX * len(p)),
    ]
    told += [(why, False) for flag, why in WHY.items() if flags & flag & ~int(Flag.RAMPED)]
    return told


def _look_at_push(servo: Servo, say: Callable[[str], None]) -> list[tuple[str, bool]]:
    servo.tune_field("weight", mass_kg=PUSH_N / GRAVITY_M_S2)
    first = servo.state().tick
    time.sleep(LOOK_S)
    sent = servo.device_state().f_D_N
    log = servo.read(first)
    p = log.rows["p_WT_m"]
    sank_mm = 1e3 * float(p[0, 2] - p[-1, 2])
    servo.tune_field("weight", mass_kg=0.0)
    say(f"it sank by {sank_mm:.1f} mm\n")
    flags = int(np.bitwise_or.reduce(log.rows["flags"][-100:]))
    told = [(f"{PUSH_N} N asked for, {-sent[2]:.2f} N sent, downwards", abs(-sent[2] - PUSH_N) < 0.05)]
    return told + [(why, False) for flag, why in WHY.items() if flags & flag]


def _feel_wall(choice: DeviceChoice, say: Callable[[str], None]) -> None:
    scene = _plate()
    scene.pose("plate", np.eye(4))
    with Servo(scene, choice, effects=["wall"]) as servo:
        servo.start((0.0, 0.0, 0.03))
        _enter(say, "A plate lies 20 mm below the middle of the workspace. Feel it; Enter ends.")


def _enter(say: Callable[[str], None], words: str) -> None:
    say(f"{words} Then press Enter … ")
    _input()


def _asks(say: Callable[[str], None], words: str) -> bool:
    say(f"{words}: y and Enter … ")
    return _input().strip().lower().startswith("y")


def _input() -> str:
    try:
        return input()
    except EOFError:
        raise DeviceError("nobody is there to press Enter; --yes goes on by itself") from None
