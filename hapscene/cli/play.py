"""`hapscene play` and `hapscene serve`: a scene in real time, for a person or for another program."""

import math
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any, Final

from hapscene.cli.console import note, say, tell, tell_over
from hapscene.cli.inputs import check_scene, find_asset, load_input
from hapscene.cli.options import LOCALHOST, Help, MeshOptions, OutputOptions, PageOptions, Pairs, Port, Positive, Vector
from hapscene.cli.paths import base_name
from hapscene.errors import DeviceError, HapsceneError, no_such, printable
from hapscene.interrupt import interrupt_noted

if TYPE_CHECKING:
    from hapscene.loop import Servo
    from hapscene.play.monitor import Monitor

__all__ = ["play", "serve"]

LOG_S: Final = 60.0
"""Length of the session log [s]."""

LOOK_S: Final = 0.1
"""Time between two looks at the servo and the keys [s]."""

QUIET_S: Final = 5.0
"""Time between two lines where standard output is no terminal [s]."""

TIMES: Final = 4
"""Lines of the monitor about force and timing [count], of which the first is shown; warnings follow them."""

KIOSK_S: Final = 60.0
"""Time without input after which a kiosk is reset [s]."""

PORT: Final = 47700
"""Default UDP port; in the range that nobody has registered."""


def play(
    scene: Annotated[str, Help("Scene, mesh, or name of an asset")] = "demo",
    /,
    *,
    device: Annotated[str, Help("Device, of `device list`; pointer is a page in the browser")] = "pointer",
    option: Annotated[Pairs, Help("Options of the device's driver, as firmware=falcon.bin")] = None,
    at: Annotated[Vector, Help("Centre of the device's workspace [m] (default: middle of the scene's top)")] = None,
    force: Annotated[Positive | None, Help("Maximum force [N]; the device's own limit still applies")] = None,
    seconds: Annotated[Positive | None, Help("End after this time [s]")] = None,
    log: Annotated[Path | None, Help("Folder for session logs, written when something breaks")] = None,
    replay: Annotated[Path | None, Help("Replay this session log, and compare its forces bit for bit")] = None,
    kiosk: Annotated[bool, Help("Reset the page after 60 s without input")] = False,
    handle: OutputOptions = OutputOptions(),
    page: PageOptions = PageOptions(),
    mesh: MeshOptions = MeshOptions(),
) -> int:
    """Feel a scene in real time: with a haptic device, or with a pointer on a page and headphones.

    On a terminal: space pauses, f writes the session log, q ends. Forces rise
    within two seconds after the start and after every pause, and end when anything
    breaks.

    for example:
      hapscene play                                     # the demo scene, by mouse
      hapscene play demo.scene.json --handle audio
      hapscene play demo.scene.json --device openhaptics
      hapscene play bunny.ply --unit m --swatch wood --device falcon --force 3
      hapscene play --replay logs/2026-11-23-101500     # the same forces again?
    """
    if replay is not None:
        from hapscene.loop.session_log import replay_log

        result = replay_log(replay)
        tell([f"written because: {printable(result.reason)}", str(result)])
        return 1 if len(result.unlike) else 0
    scene, mesh = find_asset(scene, mesh)
    check_scene(scene, mesh)
    from hapscene.device.driver_registry import DRIVERS, DeviceChoice
    from hapscene.device.model import DEVICES
    from hapscene.play.start import log_folder, on_page, with_device

    chosen: str | DeviceChoice = device
    if device not in (*DEVICES, *DRIVERS.names()):
        raise DeviceError(no_such("device", device, [*DEVICES, *DRIVERS.names()]))
    if device not in DEVICES:
        chosen = DeviceChoice(device, option or {})
        chosen.checked()  # before the scene is loaded
    logs = log or log_folder()
    made: dict[str, Any] = {"handle": handle.chosen(), "handle_file": handle.handle_file, "force_N": force}
    made |= {"ring_s": LOG_S, "log_folder": str(logs)}
    loaded = load_input(scene, mesh)
    if device == "pointer" and not option:
        place = {"title": base_name(scene), "host": page.host, "port": page.port}
        place["kiosk_s"] = KIOSK_S if kiosk else math.inf
        running = on_page(loaded, place, not page.no_browser, say, **made)
    else:
        running = with_device(loaded, chosen, at, say, **made)
    with running as servo:
        if handle.handle is not None:
            say(f"{handle.handle} plays {1e3 * servo.handle_report()['latency_s']:.0f} ms after the tick\n")
        _watch(servo, logs, math.inf if seconds is None else seconds)
    return 0


