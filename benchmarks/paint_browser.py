"""The painter's page in a real browser, Chromium, drawn by the processor, cut off from the net; and its hand."""

import asyncio
import math
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import ViewError
from hapscene.paint.model.session import Session
from hapscene.paint.web.page import Page
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

RADIUS_M: Final = 0.03
"""Of the ball that is painted [m]."""

SIZE: Final = {"width": 1280, "height": 800}

ARGUMENTS: Final = (
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
)

PATIENCE_S: Final = 120.0
"""How long anything in the browser may take [s]."""

SETTLE_S: Final = 5.0
"""From when the page is there until all of the mesh is drawn, and what the start left is done [s]."""

LOADED: Final = "window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.hand === 'ready'"

FRAMES: Final = """
window.frame_count = 0;
for (const kind of [WebGLRenderingContext, WebGL2RenderingContext]) {
  const draw = kind.prototype.drawElements;
  let last = -1;
  kind.prototype.drawElements = function (...what) {
    const now = document.timeline.currentTime;
    if (now !== last) { last = now; window.frame_count += 1; }
    return draw.apply(this, what);
  };
}
"""
"""Counts the frames in which something is drawn."""


def find_chromium() -> str | None:
    """The system's Chromium, or Chrome; None where there is none."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@contextmanager
def browser() -> Iterator[Any]:
    """A browser, of playwright's.

    Raises:
        ViewError: Chromium or playwright is missing.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise ViewError("playwright is missing: pip install 'hapscene[dev]'") from None
    path = find_chromium()
    if path is None:
        raise ViewError("no browser to measure in: apt-get install chromium")
    with sync_playwright() as runner:
        found = runner.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        try:
            yield found
        finally:
            found.close()


@contextmanager
def ball_page(subdivisions: int) -> Iterator[Page]:
    """The page of a ball of wood of 20·4^subdivisions triangles, epoxy at hand, and a hand that is ready.

    Raises:
        ViewError: viser is missing, or the hand does not get ready.
    """
    from trimesh.creation import icosphere

    scene = Scene()
    scene.add(Mesh.from_trimesh(icosphere(subdivisions=subdivisions, radius=RADIUS_M), "m"), name="ball", swatch="wood")
    scene.swatch_index("epoxy")
    with tempfile.TemporaryDirectory() as folder:
        session = Session(scene, Path(folder) / "ball.scene.json")
        with Page(session, port=0, with_autosave=False) as page:
            until(lambda: page.context.touch.status == "ready", "the painter's hand does not get ready")
            yield page


def until(true: Callable[[], bool], otherwise: str) -> None:
    """Wait for something that another thread or process does in its own time.

    Raises:
        ViewError: with the words `otherwise`, where it never comes true.
    """
    end_s = time.monotonic() + PATIENCE_S
    while not true():
        if time.monotonic() > end_s:
            raise ViewError(otherwise)
        time.sleep(0.01)


def open_tab(chromium: Any, page: Page, *scripts: str) -> Any:
    """A tab with the page, all of it drawn; `scripts` run before the page's own."""
    tab = chromium.new_page(viewport=SIZE)
    tab.set_default_timeout(1e3 * PATIENCE_S)
    for script in (FRAMES, *scripts):
        tab.add_init_script(script)
    tab.goto(page.url)
    tab.wait_for_function(LOADED)
    tab.wait_for_timeout(1e3 * SETTLE_S)
    return tab


def do(page: Page, act: Callable[[], Any]) -> Any:
    """Have something done in the page's event loop; returns its result."""

    async def done() -> Any:
        return act()

    return asyncio.run_coroutine_threadsafe(done(), page.server.get_event_loop()).result(PATIENCE_S)


@contextmanager
def orbiting(page: Page) -> Iterator[None]:
    """Meanwhile the camera of all tabs goes round the ball, once in four seconds."""
    turning = asyncio.run_coroutine_threadsafe(_orbit(page), page.server.get_event_loop())
    try:
        yield
    finally:
        turning.cancel()


async def _orbit(page: Page) -> None:
    while True:
        angle_rad = 2 * math.pi * time.monotonic() / 4.0
        for client in page.server.get_clients().values():
            with client.atomic():
                client.camera.position = np.array([3.5 * math.cos(angle_rad), 3.5 * math.sin(angle_rad), 1.5])
                client.camera.look_at = np.zeros(3)
        await asyncio.sleep(1 / 60)


def middle(tab: Any) -> tuple[float, float]:
    """The middle of the picture in the window [pixels]."""
    box = tab.locator("canvas[data-engine]").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


@contextmanager
def pressed(tab: Any) -> Iterator[None]:
    """Meanwhile the tool is held down, at first on the middle of the ball."""
    tab.keyboard.down("Shift")
    tab.mouse.move(*middle(tab))
    tab.mouse.down()
    try:
        yield
    finally:
        tab.mouse.up()
        tab.keyboard.up("Shift")


def sweep(tab: Any, seconds: float) -> None:
    """Move the pointer back and forth over the ball."""
    x, y = middle(tab)
    end_s = time.monotonic() + seconds
    while (t_s := end_s - time.monotonic()) > 0.0:
        tab.mouse.move(x + 150 * math.sin(3.0 * t_s), y + 100 * math.sin(4.1 * t_s))
        tab.wait_for_timeout(1e3 / 60)


# The hand on the ball, without a pointer: so that it can touch while the pointer does something else.

FORCE_N: Final = 1.0
STIFFNESS_N_M: Final = 400.0


@contextmanager
def touching(page: Page, strokes: bool) -> Iterator[Any]:
    """Meanwhile the hand presses on the ball's front, at rest or to and fro at up to 50 mm/s; yields the servo.

    Raises:
        ViewError: the hand does not get there.
    """
    touch, loop = page.context.touch, page.server.get_event_loop()
    do(page, lambda: touch.press(*_contact(0.0)))
    moving = asyncio.run_coroutine_threadsafe(_stroke(page), loop) if strokes else None
    try:
        until(lambda: bool(touch.servo.state().touching), "the painter's hand does not touch the ball")
        yield touch.servo
    finally:
        if moving is not None:
            moving.cancel()
        do(page, lambda: touch.lift(time.monotonic()))


async def _stroke(page: Page) -> None:
    began_s = time.monotonic()
    while True:
        page.context.touch.move(*_contact(0.3 * math.sin(5.5 * (time.monotonic() - began_s))))
        await asyncio.sleep(1 / 60)


def _contact(angle_rad: float) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """Place, normal, force and stiffness, so far round the ball from its front."""
    nhat = np.array([0.8 * math.sin(angle_rad), -0.8 * math.cos(angle_rad), 0.6])
    return RADIUS_M * nhat, nhat, FORCE_N, STIFFNESS_N_M
