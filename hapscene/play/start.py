"""Start a servo for `hapscene play`, with a device or with a page in the browser."""

import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from platformdirs import user_state_path

from hapscene.loop import Servo
from hapscene.scene.scene import Scene
from hapscene.touch import step

if TYPE_CHECKING:
    from hapscene.device.driver_registry import DeviceChoice

__all__ = ["log_folder", "on_page", "with_device"]

FINGERS: Final = 2
"""Number of fingers that can touch at the same time on the page [count]: each takes 10 µs of a tick."""


@contextmanager
def with_device(
    scene: Scene,
    devices: "list[str | DeviceChoice]",
    at: tuple[float, float, float] | None,
    say: Callable[[str], None],
    **made: Any,
) -> Iterator[Servo]:
    """A running servo with devices.

    Args:
        scene, devices: see `Servo`.
        at: centre of the devices' workspaces in the scene [m]; None for the centre of the scene's top.
        say: called with progress messages.
        made: further arguments of `Servo`.
    """
    with ExitStack() as stack:
        names = ", ".join(device if isinstance(device, str) else device.name for device in devices)
        with step(say, f"starting {names}"):
            servo = stack.enter_context(Servo(scene, devices, **made))
        servo.start([at or middle_of_top(scene)] * len(devices))
        yield servo


@contextmanager
def on_page(
    scene: Scene, place: Mapping[str, Any], with_browser: bool, say: Callable[[str], None], **made: Any
) -> Iterator[Servo]:
    """A running servo that is controlled by a page.

    Args:
        scene: see `Servo`.
        place: arguments of `PageServer`.
        with_browser: open the page in the browser.
        say: called with the address of the page and progress messages.
        made: further arguments of `Servo`.
    """
    from hapscene.play.page_server import PageServer

    with PageServer(scene, tools=FINGERS, **place) as page, ExitStack() as stack:
        say(f"{page.url}   (Ctrl-C ends)\n")
        if page.public:
            say("open to the network: anyone with this address can touch the scene\n")
        if with_browser:
            webbrowser.open(page.url)
        with step(say, "starting"):  # the page already shows the picture
            servo = stack.enter_context(Servo(scene, page.devices, **made))
            servo.start([(0.0, 0.0, 0.0)] * page.tools)
        if servo.handle_report():
            servo.turn_handle(0.0)  # silent until the page's button turns it on
            page.sound = lambda on, volume: servo.turn_handle(volume if on else 0.0)
        page.attach(servo)
        yield servo


def log_folder() -> Path:
    """Folder of the session logs of this user."""
    return user_state_path("hapscene", appauthor=False) / "logs"


def middle_of_top(scene: Scene) -> tuple[float, float, float]:
    """Centre of the scene in x and y, at the height of its top [m]."""
    corners = [
        body.mesh.vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3] for body in scene.bodies if len(body.mesh.faces)
    ]
    low, high = np.min([c.min(axis=0) for c in corners], axis=0), np.max([c.max(axis=0) for c in corners], axis=0)
    return float((low[0] + high[0]) / 2), float((low[1] + high[1]) / 2), float(high[2])