def _watch(servo: "Servo", logs: Path, seconds: float) -> None:
    """Show how a servo runs until it ends, then its summary; where it fails, its session log is written."""
    from hapscene.play.keys import pressed_keys
    from hapscene.play.monitor import Monitor

    with ExitStack() as stack:
        monitor = Monitor(servo)
        stack.callback(monitor.close)
        keys = stack.enter_context(pressed_keys())
        with interrupt_noted(servo.stop_force) as noted:
            try:
                _show_until_end(servo, monitor, keys, noted, logs, seconds)
            except HapsceneError as error:
                if servo.alive:  # otherwise it has written the log itself
                    raise
                _write_log(servo, logs, str(error))
                raise
            monitor.lines()
        tell(["", *monitor.summary()])


def _show_until_end(
    servo: "Servo",
    monitor: "Monitor",
    keys: Callable[[], str],
    noted: Callable[[], bool],
    logs: Path,
    seconds: float,
) -> None:
    terminal, paused = sys.stdout.isatty(), False
    shown_s = time.monotonic()
    end_s = shown_s + seconds
    while not noted() and time.monotonic() < end_s:
        time.sleep(min(LOOK_S, max(end_s - time.monotonic(), 0.0)))
        for key in keys():
            if key == "q":
                return
            if key == "f":
                _write_log(servo, logs, "asked for")
            if key == " ":
                (servo.resume if paused else servo.pause)()
                paused = not paused
        if not terminal and time.monotonic() - shown_s < QUIET_S:
            continue
        shown_s = time.monotonic()
        lines = monitor.lines()
        line = "; ".join([*lines[:1], *lines[TIMES:], *(["paused: space goes on"] if paused else [])])
        tell_over(line[: get_terminal_size().columns - 1]) if terminal else tell([line])


def _write_log(servo: "Servo", logs: Path, reason: str) -> None:
    from hapscene.loop.session_log import write_log

    note(write_log(servo.session_log(reason), str(logs)))


def serve(
    scene: Annotated[str, Help("Scene, mesh, MuJoCo model (.xml), or name of an asset")],
    /,
    *,
    udp: Annotated[Port, Help("UDP port; 0 for any free one")] = PORT,
    ws: Annotated[Port | None, Help("WebSocket port; 0 for any free one (default: no WebSocket)")] = None,
    host: Annotated[str, Help("Address to listen at")] = LOCALHOST,
    device: Annotated[str, Help("Simulated device, or a driver's name")] = "omni",
    mesh: MeshOptions = MeshOptions(),
) -> None:
    """Render touch for another program, over UDP and WebSocket.

    A game engine or simulator moves the bodies, and receives forces and contacts.
    docs/bridge-protocol.md has the packets; examples/engines has a client for each
    of several languages, and a page that tunes, paints, adds and removes bodies.
    Of a MuJoCo model the bodies are served; their physics is the other program's.

    for example:
      hapscene serve cup.scene.json --ws 47701
      hapscene serve crate.stl --unit m --swatch wood --device premium-1.5
    """
    scene, mesh = find_asset(scene, mesh)
    from hapscene.bridge.orders import Orders
    from hapscene.bridge.server import BridgeServer
    from hapscene.bridge.web_door import WebDoor
    from hapscene.loop import Servo
    from hapscene.touch import step

    loaded = load_input(scene, mesh, device)
    with ExitStack() as stack:
        orders = Orders(servo := Servo(loaded, device))
        server = stack.enter_context(BridgeServer(orders, host, udp))
        door = None if ws is None else WebDoor(server, host, ws)
        with step(say, f"starting the {device}"):
            stack.enter_context(servo)
        stack.enter_context(orders)
        with interrupt_noted() as noted:
            say(f"udp {server.address[0]}:{server.address[1]}   (Ctrl-C ends)\n")
            if door is not None:
                stack.enter_context(door)
                say(f"ws://{door.address[0]}:{door.address[1]}\n")
            if not server.address[0].startswith("127."):
                say("open to the network: whoever sends first from anywhere moves what is felt\n")
            server.serve(noted)
        counts = ", ".join(f"{name} {count:,}" for name, count in sorted(orders.counts.items()))
    say(f"ended; {counts or 'no client connected'}\n")
