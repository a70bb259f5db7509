"""`hapscene play` and `hapscene replay`."""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from shutil import get_terminal_size
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import note, say, tell
from hapscene.command.live import add_page_options, chosen_handle, opened_page
from hapscene.command.options import (
    add_command,
    add_mesh_options,
    add_pairs,
    base_name,
    check_scene,
    load_input,
    number,
    reading,
    vector,
)
from hapscene.errors import Codes, HapsceneError, printable
from hapscene.interrupt import interrupt_noted

if TYPE_CHECKING:
    from hapscene.servo import Servo

FLIGHT_S: Final = 60.0
"""How much of the past is kept [s]."""

LOOK_S: Final = 0.25
"""How often the terminal is brought up to date [s]."""

QUIET_S: Final = 5.0
"""And how often a line is written where there is no terminal [s]."""

TIMES: Final = 4
"""Lines of the monitor that say what is felt, and how well time is kept [count]; what troubles follows."""


def add_play(commands: Any) -> None:
    command = add_command(commands, "play", _play)
    command.add_argument("scene", metavar="SCENE", help="a scene, or a mesh")
    command.add_argument(
        "--device", default="pointer", metavar="NAME",
        help="`hapscene devices` lists them; default: pointer, a page in the browser",
    )  # fmt: skip
    add_pairs(command, "--option", "of it")
    command.add_argument(
        "--at", type=vector, metavar="X,Y,Z",
        help="where the middle of its workspace lies in the scene, in m (default: the middle of the top)",
    )  # fmt: skip
    command.add_argument(
        "--force", type=number("a force in N", 0.0), metavar="N", help="give no more than this; the device's own holds"
    )
    command.add_argument("--seconds", type=number("seconds", 0.0), metavar="S", help="end by itself")
    command.add_argument(
        "--flights", metavar="FOLDER", help="where the last minute is written when something breaks (default: yours)"
    )
    add_mesh_options(command)
    add_page_options(command.add_argument_group("what is heard, and the page"))


def _play(options: argparse.Namespace) -> int:
    """Feel a scene with what stands on the desk: a haptic device, a handle, or a pointer and headphones.

    On a terminal: space pauses, f writes the last minute down, q ends. Forces rise within two seconds after the start
    and after every pause, and end when anything breaks.

    for example:
      hapscene play demo.scene.json --handle audio
      hapscene play demo.scene.json --device openhaptics
      hapscene play bunny.ply --unit m --swatch wood --device falcon --option firmware=falcon.bin --force 3
    """
    check_scene(options.scene, options.unit, options.swatch)
    from hapscene.device.driver_registry import DeviceChoice
    from hapscene.device.model import DEVICES
    from hapscene.play.monitor import Monitor

    told: dict[str, Any] = dict(options.option)
    device: Any = options.device
    if device not in DEVICES:
        device = DeviceChoice(device, told)
        device.checked()  # refused before the scene is read
    handle = chosen_handle(options)
    scene = load_input(options.scene, options.unit, options.swatch, options.two_sided, **reading(options))
    made = {
        "handle": handle,
        "handle_file": options.handle_file,
        "ring_s": FLIGHT_S,
        "log_folder": options.flights or flights_folder(),
        "force_N": options.force,
    }
    with ExitStack() as stack:
        if options.device == "pointer" and not told:
            servo = stack.enter_context(opened_page(scene, base_name(options.scene), options, made))
        else:
            servo = stack.enter_context(_started(scene, device, options.at or middle_of_top(scene), made))
        if handle is not None:
            latency_s = servo.handle_report()["latency_s"]
            say(f"{options.handle} plays {1e3 * latency_s:.0f} ms after the tick\n")
        monitor = Monitor(servo)
        stack.callback(monitor.close)
        keys = stack.enter_context(_keys())
        with interrupt_noted() as noted:
            try:
                _watch(servo, monitor, keys, noted, options)
            except HapsceneError as error:
                if servo.alive:  # else it has written it itself
                    raise
                _write(servo, made["log_folder"], str(error))
                raise
            monitor.lines()
        tell(monitor.summary())
    return 0


