"""Response of the painter in Chromium: time to a usable page, from click to pixel, and gaps in the sound.

A page is usable when it has a tool and the mesh is drawn: a click then shows paint, after the time in the column "first
click". The browser runs already, and the command opens the page in it, as it does by default; the page is opened again,
with an empty cache, after the clicks.

`python -m hapscene_evidence.bench.painter` needs playwright, and Chromium on the path.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

SPHERES: Final = {12: None, 20_480: 5, 327_680: 7, 1_310_720: 8}
"""Subdivisions of the spheres, by face count; the cube has 12 faces."""

CLICKS: Final = 20
PAINTING_S: Final = 300.0
SOUND_FACES: Final = 20_480

KEEP: Final = """
const real = HTMLCanvasElement.prototype.getContext;  // lets the script read pixels at any time
HTMLCanvasElement.prototype.getContext = function (kind, options) {
  return real.call(this, kind, { ...options, preserveDrawingBuffer: true });
};
const small = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
window.pixelAt = (x, y) => {
  const canvas = document.querySelector("canvas[data-engine]"), box = canvas.getBoundingClientRect();
  small.clearRect(0, 0, 1, 1);
  const scale = canvas.width / box.width;
  small.drawImage(canvas, (x - box.left) * scale, (y - box.top) * scale, 1, 1, 0, 0, 1, 1);
  return [...small.getImageData(0, 0, 1, 1).data];
};
let pressed = Infinity;
window.addEventListener("pointerdown", () => { pressed = performance.now(); }, true);  // before the painter's listener
window.timeClick = (x, y) => new Promise((done) => {
  const before = window.pixelAt(x, y);
  pressed = Infinity;
  const look = () => {
    const off = window.pixelAt(x, y).reduce((sum, v, i) => sum + Math.abs(v - before[i]), 0);
    const took = performance.now() - pressed;
    if (took > 0 && off > 60) done(took / 1000); else if (took > 5000) done(NaN); else setTimeout(look, 4);
  };
  look();
});
"""

READY: Final = "window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool"


def seen(tab: Any, x: float, y: float) -> bool:
    """Whether the mesh is drawn at a place of the window, over the white background."""
    return bool(tab.evaluate(f"(() => {{ const p = window.pixelAt({x}, {y}); return p[3] > 0 && p[0] < 235; }})()"))


def usable_page(browser: Any, url: str) -> tuple[Any, tuple[float, float]]:
    """Open a page that can be painted on: it has a tool and draws the mesh; returns it, and the middle of the mesh."""
    tab = browser.new_page(viewport={"width": 1280, "height": 800})
    tab.add_init_script(KEEP)
    tab.goto(url)
    tab.wait_for_function(READY, timeout=60e3)
    box = tab.locator("canvas[data-engine]").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    while not seen(tab, x, y):
        tab.wait_for_timeout(10)
    return tab, (x, y)


def measure(browser: Any, folder: Path, faces: int, paint_s: float) -> str:
    """Measure one mesh; returns a row of the table."""
    import trimesh

    depth = SPHERES[faces]
    shape = trimesh.creation.box((40, 40, 40)) if depth is None else trimesh.creation.icosphere(depth, 25.0)
    shape.export(folder / f"{faces}.stl")
    start_s = time.perf_counter()
    opener = folder / f"opened{faces}"
    environment = os.environ | {"BROWSER": f"sh -c 'echo \"$0\" > part && mv part {opener.name}' %s"}
    command = [sys.executable, "-m", "hapscene", "paint", f"{faces}.stl", "--unit", "mm", "--up", "z", "--port", "0"]
    with subprocess.Popen(command, stdout=-1, stderr=-3, text=True, cwd=folder, env=environment) as process:
        try:
            assert process.stdout is not None
            while not opener.exists():
                assert process.poll() is None
                time.sleep(0.005)
            tab, (x, y) = usable_page(browser, opener.read_text().strip())
            command_s = time.perf_counter() - start_s
            tab.locator('.hs-pick[data-name="leather"]').click()
            tab.keyboard.down("Shift")
            tab.mouse.move(x, y)
            took_s = []
            for k in range(CLICKS):
                at = x - 150 + 75 * (k % 5), y - 75 + 50 * (k // 5)
                tab.mouse.move(*at)
                tab.wait_for_timeout(300)
                tab.evaluate(f"void (window.took = window.timeClick({at[0]}, {at[1]}))")
                tab.mouse.down()
                tab.mouse.up()
                took_s.append(tab.evaluate("window.took"))
            tab.keyboard.up("Shift")
            url = next(line for line in process.stdout if line.startswith("http")).split()[0]
            opened_s = time.perf_counter()
            usable_page(browser, url)[0].close()
            opened_s = time.perf_counter() - opened_s
            gaps = sound_gaps(browser, tab, url, (x, y), paint_s) if paint_s else ""
            return (
                f"| {faces:,} | {command_s:.1f} s | {opened_s:.1f} s | {took_s[0]:.2f} s "
                f"| {np.nanmedian(took_s):.2f} s ({np.isfinite(took_s).sum()} of {CLICKS}) | {gaps} |"
            )
        finally:
            process.kill()


def sound_gaps(browser: Any, tab: Any, url: str, middle: tuple[float, float], paint_s: float) -> str:
    """Touch in one browser while another paints; returns the number of gaps of the sound."""
    other = browser.new_page(viewport={"width": 1280, "height": 800})
    other.goto(url)
    other.wait_for_function(READY, timeout=60e3)
    tab.wait_for_function("window.hapscene.state.hand === 'ready'", timeout=300e3)
    tab.keyboard.press("6")
    for page in (tab, other):
        page.keyboard.down("Shift")
        page.mouse.move(*middle)
        page.mouse.down()
    end_s, k = time.monotonic() + paint_s, 0
    tab.wait_for_timeout(2000)
    before = tab.evaluate("[window.hapscene.sound.gaps, window.hapscene.sound.played]")
    while time.monotonic() < end_s:
        k += 1
        for page, size in ((tab, 20), (other, 100)):
            page.mouse.move(middle[0] + size * np.sin(0.3 * k), middle[1] + size * np.cos(0.17 * k))
    gaps, played = np.subtract(tab.evaluate("[window.hapscene.sound.gaps, window.hapscene.sound.played]"), before)
    return f"{gaps:.0f} in {played / 1e4:.0f} s of sound"


def main() -> None:
    """Measure all meshes and print a table."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        options = ["--enable-unsafe-swiftshader", "--autoplay-policy=no-user-gesture-required"]
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=options)
        print("| faces | usable after the command | after opening again | first click | click to pixel | gaps |")
        print("|---|---|---|---|---|---|")
        for faces in SPHERES:
            print(measure(browser, Path(folder), faces, PAINTING_S * (faces == SOUND_FACES)), flush=True)
        print(f"Load {os.getloadavg()[0]:.0f} on {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
