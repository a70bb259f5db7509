"""The question of mesh resolution: how many faces a mesh needs."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from hapscene.perception import DIRECTION_DEG, FORCE, FORCE_LEAST_N
from hapscene.render.recording import Recording
from hapscene.render.renderer import Renderer
from hapscene.surface.swatch import PLAIN

from ..bench.accuracy import angle_deg
from ..bench.machine import held_MB
from ..bench.tick_time import hot
from .measuring import spread_us
from .question import Measure, Point, Question, Setting
from .touched_surface import SPHERE, Array, bodies_of, reduced, touched

DIVISORS: Final = (1, 2, 4, 8, 16, 32, 64)
"""Factors by which the number of faces is reduced [1]."""

CREASE_RAD: Final = math.radians(40.0)
"""Angle below which shading smooths an edge [rad]: a sphere of 100 faces becomes round, a box keeps its edges."""

DEPTH_M: Final = 1e-4
"""Penetration depth above which the direction is judged [m]; there the force is 0.05 N."""

FACES_MIN: Final = 40
"""Smallest number of faces of a reduced mesh [count]."""

LEAST: Final = {"direction": 0.01, "force": 0.001, "edge": 0.01, "depth": 0.001}
"""Smallest errors that are drawn: on flat faces errors are rounding, which would extend the axis."""

PERCENTILE: Final = 95.0
"""Percentile over the ticks in contact that is reported [%]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    names = bodies_of(scene_file)
    names = ([SPHERE] if scene_file is None else []) + (names[:1] if quick else names)
    found = []
    for name in names:
        count = len(touched(scene_file, name).body.mesh.faces)
        for shaded in (False, True):
            for divisor in DIVISORS[::3] if quick else DIVISORS:
                if count // divisor >= FACES_MIN:
                    arguments = {"scene_file": scene_file, "body": name, "divisor": divisor, "shaded": shaded}
                    label = f"÷{divisor}" if divisor > 1 else "full"
                    found.append(Setting(f"{name}, shaded" if shaded else name, label, arguments))
    return found


def subject(point: Point) -> str:
    """Return the name of the body of a point."""
    return point.method.removesuffix(", shaded")


def renderer_of(scene_file: str | None, body: str, divisor: int, shaded: bool) -> Renderer:
    """Return a renderer for the reduced body alone, with the wall as the only effect."""
    scene = touched(scene_file, body).scene(reduced(scene_file, body, divisor))
    return Renderer(scene, ["wall"], crease_rad=CREASE_RAD if shaded else 0.0)


def error(scene_file: str | None, body: str, divisor: int, shaded: bool) -> dict[str, float]:
    """Return the errors of force and depth on the path, and the memory of the mesh."""
    on = touched(scene_file, body)
    recording = renderer_of(scene_file, body, divisor, shaded).run(on.p_WT_m)
    memory_MB = held_MB(lambda: renderer_of(scene_file, body, divisor, shaded))
    found = force_errors(recording, on.into_m, PLAIN.stiffness_N_m)
    return {**{key: max(value, LEAST[key]) for key, value in found.items()}, "memory": memory_MB}


def force_errors(recording: Recording, into_m: Array, stiffness_N_m: float) -> dict[str, float]:
    """Return the errors of a recording with the wall alone, against the closest points `Touched.into_m`.

    The direction error is NaN if the two are never in contact in the same tick.
    """
    true_N, force_N = stiffness_N_m * into_m, recording.f_W_N
    depth_m, size_N = np.linalg.norm(into_m, axis=1), np.linalg.norm(force_N, axis=1)
    on = recording.touching | (depth_m > 0.0)
    true_size_N = np.linalg.norm(true_N, axis=1)
    size = np.abs(size_N - true_size_N) / (FORCE * np.maximum(true_size_N, FORCE_LEAST_N))
    both = recording.touching & (depth_m > DEPTH_M)
    turn = angle_deg(force_N, true_N)[both]
    step, true_step = angle_deg(force_N[1:], force_N[:-1]), angle_deg(true_N[1:], true_N[:-1])
    sliding = both[1:] & both[:-1]
    return {
        "direction": float(np.percentile(turn, PERCENTILE)) if len(turn) else math.nan,
        "force": float(np.percentile(size[on], PERCENTILE)),
        "edge": float(np.max(np.maximum(step - true_step, 0.0)[sliding], initial=0.0)),
        "depth": 1e3 * float(np.percentile(np.abs(recording.depth_m - depth_m)[on], PERCENTILE)),
    }


def time(scene_file: str | None, body: str, divisor: int, shaded: bool) -> tuple[float, float]:
    renderer = renderer_of(scene_file, body, divisor, shaded)
    return spread_us(hot(renderer, touched(scene_file, body).p_WT_m, 3).tick_ns)


def advice(points: Sequence[Point]) -> str:
    """Recommend the coarsest mesh of each body whose errors are not perceptible."""
    found = []
    for body in dict.fromkeys(map(subject, points)):
        of = [p for p in points if p.method == body]
        fit = [
            p for p in of if p.errors["force"] <= 1.0 and max(p.errors["direction"], p.errors["edge"]) <= DIRECTION_DEG
        ]
        if not fit:
            found.append(f"{body}: full mesh")
            continue
        least, whole = min(fit, key=lambda p: p.errors["memory"]), of[0]
        found.append(f"{body} {least.label} ({least.errors['memory']:.2g} MB instead of {whole.errors['memory']:.2g})")
    return (
        f"Coarsest meshes with force, direction and edges below their limits: {'; '.join(found)}. They save memory and "
        "loading time; the tick time hardly changes. Shading suits coarse meshes of round shapes: it changes the "
        "direction of the force, not its size."
    )


QUESTION: Final = Question(
    name="mesh",
    title="Mesh resolution",
    measures=(
        Measure("direction", "error of the force's direction (95 % of ticks)", "°", DIRECTION_DEG,
                "Barbagli et al. 2006"),
        Measure("force", "error of the force's size (95 % of ticks)", "JND", 1.0, "7 %, Pang et al. 1991"),
        Measure("edge", "edges: largest turn between ticks beyond that of the surface", "°", DIRECTION_DEG,
                "Barbagli et al. 2006"),
        Measure("depth", "error of the depth (95 % of ticks)", "mm"),
        Measure("memory", "memory of the mesh", "MB"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions="Each body alone, its faces reduced by quadric error metrics (fast-simplification), touched with the "
    "wall effect along the path of a hand that explores it from above. Reference: the closest point of the full mesh, "
    "or of the round sphere. On bumpy bodies the proxy is not always at the closest point, which adds to the error. "
    "Shaded: edges below 40° are smoothed.",
    against="memory",
    subject=subject,
)  # fmt: skip