@contextmanager
def _started(scene: Any, device: Any, at: Sequence[float], made: Mapping[str, Any]) -> "Iterator[Servo]":
    """A servo that runs, the middle of its workspace at a place."""
    from hapscene.servo import Servo
    from hapscene.touch import step

    name = device if isinstance(device, str) else device.name
    with ExitStack() as stack:
        with step(say, f"starting {name}"):
            servo = stack.enter_context(Servo(scene, device, **made))
        servo.start(at)
        yield servo


def _watch(servo: "Servo", monitor: Any, keys: Callable[[], str], noted: Any, options: argparse.Namespace) -> None:
    """Show what happens until it ends."""
    terminal, count, paused = sys.stdout.isatty(), 0, False
    told_s = time.monotonic()
    end_s = told_s + (float("inf") if options.seconds is None else options.seconds)
    while not noted() and time.monotonic() < end_s:
        time.sleep(min(LOOK_S, max(end_s - time.monotonic(), 0.0)))
        for key in keys():
            if key == "q":
                return
            if key == "f":
                count = _erase(count)
                _write(servo, options.flights or flights_folder(), "asked for")
            if key == " ":
                (servo.resume if paused else servo.pause)()
                paused = not paused
        if not terminal and time.monotonic() - told_s < QUIET_S:
            continue
        lines = monitor.lines() + (["paused: space goes on"] if paused else [])
        told_s = time.monotonic()
        if not terminal:
            tell(["; ".join(lines[:1] + lines[TIMES:])])
            continue
        # what the terminal broke by itself could not be counted
        lines = [part for line in lines for part in wrap(printable(line), get_terminal_size().columns - 1)]
        _erase(count)
        tell(lines)
        count = len(lines)


def _erase(count: int) -> int:
    """Take so many lines off the terminal; how many are left: none."""
    sys.stdout.write(Codes(f"\x1b[{count}F\x1b[J" if count else ""))
    sys.stdout.flush()
    return 0


def _write(servo: "Servo", folder: str, reason: str) -> None:
    """Write the last minute, and say where."""
    from hapscene.servo.session_log import write_log

    note(write_log(servo.session_log(reason), folder))


def flights_folder() -> str:
    """Where flights of this user lie."""
    from platformdirs import user_state_path

    return str(user_state_path("hapscene", appauthor=False) / "flights")


def middle_of_top(scene: Any) -> tuple[float, float, float]:
    """The middle of a scene, at the height of its top: what a hand reaches first."""
    import numpy as np

    corners = [
        body.mesh.vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3] for body in scene.bodies if len(body.mesh.faces)
    ]
    low, high = np.min([c.min(axis=0) for c in corners], axis=0), np.max([c.max(axis=0) for c in corners], axis=0)
    return float((low[0] + high[0]) / 2), float((low[1] + high[1]) / 2), float(high[2])


@contextmanager
def _keys() -> Iterator[Callable[[], str]]:
    """What tells the keys that were pressed since it was last asked, on a terminal that can say it."""
    try:
        import select
        import termios
        import tty

        fd = sys.stdin.fileno()
        before = termios.tcgetattr(fd)
        if os.tcgetpgrp(fd) != os.getpgrp():  # in the background, who sets the terminal is stopped
            raise OSError
    except (ImportError, OSError, ValueError, termios.error):
        yield lambda: ""
        return

    def keys() -> str:
        pressed = b""
        with suppress(OSError):  # the terminal is gone
            while select.select([fd], [], [], 0.0)[0] and (read := os.read(fd, 64)):
                pressed += read
        return pressed.decode("ascii", "ignore")

    tty.setcbreak(fd)
    try:
        yield keys
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)


def add_replay(commands: Any) -> None:
    command = add_command(commands, "replay", _replay)
    command.add_argument("flight", metavar="FLIGHT", help="a folder that `hapscene play` wrote")


def _replay(options: argparse.Namespace) -> int:
    """Fly the last minute of a servo again: say whether the same inputs give the same forces, to the bit.

    for example:
      hapscene replay flights/2026-11-23-101500
    """
    from hapscene.servo.session_log import replay_log

    result = replay_log(options.flight)
    tell([f"written because: {printable(result.reason)}", str(result)])
    return 1 if len(result.unlike) else 0
