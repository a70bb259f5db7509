"""What moves the Phantom Omni's arm: mass matrix, Coriolis and gravity in joint space.

    M(q) q̈ + C(q, q̇) q̇ + G(q) = τ

    M11 = k1 + k2 cos 2q2 + k3 cos 2q3 + k4 cos q2 sin q3,  M12 = k5 sin q2,  M13 = 0
    M22 = k6,  M33 = k7,  M23 = −½ k4 sin(q2 − q3)
    G = (0, k8 cos q2 + k10 (q2 − π/2), k9 sin q3)

with the published parameters k1 … k10. Their own M23 leaves M not positive definite; this one follows from the same
k4 as M11, as for any two links in a plane. C holds the Christoffel symbols of M, so Ṁ − 2C is skew and no energy is
made. k10 is the arm's counterbalance, a spring on the shoulder.

Identified parameters are not quite a body's: with M23 as above, M still has no positive determinant in two strips of
the joint range, an elbow at over 1.17 rad (from 10 % before its stop on) and a shoulder over 1.7 rad with the forearm
level. Both angles therefore enter M through a bend that is the identity up to `ELBOW_KNEE_RAD` and `SHOULDER_KNEE_RAD`
and levels off beyond, twice differentiable; the derivatives in C are those of the bent matrix.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.contact.geometry import Vector
from hapscene.device.omni_kinematics import Turns, jacobian, turns_at
from hapscene.native import native

K1: Final = 1.798e-3
K2: Final = 0.864e-3
K3: Final = 0.486e-3
K4: Final = 2.766e-3
K5: Final = 0.308e-3
K6: Final = 2.526e-3
K7: Final = 0.652e-3
"""Inertia parameters k1 … k7 [kg·m²], published. A tenth more is a tenth more apparent mass."""

K8: Final = 164.158e-3
K9: Final = 94.050e-3
K10: Final = 117.294e-3
"""Gravity parameters k8, k9 [N·m] and counterbalance k10 [N·m/rad], published."""

ELBOW_KNEE_RAD: Final = 0.9
"""Angle q3 − q2 up to which M is the published one [rad]. Above 1.1, less the bend, M would cease to be positive."""

SHOULDER_KNEE_RAD: Final = 1.5
"""Angle q2 up to which M is the published one [rad]. Above 1.6, less the bend, M11 would come to 0."""

BEND_RAD: Final = 0.12
"""How far past its knee an angle can go in M [rad]. Wider, and M comes closer to singular; narrower, and C jumps."""

Slopes = tuple[float, float, float, float, float, float, float]


@native
def _bend(angle: float, knee: float) -> tuple[float, float]:
    """The angle past its knee as it enters M, and its derivative."""
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


def coriolis_matrix(q: ArrayLike, dq: ArrayLike) -> NDArray[np.float64]:
    """C (3, 3) [N·m·s/rad] from the Christoffel symbols of M, at joint speeds (3,) [rad/s]."""
    _, q2, q3 = np.asarray(q, float)
    w1, w2, w3 = np.asarray(dq, float)
    *_, a2, a3, b2, c3 = slopes_at(float(q2), float(q3), turns_at(0.0, float(q2), float(q3)))
    return np.array(
        [
            [0.5 * (a2 * w2 + a3 * w3), 0.5 * a2 * w1 + b2 * w2, 0.5 * a3 * w1],
            [-0.5 * a2 * w1, 0.0, c3 * w3],
            [-0.5 * a3 * w1, -c3 * w2, 0.0],
        ]
    )


def gravity(q: ArrayLike) -> NDArray[np.float64]:
    """G (3,) [N·m], the torque that holds the arm up."""
    _, q2, q3 = np.asarray(q, float)
    return np.array([0.0, *gravity_at(float(q2), turns_at(0.0, float(q2), float(q3)))])


def potential_J(q: ArrayLike) -> float:
    """Potential energy of gravity and counterbalance [J], whose gradient is G."""
    _, q2, q3 = np.asarray(q, float)
    return float(K8 * math.sin(q2) + 0.5 * K10 * (q2 - math.pi / 2.0) ** 2 - K9 * math.cos(q3))


def apparent_mass(q: ArrayLike) -> NDArray[np.float64]:
    """Mass (3,) [kg] that the arm alone shows at its tip along x, y, z of D: 1 / (J M⁻¹ Jᵀ)ᵢᵢ (Khatib 1995, eq. 15).

    That is what a force along the axis accelerates along it. Infinite where the posture is singular for it.
    """
    J = jacobian(q)
    mobility = np.diag(J @ np.linalg.solve(mass_matrix(q), J.T))
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / mobility)
