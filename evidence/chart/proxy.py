"""The question of the proxy: exact active set or alternating projection in a groove; a tip as a ball or as a point.

Alternating projection (von Neumann 1933) projects the point onto the two planes in turn. Each step multiplies the error
by cos α, with the groove's angle α: it converges quickly at a right angle and slowly in a sharp groove.
"""

import math
from typing import Any, Final

import numpy as np

from hapscene.clock import new_clock, now_ns
from hapscene.compiled.native import native
from hapscene.contact.planes import nearest
from hapscene.contact.world import PROXY
from hapscene.geometry import Vector, norm
from hapscene.perception import FORCE
from hapscene.records import records
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh

from ..bench.case import Case, slide_path, sphere
from .measuring import TICKS, spread_us, ticks_ns
from .question import Measure, Question, Setting

ANGLES_DEG: Final = (60.0, 20.0, 10.0)
"""Opening angles of the groove [°]."""

STEPS: Final = (1024, 256, 64, 16, 4, 1)
"""Numbers of projections [count]."""

TOOL_M: Final[Vector] = (0.3e-3, 0.0, -2e-3)
"""Tool position, 2 mm below the edge at the origin and slightly to the side [m]: the exact proxy is the origin."""

CALLS: Final = 2000
"""Solutions per timed call [count]."""

EXACT: Final = "active set"

ROUNDING_M: Final = 1e-15
"""Rounding of float64 at the scale of a millimetre [m]: smaller errors are drawn as this, as a log axis has no 0."""


RADIUS_M: Final = 2e-3
"""Radius of the tip [m]. A point stays below the limit for radii up to 0.3 mm."""

HALF_RAD: Final = math.radians(45.0)
"""Half of the opening angle of the groove that the tip is pressed into [rad]."""

PRESS_M: Final = 2e-3
"""Final depth of the device below the proxy [m]."""


def settings(scene_file: str | None) -> list[Setting]:
    methods = [(EXACT, "", 0), *(("projection", f"{n} steps", n) for n in STEPS)]
    grooves = [
        Setting("Proxy in a groove", method, label, {"angle_deg": a, "steps": n}, f"{a:g}°", method == EXACT)
        for method, label, n in methods
        for a in ANGLES_DEG
    ]
    lever = f"Tip of {1e3 * RADIUS_M:g} mm"
    tips = [Setting(lever, name, "", {"ball": name == "ball"}, "", name == "ball") for name in ("ball", "point")]
    return grooves + tips


def error(angle_deg: float = 0.0, steps: int = 0, ball: bool | None = None) -> dict[str, float]:
    """Return the distance of the proxy from the exact one: in a groove, or of a tip if `ball` is not None.

    `steps` is the number of projections, 0 for the active set.
    """
    if ball is not None:
        return {"off": max(tip_error_m(ball), ROUNDING_M) * 1e3}
    planes = groove(angle_deg)
    off_m = alternating_error_m(planes, steps) if steps else norm(nearest(planes[0], TOOL_M, 0.0)[1])
    return {"off": max(off_m, ROUNDING_M) * 1e3}


