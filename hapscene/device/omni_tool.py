"""The simulated Phantom Omni's tool: a mass on the arm's structure, and the hand that holds it."""

import math
from typing import Any, Final

from hapscene.contact.geometry import Vector
from hapscene.device.omni_record import OmniFlag
from hapscene.native import native

HAND_MAX_N: Final = 100.0
"""Most force of a hand on the tool [N]: more than fingers that hold a stylus can give."""

_STIFFEST_N_M, _THICKEST_NS_M, _HEAVIEST_KG, _FARTHEST_M, _FASTEST_M_S = 1e6, 1e4, 100.0, 100.0, 100.0

_HAND_NOT_FINITE = int(OmniFlag.HAND_NOT_FINITE)
_HAND_LIMITED = int(OmniFlag.HAND_LIMITED)

Grip = tuple[float, float, float, Vector, Vector]
"""The hand in D: stiffness, damping, mass, where it wants the tool, and its push plus damping times its own speed."""


@native
def grip_in_D(omni: Any, hand: Any, after_s: float) -> Grip:
    """The hand (a `HAND` record, in W), `after_s` on, as the tool in D feels it.

    What is not finite counts as 0 and is flagged; what no hand can do is cut to what one can.
    """
    k, bad1 = _bounded(hand.k_N_m, 0.0, _STIFFEST_N_M)
    b, bad2 = _bounded(hand.b_Ns_m, 0.0, _THICKEST_NS_M)
    kg, bad3 = _bounded(hand.mass_kg, 0.0, _HEAVIEST_KG)
    target, bad4 = _in_D(omni, hand.target_m, 1.0, _FARTHEST_M)
    rate, bad5 = _in_D(omni, hand.target_m_s, 0.0, _FASTEST_M_S)
    push, bad6 = _in_D(omni, hand.push_N, 0.0, 2.0 * HAND_MAX_N)
    if bad1 + bad2 + bad3 + bad4 + bad5 + bad6 > 0:
        omni.trouble |= _HAND_NOT_FINITE
    aim = (target[0] + after_s * rate[0], target[1] + after_s * rate[1], target[2] + after_s * rate[2])
    return k, b, kg, aim, (push[0] + b * rate[0], push[1] + b * rate[1], push[2] + b * rate[2])


@native
def _in_D(omni: Any, a_W: Any, s: float, most: float) -> tuple[Vector, int]:
    """R_DW (a − s p_WD), each component within ± `most`; and how many numbers were not finite."""
    R, origin = omni.R_WD, omni.p_WD_m
    x, bad1 = _bounded(a_W[0] - s * origin[0], -most, most)
    y, bad2 = _bounded(a_W[1] - s * origin[1], -most, most)
    z, bad3 = _bounded(a_W[2] - s * origin[2], -most, most)
    a_D = (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )
    return a_D, bad1 + bad2 + bad3


@native
def _bounded(x: float, low: float, high: float) -> tuple[float, int]:
    """x within [low, high]; 0 and a count of 1 where it is not finite."""
    if not math.isfinite(x):
        return 0.0, 1
    return min(max(x, low), high), 0


@native
def kick_tool(omni: Any, grip: Grip, end: Vector, ends: Vector, h_s: float) -> tuple[Vector, Vector]:
    """The tool's velocity after the step, and the structure's pull [N] on the arm's end, which is at `end`, `ends`."""
    new = _kick_axes(omni, grip, end, ends, h_s)
    force = _hand_force(omni, grip, new, h_s)
    cut = _cut(omni, force)
    if cut < 1.0:  # a hand of constant force instead
        held = (force[0] * cut, force[1] * cut, force[2] * cut)
        new = _kick_axes(omni, (0.0, 0.0, grip[2], grip[3], held), end, ends, h_s)
    x = _pull(omni, 0, end[0], ends[0], new[0], h_s)
    y = _pull(omni, 1, end[1], ends[1], new[1], h_s)
    return new, (x, y, _pull(omni, 2, end[2], ends[2], new[2], h_s))


@native
def _kick_axes(omni: Any, grip: Grip, end: Vector, ends: Vector, h_s: float) -> Vector:
    """The tool's velocity after the step."""
    x = _kick_axis(omni, 0, grip, end[0], ends[0], h_s)
    y = _kick_axis(omni, 1, grip, end[1], ends[1], h_s)
    return x, y, _kick_axis(omni, 2, grip, end[2], ends[2], h_s)


@native
def _kick_axis(omni: Any, i: int, grip: Grip, end: float, ends: float, h_s: float) -> float:
    """Velocity v' after the step along one axis: m (v' − v) = h × forces at ½ (v + v') and p + ¼ h (v + v')."""
    k, b, kg, target, push = grip
    stiffness, damping = omni.stiffness_N_m[i], omni.damping_Ns_m[i]
    p, v, m = omni.p_DT_m[i], omni.v_DT_m_s[i], omni.tool_kg + kg
    lag = 0.5 * h_s * (damping + b) + 0.25 * h_s * h_s * (stiffness + k)
    force = stiffness * (end - p) + damping * ends + k * (target[i] - p) + push[i]
    return float(((m - lag) * v + h_s * force) / (m + lag))


@native
def _cut(omni: Any, force: Vector) -> float:
    """By how much a hand's force has to be scaled down, which is flagged."""
    most = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    if most <= HAND_MAX_N:
        return 1.0
    omni.trouble |= _HAND_LIMITED
    return HAND_MAX_N / most


@native
def pull_rigid(omni: Any, grip: Grip, p: Vector, v: Vector) -> Vector:
    """The hand's force [N] on a tool that is part of the arm, at `p` with velocity `v`."""
    k, b, _, target, push = grip
    force = (
        k * (target[0] - p[0]) - b * v[0] + push[0],
        k * (target[1] - p[1]) - b * v[1] + push[1],
        k * (target[2] - p[2]) - b * v[2] + push[2],
    )
    cut = _cut(omni, force)
    return force[0] * cut, force[1] * cut, force[2] * cut


@native
def _hand_force(omni: Any, grip: Grip, new: Vector, h_s: float) -> Vector:
    """The hand's mean force on the tool [N] over the step."""
    k, b, _, target, push = grip
    p, v = omni.p_DT_m, omni.v_DT_m_s
    lag = 0.25 * h_s * k + 0.5 * b
    return (
        k * (target[0] - p[0]) + push[0] - lag * (v[0] + new[0]),
        k * (target[1] - p[1]) + push[1] - lag * (v[1] + new[1]),
        k * (target[2] - p[2]) + push[2] - lag * (v[2] + new[2]),
    )


@native
def _pull(omni: Any, i: int, end: float, ends: float, new: float, h_s: float) -> float:
    """The structure's mean force on the arm's end along one axis [N]."""
    mean = 0.5 * (omni.v_DT_m_s[i] + new)
    stretch = omni.p_DT_m[i] + 0.5 * h_s * mean - end
    return float(omni.stiffness_N_m[i] * stretch + omni.damping_Ns_m[i] * (mean - ends))
