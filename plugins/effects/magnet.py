"""Magnets: points that attract the tool.

    f = −Σ K d_i (1 − (d_i/r)²)²    over all points within the reach r [m],    K = F / (0.286 r)

d_i [m] is the vector from point i to the tool. The strength F [N] is the largest force of one point, at a distance of
r/√5. The potential, the sum of K r²/6 (1 − (1 − (d_i/r)²)³), is smooth and of finite reach, so the magnets add no
energy. The potential wells of points closer than r overlap.

`points_m` (n, 3) are given in the frame F: the first named body, or W. A point is as stiff as a wall of K = 3.5 F/r and
needs as much damping by hand and device: more than K T/2 at period T.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.geometry import dot, sub
from hapscene.surface.effect import Effect, Param
from hapscene.surface.field_frame import FADED_MOST, add_force, eased, fade, field_array, to_frame


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Adds the attraction of the points [N]."""
    tool, reach2 = to_frame(table, touch.p_WT_m), p.reach_m * p.reach_m
    stiffness = eased(touch) * p.strength_N / (FADED_MOST * p.reach_m)
    count = int(table[len(table) - 1])
    for at in range(len(table) - 1 - 3 * count, len(table) - 1, 3):
        away = sub(tool, (table[at], table[at + 1], table[at + 2]))
        d2 = dot(away, away)
        if d2 < reach2:
            add_force(out, table, -stiffness * fade(d2 / reach2), away)


def table(settings: Mapping[str, Any], rate_Hz: float) -> NDArray[np.float64]:
    """Table of the points and their number."""
    points = field_array("magnet", settings, "points_m", "(n, 3)")
    return np.array([*points.ravel(), len(points)])


EFFECT = Effect(
    "magnet",
    "Attracts the tool to points.",
    render,
    params=(
        Param("strength_N", 0.5, "N", "largest force of a point", 0.0, 100.0),
        Param("reach_m", 0.01, "m", "distance at which the force begins", 1e-4, 10.0),
    ),
    table=table,
    scope="scene",
    arrays=("points_m",),
)
