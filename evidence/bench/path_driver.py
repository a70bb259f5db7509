"""hapscene along a path, in a process of its own and called as other renderers' drivers are, and the files of them all.

    python -m hapscene_evidence.bench.path_driver MESH PATH OUT [--repeats N] [--cold-first TICK --flush-mb MIB]

`side_by_side_page.FORMATS` says what is in them; OUT has one column more here, the time of the whole tick.
"""

import argparse
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.entry import call_flags
from hapscene.compiled.native import native
from hapscene.records import ROW, records
from hapscene.render.recording import Recording
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.surface.surface_arrays import TICK

from .case import Case
from .tick_time import REPEATS, hot

Array = NDArray[np.float64]

COLUMNS: Final = 8
"""Of OUT: proxy 3 [m], force 3, in contact 0 or 1, time [ns]; of hapscene the contact's, and the tick's as a ninth."""


def write_mesh(path: Path, mesh: Mesh) -> None:
    """MESH: counts of vertices and faces, then both."""
    counts = np.array([len(mesh.vertices_m), len(mesh.faces)], "<i8")
    path.write_bytes(counts.tobytes() + mesh.vertices_m.astype("<f8").tobytes() + mesh.faces.astype("<i4").tobytes())


def read_mesh(path: Path) -> Mesh:
    """What `write_mesh` wrote."""
    data = path.read_bytes()
    vertices, faces = np.frombuffer(data, "<i8", 2)
    vertices_m = np.frombuffer(data, "<f8", 3 * vertices, 16).reshape(-1, 3)
    return Mesh(vertices_m=vertices_m, faces=np.frombuffer(data, "<i4", 3 * faces, 16 + 24 * vertices).reshape(-1, 3))


def run_cold(renderer: Renderer, path: Array, first: int, flush_mb: int) -> Recording:
    """A path, from tick `first` on with a buffer rewritten before each tick that is larger than the caches."""
    rows, samples = records(len(path), ROW), np.zeros((len(path), renderer.block))
    rows.view(np.ndarray).view(np.uint8)[:] = 0
    samples[:] = 0.0  # their pages are there before the first tick, as in the other drivers
    buffer = np.ones(flush_mb * 2**20 // 8, np.uint64)
    for n in (1, len(path)):  # once for the code to be there
        renderer.reset(path[0])
        _run_cold(renderer.world, renderer.surface, path[:n], first, buffer, rows[:n], samples[:n])
    return renderer.recording(rows, samples)


@native
def _run_cold(
    world: Any, surface: Any, path: Array, first: int, buffer: NDArray[np.uint64], rows: Any, samples: Array
) -> None:
    for k in range(len(path)):
        if k >= first:
            for i in range(0, len(buffer), 8):  # a word of each line of 64 bytes
                buffer[i] += np.uint64(1)
        call_flags(surface.entries[TICK], (world, surface, path[k, 0], path[k, 1], path[k, 2], rows[k], samples[k]))


def main() -> None:
    parser = argparse.ArgumentParser()
    for name in ("mesh", "path", "out"):
        parser.add_argument(name, type=Path)
    for name, default in (("--repeats", REPEATS), ("--cold-first", -1), ("--flush-mb", 64)):
        parser.add_argument(name, type=int, default=default)
    given = parser.parse_args()
    path = np.fromfile(given.path, "<f8").reshape(-1, 3)
    scene = Case("body", read_mesh(given.mesh), path, False).scene()
    start_s = time.perf_counter()
    renderer = Renderer(scene, effects=["wall"], seed=0)
    print(f"build_ms {1e3 * (time.perf_counter() - start_s):.1f}")
    rows = np.zeros((len(path), COLUMNS + 1))
    if given.cold_first < 0:
        found = hot(renderer, path, given.repeats)
        recording, on = found.recording, found.recording.touching
        rows[on, 7], rows[on, 8] = found.contact_ns, found.tick_ns
    else:
        recording = run_cold(renderer, path, given.cold_first, given.flush_mb)
        rows[:, 7], rows[:, 8] = recording.contact_ns, recording.tick_ns
    rows[:, :3], rows[:, 3:6], rows[:, 6] = recording.p_WP_m, recording.f_W_N, recording.touching
    rows.astype("<f8").tofile(given.out)


if __name__ == "__main__":
    main()
