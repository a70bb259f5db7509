"""Kinematics of the Haply 2DIY: arm angles, handle position, torques. Not a driver.

The device's axes H: x to the left, y towards the hand.
"""

import math
from typing import Any, Final

from hapscene.compiled.native import native

TORQUE_MAX_N_m: Final = 0.123
"""Torque limit of the firmware."""

UPPER_M, LOWER_M = 0.07, 0.09


@native
def forward(theta: Any, base_m: float) -> tuple[float, float]:
    """Handle position in H [m] for the two arm angles (2,) [rad]; NaN if the arms do not meet."""
    ax, ay = UPPER_M * math.cos(theta[0]), UPPER_M * math.sin(theta[0])
    hx, hy = base_m + UPPER_M * math.cos(theta[1]) - ax, UPPER_M * math.sin(theta[1]) - ay
    size = math.hypot(hx, hy)
    if not 1e-3 < size < 2.0 * LOWER_M * 0.999:
        return math.nan, math.nan
    rise = math.sqrt(LOWER_M * LOWER_M - 0.25 * size * size) / size
    return ax + 0.5 * hx - rise * hy, ay + 0.5 * hy + rise * hx


@native
def arm_torques(force: Any, p: Any, theta: Any, base_m: float) -> tuple[float, float]:
    """Torques [N·m] for a force (2,) in H [N] at handle position `p` (2,), Jᵀ f. Scaled down together if one exceeds
    the limit.

    J follows from the constant length of the lower arms: (p − a) · ṗ = (p − a) · ȧ for each elbow a.
    """
    x, y = UPPER_M * math.cos(theta[0]), UPPER_M * math.sin(theta[0])
    a, b = p[0] - x, p[1] - y
    first_turn = b * x - a * y
    x, y = UPPER_M * math.cos(theta[1]), UPPER_M * math.sin(theta[1])
    c, d = p[0] - base_m - x, p[1] - y
    second_turn = d * x - c * y
    det = a * d - b * c
    if abs(det) < 1e-5:  # the lower arms are in line: a singular posture
        return 0.0, 0.0
    first, second = (d * force[0] - c * force[1]) / det * first_turn, (a * force[1] - b * force[0]) / det * second_turn
    share = min(1.0, TORQUE_MAX_N_m / max(abs(first), abs(second), 1e-12))
    return share * first, share * second
