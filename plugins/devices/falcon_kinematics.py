"""Kinematics of the Novint Falcon: leg angles, grip position, motor torques. Not a driver.

The geometry is that of libnifalcon (include/falcon/core/FalconGeometry.h), in the device's axes F: x to the right, y
up, z out of the device, towards the hand.
"""

import math
from typing import Any, Final

from hapscene.geometry import Vector

MIDDLE_M: Final = 0.125
"""z in F of the origin of D, where each axis has a range of about 5 cm."""

LEG = (0.060, 0.1025, 0.01443, 0.0225, -0.025, 0.0400, -0.02309)
"""a, b, c, d + e, f, r, s of libnifalcon's FalconGeometry.h [m]."""

TURN = tuple((math.cos(angle), math.sin(angle)) for angle in (math.radians(degrees) for degrees in (105, -15, -135)))
"""Cosine and sine of the angles of the three legs around z, clockwise from the top as seen by the user."""

COUNT_RAD: Final = math.radians(360.0 * 0.01425 / (4 * 320 * 0.110))
ZERO_RAD: Final = math.radians(35.0)
"""Angle of a leg at count 0."""

UNIT_N_m: Final = -1.0e-4
"""Torque at a leg for one unit of the motor command."""

UNIT_MAX: Final = 4000
"""Largest motor command [units]. A force of 8 N needs 2,000 in the middle of the workspace and up to 8,000 in its
corners, where the force is reduced. The protocol overflows to the other sign at 32,768."""

STEP_M: Final = 1e-8
"""Step of Newton's method at which the forward kinematics stop [m]."""


def solve(A: list[tuple[float, float, float]], b: tuple[float, float, float]) -> Vector | None:
    """Solve A x = b by Cramer's rule; None if A is singular. Faster than NumPy for three unknowns."""
    (a, d, g), (p, q, r), (u, v, w) = A
    m0, m1, m2 = q * w - r * v, r * u - p * w, p * v - q * u
    det = a * m0 + d * m1 + g * m2
    size = (abs(a) + abs(d) + abs(g)) * (abs(p) + abs(q) + abs(r)) * (abs(u) + abs(v) + abs(w))
    if not abs(det) > 1e-9 * size:
        return None
    b0, b1, b2 = b
    x = b0 * m0 + d * (r * b2 - b1 * w) + g * (b1 * v - q * b2)
    y = a * (b1 * w - r * b2) + b0 * m1 + g * (p * b2 - b1 * u)
    z = a * (q * b2 - b1 * v) + d * (b1 * u - p * b2) + b0 * m2
    return x / det, y / det, z / det


def closure(p: Vector, theta: tuple[float, float, float]) -> tuple[Any, Any, Any]:
    """Closure errors of the three shins, their gradients by p (a row for each leg), and their derivatives by each
    angle.

    A shin is a parallelogram of side b with links d and e at its ends. Seen along the axis v of its leg, the knee has
    the distance ρ = d + e + √(b² − v²) from the plate.
    """
    a, b, c, links, f, r, s = LEG
    gaps, rows, turns = [], [], []
    for (cos, sin), angle in zip(TURN, theta, strict=True):
        u = cos * p[0] + sin * p[1] - r + c - a * math.cos(angle)
        v = -sin * p[0] + cos * p[1] - s + f
        w = p[2] - a * math.sin(angle)
        rho = math.sqrt(u * u + w * w)
        share = (rho - links) / rho if rho > 0.0 else 0.0
        gaps.append(0.5 * ((rho - links) ** 2 + v * v - b * b))
        rows.append((share * u * cos - v * sin, share * u * sin + v * cos, share * w))
        turns.append(share * a * (u * math.sin(angle) - w * math.cos(angle)))
    return gaps, rows, turns


def forward(theta: tuple[float, float, float], start: Vector = (0.0, 0.0, MIDDLE_M)) -> Vector | None:
    """Grip position in F [m] for three leg angles [rad], by Newton's method from `start`; None if none fits."""
    p = start
    for _ in range(20):
        gaps, rows, _turns = closure(p, theta)
        step = solve(rows, (-gaps[0], -gaps[1], -gaps[2]))
        if step is None:
            return None
        size = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        share = min(1.0, 0.02 / size) if size > 0.0 else 1.0
        p = (p[0] + share * step[0], p[1] + share * step[1], p[2] + share * step[2])
        if size < STEP_M:
            inside = abs(p[0]) < 0.12 and abs(p[1]) < 0.12 and 0.04 < p[2] < 0.2  # the other is behind the device
            return p if inside else None
    return None


def motor_units(force: Vector, p: Vector, theta: tuple[float, float, float]) -> tuple[int, int, int]:
    """Motor commands for a force in F [N], Jᵀ f. Scaled down together if one exceeds the limit."""
    _, rows, turns = closure(p, theta)
    columns = [(rows[0][i], rows[1][i], rows[2][i]) for i in range(3)]
    weights = solve(columns, force)
    if weights is None:
        return 0, 0, 0
    units = [-turn * weight / UNIT_N_m for turn, weight in zip(turns, weights, strict=True)]
    most = max(map(abs, units))
    share = min(1.0, UNIT_MAX / most) if most > 0.0 else 1.0
    x, y, z = (round(share * unit) for unit in units)
    return x, y, z
