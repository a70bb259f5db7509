"""The question of mesh resolution: how many faces a mesh needs."""

import math
from typing import Final

import numpy as np

from hapscene.fidelity.trial import memory_B
from hapscene.fidelity.tune import HALVINGS
from hapscene.perception import DIRECTION_DEG, FORCE, FORCE_LEAST_N
from hapscene.render.recording import Recording
from hapscene.render.renderer import Renderer
from hapscene.surface.swatch import PLAIN

from ..bench.accuracy import angle_deg
from .measuring import spread_us, ticks_ns
from .question import Measure, Question, Setting
from .touched_surface import SPHERE, Array, bodies_of, reduced, touched

DIVISORS: Final = tuple(2**k for k in range(HALVINGS + 1))
"""Factors by which the number of faces is reduced, as in `hapscene tune` [1]."""

CREASE_RAD: Final = math.radians(40.0)
"""Angle below which shading smooths an edge [rad]: a sphere of 100 faces becomes round, a box keeps its edges."""

DEPTH_M: Final = 1e-4
"""Penetration depth above which the direction is judged [m]; there the force is 0.05 N."""

FACES_MIN: Final = 40
"""Smallest number of faces of a reduced mesh [count]."""

PERCENTILE: Final = 95.0
"""Percentile over the ticks in contact that is reported [%]."""


def settings(scene_file: str | None) -> list[Setting]:
    names = bodies_of(scene_file)
    names = ([SPHERE] if scene_file is None else []) + names
    found = []
    for name in names:
        count = len(touched(scene_file, name).body.mesh.faces)
        for shaded in (False, True):
            for divisor in DIVISORS:
                if divisor == 1 or count // divisor >= FACES_MIN:
                    arguments = {"scene_file": scene_file, "body": name, "divisor": divisor, "shaded": shaded}
                    label, method = f"÷{divisor}" if divisor > 1 else "full", "shaded" if shaded else ""
                    default = divisor == 1 and not shaded
                    found.append(Setting(f"Mesh of {name}", method, label, arguments, default=default))
    return found


def program(scene_file: str | None, body: str, divisor: int, shaded: bool) -> bytes:
    """Return the faces of the reduced mesh."""
    mesh = reduced(scene_file, body, divisor)
    return mesh.vertices_m.tobytes() + mesh.faces.tobytes()


def renderer_of(scene_file: str | None, body: str, divisor: int, shaded: bool) -> Renderer:
    """Return a renderer for the reduced body alone, with the wall as the only effect."""
    scene = touched(scene_file, body).scene(reduced(scene_file, body, divisor))
    return Renderer(scene, ["wall"], crease_rad=CREASE_RAD if shaded else 0.0)


def error(scene_file: str | None, body: str, divisor: int, shaded: bool) -> dict[str, float]:
    """Return the errors of the force on the path, and the memory of the mesh."""
    on, renderer = touched(scene_file, body), renderer_of(scene_file, body, divisor, shaded)
    errors = force_errors(renderer.run(on.p_WT_m), on.into_m, PLAIN.stiffness_N_m)
    return {**errors, "memory": 1e-6 * memory_B(renderer)}


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
    }


def time(scene_file: str | None, body: str, divisor: int, shaded: bool) -> tuple[float, float]:
    renderer = renderer_of(scene_file, body, divisor, shaded)
    return spread_us(ticks_ns(renderer, touched(scene_file, body).p_WT_m, 3))


QUESTION: Final = Question(
    name="mesh",
    title="Mesh resolution",
    measures=(
        Measure("direction", "direction of the force", "°", DIRECTION_DEG, "Barbagli et al. 2006"),
        Measure("force", "size of the force", "JND", 1.0, "7 %, Pang et al. 1991"),
        Measure("edge", "turn at an edge", "°", DIRECTION_DEG, "Barbagli et al. 2006"),
        Measure("memory", "memory of the renderer", "MB"),
    ),
    settings=settings,
    error=error,
    time=time,
    conditions="Each body alone, its faces reduced by quadric error metrics (fast-simplification), touched with the "
    "wall effect along the path of a hand that explores it from above. Reference: the closest point of the full mesh, "
    "or of the round sphere; 95 % of the ticks. Edge: largest turn between ticks beyond that of the surface. On bumpy "
    "bodies the proxy is not always at the closest point, which adds to the error. Shaded: edges below 40° are "
    "smoothed.",
    program=program,
)
