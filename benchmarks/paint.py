"""Time of painting: what a designer waits for, on meshes up to 328 k triangles.

python -m hapscene_benchmarks.paint
"""

import time
import timeit
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from hapscene.paint.model.display import Display
from hapscene.paint.model.session import Session
from hapscene.scene.scene import Scene

from .case import RADIUS_M, short, sphere
from .sheet import Sheet

SUBDIVISIONS: Final = (5, 7)
"""Spheres that are painted: 20 k and 328 k triangles."""

BRUSH_M: Final = (0.002, 0.010)
"""Radii of the brush [m], on a ball of 50 mm: a fine and a broad one."""

MOVES: Final = 40
"""Moves of the pointer in a stroke [count], over a third of the ball."""


def measure_painting(sheet: Sheet, say: Callable[[str], None] = print) -> None:
    """Time of opening, stroke segments, fills, undo, save, and of what is shown anew after each."""
    for k in SUBDIVISIONS:
        name = f"sphere {short(20 * 4**k)}"
        say(f"{name}: painting")
        with TemporaryDirectory() as folder:
            path = Path(folder) / "ball.scene.json"
            scene = Scene()
            scene.add(sphere(k), name="ball")
            scene.save(path)
            began_s = time.perf_counter()
            session = Session.open(path)
            sheet.add(name, "open to paint", time.perf_counter() - began_s, "s")
            began_s = time.perf_counter()
            display = Display(session.painting)
            sheet.add(name, "reduce and cut to be shown", time.perf_counter() - began_s, "s")
            sheet.add(name, "triangles shown", sum(len(body.mesh.faces) for body in display.bodies), "1")
            wood = session.add_swatch("wood")
            session.painting.changes()
            for radius_m in BRUSH_M:
                _measure_stroke(sheet, name, session, display, wood, radius_m)
            _measure_fills(sheet, name, session, display, wood)
            _measure_save(sheet, name, session, path)


def _measure_stroke(sheet: Sheet, name: str, session: Session, display: Display, swatch: int, radius_m: float) -> None:
    """Median and longest time of a move of the pointer, and of what is then sent anew."""
    session.fill_body(0, 0)
    display.update(session.painting.changes())
    drawn_s, shown_s, sent_B = [], [], []
    session.begin_stroke(swatch, radius_m)
    for x in np.linspace(-0.6, 0.6, MOVES) * RADIUS_M:
        began_s = time.perf_counter()
        session.drag_to([0.0, 0.0, 10 * RADIUS_M], [x, 0.2 * x, -9 * RADIUS_M])
        drawn_s.append(time.perf_counter() - began_s)
        began_s = time.perf_counter()
        layers = [layer for key in display.update(session.painting.changes()) for layer in display.layers(key)]
        shown_s.append(time.perf_counter() - began_s)
        sent_B.append(sum(layer.vertices_m.nbytes + layer.faces.nbytes for layer in layers))
    session.end_stroke()
    brush = f"brush of {radius_m * 1e3:g} mm"
    sheet.add(name, f"{brush}: move, median", float(np.median(drawn_s)) * 1e3, "ms")
    sheet.add(name, f"{brush}: move, longest", max(drawn_s) * 1e3, "ms")
    sheet.add(name, f"{brush}: chunks anew, median", float(np.median(shown_s)) * 1e3, "ms")
    sheet.add(name, f"{brush}: to be sent, median", float(np.median(sent_B)) / 1e3, "kB")


def _measure_fills(sheet: Sheet, name: str, session: Session, display: Display, swatch: int) -> None:
    """Time of one of each."""
    acts: list[tuple[str, Callable[[], object]]] = [
        ("fill a facet", lambda: session.fill_at(session.hit_at(0, 0), "facet", swatch, 0.01)),
        ("fill the body", lambda: session.fill_body(0, swatch)),
        ("undo it", session.undo),
        ("redo it", session.redo),
        ("show it", lambda: [display.layers(key) for key in display.update(session.painting.changes())]),
    ]
    for what, act in acts:
        sheet.add(name, what, timeit.timeit(act, number=1) * 1e3, "ms")
    sheet.add(name, "history", session.history.size / 1e3, "kB")


def _measure_save(sheet: Sheet, name: str, session: Session, path: Path) -> None:
    """Of a painting that nothing shortens: each face of another swatch than the last."""
    paint = session.scene.bodies[0].face_swatch
    paint[:] = np.random.default_rng(0).integers(0, len(session.scene.swatches), len(paint))
    sheet.add(name, "save", timeit.timeit(session.save, number=1) * 1e3, "ms")
    sheet.add(name, "scene file", path.stat().st_size / 1e3, "kB")


if __name__ == "__main__":
    made = Sheet()
    measure_painting(made)
    for figure in made:
        print(f"{figure.case}, {figure.name}: {figure.value:.3g} {figure.unit}")
