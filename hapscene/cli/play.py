"""`hapscene play` and `hapscene serve`: real-time rendering of a scene for a user or for another program."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any, Final

from hapscene.cli.console import print_in_place, print_lines, print_note, print_progress
from hapscene.cli.inputs import base_name, check_scene, find_asset, load_input
from hapscene.cli.options import (
    LOCALHOST,
    Help,
    MeshOptions,
    OutputOptions,
    PageOptions,
    Pairs,
    Port,
    Positive,
    TipRadius,
    Vector,
)
from hapscene.errors import DeviceError, HapsceneError, no_such, printable
from hapscene.interrupt import interrupt_noted

if TYPE_CHECKING:
    from hapscene.device.driver_registry import DeviceChoice
    from hapscene.loop import Servo
    from hapscene.play.monitor import Monitor
    from hapscene.scene.scene import Scene

__all__ = ["play", "serve"]

LOG_S: Final = 60.0
"""Length of the session log [s]."""

FINGERS: Final = 2
"""Number of fingers that can touch at the same time on the page [count]: each takes 10 µs of a tick."""

POLL_S: Final = 0.1
"""Polling interval of the servo and the keyboard [s]."""

QUIET_S: Final = 5.0
"""Interval between status lines if standard output is not a terminal [s]."""

KIOSK_S: Final = 60.0
"""Time without input after which --kiosk resets the page [s]."""

PORT: Final = 47700
"""Default UDP port, not registered with IANA."""


def play(
    scene: Annotated[str, Help("Scene, mesh, or name of an asset")] = "demo",
    /,
    *,
    device: Annotated[
        list[str] | None,
        Help("Device from `device list`; pointer (default) is the mouse, on a page; repeat for several"),
    ] = None,
    option: Annotated[
        Pairs, Help("Options of the device driver, as firmware=falcon.bin; 2.name=Left: second device")
    ] = None,
    at: Annotated[Vector, Help("Centre of the device workspace [m] (default: middle of the scene's top)")] = None,
    force: Annotated[Positive | None, Help("Maximum force [N]; the limit of the device still applies")] = None,
    seconds: Annotated[Positive | None, Help("Duration of the session [s] (default: until Ctrl-C)")] = None,
    log: Annotated[Path | None, Help("Folder for session logs, which are written on a fault or by key f")] = None,
    replay: Annotated[Path | None, Help("Session log to replay; its forces are compared bit for bit")] = None,
    kiosk: Annotated[bool, Help("Reset the page after 60 s without input")] = False,
    handle: OutputOptions = OutputOptions(),
    page: PageOptions = PageOptions(),
    mesh: MeshOptions = MeshOptions(),
) -> int:
    """Touch a scene in real time, with haptic devices or with the mouse on a page.

    The page plays vibrations as sound; use headphones. Keys in the terminal: space
    pauses, h calibrates a device at its home position, r opens devices again after
    a fault, f writes the session log, q ends. The force rises within two seconds
    after the start and after each pause, and drops to zero on any fault.

    Exit codes with --replay: 0 the forces are equal; 1 they differ.

    examples:
      hapscene play                                     # demo scene, by mouse
      hapscene play demo.scene.json --handle audio
      hapscene play demo.scene.json --device openhaptics --device falcon
    """
    if replay is not None:
        return _replay(replay)
    scene, mesh = find_asset(scene, mesh)
    check_scene(scene, mesh)
    from platformdirs import user_state_path

    chosen = _devices(device or ["pointer"], option or {})
    logs = log or user_state_path("hapscene", appauthor=False) / "logs"
    made: dict[str, Any] = {"handle": handle.chosen(), "handle_file": handle.handle_file, "force_N": force}
    made |= {"ring_s": LOG_S, "log_folder": str(logs)}
    loaded = load_input(scene, mesh)
    if device in (None, ["pointer"]) and not option:
        if at is not None:
            raise DeviceError("--at: expected a --device, whose workspace it places; the page shows the whole scene")
        running = _on_page(loaded, base_name(scene), page, KIOSK_S if kiosk else math.inf, **made)
    else:
        running = _with_devices(loaded, chosen, at, **made)
    with running as servo:
        if handle.handle is not None:
            print_progress(f"latency of {handle.handle}: {1e3 * servo.handle_report()['latency_s']:.0f} ms\n")
        _watch(servo, logs, math.inf if seconds is None else seconds)
    return 0


@contextmanager
def _with_devices(
    scene: "Scene", devices: "list[str | DeviceChoice]", at: tuple[float, float, float] | None, **made: Any
) -> Iterator["Servo"]:
    """A running servo with devices, whose workspaces have their centres at `at` [m]; by default the middle of the top.

    `made` has further arguments of `Servo`.
    """
    from hapscene.loop import Servo
    from hapscene.touch import step

    with ExitStack() as stack:
        names = ", ".join(device if isinstance(device, str) else device.name for device in devices)
        with step(print_progress, f"starting {names}"):
            servo = stack.enter_context(Servo(scene, devices, **made))
        servo.start([at or middle_of_top(scene)] * len(devices))
        yield servo


@contextmanager
def _on_page(scene: "Scene", title: str, options: PageOptions, kiosk_s: float, **made: Any) -> Iterator["Servo"]:
    """A running servo that is controlled by a page. `made` has further arguments of `Servo`."""
    import webbrowser

    from hapscene.loop import Servo
    from hapscene.play.page_server import PageServer
    from hapscene.touch import step

    server = PageServer(scene, tools=FINGERS, title=title, host=options.host, port=options.port, kiosk_s=kiosk_s)
    with server as page, ExitStack() as stack:
        print_progress(f"{page.url}   (Ctrl-C ends)\n")
        if page.public:
            print_progress("open to the network: anyone with this address can touch the scene\n")
        if not options.no_browser:
            webbrowser.open(page.url)
        with step(print_progress, "starting"):  # the page already shows the picture
            servo = stack.enter_context(Servo(scene, page.devices, **made))
            servo.start([(0.0, 0.0, 0.0)] * page.tools)
        if servo.handle_report():
            servo.turn_handle(0.0)  # silent until the page's button turns it on
            page.sound = lambda on, volume: servo.turn_handle(volume if on else 0.0)
        page.attach(servo)
        yield servo


def middle_of_top(scene: "Scene") -> tuple[float, float, float]:
    """Centre of the scene in x and y, at the height of its top [m]."""
    import numpy as np

    corners = [
        body.mesh.vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3] for body in scene.bodies if len(body.mesh.faces)
    ]
    low, high = np.min([c.min(axis=0) for c in corners], axis=0), np.max([c.max(axis=0) for c in corners], axis=0)
    return float((low[0] + high[0]) / 2), float((low[1] + high[1]) / 2), float(high[2])


def _replay(path: Path) -> int:
    """Replay a session log; return 1 if the forces differ from the logged ones."""
    from hapscene.loop.session_log import replay_log

    result = replay_log(path)
    print_lines([f"reason of the log: {printable(result.reason)}", str(result)])
    return 1 if len(result.unlike) else 0


def _devices(names: list[str], options: dict[str, str]) -> "list[str | DeviceChoice]":
    """Simulated devices by name, and drivers with their checked options; K.NAME is an option of the K-th device."""
    from hapscene.device.driver_registry import DRIVERS, DeviceChoice
    from hapscene.device.model import DEVICES

    chosen: list[str | DeviceChoice] = []
    for number, name in enumerate(names, 1):
        if name not in (*DEVICES, *DRIVERS.names()):
            raise DeviceError(no_such("device", name, [*DEVICES, *DRIVERS.names()]))
        own = {key.removeprefix(f"{number}."): value for key, value in options.items()}
        choice = DeviceChoice(name, {key: value for key, value in own.items() if not key[:1].isdigit()})
        if name not in DEVICES:
            choice.checked()
        chosen.append(name if name in DEVICES else choice)
    takers = [str(number) for number, name in enumerate(names, 1) if name not in DEVICES]
    for key in options:
        if not takers or (key[:1].isdigit() and key.partition(".")[0] not in takers):
            numbers = f"of device {' or '.join(takers)}" if takers else "only of drivers in `device list`"
            raise DeviceError(f"--option {key}: no such device with options; expected an option {numbers}")
    return chosen


def _watch(servo: "Servo", logs: Path, seconds: float) -> None:
    """Show the status of a servo until it ends, then a summary. If the servo fails, write its session log."""
    from hapscene.play.monitor import Monitor, pressed_keys

    monitor = Monitor(servo)
    with pressed_keys() as keys:
        with interrupt_noted(servo.stop_force) as noted:
            try:
                _show_until_end(servo, monitor, keys, noted, logs, seconds)
            except HapsceneError as error:
                if servo.alive:  # a servo that has ended wrote the log itself
                    raise
                _write_log(servo, logs, str(error))
                raise
        print_lines(["", *monitor.summary()])


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
        time.sleep(min(POLL_S, max(end_s - time.monotonic(), 0.0)))
        for key in keys():
            if key == "q":
                return
            if key == "f":
                _write_log(servo, logs, "key f was pressed")
            if key == " " and servo.mode != "error":
                (servo.resume if paused else servo.pause)()
                paused = not paused
            if key == "h":
                _try(servo.home)
            if key == "r" and servo.mode == "error":
                _try(servo.recover, servo.resume)
        if not terminal and time.monotonic() - shown_s < QUIET_S:
            continue
        shown_s = time.monotonic()
        try:
            lines = monitor.lines()
        except DeviceError as error:
            if not terminal:
                raise
            lines = [f"{error}; press r to open it again, q to end"]
        line = "; ".join([*lines, *(["paused: press space to resume"] if paused else [])])
        print_in_place(line[: get_terminal_size().columns - 1]) if terminal else print_lines([line])


def _try(*actions: Callable[[], object]) -> None:
    """Call functions one after the other; print an error of theirs."""
    try:
        for act in actions:
            act()
    except HapsceneError as error:
        print_note(str(error))


def _write_log(servo: "Servo", logs: Path, reason: str) -> None:
    from hapscene.loop.session_log import write_log

    print_note(write_log(servo.session_log(reason), str(logs)))


def serve(
    scene: Annotated[str, Help("Scene, mesh, MuJoCo model (.xml), or name of an asset")],
    /,
    *,
    udp: Annotated[Port, Help("UDP port; 0 selects a free one")] = PORT,
    ws: Annotated[Port | None, Help("WebSocket port; 0 selects a free one (default: no WebSocket)")] = None,
    host: Annotated[str, Help("Address to listen at")] = LOCALHOST,
    device: Annotated[str, Help("Name of a simulated device or of a driver")] = "omni",
    tools: Annotated[int, Help("Number of tools, each for one client")] = 1,
    tip_radius: TipRadius = 0.0,
    mesh: MeshOptions = MeshOptions(),
) -> None:
    """Render touch for another program, over UDP and WebSocket.

    A game engine or simulator sends the poses of bodies, and receives forces and
    contacts. docs/reference/bridge-protocol.md specifies the packets. The folder
    examples/engines has clients in several languages, and a page that tunes,
    paints, adds and removes bodies. A MuJoCo model is served without its physics.

    examples:
      hapscene serve cup.scene.json --ws 47701
      hapscene serve crate.stl --unit m --swatch wood --device premium-1.5
    """
    scene, mesh = find_asset(scene, mesh)
    from hapscene.bridge.orders import Orders
    from hapscene.bridge.server import BridgeServer
    from hapscene.bridge.websocket import WebSocketBridge
    from hapscene.loop import Servo
    from hapscene.touch import step

    if tools < 1:
        raise DeviceError(f"--tools {tools}: expected at least 1")
    loaded = load_input(scene, mesh, device)
    with ExitStack() as stack:
        orders = Orders(servo := Servo(loaded, [device] * tools, progress=print_progress, tip_radius_m=tip_radius))
        server = stack.enter_context(BridgeServer(orders, host, udp))
        websocket = None if ws is None else WebSocketBridge(server, host, ws)
        with step(print_progress, f"starting the {device}"):
            stack.enter_context(servo)
        stack.enter_context(orders)
        with interrupt_noted() as noted:
            print_progress(f"udp {server.address[0]}:{server.address[1]}   (press Ctrl-C to end)\n")
            if websocket is not None:
                stack.enter_context(websocket)
                print_progress(f"ws://{websocket.address[0]}:{websocket.address[1]}\n")
            if not server.address[0].startswith("127."):
                print_progress("open to the network: the first client that sends a packet controls the bodies\n")
            server.serve(noted)
        counts = ", ".join(f"{name} {count:,}" for name, count in sorted(orders.counts.items()))
    print_progress(f"ended; {counts or 'no client connected'}\n")
