"""Kinematics of the Novint Falcon: leg angles, grip position, motor torques. Not a driver.

The geometry is that of libnifalcon (include/falcon/core/FalconGeometry.h), in the device's axes F: x to the right, y
up, z out of the device, towards the hand.
"""

import math
from typing import Any, Final

from hapscene.compiled.native import native
from hapscene.geometry import Vector

NOWHERE: Final = (math.nan, math.nan, math.nan)
"""Result where there is no solution."""

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


@native
def solve(A: tuple[Vector, Vector, Vector], b: Vector) -> Vector:
    """Solve A x = b by Cramer's rule; NaN if A is singular."""
    (a, d, g), (p, q, r), (u, v, w) = A
    m0, m1, m2 = q * w - r * v, r * u - p * w, p * v - q * u
    det = a * m0 + d * m1 + g * m2
    size = (abs(a) + abs(d) + abs(g)) * (abs(p) + abs(q) + abs(r)) * (abs(u) + abs(v) + abs(w))
    if not abs(det) > 1e-9 * size:
        return NOWHERE
    b0, b1, b2 = b
    x = b0 * m0 + d * (r * b2 - b1 * w) + g * (b1 * v - q * b2)
    y = a * (b1 * w - r * b2) + b0 * m1 + g * (p * b2 - b1 * u)
    z = a * (q * b2 - b1 * v) + d * (b1 * u - p * b2) + b0 * m2
    return x / det, y / det, z / det


@native
def closure(p: Any, angle: float, k: int) -> tuple[float, Vector, float]:
    """Closure error of the shin of leg `k`, its gradient by p, and its derivative by the angle of the leg.

    A shin is a parallelogram of side b with links d and e at its ends. Seen along the axis v of its leg, the knee has
    the distance ρ = d + e + √(b² − v²) from the plate.
    """
    a, b, c, links, f, r, s = LEG
    cos, sin = TURN[k]
    u = cos * p[0] + sin * p[1] - r + c - a * math.cos(angle)
    v = -sin * p[0] + cos * p[1] - s + f
    w = p[2] - a * math.sin(angle)
    rho = math.sqrt(u * u + w * w)
    share = (rho - links) / rho if rho > 0.0 else 0.0
    gap = 0.5 * ((rho - links) ** 2 + v * v - b * b)
    gradient = share * u * cos - v * sin, share * u * sin + v * cos, share * w
    return gap, gradient, share * a * (u * math.sin(angle) - w * math.cos(angle))


@native
def forward(theta: Any, start: Any) -> Vector:
    """Grip position in F [m] for three leg angles [rad], by Newton's method from `start`; NaN if none fits."""
    x, y, z = start[0], start[1], start[2]
    for _ in range(20):
        first, row0, _turn0 = closure((x, y, z), theta[0], 0)
        second, row1, _turn1 = closure((x, y, z), theta[1], 1)
        third, row2, _turn2 = closure((x, y, z), theta[2], 2)
        dx, dy, dz = solve((row0, row1, row2), (-first, -second, -third))
        size = math.sqrt(dx * dx + dy * dy + dz * dz)
        if math.isnan(size):
            return NOWHERE
        share = min(1.0, 0.02 / size) if size > 0.0 else 1.0
        x, y, z = x + share * dx, y + share * dy, z + share * dz
        if size < STEP_M:
            inside = abs(x) < 0.12 and abs(y) < 0.12 and 0.04 < z < 0.2  # the other solution is behind the device
            return (x, y, z) if inside else NOWHERE
    return NOWHERE


@native
def motor_units(force: Vector, p: Any, theta: Any) -> tuple[int, int, int]:
    """Motor commands for a force in F [N], Jᵀ f. Scaled down together if one exceeds the limit."""
    _gap0, (a, b, c), turn0 = closure(p, theta[0], 0)
    _gap1, (d, e, f), turn1 = closure(p, theta[1], 1)
    _gap2, (g, h, i), turn2 = closure(p, theta[2], 2)
    u, v, w = solve(((a, d, g), (b, e, h), (c, f, i)), force)
    x, y, z = -turn0 * u / UNIT_N_m, -turn1 * v / UNIT_N_m, -turn2 * w / UNIT_N_m
    most = max(abs(x), abs(y), abs(z))
    if not math.isfinite(most):
        return 0, 0, 0
    share = min(1.0, UNIT_MAX / most) if most > 0.0 else 1.0
    return round(share * x), round(share * y), round(share * z)