def time(angle_deg: float = 0.0, steps: int = 0, ball: bool | None = None) -> tuple[float, float]:
    if ball is not None:
        return tip_time_us(ball)
    planes, clock = groove(angle_deg), new_clock()
    taken = [time_ns(planes, steps, clock) for _ in range(30)]
    taken.sort()
    return taken[len(taken) // 2] * 1e-3, taken[-1] * 1e-3


def tip_error_m(ball: bool) -> float:
    """Return the distance of the tip's lowest point from its place in closed form, r / sin α − r above the edge [m]."""
    x, y, z = np.array(((-1, -1, 1), (-1, 1, 1), (0, -1, 0), (0, 1, 0), (1, -1, 1), (1, 1, 1))).T * 0.03
    faces = np.array(((0, 2, 1), (1, 2, 3), (2, 4, 3), (3, 4, 5)), np.int32)
    mesh = Mesh(vertices_m=np.column_stack((x, y, z / math.tan(HALF_RAD))), faces=faces)
    centre_m = RADIUS_M if ball else 0.0
    up_m = RADIUS_M / math.sin(HALF_RAD) - RADIUS_M
    path_m = np.linspace((0.0, 0.0, 0.01), (PRESS_M / 4, 0.004, up_m - PRESS_M), 500)
    path_m[:, 2] += centre_m
    found = Renderer(Case("groove", mesh, path_m).scene(), effects=["wall"], tip_radius_m=centre_m).run(path_m)
    x, _, z = found.p_WP_m[-1]
    return math.hypot(x, z - centre_m - up_m)


def tip_time_us(ball: bool) -> tuple[float, float]:
    path_m = slide_path(TICKS)
    if ball:
        path_m *= 1.0 + RADIUS_M / np.linalg.norm(path_m, axis=1, keepdims=True)
    scene = Case("sphere", sphere(5), path_m).scene()
    return spread_us(ticks_ns(Renderer(scene, effects=["wall"], tip_radius_m=RADIUS_M * ball), path_m))


def groove(angle_deg: float) -> Any:
    """Return the planes of a groove along y with its edge at the origin, open upwards: a `PROXY` record."""
    proxy = records(1, PROXY)
    half = math.radians(angle_deg) / 2
    proxy["nhat_W"][0, :2] = (math.cos(half), 0.0, math.sin(half)), (-math.cos(half), 0.0, math.sin(half))
    proxy["skin_m"] = 1e-6
    proxy["count"] = 2
    return proxy


def alternating_error_m(planes: Any, steps: int) -> float:
    """Return the distance from the exact point after a number of projections [m]."""
    return norm(alternate(planes[0], TOOL_M, steps))


@native
def alternate(proxy: Any, p: Vector, steps: int) -> Vector:
    """Project the point `p` in turn onto the planes that it lies behind."""
    for step in range(steps):
        n = proxy.nhat_W[step % proxy.count]
        short = proxy.offset_m[step % proxy.count] - (n[0] * p[0] + n[1] * p[1] + n[2] * p[2])
        if short > 0.0:
            p = (p[0] + short * n[0], p[1] + short * n[1], p[2] + short * n[2])
    return p


def time_ns(planes: Any, steps: int, clock: Any) -> float:
    """Return the time of a number of projections, or of the active set if `steps` is 0 [ns]."""
    return float(_time_alternating(planes, steps, clock) if steps else _time_exact(planes, clock)) / CALLS


@native
def _time_alternating(planes: Any, steps: int, clock: Any) -> int:
    start = now_ns(clock)
    x = 0.0
    for _ in range(CALLS):  # depends on the previous result, so that the compiler removes no call
        x = 1e-30 * alternate(planes[0], (0.3e-3 + x, 0.0, -2e-3), steps)[0]
    return int(now_ns(clock) - start) + int(x)


@native
def _time_exact(planes: Any, clock: Any) -> int:
    start = now_ns(clock)
    x = 0.0
    for _ in range(CALLS):
        x = 1e-30 * nearest(planes[0], (0.3e-3 + x, 0.0, -2e-3), 0.0)[1][0]
    return int(now_ns(clock) - start) + int(x)


QUESTION: Final = Question(
    name="proxy",
    title="Proxy method and radius of the tip",
    measures=(Measure("off", "distance of the proxy", "mm", 1e3 * FORCE * PRESS_M, "7 % of the force"),),
    settings=settings,
    error=error,
    time=time,
    conditions="The tool is 2 mm below the edge of a groove of 60, 20 or 10°. The exact solution is the edge. Time: "
    "one solution. The tip is pressed 2 mm into a right-angled groove. The exact solution is in closed form. Time: a "
    "tick with the wall, on a sphere with 20 k triangles.",
)
