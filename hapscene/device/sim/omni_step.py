"""One integration step of the simulated Phantom Omni: arm, structure, tool and hand. Compiled.

The integrator is a drift of half a step, a kick, and a drift of half a step (position Verlet: Hairer, Lubich & Wanner
2003, eq. 1.8). It is of second order and evaluates the mechanism once a step. Within the kick

- the springs and dampers of the tool, from the structure and from the hand, use the implicit midpoint rule, which is
  stable for any stiffness and grip;
- velocity-dependent terms of the arm (Coriolis, structural damping) use the velocity in the middle of the step,
  extrapolated from the change over the last step;
- Coulomb friction is implicit in the velocity after the step (below): a stopped joint has a velocity of exactly 0.

`STEP_MAX_S` is 0.1 ms, the period of the acceleration channel. The fastest mode, the tool on the structure, advances by
0.057 rad in a step. For taps and strokes with friction on a wall of 500 N/m, halving the step changes the tip by less
than 0.3 µm and the force of the wall by less than 0.1 mN, with a light, a medium and a firm grip
(tests/device/sim/test_omni_step.py). With a finite encoder resolution, a count may fall into the next tick, which
changes the position by less than a count.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import inlined, native
from hapscene.device.sim.omni_kinematics import (
    ELBOW_RAD,
    SHOULDER_RAD,
    WAIST_RAD,
    Matrix,
    Turns,
    jacobian,
    lever,
    tip,
    turns_at,
)
from hapscene.device.sim.omni_record import OmniFlag
from hapscene.geometry import Vector

__all__ = [
    "K8",
    "K9",
    "K10",
    "STEP_MAX_S",
    "STOP_OVER_RAD",
    "ahead",
    "apparent_mass",
    "coriolis_at",
    "gravity",
    "gravity_at",
    "grip_in_D",
    "mass_matrix",
    "slopes_at",
    "slow",
    "solve",
    "step",
]

# Dynamics of the arm: mass matrix, Coriolis and gravity terms in joint space.
#
#     M(q) q̈ + C(q, q̇) q̇ + G(q) = τ
#
#     M11 = k1 + k2 cos 2q2 + k3 cos 2q3 + k4 cos q2 sin q3,  M12 = k5 sin q2,  M13 = 0
#     M22 = k6,  M33 = k7,  M23 = −½ k4 sin(q2 − q3)
#     G = (0, k8 cos q2 + k10 (q2 − π/2), k9 sin q3)
#
# with the published parameters k1 … k10. The published M23 makes M indefinite; this one follows from the same k4 as
# M11, as for any two links in a plane. C contains the Christoffel symbols of M, so that Ṁ − 2C is skew-symmetric and
# energy is conserved. k10 is the counterbalance of the arm, a spring at the shoulder.
#
# The identified parameters are not exactly those of a rigid body: with this M23, the determinant of M is not positive
# in two regions of the joint range, for an elbow above 1.17 rad (the last 10 % before its stop) and for a shoulder
# above 1.7 rad with a horizontal forearm. Therefore both angles enter M through a saturating function, which is the
# identity up to `ELBOW_KNEE_RAD` and `SHOULDER_KNEE_RAD` and is twice differentiable. C uses the derivatives of the
# resulting matrix.


K1: Final = 1.798e-3
K2: Final = 0.864e-3
K3: Final = 0.486e-3
K4: Final = 2.766e-3
K5: Final = 0.308e-3
K6: Final = 2.526e-3
K7: Final = 0.652e-3
"""Inertia parameters k1 … k7 [kg·m²], published. The apparent mass is proportional to them."""

K8: Final = 164.158e-3
K9: Final = 94.050e-3
K10: Final = 117.294e-3
"""Gravity parameters k8, k9 [N·m] and counterbalance k10 [N·m/rad], published."""

ELBOW_KNEE_RAD: Final = 0.9
"""Angle q3 − q2 up to which M is the published one [rad]. Without saturation, M would be indefinite from 1.1 on."""

SHOULDER_KNEE_RAD: Final = 1.5
"""Angle q2 up to which M is the published one [rad]. Without saturation, M11 would be 0 from 1.6 on."""

BEND_RAD: Final = 0.12
"""Range of an angle beyond its knee in M [rad]. With a wider range M is closer to singular, with a narrower one C
jumps."""

Slopes = tuple[float, float, float, float, float, float, float]


@native
def _bend(angle: float, knee: float) -> tuple[float, float]:
    """Saturate an angle beyond its knee. Also returns the derivative."""
    level = math.tanh((angle - knee) / BEND_RAD)
    return knee + BEND_RAD * level, 1.0 - level * level


@native
def slopes_at(q2: float, q3: float, turns: Turns) -> Slopes:
    """M11, M12, M23 [kg·m²] and their derivatives ∂M11/∂q2, ∂M11/∂q3, ∂M12/∂q2, ∂M23/∂q3 = −∂M23/∂q2."""
    _, _, s2, c2, s3, c3 = turns
    se, ce = s3 * c2 - c3 * s2, c3 * c2 + s3 * s2
    slope2, slope = 1.0, 1.0
    if q2 > SHOULDER_KNEE_RAD:
        bent, slope2 = _bend(q2, SHOULDER_KNEE_RAD)
        s2, c2 = math.sin(bent), math.cos(bent)
    if q3 - q2 > ELBOW_KNEE_RAD:
        bent, slope = _bend(q3 - q2, ELBOW_KNEE_RAD)
        se, ce = math.sin(bent), math.cos(bent)
    return (
        K1 + K2 * (1.0 - 2.0 * s2 * s2) + K3 * (1.0 - 2.0 * s3 * s3) + K4 * c2 * s3,
        K5 * s2,
        0.5 * K4 * se,
        (-4.0 * K2 * c2 - K4 * s3) * s2 * slope2,
        (-4.0 * K3 * s3 + K4 * c2) * c3,
        K5 * c2 * slope2,
        0.5 * K4 * ce * slope,
    )


@native
def coriolis_at(slopes: Slopes, w1: float, w2: float, w3: float) -> Vector:
    """C(q, q̇) q̇ [N·m] at joint speeds w [rad/s], from `slopes_at`."""
    a2, a3, b2, c3 = slopes[3], slopes[4], slopes[5], slopes[6]
    return (
        (a2 * w2 + a3 * w3) * w1 + b2 * w2 * w2,
        c3 * w3 * w3 - 0.5 * a2 * w1 * w1,
        -c3 * w2 * w2 - 0.5 * a3 * w1 * w1,
    )


@native
def gravity_at(q2: float, turns: Turns) -> tuple[float, float]:
    """G2, G3 [N·m]; G1 is 0."""
    return K8 * turns[3] + K10 * (q2 - math.pi / 2.0), K9 * turns[4]


def mass_matrix(q: ArrayLike) -> NDArray[np.float64]:
    """M (3, 3) [kg·m²] at joint angles (3,) [rad]; symmetric, positive definite within the joint limits."""
    _, q2, q3 = np.asarray(q, float)
    a, b, c, *_ = slopes_at(float(q2), float(q3), turns_at(0.0, float(q2), float(q3)))
    return np.array([[a, b, 0.0], [b, K6, c], [0.0, c, K7]])


def gravity(q: ArrayLike) -> NDArray[np.float64]:
    """G (3,) [N·m], the joint torque that holds the arm against gravity."""
    _, q2, q3 = np.asarray(q, float)
    return np.array([0.0, *gravity_at(float(q2), turns_at(0.0, float(q2), float(q3)))])


def apparent_mass(q: ArrayLike) -> NDArray[np.float64]:
    """Apparent mass (3,) [kg] of the arm at its tip along x, y, z of D: 1 / (J M⁻¹ Jᵀ)ᵢᵢ (Khatib 1995, eq. 15).

    It is the ratio of a force along the axis to the acceleration along it. Infinite in a singular posture.
    """
    J = jacobian(q)
    mobility = np.diag(J @ np.linalg.solve(mass_matrix(q), J.T))
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / mobility)


# Coulomb friction in three coupled joints, implicit in the velocity after a step, so that joints stick without chatter.
#
#     A (w − w*) + λ = 0,   |λᵢ| ≤ Λᵢ,   wᵢ > 0 ⇒ λᵢ = Λᵢ,   wᵢ < 0 ⇒ λᵢ = −Λᵢ
#
# is Coulomb friction as a set-valued law under backward Euler (Kikuuwe et al. 2006, eq. 12, there for one mass). It
# minimises ½ (w − w*)ᵀ A (w − w*) + Σ Λᵢ |wᵢ|, and has one solution, since A is positive definite. The solution is
# found by changing the state of one joint at a time, the first that violates the law; this ends for every positive
# definite A (Murty 1974).


TRIES: Final = 27
"""Number of combinations of sliding and sticking [count]. Two or three are tried in practice."""

Symmetric = tuple[float, float, float, float, float, float]
"""A11, A22, A33, A12, A13, A23."""


@native
def solve(A: Symmetric, b: Vector) -> Vector:
    """Solve A x = b by cofactors. A is positive definite."""
    a11, a22, a33, a12, a13, a23 = A
    c11, c12, c13 = a22 * a33 - a23 * a23, a13 * a23 - a12 * a33, a12 * a23 - a13 * a22
    c22, c23, c33 = a11 * a33 - a13 * a13, a12 * a13 - a11 * a23, a11 * a22 - a12 * a12
    scale = 1.0 / (a11 * c11 + a12 * c12 + a13 * c13)
    return (
        (c11 * b[0] + c12 * b[1] + c13 * b[2]) * scale,
        (c12 * b[0] + c22 * b[1] + c23 * b[2]) * scale,
        (c13 * b[0] + c23 * b[1] + c33 * b[2]) * scale,
    )


@inlined
def _moving(A: Symmetric, b: Vector, s: Vector) -> Vector:
    """Solve A x = b for the joints with s ≠ 0; x is 0 for the others."""
    m1, m2, m3 = abs(s[0]), abs(s[1]), abs(s[2])
    reduced = (
        A[0] * m1 + 1.0 - m1,
        A[1] * m2 + 1.0 - m2,
        A[2] * m3 + 1.0 - m3,
        A[3] * m1 * m2,
        A[4] * m1 * m3,
        A[5] * m2 * m3,
    )
    return solve(reduced, (b[0] * m1, b[1] * m2, b[2] * m3))


@native
def _turned(s: float, w: float, held: float, most: float) -> float:
    """The next state of a joint; the same state if it obeys the law. `held` is the impulse that would hold the
    joint."""
    if s == 0.0:
        if held > most:
            return 1.0
        if held < -most:
            return -1.0
        return 0.0
    return 0.0 if s * w < 0.0 else s


@native
def _sign(x: float) -> float:
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


@inlined
def slow(A: Symmetric, push: Vector, most: Vector, before: Vector) -> Vector:
    """Joint velocities w after a step with Coulomb friction.

    `push` is A w*, the momentum [N·m·s] without friction. `most` is the largest friction impulse Λ of each joint
    [N·m·s]. `before` are the velocities before the step, whose signs are tried first. A joint with Λ = 0 never sticks.
    """
    s1, s2, s3 = _sign(before[0]), _sign(before[1]), _sign(before[2])
    w = before
    for _ in range(TRIES):
        drive = (push[0] - s1 * most[0], push[1] - s2 * most[1], push[2] - s3 * most[2])
        w = _moving(A, drive, (s1, s2, s3))
        t = _turned(s1, w[0], push[0] - A[3] * w[1] - A[4] * w[2], most[0])
        if t != s1:
            s1 = t
            continue
        t = _turned(s2, w[1], push[1] - A[3] * w[0] - A[5] * w[2], most[1])
        if t != s2:
            s2 = t
            continue
        t = _turned(s3, w[2], push[2] - A[4] * w[0] - A[5] * w[1], most[2])
        if t != s3:
            s3 = t
            continue
        break
    return w


# The tool, a mass on the structure of the arm, and the hand that holds it.


HAND_MAX_N: Final = 100.0
"""Limit of the force of a hand on the tool [N], above that of fingers that hold a stylus."""

_STIFFEST_N_M, _THICKEST_NS_M, _HEAVIEST_KG, _FARTHEST_M, _FASTEST_M_S = 1e6, 1e4, 100.0, 100.0, 100.0

_HAND_NOT_FINITE = int(OmniFlag.HAND_NOT_FINITE)
_HAND_LIMITED = int(OmniFlag.HAND_LIMITED)

Grip = tuple[float, float, float, Vector, Vector]
"""The hand in D: stiffness, damping, mass, target position, and its force plus damping times target velocity."""


@native
def grip_in_D(omni: np.record, hand: np.record) -> tuple[Grip, Vector]:
    """Convert a `HAND` record from W to D. Also returns the velocity of the target.

    Values that are not finite are replaced by 0 and flagged. Other values are limited to those of a hand.
    """
    k, bad1 = _bounded(hand.k_N_m, 0.0, _STIFFEST_N_M)
    b, bad2 = _bounded(hand.b_Ns_m, 0.0, _THICKEST_NS_M)
    kg, bad3 = _bounded(hand.mass_kg, 0.0, _HEAVIEST_KG)
    target, bad4 = _in_D(omni, hand.target_m, 1.0, _FARTHEST_M)
    rate, bad5 = _in_D(omni, hand.target_m_s, 0.0, _FASTEST_M_S)
    push, bad6 = _in_D(omni, hand.push_N, 0.0, 2.0 * HAND_MAX_N)
    if bad1 + bad2 + bad3 + bad4 + bad5 + bad6 > 0:
        omni.trouble |= _HAND_NOT_FINITE
    return (k, b, kg, target, (push[0] + b * rate[0], push[1] + b * rate[1], push[2] + b * rate[2])), rate


@native
def ahead(grip: Grip, rate: Vector, after_s: float) -> Grip:
    """The hand of `grip_in_D` after `after_s`, with its target moved."""
    k, b, kg, p, push = grip
    return k, b, kg, (p[0] + after_s * rate[0], p[1] + after_s * rate[1], p[2] + after_s * rate[2]), push


@native
def _in_D(omni: np.record, a_W: NDArray[np.float64], s: float, most: float) -> tuple[Vector, int]:
    """R_DW (a − s p_WD), each component limited to ± `most`. Also returns the number of values that were not finite."""
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
    """Limit x to [low, high]. Returns 0 and a count of 1 for a value that is not finite."""
    if not math.isfinite(x):
        return 0.0, 1
    return min(max(x, low), high), 0


@inlined
def kick_tool(omni: np.record, grip: Grip, end: Vector, ends: Vector, h_s: float) -> tuple[Vector, Vector]:
    """Velocity of the tool after the step, and force of the structure on the arm [N]; `end`, `ends`: arm position,
    velocity."""
    new = _kick_axes(omni, grip, end, ends, h_s)
    force = _hand_force(omni, grip, new, h_s)
    cut = _cut(omni, force)
    if cut < 1.0:  # replace the hand by a constant force at the limit
        held = (force[0] * cut, force[1] * cut, force[2] * cut)
        new = _kick_axes(omni, (0.0, 0.0, grip[2], grip[3], held), end, ends, h_s)
    x = _pull(omni, 0, end[0], ends[0], new[0], h_s)
    y = _pull(omni, 1, end[1], ends[1], new[1], h_s)
    return new, (x, y, _pull(omni, 2, end[2], ends[2], new[2], h_s))


@native
def _kick_axes(omni: np.record, grip: Grip, end: Vector, ends: Vector, h_s: float) -> Vector:
    """Velocity of the tool after the step."""
    x = _kick_axis(omni, 0, grip, end[0], ends[0], h_s)
    y = _kick_axis(omni, 1, grip, end[1], ends[1], h_s)
    return x, y, _kick_axis(omni, 2, grip, end[2], ends[2], h_s)


@native
def _kick_axis(omni: np.record, i: int, grip: Grip, end: float, ends: float, h_s: float) -> float:
    """Velocity v' after the step along one axis: m (v' − v) = h × forces at ½ (v + v') and p + ¼ h (v + v')."""
    k, b, kg, target, push = grip
    stiffness, damping = omni.stiffness_N_m[i], omni.damping_Ns_m[i]
    p, v, m = omni.p_DT_m[i], omni.v_DT_m_s[i], omni.tool_kg + kg
    lag = 0.5 * h_s * (damping + b) + 0.25 * h_s * h_s * (stiffness + k)
    force = stiffness * (end - p) + damping * ends + k * (target[i] - p) + push[i]
    return float(((m - lag) * v + h_s * force) / (m + lag))


@native
def _cut(omni: np.record, force: Vector) -> float:
    """Factor that limits a force of the hand to `HAND_MAX_N`. Flags a limited force."""
    most = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    if most <= HAND_MAX_N:
        return 1.0
    omni.trouble |= _HAND_LIMITED
    return HAND_MAX_N / most


@native
def _hand_force(omni: np.record, grip: Grip, new: Vector, h_s: float) -> Vector:
    """Mean force of the hand on the tool over the step [N]."""
    k, b, _, target, push = grip
    p, v = omni.p_DT_m, omni.v_DT_m_s
    lag = 0.25 * h_s * k + 0.5 * b
    return (
        k * (target[0] - p[0]) + push[0] - lag * (v[0] + new[0]),
        k * (target[1] - p[1]) + push[1] - lag * (v[1] + new[1]),
        k * (target[2] - p[2]) + push[2] - lag * (v[2] + new[2]),
    )


@native
def _pull(omni: np.record, i: int, end: float, ends: float, new: float, h_s: float) -> float:
    """Mean force of the structure on the arm along one axis [N]."""
    mean = 0.5 * (omni.v_DT_m_s[i] + new)
    stretch = omni.p_DT_m[i] + 0.5 * h_s * mean - end
    return float(omni.stiffness_N_m[i] * stretch + omni.damping_Ns_m[i] * (mean - ends))


STEP_MAX_S: Final = 1e-4
"""Longest step of the integrator [s]; longer calls are divided. A ten times longer step loses the structural mode."""

STOP_NM_RAD: Final = 50.0
"""Stiffness of a joint's end stop [N·m/rad]: 3.3 N at the tip deflect it by 9 mrad. Real stops are stiffer, but need a
finer step, without a perceptible difference."""

STOP_NMS: Final = 0.3
"""Damping of an end stop on compression [N·m·s/rad]: 0.4 of the critical damping of the shoulder."""

STOP_OVER_RAD: Final = 0.1
"""Largest deflection of an end stop [rad]. The joint then stops at once."""

SPEED_MAX_RAD_S: Final = 100.0
"""Speed limit of a joint [rad/s]: 13 m/s at the tip, ten times a fast hand. Keeps the state finite for all inputs."""

_AT_STOP = int(OmniFlag.AT_STOP)
_SPEED_LIMITED = int(OmniFlag.SPEED_LIMITED)


@inlined
def step(omni: np.record, grip: Grip, h_s: float) -> None:
    """Advance by one step of at most `STEP_MAX_S`, with a hand that is constant over the step."""
    q, w = omni.q, omni.dq
    half = 0.5 * h_s
    q1, q2, q3 = q[0] + half * w[0], q[1] + half * w[1], q[2] + half * w[2]
    now = _kick(omni, grip, (q1, q2, q3), h_s)
    q[0], q[1], q[2] = q1 + half * now[0], q2 + half * now[1], q3 + half * now[2]
    for i in range(3):
        omni.ddq[i] = (now[i] - w[i]) / h_s
        w[i] = now[i]
    _keep(omni)


@inlined
def _kick(omni: np.record, grip: Grip, q: Vector, h_s: float) -> Vector:
    """Joint velocities after the step for an arm at `q` in mid-step. Also advances the tool, which is a separate
    mass."""
    p, v = omni.p_DT_m, omni.v_DT_m_s
    turns = turns_at(q[0], q[1], q[2])
    slopes, load = slopes_at(q[1], q[2], turns), _load(omni, q, turns)
    end, J = tip(turns), lever(turns)
    before, mean = _speeds(omni, h_s)
    new, pull = kick_tool(omni, grip, end, _times(J, mean), h_s)
    torque = _transposed(J, pull)
    now = _kick_arm(omni, slopes, load, q, before, mean, torque, h_s)
    for i in range(3):
        p[i] += 0.5 * h_s * (v[i] + new[i])
        v[i] = new[i]
    return now


@native
def _speeds(omni: np.record, h_s: float) -> tuple[Vector, Vector]:
    """Joint velocities before the step, and their mean over the step by extrapolation from the last step."""
    w, rate, half = omni.dq, omni.ddq, 0.5 * h_s
    return (w[0], w[1], w[2]), (w[0] + half * rate[0], w[1] + half * rate[1], w[2] + half * rate[2])


@inlined
def _kick_arm(
    omni: np.record,
    slopes: Slopes,
    load: Vector,
    q: Vector,
    w: Vector,
    mean: Vector,
    torque: Vector,
    h_s: float,
) -> Vector:
    """Joint velocities after the step, from w, `load` and the `torque` of the tip."""
    bias = coriolis_at(slopes, mean[0], mean[1], mean[2])
    stop = _stops(omni, q, mean)
    drive1 = load[0] + torque[0] - bias[0] + stop[0]
    drive2 = load[1] + torque[1] - bias[1] + stop[1]
    drive3 = load[2] + torque[2] - bias[2] + stop[2]
    m11, m22, m33, m12, m13, m23 = slopes[0], K6, K7, slopes[1], 0.0, slopes[2]
    b = omni.viscous_Nms
    lag1, lag2, lag3 = 0.5 * h_s * b[0], 0.5 * h_s * b[1], 0.5 * h_s * b[2]
    push = (
        (m11 - lag1) * w[0] + m12 * w[1] + m13 * w[2] + h_s * drive1,
        m12 * w[0] + (m22 - lag2) * w[1] + m23 * w[2] + h_s * drive2,
        m13 * w[0] + m23 * w[1] + (m33 - lag3) * w[2] + h_s * drive3,
    )
    c = omni.friction_Nm
    A = (m11 + lag1, m22 + lag2, m33 + lag3, m12, m13, m23)
    return slow(A, push, (h_s * c[0], h_s * c[1], h_s * c[2]), w)


@native
def _load(omni: np.record, q: Vector, turns: Turns) -> Vector:
    """Torques of motors and gravity [N·m]."""
    t = omni.torque_Nm
    if omni.gravity == 0:
        return t[0], t[1], t[2]
    weight2, weight3 = gravity_at(q[1], turns)
    return t[0], t[1] - weight2, t[2] - weight3


@native
def _stops(omni: np.record, q: Vector, w: Vector) -> Vector:
    """Torques of the end stops [N·m]: waist, shoulder, and the elbow, which couples shoulder and forearm."""
    waist = _stop(q[0], w[0], WAIST_RAD[0], WAIST_RAD[1])
    shoulder = _stop(q[1], w[1], SHOULDER_RAD[0], SHOULDER_RAD[1])
    elbow = _stop(q[2] - q[1], w[2] - w[1], ELBOW_RAD[0], ELBOW_RAD[1])
    if waist != 0.0 or shoulder != 0.0 or elbow != 0.0:
        omni.trouble |= _AT_STOP
    return waist, shoulder - elbow, elbow


@native
def _stop(angle: float, speed: float, low: float, high: float) -> float:
    """A spring beyond each limit, with a damper on compression only, so that it never pulls."""
    if angle > high:
        return -STOP_NM_RAD * (angle - high) - STOP_NMS * max(speed, 0.0)
    if angle < low:
        return STOP_NM_RAD * (low - angle) - STOP_NMS * min(speed, 0.0)
    return 0.0


@inlined
def _keep(omni: np.record) -> None:
    """Limit the joints to the largest deflection of the stops, and their velocities to `SPEED_MAX_RAD_S`."""
    q, w = omni.q, omni.dq
    for i in range(3):
        if abs(w[i]) > SPEED_MAX_RAD_S:
            w[i] = math.copysign(SPEED_MAX_RAD_S, w[i])
            omni.trouble |= _SPEED_LIMITED
    _hold_within(omni, 0, 0.0, WAIST_RAD[0], WAIST_RAD[1])
    _hold_within(omni, 1, 0.0, SHOULDER_RAD[0], SHOULDER_RAD[1])
    _hold_within(omni, 2, q[1], ELBOW_RAD[0], ELBOW_RAD[1])


@native
def _hold_within(omni: np.record, i: int, base: float, low: float, high: float) -> None:
    """Stop a joint at the largest deflection of its end stop."""
    q = omni.q
    least, most = base + low - STOP_OVER_RAD, base + high + STOP_OVER_RAD
    if q[i] < least or q[i] > most:
        q[i] = min(max(q[i], least), most)
        omni.dq[i] = 0.0


@native
def _times(J: Matrix, w: Vector) -> Vector:
    """J w."""
    return (
        J[0][0] * w[0] + J[0][1] * w[1] + J[0][2] * w[2],
        J[1][1] * w[1] + J[1][2] * w[2],
        J[2][0] * w[0] + J[2][1] * w[1] + J[2][2] * w[2],
    )


@native
def _transposed(J: Matrix, f: Vector) -> Vector:
    """Jᵀ f."""
    return (
        J[0][0] * f[0] + J[2][0] * f[2],
        J[0][1] * f[0] + J[1][1] * f[1] + J[2][1] * f[2],
        J[0][2] * f[0] + J[1][2] * f[1] + J[2][2] * f[2],
    )
