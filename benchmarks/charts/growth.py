"""The question of growth: what each thing costs when there is more of it, and with which exponent."""

import os
import signal
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.capture.batch import find_recordings, fit_batch
from hapscene.capture.fit.swatch import FitOptions
from hapscene.constants import TICK_S
from hapscene.errors import HapsceneError
from hapscene.renderer import EFFECTS, Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.effect import Effect
from hapscene.surface.library import load_swatch

from ..case import short, slide_path, sphere
from ..crowd import crowd_of, grid
from ..machine import held_MB
from ..tick_time import hot
from .exponent import exponents
from .question import Measure, Point, Question, Setting, no_time

TICKS: Final = 4000

SIZES: Final[Mapping[str, tuple[int, ...]]] = {
    "triangles": (3, 4, 5, 6, 7, 8),  # subdivisions of an icosahedron
    "bodies of 82 k triangles": (1, 10, 100, 1000),
    "bodies of 1.31 M triangles": (1, 10, 100),
    "swatches": (1, 10, 100, 1000),
    "effects": (1, 2, 4, 8, 16),
    "tools": (1, 2, 4),
    "recordings": (10, 30, 100),
    "processes": (1, 2),
    "Dask workers": (1, 2),
    "Dask workers, one killed": (2,),
}
"""What there is more of, and how much [count]."""

SUBDIVISIONS: Final = {"bodies of 82 k triangles": 6, "bodies of 1.31 M triangles": 8}
"""Of each of the bodies [count]."""

BATCH: Final = 60
"""Recordings of the batches whose workers grow in number [count]."""

