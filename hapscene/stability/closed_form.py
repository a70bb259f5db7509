"""The stiffness limit of a sampled wall in closed form: stability of small motion, without friction.

    plant     m ẍ = F − b ẋ, F held over the tick T
    wall      F = K x + B Δx/T, with depth x, sampled once per tick; F is applied d ticks later

δ = bT/m, a = e^(−δ), e = 1 − a.
"""

import math

import numpy as np

__all__ = ["limit_of_small_motion"]


def limit_of_small_motion(
    mass_kg: float, damping_Ns_m: float, tick_s: float, delay_ticks: int = 0, wall_damping_Ns_m: float = 0.0
) -> float:
    """Largest K for which all roots of the characteristic polynomial lie in the unit circle [N/m], for any b, B and d.

    0 if no stiffness is stable. The polynomial is (z − 1)(z − a) z^(d+1) + (pz + r)(Kz + B(z − 1)/T).
    """
    from scipy.optimize import brentq

    if damping_Ns_m + wall_damping_Ns_m == 0.0:
        return 0.0
    p, r = hold_coefficients(mass_kg, damping_Ns_m, tick_s)
    e = -math.expm1(-damping_Ns_m * tick_s / mass_kg)

    def border(theta: float) -> complex:
        """K + (B/T)(1 − 1/z) of the walls that have z = e^(iθ) as a root."""
        half, z = math.sin(theta / 2.0), complex(math.cos(theta), math.sin(theta))
        less_a = complex(e - 2.0 * half * half, z.imag)  # z − a, without subtracting nearly equal numbers
        return -(z**delay_ticks) * 2j * half * complex(math.cos(theta / 2.0), half) * less_a / (p * z + r)

    def wall(theta: float) -> tuple[float, float]:
        """K and B of the wall at `theta`."""
        at = border(theta)
        damper = at.imag / math.sin(theta)
        return at.real - 2.0 * damper * math.sin(theta / 2.0) ** 2, tick_s * damper

    end, limit = math.pi / (delay_ticks + 1) * (1.0 - 1e-9), math.inf
    thetas = end * np.linspace(1e-5, 1.0, 200) ** 2
    after = next((theta for theta in thetas if wall(theta)[1] > wall_damping_Ns_m), 0.0)
    if after > 0.0:  # a pair of complex roots leaves the unit circle
        at = brentq(lambda theta: wall(theta)[1] - wall_damping_Ns_m, 1e-12 * end, after, xtol=1e-300, rtol=1e-15)
        limit = wall(at)[0]
    elif wall(end)[0] <= 0.0:  # the wall damping exceeds its largest stable value
        return 0.0
    if delay_ticks == 0 and p > r:  # in an overdamped device, a root may leave through −1
        limit = min(limit, 2.0 * (2.0 - e) / (p - r) - 2.0 * wall_damping_Ns_m / tick_s)
    return max(0.0, limit)


def hold_coefficients(mass_kg: float, damping_Ns_m: float, tick_s: float) -> tuple[float, float]:
    """Coefficients p and r [m/N] of the sampled plant X(z)/F(z) = (pz + r)/((z − 1)(z − a)); both T²/2m for b = 0."""
    delta = damping_Ns_m * tick_s / mass_kg
    if delta < 1e-2:  # (δ − e)/δ² would lose precision
        second = sum((-delta) ** n / math.factorial(n + 2) for n in range(8))
        first = sum((-delta) ** n / math.factorial(n + 1) for n in range(8))
    else:
        e = -math.expm1(-delta)
        second, first = (delta - e) / delta**2, e / delta
    scale = tick_s**2 / mass_kg
    return scale * second, scale * (first - second)
