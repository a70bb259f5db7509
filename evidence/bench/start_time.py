"""Time from the start of `import hapscene` to the first tick in a new process; memory per triangle of a mesh."""

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.errors import HapsceneError
from hapscene.scene.ply import save_mesh
from hapscene.scene.scene import Scene

from .case import Case
from .sheet import Sheet

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

_MEMORY: Final = """
import ctypes, mmap, sys
from pathlib import Path
import numpy as np
from hapscene import load_mesh
from hapscene.contact.world import Shapes
from hapscene.scene.mesh import Mesh

def resident_B():
    file = Path("/proc/self/statm")
    getattr(ctypes.CDLL(None), "malloc_trim", int)(0)  # free memory that is not yet returned does not count
    return int(file.read_text().split()[1]) * mmap.PAGESIZE

mesh = load_mesh(sys.argv[1], "m")
Shapes([Mesh(np.eye(3), np.array([[0, 1, 2]]))], 0.0)  # compiles
before_B = resident_B()
shapes = Shapes([mesh], 0.0)
print((resident_B() - before_B) / len(mesh.faces))
"""


def measure_start(sheet: Sheet, case: Case, repeats: int) -> None:
    """Measure `import hapscene` and the time to the first tick of a saved scene, in new processes with warm caches."""
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
            rows = [_run(_START, file) for _ in range(repeats + 1)][1:]
            if kind == "ply" and Path("/proc/self/statm").exists():
                sheet.add(case.name, "memory a triangle", _run(_MEMORY, mesh)[0], "B")
        imported_s, ready_s = np.median(rows, axis=0)
        sheet.add("start", "import hapscene", imported_s, "s")
        sheet.add("start", f"{case.name}, {'' if kind == 'ply' else 'STL, '}load to first tick", ready_s, "s")


def _run(program: str, file: Path) -> list[float]:
    """Run a program in a new Python process with a file as its argument; return the numbers that it prints."""
    done = subprocess.run([sys.executable, "-c", program, str(file)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise HapsceneError(f"a timed process failed: {done.stderr.strip().splitlines()[-1]}")
    return [float(word) for word in done.stdout.split()]
