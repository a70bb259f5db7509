"""The compensators that one may choose between."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.errors import HandleError, no_such
from hapscene.handle.plant import Array, Plant

__all__ = [
    "BUTTERWORTH",
    "COMPENSATORS",
    "COUNT",
    "CRITICAL",
    "differences",
    "find_compensator",
    "integrals",
    "retune",
    "section",
    "weights",
]

# What the inverse of the handle is a sum of: an acceleration, and its leaky integrals. Compiled.
#
# The inverse of eq. 8 is den(s)/(m_c s⁴) = m_h + θ₁/s + θ₂/s² + θ₃/s³ + θ₄/s⁴: linear in five numbers. s⁴ would ask for
# endless force at rest, so it becomes a D(s) = (s² + d₁ω₀s + ω₀²)(s² + d₂ω₀s + ω₀²) of fourth order, and
#
#     F = Σ θ_i φ_i,  φ_i = s^(4−i) ω₀^i / D(s) · a,  i = 0 … 4,
#
# with θ_i = den_i / (m_c ω₀^i) [kg]. Every approximate inverse here is a choice of ω₀, d₁, d₂ and θ. The same five
# signals of the acceleration that was measured give θ: see `handle_loop.learn`.
#
# D is run as sections of second order in the state-variable form, discretised by the trapezoidal rule (Tustin):
# (s², ω₀s, ω₀²)/(s² + dω₀s + ω₀²) at once, well conditioned where a direct form of fourth order is not.


COUNT: Final = 5
"""Signals φ_i [count]."""

CRITICAL: Final = (2.0, 2.0)
"""Damping d₁, d₂ of (s + ω₀)⁴ [1]."""

BUTTERWORTH: Final = (2.0 * math.cos(math.pi / 8.0), 2.0 * math.cos(3.0 * math.pi / 8.0))
"""Damping d₁, d₂ of Butterworth's polynomial of fourth order [1]: the flattest above its corner."""


def weights(plant: Plant, corner_Hz: float) -> Array:
    """θ (5,) [kg] of a plant's inverse."""
    omega = 2.0 * np.pi * corner_Hz
    return np.asarray(plant.denominator() / plant.m_c_kg / omega ** np.arange(COUNT))


@native
def section(state: Any, at: int, g: float, d: float, x: float) -> tuple[float, float, float]:
    """One section of second order, its state at [at, at+1]: (s², ω₀s, ω₀²)/(s² + dω₀s + ω₀²) of x; g = tan(ω₀T/2).

    Zavalishin 2012, "The Art of VA Filter Design", the trapezoidal state-variable filter.
    """
    share = 1.0 / (1.0 + g * (g + d))  # what comes of the state first: x, which others wait for, goes its own short way
    rest = -((g + d) * state[at] + state[at + 1]) * share
    swing = g * rest + state[at]
    high, band, low = share * x + rest, g * share * x + swing, g * g * share * x + (g * swing + state[at + 1])
    state[at] = band + g * high
    state[at + 1] = low + g * band
    return high, band, low


@native
def integrals(state: Any, g: float, d1: float, d2: float, a: float) -> tuple[float, float, float, float, float]:
    """φ_0 … φ_4 of the next sample a; state (6,)."""
    high, _, low = section(state, 0, g, d1, a)
    phi0, phi1, phi2 = section(state, 2, g, d2, high)
    _, phi3, phi4 = section(state, 4, g, d2, low)
    return phi0, phi1, phi2, phi3, phi4


@native
def retune(state: Any, ratio: float) -> None:
    """Change ω₀ of `integrals` by a ratio without a step: the integrals stay, and what is scaled by ω₀^i follows it."""
    square = ratio * ratio
    state[0] *= ratio
    state[1] *= square
    state[2] *= ratio
    state[3] *= square
    state[4] *= ratio * square
    state[5] *= square * square


@native
def differences(state: Any, g: float, d1: float, d2: float, f: float) -> float:
    """s⁴/D(s) of the next sample f; state (4,)."""
    high = section(state, 0, g, d1, f)[0]
    return section(state, 2, g, d2, high)[0]


@dataclass(frozen=True)
class Compensator:
    """How a force is made of the desired acceleration.

    Attributes:
        says: in a few words.
        mass_only: F = m_h a, no filter.
        corner_Hz: f₀ of the denominator D(s).
        damping: d₁, d₂ of D(s).
        leads: whether the amplifier's lag is made up for.
        adapts: whether θ is learnt from the accelerometer.
        force_share: share of the force limit that the anticipated force may use [1].
        travel_share: share of the travel that the anticipated swing may use [1].
        yield_share: share of the travel that `governor.YIELD` counts the swing over, as what was learnt foretells it
            [1]; the nominal handle's swing always counts over `governor.TRAVEL_SHARE`.
    """

    says: str
    mass_only: bool = False
    corner_Hz: float = 5.0
    damping: tuple[float, float] = CRITICAL
    leads: bool = False
    adapts: bool = False
    force_share: float = 1.0
    travel_share: float = 0.6
    yield_share: float = 0.6


FLAT_HZ: Final = 9.0
"""Corner of the flat inverse [Hz]: 0.1 % is lost at 20 Hz, where (s + ω₀)⁴ would lose a third. Lower follows taps a
little better; but at 8 Hz a tap of 20 m/s² in a grip four times as firm runs into the coil's stops."""

_FLAT: Final = Compensator("den(s)/(m_c D(s)), D of Butterworth", corner_Hz=FLAT_HZ, damping=BUTTERWORTH, leads=True)

_ADAPTIVE: Final = replace(
    _FLAT,
    says="nearly the same, learnt from the accelerometer",
    corner_Hz=8.0,
    damping=(1.9, 1.2),
    adapts=True,
    force_share=0.98,
    travel_share=0.9,
    yield_share=1.8,
)
"""Chosen on taps, noise, a texture and a chirp, quiet to twenty times too loud, with the grip as it is and four times
as firm. It knows what the handle that it has learnt will do with travel and force, and may use nearly all of them."""

COMPENSATORS: Final[Mapping[str, Compensator]] = {
    "none": Compensator("no force: the base line, an error of 1", mass_only=True),
    "naive": Compensator("F = m_h a", mass_only=True),
    "inverse": Compensator("den(s)/(m_c (s + ω₀)⁴), f₀ = 5 Hz", leads=True),
    "flat": _FLAT,
    "adaptive": _ADAPTIVE,
}
"""By name."""


def find_compensator(name: str) -> Compensator:
    """The compensator of that name.

    Raises:
        HandleError: there is none.
    """
    if name not in COMPENSATORS:
        raise HandleError(no_such("compensator", str(name), COMPENSATORS))
    return COMPENSATORS[name]
