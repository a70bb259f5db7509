"""What theory says of a sampled wall: the formulas that the simulated answers are held to.

    plant     m ẍ = F − b ẋ − c sgn ẋ, F held over T
    wall      F = K d + B Δd/T, with depth d counted in encoder steps Δ, and F going out d ticks later

δ = bT/m, a = e^(−δ), e = 1 − a. [pub] is published; [drv] was derived, here or where said, and holds to rounding.
Nothing in the simulation uses any of this.
"""

import math
from typing import Final

import numpy as np

__all__ = [
    "APEX_ALPHA",
    "APEX_BETA",
    "comes_to_rest",
    "largest_root",
    "limit_of_passivity",
    "limit_of_rest",
    "limit_of_small_motion",
    "limit_with_one_delay",
    "limit_with_wall_damping",
    "limit_without_delay",
    "peak_speed",
    "restitution",
]

APEX_ALPHA: Final = 4.0 * (math.sqrt(2.0) - 1.0) ** 2
"""Stiffest wall that any damping lets rest on a device without damping of its own, as KT²/m [1]; [drv] from W5."""

APEX_BETA: Final = 2.0 * (math.sqrt(2.0) - 1.0)
"""The damping that does it, as BT/m [1]."""


def limit_without_delay(mass_kg: float, damping_Ns_m: float, tick_s: float) -> float:
    """W1: K = (b/T) δe/(e − aδ) [N/m] for B = 0, d = 0; 2b/T where δ is small. [drv]

    Where the pair of poles leaves the unit circle (the determinant (z−1)(z−a) + K(pz + r) at z = 0 is 1). Above
    δ = 3.72 a pole leaves through −1 before that: then `limit_of_small_motion` is right.
    """
    delta = damping_Ns_m * tick_s / mass_kg
    if delta == 0.0:
        return 0.0
    return float(-math.expm1(-delta) / _held(mass_kg, damping_Ns_m, tick_s)[1])


def limit_with_one_delay(mass_kg: float, damping_Ns_m: float, tick_s: float) -> float:
    """W2: K = 2e/(s + √(s² + 4r²e)), s = r(1 + a) + p [N/m] for B = 0, d = 1; b/(T/2 + T) where δ is small. [drv]"""
    delta = damping_Ns_m * tick_s / mass_kg
    if delta == 0.0:
        return 0.0
    e = -math.expm1(-delta)
    p, r = _held(mass_kg, damping_Ns_m, tick_s)
    s = r * (2.0 - e) + p
    return float(2.0 * e / (s + math.sqrt(s * s + 4.0 * r * r * e)))


def limit_of_passivity(damping_Ns_m: float, wall_damping_Ns_m: float, tick_s: float) -> float:
    """W3: K = 2(b − |B|)/T [N/m], up to which no motion whatever gets energy out of the wall (Colgate & Schenkel 1997,
    Journal of Robotic Systems 14:37, eq. 1 for a virtual spring and damper). [pub] Below 0 there is none."""
    return 2.0 * (damping_Ns_m - abs(wall_damping_Ns_m)) / tick_s


def limit_of_rest(coulomb_N: float, quantum_m: float) -> float:
    """W4: K = 2c/Δ [N/m]: above it friction cannot hold the half step by which the wall's force misses what is asked of
    it (Abbott & Okamura 2005, IEEE Transactions on Robotics 21:952: passive for K ≤ min(2b/T, 2c/Δ)). [pub]"""
    return 2.0 * coulomb_N / quantum_m


def limit_with_wall_damping(mass_kg: float, wall_damping_Ns_m: float, tick_s: float) -> float:
    """W5: K = (m/T²) 2β(2 − β)/(2 + β) [N/m], β = BT/m < 2, for b = 0, d = 0. [drv]

    From the determinant of (z − 1)² z + (T²/2m)(z + 1)(Kz + B(z − 1)/T), Jury's last condition.
    """
    beta = wall_damping_Ns_m * tick_s / mass_kg
    return max(0.0, mass_kg / tick_s**2 * 2.0 * beta * (2.0 - beta) / (2.0 + beta))


def comes_to_rest(coulomb_N: float, stiffness_N_m: float, quantum_m: float) -> bool:
    """W6: a tool pushed at half an encoder step comes to rest where c/(KΔ) ≥ 1/2. [drv]"""
    return coulomb_N / (stiffness_N_m * quantum_m) >= 0.5


