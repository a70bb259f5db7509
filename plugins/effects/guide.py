"""A guide: a virtual fixture (Rosenberg 1993) that leads the tool to a point, a line or a plane, or keeps it away.

`points_m` (n, 3) in F (the first named body, or W) are a point, a line from the first to the second, or a polyline
through all; with `normal` (3,) one point and a normal are a plane. With the distance d [m] to the nearest place, the
outward direction n̂ away from it, stiffness K [N/m] and reach r [m]:

    attracting   f = −K d (1 − (d/r)²)² n̂          no force at the place and from r on, at most 0.286 K r between
    repelling    f = K (r − d) min(1, 4 d/r) n̂     none from r on; within r/4 it falls to 0, where n̂ turns round
                 f = K max(0, r − s) n̂             of a plane: all behind it is forbidden, s its signed distance

Each is the gradient of a potential by d, so no closed path gives energy, and the force is continuous: a tool that
enters feels no kick. (Where two stretches of a polyline are equally near within r, the force turns round; the potential
does not jump.) Nowhere is it stiffer than K but at a repelling line's middle, which pushes away. Rendered at period T
it is passive while hand and device damp more than K T/2 (Colgate & Schenkel 1997); `viscosity` adds damping.
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
    """Closest point to `p` of the polyline through the `count` points that the table has from `start` on."""
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
    """Add the force towards the place, or away from it [N]."""
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
    """The points, the unit normal of a plane or zeros, and how many points there are."""
    points = field_array("guide", settings, "points_m", "(n, 3): a point, a line, a polyline, or a plane with normal")
    if settings["normal"] is None:
        return np.array([*points.ravel(), 0.0, 0.0, 0.0, len(points)])
    normal = field_array("guide", settings, "normal", "of a plane (3,)")
    length = np.linalg.norm(normal)
    if len(points) != 1 or len(normal) != 1 or length == 0.0:
        raise EffectError("effect 'guide': a plane is one point in points_m, and a normal (3,) that is not 0")
    return np.array([*points[0], *(normal[0] / length), 1.0])


EFFECT = Effect(
    "guide",
    "Leads the tool to a point, line or plane, or keeps it away.",
    render,
    params=(
        Param("stiffness_N_m", 200.0, "N/m", "how hard", 0.0, 1e4),
        Param("reach_m", 0.01, "m", "distance at which it begins", 1e-4, 10.0),
        Param("repelling", 0.0, "1", "0 attracts, above 0 keeps away", 0.0, 1.0),
    ),
    table=table,
    scope="scene",
    arrays=("points_m", "normal"),
)
