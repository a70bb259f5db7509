"""What is known of a handle after it was identified: the plant, the grips, and how sure each number is."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from hapscene.handle.plant import Plant

Interval = tuple[float, float]

OWN: Final = ("m_c_kg", "k_s_N_m", "b_s_Ns_m", "m_h_kg")
"""Parameters of the handle itself, the same in every grip."""

HAND: Final = ("k_u_N_m", "b_u_Ns_m")
"""Parameters of the hand, different in every grip."""


@dataclass(frozen=True)
class Grip:
    """A hand that held the handle while it was identified.

    Attributes:
        name: as "light".
        k_u_N_m, b_u_Ns_m: its stiffness and damping.
        intervals: of them, by name, at 95 %.
        absent: why one of them has no interval, by name.
        coherence: median over the band: share of the acceleration's power that the force explains [1].
        coherence_least: the least over the band [1].
    """

    name: str
    k_u_N_m: float
    b_u_Ns_m: float
    coherence: float
    coherence_least: float
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    absent: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Identification:
    """A handle, as measured.

    Attributes:
        name: of the handle.
        plant: the nominal handle, for a compensator: its k_u and b_u are the geometric means over the grips.
        grips: in the order in which they were played, one or more.
        intervals: of the plant's own parameters and amplifier_Hz, by name, at 95 %.
        absent: why one of them has no interval, by name; the plant then holds an assumption.
        asymptote_kg: the first estimate of m_h, force over acceleration where that is flattest.
        asymptote_Hz: the band where that is.
        delay_s: how much later the acceleration came than the amplifier's and accelerometer's poles say.
        accelerometer_Hz: the accelerometer's pole, which was taken as known.
        rate_Hz: of force and acceleration.
        band_Hz: of the sweep.
        misfit: what the model leaves of the responses, root mean square, over what noise explains [1].
        provenance: where the numbers come from.
    """

    name: str
    plant: Plant
    grips: tuple[Grip, ...]
    intervals: Mapping[str, Interval]
    absent: Mapping[str, str]
    asymptote_kg: float
    asymptote_Hz: Interval
    delay_s: float
    accelerometer_Hz: float
    rate_Hz: float
    band_Hz: Interval
    misfit: float
    provenance: str = ""

    def plant_in(self, grip: Grip) -> Plant:
        """The plant as it was in that grip."""
        return replace(self.plant, k_u_N_m=grip.k_u_N_m, b_u_Ns_m=grip.b_u_Ns_m)