SAMPLES: Final = 1500
"""Of a small recording [count]: a second and a half at 1 kHz."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    found, batch = [], 20 if quick else BATCH
    for kind, sizes in SIZES.items():
        if kind.startswith("Dask") and find_spec("distributed") is None:
            continue
        for n in sizes[:3] if quick else sizes:
            label = short(20 * 4**n) if kind == "triangles" else f"{n:,}"
            found.append(Setting(kind, label, {"kind": kind, "n": n, "batch": batch}))
    return found


def error(kind: str, n: int, batch: int) -> dict[str, float]:
    """The costs of so many."""
    if kind == "triangles":
        return {"work": 20 * 4**n, **_scene_costs(lambda: _spheres(sphere(n), 1), ["wall"])}
    if kind.startswith("bodies"):
        return {"work": n, **_scene_costs(lambda: _spheres(sphere(SUBDIVISIONS[kind]), n), ["wall"])}
    if kind == "swatches":
        return {"work": n, **_scene_costs(lambda: _painted(n), EFFECTS)}
    if kind == "effects":
        idle = [Effect(f"idle_{i}", "Does nothing.", _do_nothing) for i in range(n)]
        return {"work": n, "tick": _tick_us(Renderer(_spheres(sphere(6), 1), idle))[0]}
    if kind == "tools":
        return {"work": n, "tick": _tools_us(n)}
    if kind == "recordings":
        return {"work": n, "batch": _batch_s(n, jobs=1)}
    return {"work": n, "rate": batch / _batch_s(batch, jobs=n, dask="Dask" in kind, kill="killed" in kind)}


def _scene_costs(build: Callable[[], Scene], effects: Sequence[str]) -> dict[str, float]:
    """Loading [s] and memory [MB] of a renderer of a scene, the median tick and the one in a thousand [µs]."""
    scene = build()
    Renderer(_spheres(sphere(1), 1), effects)  # what is loaded once is not this scene's
    start_s = clock.perf_counter()
    renderer = Renderer(scene, effects)
    load_s = clock.perf_counter() - start_s
    median_us, late_us = _tick_us(renderer)
    del renderer
    return {"tick": median_us, "late": late_us, "load": load_s, "memory": held_MB(lambda: Renderer(scene, effects))}


def _tick_us(renderer: Renderer) -> tuple[float, float]:
    """The median and the 99.9th percentile [µs] of ticks, each the least of some runs: without what others take."""
    ticks = hot(renderer, slide_path(TICKS), 3).tick_ns
    return 1e-3 * float(np.median(ticks)), 1e-3 * float(np.percentile(ticks, 99.9))


def _spheres(mesh: Mesh, count: int) -> Scene:
    """Bodies of one mesh on a grid; the tool slides over the first."""
    return crowd_of(mesh, grid(count))


def _painted(count: int) -> Scene:
    """A sphere in slices from top to bottom, each of a swatch of its own."""
    scene, wood = _spheres(sphere(6), 1), load_swatch("wood")
    height = scene.bodies[0].mesh.triangles_m[:, :, 2].mean(axis=1)
    slices = np.minimum((np.argsort(np.argsort(height)) * count) // len(height), count - 1)
    for k in range(count):
        scene.paint("body 0", replace(wood, name=f"wood {k}"), slices == k)
    return scene


def _do_nothing(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    pass


def _tools_us(count: int) -> float:
    """A step of each of so many tools in one scene from Python, one after the other: the median [µs]."""
    scene = _spheres(sphere(6), 1)
    tools = [Renderer(scene) for _ in range(count)]
    took_ns = []
    for p in slide_path(TICKS):
        start_ns = clock.perf_counter_ns()
        for tool in tools:
            tool.step(p)
        took_ns.append(clock.perf_counter_ns() - start_ns)
    return 1e-3 * float(np.median(took_ns))


def _batch_s(count: int, jobs: int, dask: bool = False, kill: bool = False) -> float:
    """Time to fit so many small recordings once the first one is through [s]: the processes are there by then.

    Raises:
        HapsceneError: one of them was not fitted.
    """
    with tempfile.TemporaryDirectory() as folder:
        rng = np.random.default_rng(0)
        for k in range(count):
            values = "\n".join(f"{a:.5f}" for a in rng.standard_normal(SAMPLES))
            Path(folder, f"r{k:05}.csv").write_text(f"acceleration\n{values}\n", encoding="utf-8")
        items = find_recordings([folder])
        words: dict[str, Any] = {"reading": {"rate_Hz": 1000.0, "units": {"acceleration": "m/s2"}},
                                 "options": FitOptions(order=3)}  # fmt: skip
        out = Path(folder, "swatches")
        done_s: list[float] = []
        pids: list[int] = []

        def after(result: Any) -> None:
            done_s.append(clock.perf_counter())
            if pids and len(done_s) == count // 4:
                os.kill(pids[0], signal.SIGKILL)

        if not dask:
            result = fit_batch(items, out, jobs=jobs, after=after, **words)
        else:
            cluster_of: Any = import_module("distributed").LocalCluster
            with cluster_of(n_workers=jobs, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:
                pids += [worker.pid for worker in cluster.workers.values()] if kill else []
                result = fit_batch(items, out, scheduler=cluster.scheduler_address, after=after, **words)
    if len(result.fitted) != count:
        raise HapsceneError(f"a batch lost {count - len(result.fitted)} of {count} recordings")
    return (done_s[-1] - done_s[0]) * count / (count - 1)


def faces(point: Point) -> float:
    """Triangles of the scene of a point [count]."""
    if point.method == "triangles":
        return point.errors["work"]
    return point.errors["work"] * 20 * 4 ** SUBDIVISIONS[point.method] if point.method in SUBDIVISIONS else 0.0


def advice(points: Sequence[Point]) -> str:
    tick, load, memory = (exponents(points, key) for key in ("tick", "load", "memory"))
    fine = max((p for p in points if p.method == "triangles"), key=lambda p: p.errors["work"])
    large = max((p for p in points if p.errors.get("late", np.inf) < 1e6 * TICK_S), key=faces)
    each_B = 1e6 * fine.errors["memory"] / fine.errors["work"]
    steep = [
        f"{of} ({grown.words()})" for kind in (tick, load, memory) for of, grown in kind.items() if grown.low > 1.05
    ]
    return (
        f"A tick grows with triangles as {tick['triangles'].words()}; a triangle takes {each_B:.0f} bytes and "
        f"{1e6 * fine.errors['load'] / fine.errors['work']:.2g} µs to load. The largest scene that was tried and holds "
        f"1 kHz in 99.9 % of ticks, by the tick alone, has {short(round(faces(large)))} triangles ({large.method}: "
        f"{large.label}{'' if large.method == 'triangles' else ', of one mesh'}; {large.errors['late']:.2g} µs). "
        "Choose by memory and loading, then, not by the tick; not so "
        "where a loop wakes late, which no tick mends. "
        + (f"Faster than its work grows: {', '.join(steep)}." if steep else "Nothing grew faster than its work.")
    )


QUESTION: Final = Question(
    name="growth",
    title="How does each cost grow?",
    measures=(
        Measure("tick", "a tick, median", "µs"),
        Measure("late", "a tick, p99.9", "µs"),
        Measure("load", "making a renderer of what is in memory", "s"),
        Measure("memory", "memory of the renderer", "MB"),
        Measure("batch", "a batch in one process that is there", "s"),
        Measure("rate", "recordings fitted in a second", "1/s", more_is_better=True),
    ),
    settings=settings,
    error=error,
    time=no_time,
    advice=advice,
    conditions="A slide over an icosphere: with the wall alone; with all five effects and a wood of its own for each "
    "slice where swatches grow in number; effects that do nothing; tools that step in turn from Python. Bodies share "
    "one mesh. Recordings of a second and a half, order 3. No servo: what a loop adds by waking late is not in it.",
    growth=True,
)
