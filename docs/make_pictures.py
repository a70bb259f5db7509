"""Makes the pictures of README, tutorial and architecture anew: `python docs/make_pictures.py`, some minutes.

In the environment of `make nightly`. Each is made on light and on dark ground. The window needs Xvfb (package
xvfb), the painter Chromium; without them theirs are left out.
"""

import io
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from PIL import Image, ImageGrab

from hapscene.paint.model.session import Session
from hapscene.paint.web.page import Page
from hapscene.scene.scene import load_scene

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))

from tests.chromium import find_chromium, launched  # noqa: E402
from tests.screen import virtual_screen  # noqa: E402

IMG = DOCS / "img"
SCENE = ROOT / "assets" / "demo.scene.json"

WINDOW_S = 9.73
"""When the window's picture is taken [s]: the tool strokes the plate."""

PATIENCE_S = 120.0

LOADED = "window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.hand === 'ready'"
"""Condition, as JavaScript, that the painter's page is ready."""

PAINTER = {"width": 1200, "height": 750}
"""Of the painter's page [pixels]."""

PLAY = f"""
import pickle
import sys
from hapscene.render.recording import Recording
from hapscene.touch import open_scene
from hapscene.view import window
from hapscene.view.gl import watch
from hapscene.view.palette import DARK, LIGHT
def open_here(job):
    player, title, theme = pickle.loads(job)
    figure = player.figure
    watch(figure.parts, figure.points_m(tool=True), title, theme, lambda: player.at({WINDOW_S}))
    return ""
window._run = open_here
scene, touch = open_scene(sys.argv[1]), Recording.load(sys.argv[2])
window.play_in_window(scene, touch, "hapscene", theme=DARK if sys.argv[3] else LIGHT)
"""
"""The window, opened by this process itself and standing still."""


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="hapscene-") as name:
        folder = Path(name)
        pebble = _pebble(folder)
        for dark in ("", "-dark"):
            option = ["--dark"] if dark else []
            out = folder / f"demo{dark}"
            _hapscene("demo", "--out", out, *option)
            for picture in ("scene", "plots"):
                shutil.copyfile(out / f"{picture}.png", IMG / f"{picture}{dark}.png")
            _painter(folder, dark)
            _hapscene("view", pebble, "--size", 800, 560, "--out", IMG / f"pebble{dark}.png", *option)
            film = ("--turn", 0, "--size", 720, 450)
            _hapscene("view", SCENE, "--touch", out / "touch.npz", *film, "--out", DOCS / f"demo{dark}.gif", *option)
            if shutil.which("Xvfb") is None:
                print(f"without window{dark}.png: there is no Xvfb")
            else:
                _window(out / "touch.npz", dark).save(IMG / f"window{dark}.png", optimize=True)


def _hapscene(*words: Any) -> None:
    subprocess.run([sys.executable, "-m", "hapscene", *map(str, words)], cwd=ROOT, check=True)


def _pebble(folder: Path) -> Path:
    """The tutorial's scene, made by the tutorial's own programs."""
    programs = re.findall(r"```python\n(.*?)```", (DOCS / "tutorial.md").read_text(encoding="utf-8"), re.DOTALL)
    for program in programs[:2]:
        subprocess.run([sys.executable, "-c", program], cwd=folder, check=True)
    return folder / "pebble.scene.json"


def _painter(folder: Path, dark: str) -> None:
    """The painter on the demo scene, as it opens."""
    if find_chromium() is None:
        print(f"without painter{dark}.png: no Chromium was found")
        return
    session = Session(load_scene(SCENE), folder / f"demo{dark}.scene.json")
    with launched() as chromium, Page(session, port=0, with_autosave=False) as page:
        tab = chromium.new_page(viewport=PAINTER, color_scheme="dark" if dark else "light")
        tab.goto(page.url)
        tab.wait_for_function(LOADED, timeout=1e3 * PATIENCE_S)
        tab.wait_for_timeout(5000.0)  # until all of it is drawn
        picture = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
        picture.quantize(256).save(IMG / f"painter{dark}.png", optimize=True)


def _window(touch: Path, dark: str) -> Image.Image:
    """The window at `WINDOW_S` of a touch."""
    with virtual_screen(1000, 750) as display:
        command = [sys.executable, "-c", PLAY, str(SCENE), str(touch), dark]
        with subprocess.Popen(command, env=os.environ | {"DISPLAY": display}) as process:
            try:
                return _drawn(display)
            finally:
                process.send_signal(signal.SIGINT)  # so that it removes its folder


def _drawn(display: str) -> Image.Image:
    """The screen, the window over all of it, once something is drawn and stays."""
    end_s, last = time.monotonic() + PATIENCE_S, b""
    while time.monotonic() < end_s:
        time.sleep(1.0)
        screen = ImageGrab.grab(xdisplay=display).convert("RGB")
        if len(screen.getcolors(1 << 24) or ()) > 100 and screen.tobytes() == last:
            return screen.quantize(256)
        last = screen.tobytes()
    raise SystemExit("the window never opened")


if __name__ == "__main__":
    main()
