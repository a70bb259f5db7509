"""Times that are not hot: a tick in a loop that sleeps in between, and the start of a process."""

import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.renderer import Renderer
from hapscene.scene.ply import save_mesh
from hapscene.scene.scene import Scene

from .case import Case
from .machine import run_python
from .sheet import Sheet
from .tick_time import last_row

_TICK_NS: Final = round(TICK_S * 1e9)

_FAILED: Final = "the process that was to be timed failed"

_START: Final = """
import sys, time
start = time.perf_counter()
import hapscene
imported = time.perf_counter()
scene = hapscene.load_scene(sys.argv[1])
renderer = hapscene.Renderer(scene)
renderer.step((0.0, 0.0, 0.07))
print(imported - start, time.perf_counter() - start)
"""


def measure_cold(sheet: Sheet, case: Case, duration_s: float) -> None:
    """Ticks of a real 1 kHz loop in Python, which sleeps until each millisecond: caches are cold, the clock slow.

    Beside them how late the loop wakes, with the tick and without: what the system does, not the tick.
    """
    count = round(duration_s / TICK_S)
    touching = np.flatnonzero(np.linalg.norm(case.p_WT_m, axis=1) < 0.049)
    path = case.p_WT_m[touching[: max(count, 1)]]
    renderer = Renderer(case.scene())
    renderer.reset(1.4 * path[0])
    late, contact, tick = [], [], []
    for p in path:
        late.append(_sleep_to_next_tick())
        renderer.step(p)
        row = last_row(renderer)
        contact.append(int(row["contact_ns"]))
        tick.append(int(row["tick_ns"]))
    name = f"{case.name}, 1 kHz loop"
    sheet.add_spread(name, "contact", contact, "µs", 1e-3)
    sheet.add_spread(name, "tick", tick, "µs", 1e-3)
    sheet.add_spread(name, "late", late, "µs", 1e-3)


def measure_sleep(sheet: Sheet, duration_s: float) -> None:
    """How late an empty loop wakes."""
    late = [_sleep_to_next_tick() for _ in range(round(duration_s / TICK_S))]
    sheet.add_spread("empty 1 kHz loop", "late", late, "µs", 1e-3)


def _sleep_to_next_tick() -> int:
    """Sleep until the next whole millisecond; return how late that was [ns]."""
    due_ns = (time.perf_counter_ns() // _TICK_NS + 1) * _TICK_NS
    time.sleep((due_ns - time.perf_counter_ns()) * 1e-9)
    return time.perf_counter_ns() - due_ns


_MEMORY: Final = """
import mmap, sys
from pathlib import Path
import numpy as np
from hapscene import load_mesh
from hapscene.contact.world import Shapes
from hapscene.scene.mesh import Mesh

def resident_B():
    file = Path("/proc/self/statm")
    return int(file.read_text().split()[1]) * mmap.PAGESIZE if file.exists() else 0

mesh = load_mesh(sys.argv[1], "m")
Shapes([Mesh(np.eye(3), np.array([[0, 1, 2]]))], 0.0)  # its code
before_B = resident_B()
shapes = Shapes([mesh], 0.0)
print((resident_B() - before_B) / len(mesh.faces))
"""


def measure_start(sheet: Sheet, case: Case, repeats: int) -> None:
    """A fresh process: `import hapscene`, and from there to the first tick of a saved scene. The cache is warm."""
    import trimesh

    for kind in ("ply", "stl"):
        with tempfile.TemporaryDirectory() as folder:
            mesh, file = Path(folder) / f"mesh.{kind}", Path(folder) / "bench.scene.json"
            if kind == "ply":
                save_mesh(case.mesh, mesh)
            else:
                trimesh.Trimesh(case.mesh.vertices_m, case.mesh.faces, process=False).export(mesh)
            scene = Scene()
            scene.add(mesh, name="body", unit="m", swatch="wood")
            scene.save(file)
            rows = [_start(file) for _ in range(repeats + 1)][1:]
            if kind == "ply" and (taken_B := float(run_python([_MEMORY, str(mesh)], _FAILED))) > 0.0:
                sheet.add(case.name, "memory a triangle", taken_B, "B")
        imported_s, ready_s = np.median(rows, axis=0)
        sheet.add("start", "import hapscene", imported_s, "s")
        sheet.add("start", f"{case.name}, {'' if kind == 'ply' else 'STL, '}load to first tick", ready_s, "s")


def _start(file: Path) -> list[float]:
    return [float(word) for word in run_python([_START, str(file)], _FAILED).split()]
