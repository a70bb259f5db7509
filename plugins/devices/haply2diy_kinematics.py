"""Kinematics of the Haply 2DIY: arm angles, handle position, torques. Not a driver.

The device's axes H: x to the left, y towards the hand.
"""

import math
from typing import Final

TORQUE_MAX_N_m: Final = 0.123
"""Torque limit of the firmware."""

UPPER_M, LOWER_M = 0.07, 0.09


def forward(theta: tuple[float, float], base_m: float) -> tuple[float, float] | None:
    """Handle position in H [m] for the two arm angles [rad]; None if the arms do not meet."""
    ax, ay = UPPER_M * math.cos(theta[0]), UPPER_M * math.sin(theta[0])
    hx, hy = base_m + UPPER_M * math.cos(theta[1]) - ax, UPPER_M * math.sin(theta[1]) - ay
    size = math.hypot(hx, hy)
    if not 1e-3 < size < 2.0 * LOWER_M * 0.999:
        return None
    rise = math.sqrt(LOWER_M * LOWER_M - 0.25 * size * size) / size
    return ax + 0.5 * hx - rise * hy, ay + 0.5 * hy + rise * hx


def arm_torques(
    force: tuple[float, float], p: tuple[float, float], theta: tuple[float, float], base_m: float
) -> tuple[float, float]:
    """Torques [N·m] for a force in H [N], Jᵀ f. Scaled down together if one exceeds the limit.

    J follows from the constant length of the lower arms: (p − a) · ṗ = (p − a) · ȧ for each elbow a.
    """
    rows, turns = [], []
    for angle, base in zip(theta, (0.0, base_m), strict=True):
        x, y = UPPER_M * math.cos(angle), UPPER_M * math.sin(angle)
        rows.append((p[0] - base - x, p[1] - y))
        turns.append(rows[-1][1] * x - rows[-1][0] * y)
    (a, b), (c, d) = rows
    det = a * d - b * c
    if abs(det) < 1e-5:  # the lower arms are in line: a singular posture
        return 0.0, 0.0
    first, second = (d * force[0] - c * force[1]) / det * turns[0], (a * force[1] - b * force[0]) / det * turns[1]
    share = min(1.0, TORQUE_MAX_N_m / max(abs(first), abs(second), 1e-12))
    return share * first, share * second
