"""Guide: a virtual fixture (Rosenberg 1993) that attracts the tool to a point, line or plane, or repels it.

`points_m` (n, 3) in the frame F (the first named body, or W) define a point, a line between two points, or a polyline.
A point with a `normal` (3,) defines a plane. With the distance d [m] from the nearest point of the shape, the unit
vector n̂ from there to the tool, stiffness K [N/m] and reach r [m]:

    attracting   f = −K d (1 − (d/r)²)² n̂          0 on the shape and beyond r; at most 0.286 K r
    repelling    f = K (r − d) min(1, 4 d/r) n̂     0 beyond r; falls to 0 within r/4, where n̂ changes direction
                 f = K max(0, r − s) n̂             plane with signed distance s: repels everything behind it

Each force is the gradient of a potential and continuous, so it adds no energy and a tool that comes within reach feels
no step. (Where two segments of a polyline are equally near, the direction changes; the potential is continuous.) The
stiffness does not exceed K, except in the middle of a repelling line. At period T the guide is passive if hand and
device provide a damping of more than K T/2 (Colgate & Schenkel 1997); the effect `viscosity` adds damping.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import EffectError
from hapscene.geometry import Vector, along, dot, sub
from hapscene.surface.effect import Effect, Param
from hapscene.surface.field_frame import add_force, eased, fade, field_array, to_frame


@native
def nearest_on_polyline(table: NDArray[np.float64], start: int, count: int, p: Vector) -> Vector:
    """Closest point to `p` on the polyline through `count` points that are stored in the table from `start` on."""
    best, best2 = (table[start], table[start + 1], table[start + 2]), math.inf
    for i in range(max(1, count - 1)):
        at = start + 3 * i
        after = at + 3 if count > 1 else at
        a = (table[at], table[at + 1], table[at + 2])
        way = sub((table[after], table[after + 1], table[after + 2]), a)
        length2 = dot(way, way)
        share = min(1.0, max(0.0, dot(sub(p, a), way) / length2)) if length2 > 0.0 else 0.0
        found = along(a, share, way)
        back = sub(p, found)
        if dot(back, back) < best2:
            best, best2 = found, dot(back, back)
    return best


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Adds the force towards the shape, or away from it [N]."""
    count = int(table[len(table) - 1])
    start = len(table) - 4 - 3 * count
    tool, stiffness, reach = to_frame(table, touch.p_WT_m), p.stiffness_N_m * eased(touch), p.reach_m
    n = (table[len(table) - 4], table[len(table) - 3], table[len(table) - 2])
    is_plane = dot(n, n) > 0.0
    if is_plane:
        s_m = dot(sub(tool, (table[start], table[start + 1], table[start + 2])), n)
        away = (s_m * n[0], s_m * n[1], s_m * n[2])
        if p.repelling > 0.0:
            if s_m < reach:
                add_force(out, table, stiffness * (reach - s_m), n)
            return
    else:
        away = sub(tool, nearest_on_polyline(table, start, count, tool))
    d = math.sqrt(dot(away, away))
    if d >= reach:
        return
    if p.repelling > 0.0:
        add_force(out, table, stiffness * (reach - d) / max(d, 0.25 * reach), away)
    else:
        add_force(out, table, -stiffness * fade((d / reach) ** 2), away)


def table(settings: Mapping[str, Any], rate_Hz: float) -> NDArray[np.float64]:
    """Table of the points, the unit normal of a plane or zeros, and the number of points."""
    points = field_array("guide", settings, "points_m", "(n, 3), points of a line or polyline")
    if settings["normal"] is None:
        return np.array([*points.ravel(), 0.0, 0.0, 0.0, len(points)])
    normal = field_array("guide", settings, "normal", "of a plane (3,)")
    length = np.linalg.norm(normal)
    if len(points) != 1 or len(normal) != 1 or length == 0.0:
        raise EffectError("effect 'guide': invalid plane; expected one point in points_m and a nonzero normal (3,)")
    return np.array([*points[0], *(normal[0] / length), 1.0])


EFFECT = Effect(
    "guide",
    "Attracts the tool to a point, line or plane, or repels it.",
    render,
    params=(
        Param("stiffness_N_m", 200.0, "N/m", "stiffness of the guide", 0.0, 1e4),
        Param("reach_m", 0.01, "m", "distance at which the force begins", 1e-4, 10.0),
        Param("repelling", 0.0, "1", "0: attracts; above 0: repels", 0.0, 1.0),
    ),
    table=table,
    scope="scene",
    arrays=("points_m", "normal"),
)
