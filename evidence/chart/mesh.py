"""The question of the mesh: how much of a scan may be left out before the hand notices."""

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
"""Of the faces [count]."""

CREASE_RAD: Final = math.radians(40.0)
"""Edges below which a shaded mesh is felt round [rad]: those of a sphere of 100 faces are, those of a box are not."""

DEPTH_M: Final = 1e-4
"""Depth from which a direction is judged [m]: there is 0.05 N, and a skin of a micrometre is 1/100 of it."""

FACES_MIN: Final = 40
"""Faces that are left at least [count]."""

LEAST: Final = {"direction": 0.01, "force": 0.001, "edge": 0.01, "depth": 0.001}
"""What errors are told as where they are less: on flat faces they are rounding, which would fill the picture."""

LATE: Final = 95.0
"""Percentile of the ticks in contact that an error is told of: what 19 in 20 lie below."""


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
                    label = f"÷{divisor}" if divisor > 1 else "whole"
                    found.append(Setting(f"{name}, shaded" if shaded else name, label, arguments))
    return found


def subject(point: Point) -> str:
    """The body that a point is of."""
    return point.method.removesuffix(", shaded")


def renderer_of(scene_file: str | None, body: str, divisor: int, shaded: bool) -> Renderer:
    """One that has the reduced body alone, and the wall alone."""
    scene = touched(scene_file, body).scene(reduced(scene_file, body, divisor))
    return Renderer(scene, ["wall"], crease_rad=CREASE_RAD if shaded else 0.0)


def error(scene_file: str | None, body: str, divisor: int, shaded: bool) -> dict[str, float]:
    """Errors of force and depth on the path, and the mesh's memory."""
    on = touched(scene_file, body)
    felt = renderer_of(scene_file, body, divisor, shaded).run(on.p_WT_m)
    memory_MB = held_MB(lambda: renderer_of(scene_file, body, divisor, shaded))
    found = force_errors(felt, on.into_m, PLAIN.stiffness_N_m)
    return {**{key: max(value, LEAST[key]) for key, value in found.items()}, "memory": memory_MB}


def force_errors(felt: Recording, into_m: Array, stiffness_N_m: float) -> dict[str, float]:
    """Of a recording with the wall alone, against the closest points of `Touched.into_m`.

    Where both never touch at once there is no direction: NaN.
    """
    true_N, force_N = stiffness_N_m * into_m, felt.f_W_N
    depth_m, size_N = np.linalg.norm(into_m, axis=1), np.linalg.norm(force_N, axis=1)
    on = felt.touching | (depth_m > 0.0)
    true_size_N = np.linalg.norm(true_N, axis=1)
    size = np.abs(size_N - true_size_N) / (FORCE * np.maximum(true_size_N, FORCE_LEAST_N))
    both = felt.touching & (depth_m > DEPTH_M)
    turn = angle_deg(force_N, true_N)[both]
    step, true_step = angle_deg(force_N[1:], force_N[:-1]), angle_deg(true_N[1:], true_N[:-1])
    sliding = both[1:] & both[:-1]
    return {
        "direction": float(np.percentile(turn, LATE)) if len(turn) else math.nan,
        "force": float(np.percentile(size[on], LATE)),
        "edge": float(np.max(np.maximum(step - true_step, 0.0)[sliding], initial=0.0)),
        "depth": 1e3 * float(np.percentile(np.abs(felt.depth_m - depth_m)[on], LATE)),
    }


def time(scene_file: str | None, body: str, divisor: int, shaded: bool) -> tuple[float, float]:
    renderer = renderer_of(scene_file, body, divisor, shaded)
    return spread_us(hot(renderer, touched(scene_file, body).p_WT_m, 3).tick_ns)


def advice(points: Sequence[Point]) -> str:
    said = []
    for body in dict.fromkeys(map(subject, points)):
        of = [p for p in points if p.method == body]
        fit = [
            p for p in of if p.errors["force"] <= 1.0 and max(p.errors["direction"], p.errors["edge"]) <= DIRECTION_DEG
        ]
        if not fit:
            said.append(f"{body} whole")
            continue
        least, whole = min(fit, key=lambda p: p.errors["memory"]), of[0]
        said.append(f"{body} {least.label} ({least.errors['memory']:.2g} MB of {whole.errors['memory']:.2g})")
    return (
        f"Take the coarsest mesh whose force, direction and edges nobody feels: {'; '.join(said)}. It saves memory and "
        "loading; a tick gains next to nothing. Shade what was round and is coarse. Do not where the facets are the "
        "shape, or where energy counts: shading turns the force and leaves its size."
    )


QUESTION: Final = Question(
    name="mesh",
    title="How coarse may a mesh be?",
    measures=(
        Measure("direction", "direction of the force, off by (95 % of ticks)", "°", DIRECTION_DEG,
                "Barbagli et al. 2006"),
        Measure("force", "size of the force, off by (95 % of ticks)", "JND", 1.0, "7 %, Pang et al. 1991"),
        Measure("edge", "felt edge: largest turn from tick to tick beyond the surface's own", "°", DIRECTION_DEG,
                "Barbagli et al. 2006"),
        Measure("depth", "depth, off by (95 % of ticks)", "mm"),
        Measure("memory", "memory of the mesh", "MB"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions="Each body by itself, its faces reduced by quadric error metrics (fast-simplification), felt with the "
    "wall alone along the path of a hand that explores it from above. Truth: the point of the unreduced mesh that is "
    "closest to the tool, by distances to its triangles; of the sphere, the round surface. A proxy that was led over "
    "bumps is not always at the closest point: so much of the error is not the mesh's. Shaded: edges below 40° are "
    "felt round.",
    against="memory",
    subject=subject,
)  # fmt: skip
