"""Draws the pictures of README and tutorials: `python docs/make_pictures.py`, which takes some minutes.

Run it in the environment of `make nightly`. Each picture has a light and a dark version. The picture of the window
needs Xvfb (package xvfb), that of the painter Chromium; a picture without its program is skipped.
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
"""Time in the touch that the picture of the window shows [s]: the tool strokes the plate."""

PATIENCE_S = 120.0
"""Longest time to wait for the window or the page [s]."""

LOADED = "window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.hand === 'ready'"
"""JavaScript condition that the page of the painter is ready."""

PAINTER = {"width": 1200, "height": 750}
"""Size of the painter's page [pixels]."""

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
"""Program that opens the window in its own process, paused at `WINDOW_S`."""


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="hapscene-") as name:
        folder = Path(name)
        pebble = _pebble(folder)
        for dark in ("", "-dark"):
            option = ["--dark"] if dark else []
            out = folder / f"demo{dark}"
            _hapscene("demo", "--out", out, *option)
            shutil.copyfile(out / "plots.png", IMG / f"plots{dark}.png")
            _painter(folder, dark)
            _hapscene("view", pebble, "--size", 800, 560, "--out", IMG / f"pebble{dark}.png", *option)
            film = ("--turn", 0, "--size", 720, 450)
            _hapscene("view", SCENE, "--touch", out / "touch.npz", *film, "--out", IMG / f"demo{dark}.gif", *option)
            if shutil.which("Xvfb") is None:
                print(f"skipping window{dark}.png: Xvfb was not found")
            else:
                _window(out / "touch.npz", dark).save(IMG / f"window{dark}.png", optimize=True)


def _hapscene(*words: Any) -> None:
    subprocess.run([sys.executable, "-m", "hapscene", *map(str, words)], cwd=ROOT, check=True)


def _pebble(folder: Path) -> Path:
    """Make the scene of the tutorial with the programs of the tutorial."""
    programs = re.findall(
        r"```python\n(.*?)```", (DOCS / "tutorials" / "paint-a-scene.md").read_text(encoding="utf-8"), re.DOTALL
    )
    for program in programs[:2]:
        subprocess.run([sys.executable, "-c", program], cwd=folder, check=True)
    return folder / "pebble.scene.json"


def _painter(folder: Path, dark: str) -> None:
    """Draw the painter with the demo scene."""
    if find_chromium() is None:
        print(f"skipping painter{dark}.png: Chromium was not found")
        return
    session = Session(load_scene(SCENE), folder / f"demo{dark}.scene.json")
    with launched() as chromium, Page(session, port=0) as page:
        tab = chromium.new_page(viewport=PAINTER, color_scheme="dark" if dark else "light")
        tab.goto(page.url)
        tab.wait_for_function(LOADED, timeout=1e3 * PATIENCE_S)
        tab.wait_for_timeout(5000.0)  # until the page is drawn completely
        picture = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
        picture.quantize(256).save(IMG / f"painter{dark}.png", optimize=True)


def _window(touch: Path, dark: str) -> Image.Image:
    """Return the picture of the window at `WINDOW_S`."""
    with virtual_screen(1000, 750) as display:
        command = [sys.executable, "-c", PLAY, str(SCENE), str(touch), dark]
        with subprocess.Popen(command, env=os.environ | {"DISPLAY": display}) as process:
            try:
                return _drawn(display)
            finally:
                process.send_signal(signal.SIGINT)  # lets it remove its folder


def _drawn(display: str) -> Image.Image:
    """Return the screen once something is drawn and no longer changes."""
    end_s, last = time.monotonic() + PATIENCE_S, b""
    while time.monotonic() < end_s:
        time.sleep(1.0)
        screen = ImageGrab.grab(xdisplay=display).convert("RGB")
        if len(screen.getcolors(1 << 24) or ()) > 100 and screen.tobytes() == last:
            return screen.quantize(256)
        last = screen.tobytes()
    raise SystemExit("the window did not open")


if __name__ == "__main__":
    main()
