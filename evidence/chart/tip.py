"""The question of the tip: a ball of its radius, or a point."""

import math
from typing import Final

import numpy as np

from hapscene.perception import FORCE
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh

from ..bench.case import Case, slide_path, sphere
from ..bench.tick_time import hot
from .groove import ROUNDING_M
from .measuring import TICKS
from .question import Measure, Question, Setting

RADIUS_M: Final = 2e-3
"""Radius of the tip [m]. A point stays below the limit for radii up to 0.3 mm."""

HALF_RAD: Final = math.radians(45.0)
"""Half of the opening angle of the groove [rad]."""

PRESS_M: Final = 2e-3
"""Final depth of the device below the proxy [m]."""


def settings(scene_file: str | None) -> list[Setting]:
    lever, r = f"Tip of {1e3 * RADIUS_M:g} mm", RADIUS_M
    return [
        Setting(lever, method, "", {"radius_m": r, "ball": method == "ball"}, "", method == "ball")
        for method in ("ball", "point")
    ]


def error(radius_m: float, ball: bool) -> dict[str, float]:
    """Return the distance of the tip's lowest point from its place in closed form, r / sin α − r above the edge."""
    x, y, z = np.array(((-1, -1, 1), (-1, 1, 1), (0, -1, 0), (0, 1, 0), (1, -1, 1), (1, 1, 1))).T * 0.03
    faces = np.array(((0, 2, 1), (1, 2, 3), (2, 4, 3), (3, 4, 5)), np.int32)
    groove = Mesh(vertices_m=np.column_stack((x, y, z / math.tan(HALF_RAD))), faces=faces)
    centre_m = radius_m if ball else 0.0
    up_m = radius_m / math.sin(HALF_RAD) - radius_m
    path_m = np.linspace((0.0, 0.0, 0.01), (PRESS_M / 4, 0.004, up_m - PRESS_M), 500)
    path_m[:, 2] += centre_m
    found = Renderer(Case("groove", groove, path_m).scene(), effects=["wall"], tip_radius_m=radius_m * ball).run(path_m)
    x, _, z = found.p_WP_m[-1]
    return {"off": 1e3 * max(math.hypot(x, z - centre_m - up_m), ROUNDING_M)}


def time(radius_m: float, ball: bool) -> tuple[float, float]:
    path_m = slide_path(TICKS)
    if ball:
        path_m *= 1.0 + radius_m / np.linalg.norm(path_m, axis=1, keepdims=True)
    scene = Case("sphere", sphere(5), path_m).scene()
    tick_us = 1e-3 * hot(Renderer(scene, effects=["wall"], tip_radius_m=radius_m * ball), path_m).tick_ns
    return float(np.median(tick_us)), float(np.percentile(tick_us, 99))


QUESTION: Final = Question(
    name="tip",
    title="Radius of the tip",
    measures=(Measure("off", "distance of the proxy", "mm", 1e3 * FORCE * PRESS_M, "7 % of the force"),),
    settings=settings,
    error=error,
    time=time,
    conditions="The tip is pressed 2 mm into a right-angled groove. The exact solution is in closed form. Time: a tick "
    "with the wall, on a sphere with 20 k triangles.",
)
