"""Touch on a page in the browser: what `demo --live` does, and `play` with the device `pointer`."""

import argparse
import math
import time
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import say
from hapscene.command.options import HOST, add_pairs, port
from hapscene.constants import TICK_S
from hapscene.interrupt import interrupt_noted

if TYPE_CHECKING:
    from hapscene.device.driver_registry import DeviceChoice
    from hapscene.play.page_server import PageServer
    from hapscene.scene.scene import Scene
    from hapscene.servo import Servo

TOOLS: Final = 2
"""Fingers that touch at a time [count]: each takes 10 µs of a tick, and two hands are what a person has."""

KIOSK_S: Final = 60.0
"""After how long without input a kiosk is as at the start [s]."""

NAP_S: Final = 0.2


def add_page_options(command: Any) -> None:
    """Where the page is, and what is heard."""
    command.add_argument("--handle", metavar="NAME", help="what plays the vibrations: audio, serial, usb")
    add_pairs(command, "--handle-option", "of the handle")
    command.add_argument("--handle-file", metavar="FILE", help="of `handle identify`: it drives the handle")
    command.add_argument("--kiosk", action="store_true", help=f"all as at the start after {KIOSK_S:g} s without input")
    command.add_argument("--port", type=port, default=0, help="where the page is (default: any that is free)")
    command.add_argument(
        "--host",
        default=HOST,
        metavar="ADDRESS",
        help="to serve at (default 127.0.0.1: this computer alone); 0.0.0.0 for phones in the same network: whoever "
        "has the printed address may touch",
    )
    command.add_argument("--no-browser", action="store_true", help="open no browser; print the address alone")


def chosen_handle(options: argparse.Namespace) -> "DeviceChoice | None":
    """The handle that the options name. Raises DeviceError where it is none, before anything starts."""
    from hapscene.device.driver_registry import DeviceChoice

    if options.handle is None:
        return None
    choice = DeviceChoice(options.handle, dict(options.handle_option))
    choice.checked(handle=True)
    return choice


def play_on_page(scene: "Scene", title: str, options: argparse.Namespace) -> None:
    """Have a scene touched on the page until Ctrl-C. Raises what `open_page` raises, and where the servo has ended."""
    made = {"handle": chosen_handle(options), "handle_file": options.handle_file}
    with opened_page(scene, title, options, made) as servo, interrupt_noted() as noted:
        while not noted():
            time.sleep(NAP_S)
            servo.state()


@contextmanager
def opened_page(scene: "Scene", title: str, options: argparse.Namespace, made: Mapping[str, Any]) -> "Iterator[Servo]":
    """The servo behind a page that is open as the options say (`add_page_options`)."""
    kiosk_s = KIOSK_S if options.kiosk else math.inf
    place = {"host": options.host, "port": options.port, "with_browser": not options.no_browser}
    with open_page(scene, title, kiosk_s=kiosk_s, **place, **made) as (_, servo):
        yield servo


@contextmanager
def open_page(
    scene: "Scene",
    title: str,
    *,
    host: str = HOST,
    port: int = 0,
    kiosk_s: float = math.inf,
    with_browser: bool = True,
    **made: Any,
) -> "Iterator[tuple[PageServer, Servo]]":
    """A page, and the servo that it moves, started and shown there. Its address is printed.

    Args:
        scene: what is touched.
        title, host, port, kiosk_s: as `PageServer` has them.
        with_browser: whether to open the page, too.
        made: more arguments of `Servo`.

    Raises:
        HapsceneError: websockets is missing, the port is taken, or what `Servo` refuses.
    """
    from hapscene.play.page_server import PageServer
    from hapscene.servo import Servo
    from hapscene.touch import step

    place = {"host": host, "port": port, "tick_s": made.get("tick_s", TICK_S)}
    with PageServer(scene, title=title, tools=TOOLS, kiosk_s=kiosk_s, **place) as page, ExitStack() as stack:
        print(f"{page.url}   (Ctrl-C ends)", flush=True)
        if page.public:
            say("open to the network: whoever has this address may touch\n")
        if with_browser:
            webbrowser.open(page.url)
        with step(say, "starting"):  # meanwhile the page shows the picture, and says so
            servo = stack.enter_context(Servo(scene, page.devices, **made))
            servo.start([(0.0, 0.0, 0.0)] * page.tools)
        start_sound(page, servo)
        page.attach(servo)
        yield page, servo


def start_sound(page: "PageServer", servo: "Servo") -> None:
    """Have the page's button and volume be those of the servo's handle, silent at first; there is none without one."""
    if not servo.handle_report():
        return

    def hear(on: bool, volume: float) -> None:
        servo.turn_handle(volume if on else 0.0)

    hear(False, 0.0)
    page.sound = hear