def peak_speed(
    coulomb_N: float,
    stiffness_N_m: float,
    tick_s: float,
    damping_Ns_m: float,
    wall_damping_Ns_m: float = 0.0,
    delay_ticks: int = 0,
) -> float:
    """W7: v = 8c/(π(KT(1 + 2d) − 2b − 2B)) [m/s]: motion of a lower peak speed dies, a faster one grows. [drv]

    By the energy of one cycle: friction takes 4cX of it, the dampers π(b + B)ωX², and the force's mean lateness
    T(1/2 + d) gives πKT(1/2 + d)ωX². For ωT ≪ 1. Infinite where dampers alone suffice.
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
    late_Ns_m = stiffness_N_m * tick_s * (0.5 + delay_ticks) - damping_Ns_m - wall_damping_Ns_m
    return math.exp(math.pi * late_Ns_m / (2.0 * math.sqrt(stiffness_N_m * mass_kg)))


def largest_root(
    stiffness_N_m: float,
    mass_kg: float,
    damping_Ns_m: float,
    tick_s: float,
    delay_ticks: int = 0,
    wall_damping_Ns_m: float = 0.0,
) -> float:
    """Largest |z| of the loop's characteristic polynomial [1]: small motion in contact dies where it is below 1. [drv]

    (z − 1)(z − a) z^(d+1) + (pz + r)(Kz + B(z − 1)/T), with p = (m/b²)(δ − e), r = (m/b²)(e − aδ).
    """
    p, r = _held(mass_kg, damping_Ns_m, tick_s)
    a = math.exp(-damping_Ns_m * tick_s / mass_kg)
    free = np.concatenate((np.array((1.0, -1.0 - a, a)), np.zeros(delay_ticks + 1)))
    damper = wall_damping_Ns_m / tick_s
    wall = np.polymul((p, r), (stiffness_N_m + damper, -damper))
    return float(np.abs(np.roots(np.polyadd(free, wall))).max())


def limit_of_small_motion(
    mass_kg: float, damping_Ns_m: float, tick_s: float, delay_ticks: int = 0, wall_damping_Ns_m: float = 0.0
) -> float:
    """The largest K at which all roots of the characteristic polynomial lie in the unit circle [N/m], for any b, B, d;
    0 where there is none. W1, W2 and W5 are its cases. [drv]"""
    from scipy.optimize import brentq

    if damping_Ns_m + wall_damping_Ns_m == 0.0:
        return 0.0
    p, r = _held(mass_kg, damping_Ns_m, tick_s)
    e = -math.expm1(-damping_Ns_m * tick_s / mass_kg)

    def border(theta: float) -> complex:
        """K + (B/T)(1 − 1/z) of the walls for which z = e^(iθ) is a root."""
        half, z = math.sin(theta / 2.0), complex(math.cos(theta), math.sin(theta))
        less_a = complex(e - 2.0 * half * half, z.imag)  # z − a without the difference of nearly equal numbers
        return -(z**delay_ticks) * 2j * half * complex(math.cos(theta / 2.0), half) * less_a / (p * z + r)

    def wall(theta: float) -> tuple[float, float]:
        """K and B of it."""
        at = border(theta)
        damper = at.imag / math.sin(theta)
        return at.real - 2.0 * damper * math.sin(theta / 2.0) ** 2, tick_s * damper

    end, limit = math.pi / (delay_ticks + 1) * (1.0 - 1e-9), math.inf
    thetas = end * np.linspace(1e-5, 1.0, 200) ** 2
    after = next((theta for theta in thetas if wall(theta)[1] > wall_damping_Ns_m), 0.0)
    if after > 0.0:  # a pair of roots leaves
        at = brentq(lambda theta: wall(theta)[1] - wall_damping_Ns_m, 1e-12 * end, after, xtol=1e-300, rtol=1e-15)
        limit = wall(at)[0]
    elif delay_ticks > 0 or wall(end)[0] <= 0.0:  # more than the largest damping
        return 0.0
    if delay_ticks == 0 and p > r:  # or, of an overdamped device, one by −1
        limit = min(limit, 2.0 * (2.0 - e) / (p - r) - 2.0 * wall_damping_Ns_m / tick_s)
    return max(0.0, limit)


def _held(mass_kg: float, damping_Ns_m: float, tick_s: float) -> tuple[float, float]:
    """p and r [m/N] of the plant with a held force, X(z)/F(z) = (pz + r)/((z − 1)(z − a)); T²/2m both where b = 0."""
    delta = damping_Ns_m * tick_s / mass_kg
    if delta < 1e-2:  # (δ − e)/δ² would lose digits
        second = sum((-delta) ** n / math.factorial(n + 2) for n in range(8))
        first = sum((-delta) ** n / math.factorial(n + 1) for n in range(8))
    else:
        e = -math.expm1(-delta)
        second, first = (delta - e) / delta**2, e / delta
    scale = tick_s**2 / mass_kg
    return scale * second, scale * (first - second)
