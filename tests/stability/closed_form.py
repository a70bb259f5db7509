"""Closed forms for walls, with which the simulated limits are compared: W1 to W8 of the reference table.

    plant     m ẍ = F − b ẋ − c sgn ẋ, F held over the tick T
    wall      F = K x + B Δx/T, with depth x in encoder steps Δ, sampled once per tick; F is applied d ticks later

δ = bT/m, a = e^(−δ), e = 1 − a. [pub] marks published formulas; [drv] marks formulas derived here or where stated,
which are exact up to rounding. The simulation does not use these formulas.
"""

import math

from hapscene.stability.closed_form import limit_of_small_motion as limit_of_small_motion


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
