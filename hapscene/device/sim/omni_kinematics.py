"""Kinematics of the Phantom Omni: forward and inverse kinematics, Jacobian.

The origin of frame D is on the table below the waist. Its axes are those of OpenHaptics: x to the right, y up, z
towards the user. The tip T is the centre of the gimbal, as in OpenHaptics: the point at which the base motors act.

Joints q [rad], as in Çavuşoğlu et al. 2002 and in the dynamics:

- q1, the waist, rotates about y, positive to the right.
- q2, the shoulder, is the angle of the upper arm above the horizontal.
- q3 is the angle of the forearm from straight down towards the user. It is not relative to the upper arm, since a
  parallelogram drives the forearm from the base. At q2 = q3 the arms are orthogonal, as in the nominal posture of the
  data sheet.

    r = l1 cos q2 + l2 sin q3
    p_DT = (r sin q1, h + l1 sin q2 − l2 cos q3, r cos q1)

Links and limits are from `models/urdf/omni.urdf` of jhu-saw/sawSensablePhantom. Its x axis points to the left and its y
axis to the user, so that waist and shoulder equal q1 and q2. Its elbow θ is relative to the upper arm, with the forearm
turned down by 1.5 rad: q3 = q2 + θ + π/2 − 1.5. The limits of θ therefore bound the difference q3 − q2.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.geometry import Vector

__all__ = [
    "ELBOW_RAD",
    "FOREARM_M",
    "NOMINAL_LEVER_M",
    "NOMINAL_RAD",
    "SHOULDER_RAD",
    "SINGULAR",
    "UPPER_M",
    "WAIST_RAD",
    "Matrix",
    "Turns",
    "forward",
    "inverse",
    "jacobian",
    "lever",
    "leverage",
    "reachable",
    "tip",
    "turns_at",
    "within_limits",
]

UPPER_M: Final = 0.134
"""Length l1 of the upper arm, shoulder to elbow [m]. URDF of sawSensablePhantom. It determines the workspace."""

FOREARM_M: Final = 0.1325
"""Length l2 of the forearm, elbow to the gimbal's centre [m]. URDF: 0.08 + 0.0525."""

SHOULDER_M: Final = 0.09 + 0.035
"""Height h of the shoulder over the table [m]. URDF: table to waist 0.09, waist to shoulder 0.035."""

WAIST_RAD: Final = (-0.98, 0.98)
"""Limits of q1 [rad]. URDF. Below π/2, so that the sign of z determines the side of the waist axis."""

SHOULDER_RAD: Final = (0.0, 1.75)
"""Limits of q2 [rad]. URDF."""

ELBOW_TURN_RAD: Final = math.pi / 2.0 - 1.5
"""Difference between q3 − q2 and the elbow angle of the URDF [rad]."""

ELBOW_RAD: Final = (-0.81 + ELBOW_TURN_RAD, 1.25 + ELBOW_TURN_RAD)
"""Limits of q3 − q2 [rad]: the elbow limits of the URDF, −0.81 and 1.25. They exclude ±π/2, where the arm would be
stretched or folded and the inverse kinematics would have two solutions."""

NOMINAL_RAD: Final = (0.0, 0.65, 0.65)
"""The nominal posture [rad] of the data sheet: orthogonal arms, the tip in the middle of the workspace. The three
joints then move the tip in orthogonal directions with the levers `NOMINAL_LEVER_M`."""

NOMINAL_LEVER_M: Final = (UPPER_M * math.cos(0.65) + FOREARM_M * math.sin(0.65), UPPER_M, FOREARM_M)
"""Lever of each joint at the tip in the nominal posture [m/rad]."""

SINGULAR: Final = 0.05
"""Ratio of det J to that of the nominal posture below which a posture counts as singular [1]. The lever along some
direction is then a twentieth, and the encoders resolve the tip twenty times coarser there."""

Matrix = tuple[Vector, Vector, Vector]
Turns = tuple[float, float, float, float, float, float]


@native
def turns_at(q1: float, q2: float, q3: float) -> Turns:
    """Sines and cosines of the joint angles [rad]: sin q1, cos q1, sin q2, cos q2, sin q3, cos q3."""
    return math.sin(q1), math.cos(q1), math.sin(q2), math.cos(q2), math.sin(q3), math.cos(q3)


@native
def tip(turns: Turns) -> Vector:
    """The tip p_DT [m]."""
    s1, c1, s2, c2, s3, c3 = turns
    r = UPPER_M * c2 + FOREARM_M * s3
    return r * s1, SHOULDER_M + UPPER_M * s2 - FOREARM_M * c3, r * c1


@native
def lever(turns: Turns) -> Matrix:
    """Rows of J = ∂p_DT/∂q [m/rad]."""
    s1, c1, s2, c2, s3, c3 = turns
    r = UPPER_M * c2 + FOREARM_M * s3
    out2, out3 = -UPPER_M * s2, FOREARM_M * c3
    return (r * c1, out2 * s1, out3 * s1), (0.0, UPPER_M * c2, FOREARM_M * s3), (-r * s1, out2 * c1, out3 * c1)


