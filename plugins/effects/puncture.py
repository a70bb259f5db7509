"""Puncture: a surface that breaks above a normal force, and then holds the shaft of the inserted needle.

The effect adds no force until `touch.normal_force_N` exceeds the puncture force. Then it releases the tool from the
surface, the force of the wall ends, and the shaft forces remain (after the needle forces of Okamura, Simone & O'Leary
2004: stiffness, cutting, friction). In the frame of the punctured body:

    f = −k z â − K l,    z ← clip(z + Δs, ±D/k)

s [m] is the displacement along the insertion axis â, which is the surface normal at the puncture (a point tool has no
axis, and its direction of motion is dominated by encoder noise at such low speeds). D [N] is the friction along the
shaft, which sticks with a spring of k [N/m] and slips as in `plugins/effects/friction.py`. l [m] is the displacement
perpendicular to the axis and K [N/m] the lateral stiffness. The force starts at 0, adds no energy, and ends when the
tool leaves the body.

Each body uses the parameters of the swatch that was punctured, and receives the reaction force.
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
    """Adds the force of the k-th punctured body on the shaft [N]; ends when the tool is outside the body."""
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
    """Adds the forces of all punctured bodies [N] and releases the tool where the puncture force is exceeded."""
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
    "Penetration above a normal force, with friction along the shaft.",
    render,
    params=(
        Param("puncture_force_N", 0.0, "N", "normal force at which the surface breaks; 0: never", 0.0, 1e3),
        Param("drag_N", 0.5, "N", "friction along the inserted shaft", 0.0, 1e3),
        Param("drag_stiffness_N_m", STIFFNESS_N_M, "N/m", "stiffness along the shaft while sticking", 1.0, 1e5),
        Param("shaft_stiffness_N_m", 200.0, "N/m", "lateral stiffness of the shaft", 0.0, 1e5),
    ),
    state=(
        State("body", _EACH),  # index of the punctured body plus 1; 0: free entry
        State("fresh", _EACH),  # 1 until the body pose is known; until then the axis is in W
        State("axis", (PASSED_MAX, 3)),
        State("entry_m", (PASSED_MAX, 3)),
        State("along_m", _EACH),
        State("z_m", _EACH),
        State("drag_N", _EACH),
        State("drag_N_m", _EACH),
        State("shaft_N_m", _EACH),
    ),
)
