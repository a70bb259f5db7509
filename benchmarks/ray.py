"""Where the time of a contact goes: the rays of a path, counted in the interpreted tick, timed in a compiled loop."""

import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import new_clock, now_ns
from hapscene.contact.embree import Search, first_face, new_ray
from hapscene.contact.world import skin_of
from hapscene.errors import HapsceneError
from hapscene.native import INTERPRETED, native
from hapscene.renderer import Renderer
from hapscene.scene.scene import Scene

from .case import slide_path, sphere
from .machine import run_python
from .sheet import Sheet

Rays = NDArray[np.float64]
"""Rays (n, 7): origin [m], unit direction, length [m], in the search structure's frame."""


def measure_rays(sheet: Sheet, name: str, subdivisions: int, tick_count: int, repeats: int) -> None:
    """Count the rays in contact, and time them alone, in their order."""
    mesh = sphere(subdivisions)
    search = Search(mesh.vertices_m, mesh.faces, skin_of(mesh))
    rays, ticks = recorded_rays(subdivisions, tick_count)
    ray_ns = time_rays(search.handle, rays, repeats)
    sheet.add(name, "rays a tick mean", len(rays) / ticks, "1")
    sheet.add(name, "ray mean", ray_ns, "ns")
    sheet.add(name, "rays of a tick mean", ray_ns * len(rays) / ticks, "ns")


def time_rays(handle: int, rays: Rays, repeats: int) -> float:
    """Mean time of a ray [ns]: the least of several passes over all, each after the one before."""
    clock = new_clock()
    times = [_cast_all(handle, new_ray(), rays, clock) for _ in range(repeats + 1)]
    return min(times[1:]) / len(rays)


@native
def _cast_all(handle: int, ray: NDArray[np.float32], rays: Rays, clock: NDArray[np.int64]) -> int:
    start = now_ns(clock)
    wait = 0.0
    for i in range(len(rays)):
        r = rays[i]
        first_face(handle, ray, (r[0] + wait, r[1], r[2]), (r[3], r[4], r[5]), r[6], 0)
        wait = 0.0 * ray[8]  # in a tick, too, a ray starts where the one before has ended: none overlap
    return int(now_ns(clock) - start)


def recorded_rays(subdivisions: int, tick_count: int) -> tuple[Rays, int]:
    """The rays that a slide over a sphere casts while in contact, and the ticks in contact.

    They are noted by a process that runs the tick interpreted: the same code, so the same rays.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rays.npz"
        code = f"from hapscene_benchmarks.ray import record; record({subdivisions}, {tick_count}, {str(file)!r})"
        run_python([code], "the rays could not be recorded", NUMBA_DISABLE_JIT="1")
        with np.load(file, allow_pickle=False) as arrays:
            return arrays["rays"], int(arrays["ticks"])


def record(subdivisions: int, tick_count: int, file: str) -> None:
    """Write the rays of a slide; only where the tick runs interpreted, so that a ray can be listened to."""
    if not INTERPRETED:
        raise HapsceneError("rays are recorded under NUMBA_DISABLE_JIT=1")
    caster: Any = import_module("hapscene.contact.cast")
    noted: list[list[float]] = []
    cast_ray = caster.first_face

    def listen(search: int, ray: Any, origin: Any, direction: Any, far_m: float, arguments: int) -> int:
        noted.append([*origin, *direction, far_m])
        return int(cast_ray(search, ray, origin, direction, far_m, arguments))

    caster.first_face = listen
    scene = Scene()
    scene.add(sphere(subdivisions))
    renderer = Renderer(scene, effects=[])
    path = slide_path(tick_count)
    renderer.reset(path[0])
    kept: list[list[float]] = []
    ticks = 0
    for k in range(len(path)):
        noted.clear()
        if renderer.run(path[k : k + 1]).touching[0]:
            kept += noted
            ticks += 1
    np.savez(file, rays=np.array(kept).reshape(-1, 7), ticks=ticks)
