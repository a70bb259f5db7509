"""Puncture: a surface that breaks where it is pressed too hard, and then grips the shaft of the needle that is in it.

Until `touch.normal_force_N` exceeds the puncture force it adds nothing: the wall holds. Then it lets the tool in, the
wall's force ends, and of the needle forces of Okamura, Simone & O'Leary 2004 (stiffness, cutting, friction) what holds
the shaft is left, in the frame of the body that was pierced:

    f = −k z â − K l,    z ← clip(z + Δs, ±D/k)

with s [m] the way along the entry axis â, the normal where it broke (a point has no axis of its own, and the direction
in which it moves is the encoder's noise as slowly as skin breaks); D [N] the drag, which sticks by a spring of k [N/m]
and slips as friction does (`plugins/effects/friction.py`); l [m] the way off the axis and K [N/m] the shaft's
stiffness. The grip begins at no force, its springs give back what was put into them, and it ends when the tool is out
again.

Each body grips with the numbers of the swatch that broke, whatever is touched within it, and gets the reverse.
"""

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import PASSED_MAX, STIFFNESS_N_M
from hapscene.geometry import along, dot, sub
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.field_frame import to_frame, turn


@native
def grip(touch: np.record, s: np.record, k: int, out: np.record) -> None:
    """What the k-th pierced body does to the shaft [N]; nothing any more once the tool is out of it."""
    at = -1
    for i in range(touch.inside):
        if touch.inside_body[i] == s.body[k] - 1.0:
            at = i
    if at < 0:
        s.body[k] = 0.0
        return
    X, axis, entry = touch.inside_X_WB[at], s.axis[k], s.entry_m[k]
    tool = to_frame(X, touch.p_WT_m)
    if s.fresh[k] != 0.0:
        x, y, z = axis[0], axis[1], axis[2]
        for i in range(3):
            axis[i] = X[i] * x + X[3 + i] * y + X[6 + i] * z
            entry[i] = tool[i]
        s.along_m[k] = s.z_m[k] = s.fresh[k] = 0.0
    way, a = sub(tool, (entry[0], entry[1], entry[2])), (axis[0], axis[1], axis[2])
    along_m = dot(way, a)
    most_m = s.drag_N[k] / s.drag_N_m[k]
    s.z_m[k] = min(max(s.z_m[k] + along_m - s.along_m[k], -most_m), most_m)
    s.along_m[k] = along_m
    drag_N, side_N_m = -s.drag_N_m[k] * s.z_m[k] + s.shaft_N_m[k] * along_m, s.shaft_N_m[k]
    f = turn(X, along((-side_N_m * way[0], -side_N_m * way[1], -side_N_m * way[2]), drag_N, a))
    for i in range(3):
        out.f_W_N[i] += f[i]
        out.f_inside_W_N[at, i] += f[i]


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Add the grip of all that was pierced [N]; let the tool in where it presses too hard."""
    free = -1
    for k in range(PASSED_MAX):
        if s.body[k] != 0.0:
            grip(touch, s, k, out)
        if s.body[k] == 0.0:
            free = k
    if free >= 0 and touch.touching and 0.0 < p.puncture_force_N < touch.normal_force_N:
        out.release = 1
        s.body[free], s.fresh[free] = touch.body + 1.0, 1.0
        s.drag_N[free], s.drag_N_m[free], s.shaft_N_m[free] = p.drag_N, p.drag_stiffness_N_m, p.shaft_stiffness_N_m
        for i in range(3):
            s.axis[free, i] = touch.nhat_W[i]


_EACH = (PASSED_MAX,)

EFFECT = Effect(
    "puncture",
    "Breaks where it is pressed too hard, then grips the shaft.",
    render,
    params=(
        Param("puncture_force_N", 0.0, "N", "normal force at which it breaks; 0 never", 0.0, 1e3),
        Param("drag_N", 0.5, "N", "friction along the shaft once it is in", 0.0, 1e3),
        Param("drag_stiffness_N_m", STIFFNESS_N_M, "N/m", "stiffness along while it sticks", 1.0, 1e5),
        Param("shaft_stiffness_N_m", 200.0, "N/m", "stiffness sideways", 0.0, 1e5),
    ),
    state=(
        State("body", _EACH),  # which was pierced, and 1; 0 where none was
        State("fresh", _EACH),  # 1 until its pose is known: the axis is in W till then
        State("axis", (PASSED_MAX, 3)),
        State("entry_m", (PASSED_MAX, 3)),
        State("along_m", _EACH),
        State("z_m", _EACH),
        State("drag_N", _EACH),
        State("drag_N_m", _EACH),
        State("shaft_N_m", _EACH),
    ),
)