@native
def joints_at(x: float, y: float, z: float) -> Vector:
    """Joint angles [rad] for a tip position [m] in D; those of the nearest reachable distance if out of reach. Always
    finite.

    The arm bends downwards (q3 − q2 < π/2), as its limits require. On the waist axis, q1 is undefined and set to 0.
    """
    r = math.hypot(x, z)
    side = 1.0
    if z < 0.0:  # q1 stays within ±π/2, so the tip is behind the waist axis
        side = -1.0
    q1 = math.atan2(side * x, side * z) if r > 0.0 else 0.0
    r *= side
    up = y - SHOULDER_M
    reach2 = r * r + up * up
    # cosine of the angle between upper arm and forearm, which is q3 − π/2 − q2 ≤ 0
    turn = (reach2 - UPPER_M * UPPER_M - FOREARM_M * FOREARM_M) / (2.0 * UPPER_M * FOREARM_M)
    turn = min(1.0, max(-1.0, turn))
    elbow = -math.acos(turn)
    q2 = math.atan2(up, r) - math.atan2(FOREARM_M * math.sin(elbow), UPPER_M + FOREARM_M * turn)
    if q2 > math.pi:
        q2 -= 2.0 * math.pi
    return q1, q2, q2 + elbow + math.pi / 2.0


@native
def leverage(turns: Turns) -> float:
    """Determinant of the Jacobian relative to the nominal posture [1]; 0 in a singular posture."""
    _, _, s2, c2, s3, c3 = turns
    return (UPPER_M * c2 + FOREARM_M * s3) / NOMINAL_LEVER_M[0] * (c3 * c2 + s3 * s2)


@native
def _forward(q: NDArray[np.float64], p: NDArray[np.float64]) -> None:
    for i in range(len(q)):
        p[i, 0], p[i, 1], p[i, 2] = tip(turns_at(q[i, 0], q[i, 1], q[i, 2]))


@native
def _inverse(p: NDArray[np.float64], q: NDArray[np.float64]) -> None:
    for i in range(len(p)):
        q[i, 0], q[i, 1], q[i, 2] = joints_at(p[i, 0], p[i, 1], p[i, 2])


@native
def _jacobian(q: NDArray[np.float64], J: NDArray[np.float64]) -> None:
    for i in range(len(q)):
        rows = lever(turns_at(q[i, 0], q[i, 1], q[i, 2]))
        for k in range(3):
            J[i, 0, k], J[i, 1, k], J[i, 2, k] = rows[0][k], rows[1][k], rows[2][k]


def forward(q: ArrayLike) -> NDArray[np.float64]:
    """The tip p_DT (…, 3) [m] at joint angles q (…, 3) [rad]."""
    rows, shape = _rows(q)
    p = np.empty_like(rows)
    _forward(rows, p)
    return p.reshape(shape)


def inverse(p_DT_m: ArrayLike) -> NDArray[np.float64]:
    """Joint angles (…, 3) [rad] for tips (…, 3) [m] in D. Always finite, but valid only where `reachable`."""
    rows, shape = _rows(p_DT_m)
    q = np.empty_like(rows)
    _inverse(rows, q)
    return q.reshape(shape)


def jacobian(q: ArrayLike) -> NDArray[np.float64]:
    """J (…, 3, 3) [m/rad] with v_DT = J dq/dt."""
    rows, shape = _rows(q)
    J = np.empty((len(rows), 3, 3))
    _jacobian(rows, J)
    return J.reshape(*shape, 3)


def within_limits(q: ArrayLike) -> NDArray[np.bool_]:
    """Whether postures (…, 3) [rad] are within the joint limits (…,), with a tolerance for rounding."""
    rows, shape = _rows(q)
    low, high = np.array([WAIST_RAD, SHOULDER_RAD, ELBOW_RAD]).T
    free = np.column_stack([rows[:, 0], rows[:, 1], rows[:, 2] - rows[:, 1]])
    inside = np.all((free >= low - 1e-9) & (free <= high + 1e-9), axis=1)
    return np.asarray(inside.reshape(shape[:-1]))


def reachable(p_DT_m: ArrayLike) -> NDArray[np.bool_]:
    """Whether tips (…, 3) [m] in D are reachable within the joint limits (…,)."""
    rows, shape = _rows(p_DT_m)
    q = inverse(rows)
    met = np.linalg.norm(forward(q) - rows, axis=1) < 1e-9
    return np.asarray((met & within_limits(q)).reshape(shape[:-1]))


def _rows(values: ArrayLike) -> tuple[NDArray[np.float64], tuple[int, ...]]:
    """Reshape to rows (n, 3). Also returns the original shape."""
    array = np.asarray(values, np.float64)
    return np.ascontiguousarray(array.reshape(-1, 3)), array.shape
