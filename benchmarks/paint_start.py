"""How soon the painter is there, and how soon a click is seen: on a cube with a fine border, on 20 k and 1.3 M faces.

python -m hapscene_benchmarks.paint_start
"""

import os
import statistics
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from trimesh.creation import box, icosphere

from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene

from .markdown import table
from .paint_browser import PATIENCE_S, RADIUS_M, SETTLE_S, SIZE, browser
from .paint_page import WATCH_PIXEL, machine_line, measure_click

SUBDIVISIONS: Final = {"ball of 20,480": 5, "ball of 1,310,720": 8}

CLICK_COUNT: Final = 7

USABLE: Final = "window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool"

SEEN: Final = """
() => {
  const canvas = document.querySelector("canvas[data-engine]");
  const seen = document.createElement("canvas").getContext("2d");
  const read = (x, y) => {
    seen.clearRect(0, 0, 1, 1);
    seen.drawImage(canvas, x, y, 1, 1, 0, 0, 1, 1);
    return seen.getImageData(0, 0, 1, 1).data.slice(0, 3).join();
  };
  return read(canvas.width / 2, canvas.height / 2) !== read(2, canvas.height / 2);
}
"""
"""Whether the middle of the picture looks unlike its rim: the body is drawn."""


def write_scenes(folder: Path) -> dict[str, Path]:
    """A cube of 12 triangles with a fine border, and plain balls, as scene files."""
    made = {"cube of 12, fine border": Scene()}
    cube = made["cube of 12, fine border"]
    cube.add(Mesh.from_trimesh(box((0.04, 0.04, 0.04)), "m"), name="cube", swatch="wood")
    cube.paint("cube", "epoxy", Sphere((-0.02, -0.02, 0.0), 0.012))
    for name, subdivisions in SUBDIVISIONS.items():
        ball = icosphere(subdivisions=subdivisions, radius=RADIUS_M)
        made[name] = Scene()
        made[name].add(Mesh.from_trimesh(ball, "m"), name="ball", swatch="wood")
    for scene in made.values():
        scene.swatch_index("epoxy")
    paths = {name: folder / f"{number}.scene.json" for number, name in enumerate(made)}
    for name, scene in made.items():
        scene.save(paths[name])
    return paths


@contextmanager
def painter(path: Path) -> Iterator[str]:
    """`hapscene paint` of a scene; its address, once and as it gives it to a browser."""
    command = [sys.executable, "-m", "hapscene", "paint", str(path), "--port", "0"]
    environment = os.environ | {"BROWSER": "echo %s"}  # a browser that says which file it was given
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=path.parent, env=environment)
    try:
        assert process.stdout is not None
        opener = next(word for line in process.stdout for word in line.split() if word.startswith("file://"))
        with urllib.request.urlopen(opener) as file:
            yield file.read().decode().partition("url=")[2].partition('"')[0]
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


def measure(path: Path, chromium: Any) -> tuple[float, list[float]]:
    """From the command to a page that is drawn and takes a tool [s]; from clicks to pixels [ms]."""
    began_s = time.monotonic()
    with painter(path) as url:
        tab = chromium.new_page(viewport=SIZE)
        tab.set_default_timeout(1e3 * PATIENCE_S)
        tab.add_init_script(WATCH_PIXEL)
        tab.goto(url)
        tab.wait_for_function(USABLE)
        tab.wait_for_function(SEEN)
        usable_s = time.monotonic() - began_s
        tab.wait_for_timeout(1e3 * SETTLE_S)
        took_ms = measure_click(tab, CLICK_COUNT)
        tab.close()
    return usable_s, took_ms


def main() -> None:
    """Print a table; takes a minute or two."""
    print(machine_line(), flush=True)
    rows = []
    with TemporaryDirectory() as folder, browser() as chromium:
        for name, path in write_scenes(Path(folder)).items():
            usable_s, took_ms = measure(path, chromium)
            rows.append((name, f"{usable_s:.1f}", f"{statistics.median(took_ms):.0f}", f"{max(took_ms):.0f}"))
    print(table(("faces", "command to page [s]", "click to pixel, median [ms]", "longest [ms]"), rows), flush=True)


if __name__ == "__main__":
    main()
