"""Compensators of the handle, and the filters that approximate the inverse of its dynamics."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.errors import HandleError, no_such
from hapscene.handle.plant import Array, Plant

__all__ = [
    "BUTTERWORTH",
    "COMPENSATORS",
    "COUNT",
    "CRITICAL",
    "Compensator",
    "differences",
    "find_compensator",
    "integrals",
    "retune",
    "section",
    "weights",
]

# The inverse as a sum of an acceleration and its leaky integrals.
#
# The inverse of eq. 8 is den(s)/(m_c s⁴) = m_h + θ₁/s + θ₂/s² + θ₃/s³ + θ₄/s⁴: linear in five numbers. The poles at s =
# 0 would need infinite force at rest. They are replaced by D(s) = (s² + d₁ω₀s + ω₀²)(s² + d₂ω₀s + ω₀²), so that
#
#     F = Σ θ_i φ_i,  φ_i = s^(4−i) ω₀^i / D(s) · a,  i = 0 … 4,
#
# with θ_i = den_i / (m_c ω₀^i) [kg]. Each approximate inverse is a choice of ω₀, d₁, d₂ and θ. The same signals φ of
# the measured acceleration give an estimate of θ (`handle_loop.learn`).
#
# D is computed as second-order sections in state-variable form, discretised by the trapezoidal rule (Tustin). They are
# well conditioned, which a direct form of fourth order is not.


COUNT: Final = 5
"""Number of signals φ_i."""

CRITICAL: Final = (2.0, 2.0)
"""Damping d₁, d₂ of (s + ω₀)⁴ [1]."""

BUTTERWORTH: Final = (2.0 * math.cos(math.pi / 8.0), 2.0 * math.cos(3.0 * math.pi / 8.0))
"""Damping d₁, d₂ of the Butterworth polynomial of fourth order [1]: maximally flat above its corner."""


def weights(plant: Plant, corner_Hz: float) -> Array:
    """θ (5,) [kg] of the inverse of a plant."""
    omega = 2.0 * np.pi * corner_Hz
    return np.asarray(plant.denominator() / plant.m_c_kg / omega ** np.arange(COUNT))


@native
def section(state: Array, at: int, g: float, d: float, x: float) -> tuple[float, float, float]:
    """Second-order section, (s², ω₀s, ω₀²)/(s² + dω₀s + ω₀²) of x; g = tan(ω₀T/2), state at [at, at+1].

    Trapezoidal state-variable filter (Zavalishin 2012, "The Art of VA Filter Design").
    """
    share = 1.0 / (1.0 + g * (g + d))  # first the part that does not wait for x
    rest = -((g + d) * state[at] + state[at + 1]) * share
    swing = g * rest + state[at]
    high, band, low = share * x + rest, g * share * x + swing, g * g * share * x + (g * swing + state[at + 1])
    state[at] = band + g * high
    state[at + 1] = low + g * band
    return high, band, low


@native
def integrals(state: Array, g: float, d1: float, d2: float, a: float) -> tuple[float, float, float, float, float]:
    """φ_0 … φ_4 of the next sample a of the acceleration; state (6,)."""
    high, _, low = section(state, 0, g, d1, a)
    phi0, phi1, phi2 = section(state, 2, g, d2, high)
    _, phi3, phi4 = section(state, 4, g, d2, low)
    return phi0, phi1, phi2, phi3, phi4


@native
def retune(state: Array, ratio: float) -> None:
    """Change ω₀ of `integrals` by a ratio without a step of the output: rescale the states by powers of ω₀."""
    square = ratio * ratio
    state[0] *= ratio
    state[1] *= square
    state[2] *= ratio
    state[3] *= square
    state[4] *= ratio * square
    state[5] *= square * square


@native
def differences(state: Array, g: float, d1: float, d2: float, f: float) -> float:
    """s⁴/D(s) of the next sample f; state (4,)."""
    high = section(state, 0, g, d1, f)[0]
    return section(state, 2, g, d2, high)[0]


@dataclass(frozen=True)
class Compensator:
    """Parameters of a compensator, which computes a force from the desired acceleration.

    Attributes:
        mass_only: use F = m_h a, without a filter.
        corner_Hz: corner f₀ of the denominator D(s) [Hz].
        damping: d₁, d₂ of D(s) [1].
        leads: whether to compensate the lag of the amplifier.
        adapts: whether to estimate θ from the accelerometer.
        force_share: share of the force limit that the governor may use [1].
        travel_share: share of the travel that the governor may use [1].
        yield_share: share of the travel to which `governor.YIELD` relates the swing of the learnt handle [1]. The swing
            of the nominal handle is related to `governor.TRAVEL_SHARE`.
    """

    mass_only: bool = False
    corner_Hz: float = 5.0
    damping: tuple[float, float] = CRITICAL
    leads: bool = False
    adapts: bool = False
    force_share: float = 1.0
    travel_share: float = 0.6
    yield_share: float = 0.6


FLAT_HZ: Final = 9.0
"""Corner of the flat inverse [Hz]. It loses 0.1 % at 20 Hz, where (s + ω₀)⁴ would lose a third. A lower corner follows
taps slightly better, but at 8 Hz a tap of 20 m/s² in a grip four times as firm drives the coil into its stops."""

_FLAT: Final = Compensator(corner_Hz=FLAT_HZ, damping=BUTTERWORTH, leads=True)

_ADAPTIVE: Final = replace(
    _FLAT,
    corner_Hz=8.0,
    damping=(1.9, 1.2),
    adapts=True,
    force_share=0.98,
    travel_share=0.9,
    yield_share=1.8,
)
"""Chosen on taps, noise, a texture and a chirp, from quiet to twenty times too strong, with the nominal grip and one
four times as firm. It predicts travel and force of the learnt handle, and may use nearly all of both."""

COMPENSATORS: Final[Mapping[str, Compensator]] = {
    "none": Compensator(mass_only=True),  # no force: the baseline, with an error of 1
    "naive": Compensator(mass_only=True),  # F = m_h a
    "inverse": Compensator(leads=True),  # den(s)/(m_c (s + ω₀)⁴), f₀ = 5 Hz
    "flat": _FLAT,  # den(s)/(m_c D(s)), D of Butterworth
    "adaptive": _ADAPTIVE,  # nearly the same, with θ estimated from the accelerometer
}
"""Compensators by name."""


def find_compensator(name: str) -> Compensator:
    """Look up a compensator by name. Raises HandleError: unknown name."""
    if name not in COMPENSATORS:
        raise HandleError(no_such("compensator", str(name), COMPENSATORS))
    return COMPENSATORS[name]
