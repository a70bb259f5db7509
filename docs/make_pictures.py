"""Draws the pictures of README, tutorials and gallery: `python docs/make_pictures.py`, which takes some minutes.

Run it in the environment of `make nightly`. Each picture has a light and a dark version. The picture of the painter
needs Chromium and is skipped without it.
"""

import io
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from PIL import Image

from hapscene.paint.model.session import Session
from hapscene.paint.web.page import Page
from hapscene.scene.scene import Scene, load_scene
from hapscene.swatches.library import computed_entries, load_swatch, shipped_swatches
from hapscene.swatches.picture import ball_png
from hapscene.swatches.site import STYLE, draw_spectra, draw_tap, scale_of
from hapscene.swatches.sound import swatch_sound, wav_bytes
from hapscene.view.chart import new_chart, save_chart
from hapscene.view.palette import DARK, LIGHT
from hapscene.view.picture import write_picture

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))

from tests.chromium import find_chromium, launched  # noqa: E402

IMG = DOCS / "img"
GALLERY = DOCS / "results" / "gallery"
SCENE = ROOT / "assets" / "demo.scene.json"

PATIENCE_S = 120.0
"""Longest time to wait for the page [s]."""

LOADED = "window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.hand === 'ready'"
"""JavaScript condition that the page of the painter is ready."""

PAINTER = {"width": 1200, "height": 750}
"""Size of the painter's page [pixels]."""


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
            film = ("--size", 600, 375)
            _hapscene("view", SCENE, "--touch", out / "touch.npz", *film, "--out", IMG / f"demo{dark}.gif", *option)
        gallery(folder)


def _hapscene(*words: Any) -> None:
    subprocess.run([sys.executable, "-m", "hapscene", *map(str, words)], cwd=ROOT, check=True)


def gallery(folder: Path) -> None:
    """Draw and play the swatches of docs/results/gallery.md."""
    for entry in computed_entries():
        (GALLERY / f"{entry.name}-ball.png").write_bytes(ball_png(load_swatch(entry.name)))
    swatches = [load_swatch(name) for name in shipped_swatches()]
    scale, body = scale_of(swatches), folder / "body.png"
    for swatch in swatches:
        (GALLERY / f"{swatch.name}.wav").write_bytes(wav_bytes(swatch_sound(swatch)))
        scene = Scene()
        scene.add(ROOT / "assets" / "meshes" / "toad.ply", unit="m", swatch=swatch)
        for name, theme in (("light", LIGHT), ("dark", DARK)):
            write_picture(scene, None, body, size=(600, 560), theme=replace(theme, background=theme.page))
            with new_chart(12.4, 3.7, style=STYLE) as chart:
                shown, spectra, tap = chart.subplots(1, 3, width_ratios=[1.3, 1.7, 1.2])
                shown.imshow(Image.open(body).crop((0, 0, 600, 500)))  # without the legend
                shown.set_axis_off()
                draw_spectra(spectra, swatch, scale)
                draw_tap(tap, swatch, scale)
                spectra.set_title("stroked", loc="left")
                tap.set_title("tapped at 100 mm/s", loc="left")
                picture = Image.open(save_chart(chart, body, 100, dark=theme is DARK)).convert("RGB")
            picture.quantize(256).save(GALLERY / f"{swatch.name}-{name}.png", optimize=True)


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


if __name__ == "__main__":
    main()
