"""Times hapscene along a path in a separate process, through the file interface of all renderers of `side_by_side`.

    python -m hapscene_evidence.bench.path_driver MESH PATH OUT [--radius M] [--repeats N]
        [--cold-first TICK --flush-mb MIB]

The programs for other renderers are not part of hapscene. A folder BUILD holds `chai_path`, `hapi_path` or both:
programs without a device around CHAI3D 3.3.0 (github.com/chai3d/chai3d) and HAPI 1.3.1 (github.com/ChristianFrisson/
HAPI and its H3DUtil), compiled with -O3 -march=native. `chai_path` also takes --mode static|dynamic and --scale
UNITS_PER_M. The tool is a ball of --radius, 0 by default. Files are little-endian:

| file | content |
|---|---|
| MESH | two int64: numbers of vertices and faces; float64 (vertices, 3) [m]; int32 (faces, 3) |
| PATH | float64 (ticks, 3) [m]: position of the tool in each tick |
| OUT | float64 (ticks, 8): proxy (3) [m], force (3) [N], 1 in contact or 0, time [ns]; hapscene adds the tick's time |

A program prints the line `build_ms NUMBER`, the time to build the search structure of a mesh in memory, and exits with
0, or with the error as the last line of stderr. It runs the path once to warm up and N times timed, each time with a
new proxy at the first position. Only the renderer's call lies between two reads of a monotonic clock; the minimum of
each tick counts. With --cold-first it runs once; from that tick on, it first rewrites one word of each 64-byte line of
a buffer of MIB. CHAI3D: a `cMultiMesh` in a `cWorld` with `createAABBCollisionDetector`, a `cAlgorithmFingerProxy` of
that radius, in mode dynamic with `m_useDynamicProxy`. HAPI: a `HapticTriangleTree` over an `AABBTree`, front sides, a
smooth `FrictionSurface`, a `GodObjectRenderer`.
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
"""Columns of OUT. hapscene's time is that of the contact; a ninth column has the time of the tick."""


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Write a mesh as MESH."""
    counts = np.array([len(mesh.vertices_m), len(mesh.faces)], "<i8")
    path.write_bytes(counts.tobytes() + mesh.vertices_m.astype("<f8").tobytes() + mesh.faces.astype("<i4").tobytes())


def read_mesh(path: Path) -> Mesh:
    """Read MESH."""
    data = path.read_bytes()
    vertices, faces = np.frombuffer(data, "<i8", 2)
    vertices_m = np.frombuffer(data, "<f8", 3 * vertices, 16).reshape(-1, 3)
    return Mesh(vertices_m=vertices_m, faces=np.frombuffer(data, "<i4", 3 * faces, 16 + 24 * vertices).reshape(-1, 3))


def run_cold(renderer: Renderer, path: Array, first: int, flush_mb: int) -> Recording:
    """Run a path; from tick `first` on, rewrite a buffer larger than the caches before each tick."""
    rows, samples = records(len(path), ROW), np.zeros((len(path), renderer.block))
    rows.view(np.ndarray).view(np.uint8)[:] = 0
    samples[:] = 0.0  # touches the pages before the first tick, as the other programs do
    buffer = np.ones(flush_mb * 2**20 // 8, np.uint64)
    for n in (1, len(path)):  # one tick first, which compiles the code
        renderer.reset(path[0])
        _run_cold(renderer.world, renderer.surface, path[:n], first, buffer, rows[:n], samples[:n])
    return renderer.recording(rows, samples)


@native
def _run_cold(
    world: Any, surface: Any, path: Array, first: int, buffer: NDArray[np.uint64], rows: Any, samples: Array
) -> None:
    for k in range(len(path)):
        if k >= first:
            for i in range(0, len(buffer), 8):  # one word of each cache line of 64 bytes
                buffer[i] += np.uint64(1)
        call_flags(surface.entries[TICK], (world, surface, path[k, 0], path[k, 1], path[k, 2], rows[k], samples[k]))


def main() -> None:
    parser = argparse.ArgumentParser()
    for name in ("mesh", "path", "out"):
        parser.add_argument(name, type=Path)
    for name, default in (("--radius", 0.0), ("--repeats", REPEATS), ("--cold-first", -1), ("--flush-mb", 64)):
        parser.add_argument(name, type=type(default), default=default)
    given = parser.parse_args()
    path = np.fromfile(given.path, "<f8").reshape(-1, 3)
    scene = Case("body", read_mesh(given.mesh), path).scene()
    start_s = time.perf_counter()
    renderer = Renderer(scene, effects=["wall"], seed=0, tip_radius_m=given.radius)
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
