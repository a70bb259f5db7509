"""Closed forms for walls, with which the simulated limits are compared: W1 to W8 of the reference table.

    plant     m ẍ = F − b ẋ − c sgn ẋ, F held over the tick T
    wall      F = K x + B Δx/T, with depth x in encoder steps Δ, sampled once per tick; F is applied d ticks later

δ = bT/m, a = e^(−δ), e = 1 − a. [pub] marks published formulas; [drv] marks formulas derived here or where stated,
which are exact up to rounding. The simulation does not use these formulas.
"""

import math

from hapscene.stability.closed_form import hold_coefficients, limit_of_small_motion

__all__ = [
    "comes_to_rest",
    "limit_of_passivity",
    "limit_of_rest",
    "limit_of_small_motion",
    "limit_with_one_delay",
    "limit_with_wall_damping",
    "limit_without_delay",
    "peak_speed",
    "restitution",
]


def limit_without_delay(mass_kg: float, damping_Ns_m: float, tick_s: float) -> float:
    """W1: K = (b/T) δe/(e − aδ) [N/m] for B = 0, d = 0; 2b/T for small δ. [drv]

    There the pair of poles leaves the unit circle (the determinant (z−1)(z−a) + K(pz + r) at z = 0 is 1). Above δ =
    3.72 a pole leaves through −1 before that; `limit_of_small_motion` covers this case.
    """
    delta = damping_Ns_m * tick_s / mass_kg
    if delta == 0.0:
        return 0.0
    return float(-math.expm1(-delta) / hold_coefficients(mass_kg, damping_Ns_m, tick_s)[1])


def limit_with_one_delay(mass_kg: float, damping_Ns_m: float, tick_s: float) -> float:
    """W2: K = 2e/(s + √(s² + 4r²e)), s = r(1 + a) + p [N/m] for B = 0, d = 1; b/(T/2 + T) for small δ. [drv]"""
    delta = damping_Ns_m * tick_s / mass_kg
    if delta == 0.0:
        return 0.0
    e = -math.expm1(-delta)
    p, r = hold_coefficients(mass_kg, damping_Ns_m, tick_s)
    s = r * (2.0 - e) + p
    return float(2.0 * e / (s + math.sqrt(s * s + 4.0 * r * r * e)))


def limit_of_passivity(damping_Ns_m: float, wall_damping_Ns_m: float, tick_s: float) -> float:
    """W3: K = 2(b − |B|)/T [N/m], up to which no motion extracts energy from the wall. [pub] Negative: no passive wall.

    Colgate & Schenkel 1997, Journal of Robotic Systems 14:37, eq. 1, for a virtual spring and damper.
    """
    return 2.0 * (damping_Ns_m - abs(wall_damping_Ns_m)) / tick_s


def limit_of_rest(coulomb_N: float, quantum_m: float) -> float:
    """W4: K = 2c/Δ [N/m], above which friction cannot balance the force of half an encoder step. [pub]

    Abbott & Okamura 2005, IEEE Transactions on Robotics 21:952: passive for K ≤ min(2b/T, 2c/Δ).
    """
    return 2.0 * coulomb_N / quantum_m


def limit_with_wall_damping(mass_kg: float, wall_damping_Ns_m: float, tick_s: float) -> float:
    """W5: K = (m/T²) 2β(2 − β)/(2 + β) [N/m], β = BT/m < 2, for b = 0, d = 0. [drv]

    From the determinant of (z − 1)² z + (T²/2m)(z + 1)(Kz + B(z − 1)/T), by the last condition of Jury.
    """
    beta = wall_damping_Ns_m * tick_s / mass_kg
    return max(0.0, mass_kg / tick_s**2 * 2.0 * beta * (2.0 - beta) / (2.0 + beta))


def comes_to_rest(coulomb_N: float, stiffness_N_m: float, quantum_m: float) -> bool:
    """W6: a tool pushed to the middle of an encoder step comes to rest if c/(KΔ) ≥ 1/2. [drv]"""
    return coulomb_N / (stiffness_N_m * quantum_m) >= 0.5


def peak_speed(
    coulomb_N: float,
    stiffness_N_m: float,
    tick_s: float,
    damping_Ns_m: float,
    wall_damping_Ns_m: float = 0.0,
    delay_ticks: int = 0,
) -> float:
    """W7: v = 8c/(π(KT(1 + 2d) − 2b − 2B)) [m/s]: motion with a lower peak speed decays, faster motion grows. [drv]

    From the energy of one cycle for ωT ≪ 1: friction takes 4cX, the dampers take π(b + B)ωX², and the mean delay
    T(1/2 + d) of the force adds πKT(1/2 + d)ωX². Infinite if the dampers alone suffice.
    """
    lack = stiffness_N_m * tick_s * (1 + 2 * delay_ticks) - 2.0 * (damping_Ns_m + wall_damping_Ns_m)
    return 8.0 * coulomb_N / (math.pi * lack) if lack > 0.0 else math.inf


def restitution(
    mass_kg: float,
    stiffness_N_m: float,
    tick_s: float,
    delay_ticks: int = 0,
    damping_Ns_m: float = 0.0,
    wall_damping_Ns_m: float = 0.0,
) -> float:
    """W8: speed after a bounce over the speed before, exp(π(KT/2 + KdT − b − B)/(2√(Km))) [1]. [drv], for ωT ≪ 1."""
    delay_Ns_m = stiffness_N_m * tick_s * (0.5 + delay_ticks) - damping_Ns_m - wall_damping_Ns_m
    return math.exp(math.pi * delay_Ns_m / (2.0 * math.sqrt(stiffness_N_m * mass_kg)))
