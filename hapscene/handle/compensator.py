"""The compensators that one may choose between."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from hapscene.errors import HandleError, no_such
from hapscene.handle.basis import BUTTERWORTH, CRITICAL


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
    """

    says: str
    mass_only: bool = False
    corner_Hz: float = 5.0
    damping: tuple[float, float] = CRITICAL
    leads: bool = False
    adapts: bool = False
    force_share: float = 1.0


FLAT_HZ: Final = 9.0
"""Corner of the flat inverses [Hz]: 0.1 % is lost at 20 Hz, where (s + ω₀)⁴ would lose a third. Lower follows taps a
little better; but at 8 Hz a tap of 20 m/s² in a grip four times as firm runs into the coil's stops."""

COMPENSATORS: Final[Mapping[str, Compensator]] = {
    "none": Compensator("no force: the base line, an error of 1", mass_only=True),
    "naive": Compensator("F = m_h a", mass_only=True),
    "inverse": Compensator("den(s)/(m_c (s + ω₀)⁴), f₀ = 5 Hz", leads=True),
    "flat": Compensator("den(s)/(m_c D(s)), D of Butterworth", corner_Hz=FLAT_HZ, damping=BUTTERWORTH, leads=True),
    "adaptive": Compensator(
        "the same, learnt from the accelerometer",
        corner_Hz=FLAT_HZ,
        damping=BUTTERWORTH,
        leads=True,
        adapts=True,
        force_share=0.75,
    ),
}
"""By name. `adaptive` may find a mass a third above the nominal, and needs as much more force: hence its share."""


def find_compensator(name: str) -> Compensator:
    """The compensator of that name.

    Raises:
        HandleError: there is none.
    """
    if name not in COMPENSATORS:
        raise HandleError(no_such("compensator", str(name), COMPENSATORS))
    return COMPENSATORS[name]
