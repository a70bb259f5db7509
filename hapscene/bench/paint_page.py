"""How long the painter's page takes from a click to the changed pixel, in a real browser.

python -m hapscene.bench.paint_page
"""

import platform
import shutil
import statistics
import tempfile
from pathlib import Path
from typing import Any, Final, NamedTuple

from hapscene.errors import ViewError

SUBDIVISIONS: Final = (5, 7)
"""Of the ball that is painted [count]: 20,480 and 327,680 triangles."""

CLICK_COUNT: Final = 9

SIZE: Final = {"width": 1280, "height": 800}

CHANGE: Final = 40
"""By how much a channel of the pixel must have changed [0 to 255]: more than light and rounding do."""

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
)
"""Chromium drawn by the processor."""

WATCH: Final = """
const get = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, more) {
  return get.call(this, kind, String(kind).startsWith("webgl") ? { ...more, preserveDrawingBuffer: true } : more);
};
addEventListener("pointerdown", () => { window.pressed_ms = performance.now(); }, true);
window.watch_pixel = (x, y) => {
  const seen = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const read = () => {
    const canvas = document.querySelector("canvas[data-engine]"), box = canvas.getBoundingClientRect();
    const scale = canvas.width / box.width;
    seen.drawImage(canvas, (x - box.left) * scale, (y - box.top) * scale, 1, 1, 0, 0, 1, 1);
    return seen.getImageData(0, 0, 1, 1).data;
  };
  const before = read();
  window.pressed_ms = window.took_ms = null;
  (function look() {
    const now = read();
    const change = Math.max(...[0, 1, 2].map((i) => Math.abs(now[i] - before[i])));
    if (window.pressed_ms !== null && change > CHANGE) window.took_ms = performance.now() - window.pressed_ms;
    else requestAnimationFrame(look);
  })();
};
""".replace("CHANGE", str(CHANGE))
"""Watches a pixel from frame to frame: what is drawn is kept, so that it can be read, which makes drawing slower."""


class Reaction(NamedTuple):
    """From click to changed pixel, of `CLICK_COUNT` clicks on a ball of so many triangles [ms]."""

    triangle_count: int
    median_ms: float
    worst_ms: float


def measure(subdivisions: int, click_count: int = CLICK_COUNT) -> Reaction:
    """Click with the brush on a ball in a browser, without a graphics card.

    Raises:
        ViewError: Chromium, playwright or viser is missing.
    """
    from trimesh.creation import icosphere

    from hapscene.paint.page import Page
    from hapscene.paint.session import Session
    from hapscene.scene.mesh import Mesh
    from hapscene.scene.scene import Scene

    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise ViewError("playwright is missing: pip install 'hapscene[dev]'") from None
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        raise ViewError("no browser to measure in: apt-get install chromium")
    scene = Scene()
    ball = Mesh.from_trimesh(icosphere(subdivisions=subdivisions, radius=0.03), "m")
    scene.add(ball, name="ball", swatch="wood")
    scene.swatch_index("epoxy")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as runner:
        session = Session(scene, Path(folder) / "ball.scene.json")
        with Page(session, port=0, with_autosave=False) as page:
            browser = runner.chromium.launch(executable_path=chromium, args=list(ARGUMENTS))
            took_ms = _click(browser, page.url, click_count)
            browser.close()
    return Reaction(len(ball.faces), statistics.median(took_ms), max(took_ms))


def _click(browser: Any, url: str, click_count: int) -> list[float]:
    """Paint and undo, again and again; from the press to the pixel [ms]."""
    tab = browser.new_page(viewport=SIZE)
    tab.set_default_timeout(120_000.0)
    tab.add_init_script(WATCH)
    tab.goto(url)
    tab.wait_for_function("window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.hand === 'ready'")
    tab.wait_for_timeout(5000)  # until all of the mesh is drawn, and what the start left is done
    box = tab.locator("canvas[data-engine]").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    took_ms = []
    tab.keyboard.down("Shift")
    tab.mouse.move(x, y)
    for _ in range(click_count + 1):
        tab.wait_for_timeout(500)
        tab.evaluate(f"window.watch_pixel({x}, {y})")
        tab.mouse.down()
        tab.mouse.up()
        tab.wait_for_function("window.took_ms !== null")
        took_ms.append(float(tab.evaluate("window.took_ms")))
        tab.evaluate("window.hapscene.send({ do: 'undo' })")
        tab.wait_for_function("!window.hapscene.state.undo")
    return took_ms[1:]  # the first has the browser compile its shaders


def main() -> None:
    """Print a table."""
    size = f"{SIZE['width']}×{SIZE['height']}"
    print(f"from click to changed pixel, Chromium drawing on {platform.machine()}, {size}, {CLICK_COUNT} clicks")
    for subdivisions in SUBDIVISIONS:
        found = measure(subdivisions)
        print(f"{found.triangle_count:9,} triangles: {found.median_ms:5.0f} ms, worst {found.worst_ms:5.0f} ms")


if __name__ == "__main__":
    main()
