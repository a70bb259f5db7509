"""Perceptual comparison of surfaces.

Differences are expressed in just noticeable differences (JND): at 1 JND, people distinguish two surfaces in three of
four trials. The distance of two surfaces is that of the quantity with the largest difference. Differences in several
quantities are assumed not to add up, so the distance is a lower estimate.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Literal

import numpy as np

from hapscene import perception
from hapscene.capture.fit import distance as spectral
from hapscene.capture.io.streams import Array
from hapscene.surface.swatch import TOOL_FIELDS, Swatch, touched_with
from hapscene.surface.taps import Tap, Taps
from hapscene.surface.texture import Texture

__all__ = ["Comparison", "Difference", "compare", "rank"]

Verdict = Literal["cannot be distinguished", "can be distinguished", "is clearly different", "cannot be compared"]

CLEAR_JND: Final = 2.0
"""Smallest distance of clearly different surfaces [JND]. In a two-interval forced choice, 1 JND (75 % correct) is
d′ = 0.95, and 2 JND are 91 % correct (P = Φ(d′/√2), Green & Swets 1966)."""

PLACES: Final = (0.5, 0.75, 1.0)
"""Forces and speeds at which textures are compared, relative to the largest that both textures have models for [1]."""

APPROACH_M_S: Final = 0.1
"""Approach speed at which taps are compared [m/s]; a light tap."""

QUIET_DB: Final = -40.0
"""Lower limit of the level of a band relative to the total level [dB]. Weaker bands are masked and must not contribute
to the difference."""


@dataclass(frozen=True)
class Quantity:
    """A quantity in which surfaces are compared, with its just noticeable difference.

    Attributes:
        name: name of the quantity.
        value_unit: unit of the quantity; "1" for dimensionless.
        unit: unit of differences: "dB", or "%" of the mean of both values.
        jnd: just noticeable difference in that unit; `hapscene.perception` has the sources.
    """

    name: str
    value_unit: str
    unit: str
    jnd: float


LEVEL = Quantity("vibration level", "m/s²", "dB", perception.BAND_DB)
SPECTRUM = Quantity("vibration spectrum", "", "dB", perception.BAND_DB)
STATIC = Quantity("static friction", "1", "%", 100.0 * perception.FRICTION)
DYNAMIC = Quantity("dynamic friction", "1", "%", 100.0 * perception.FRICTION)
COMPLIANCE = Quantity("compliance", "mm/N", "%", 100.0 * perception.COMPLIANCE)
TAP_LEVEL = Quantity("tap level", "m/s²", "dB", perception.BAND_DB)
TAP_FREQUENCY = Quantity("tap frequency", "Hz", "%", 100.0 * perception.FREQUENCY)


@dataclass(frozen=True)
class Difference:
    """Difference of two surfaces in one quantity.

    Attributes:
        quantity: the quantity with unit and JND.
        first: value of the first surface in the unit of the quantity; NaN if it is not a single number.
        second: value of the second surface.
        change: signed change from first to second in the unit of differences; unsigned for spectra.
    """

    quantity: Quantity
    first: float
    second: float
    change: float

    @property
    def distance_jnd(self) -> float:
        """Difference in JND."""
        return abs(self.change) / self.quantity.jnd

    @property
    def verdict(self) -> Verdict:
        """Verdict on this quantity."""
        return _verdict(self.distance_jnd)


@dataclass(frozen=True)
class Comparison:
    """Comparison of two surfaces.

    Attributes:
        first: name of the first surface.
        second: name of the second surface.
        differences: differences in the quantities that both surfaces have.
        skipped: reasons for the quantities that were not compared, by name.
        tools: tools of both recordings, if they are known and differ.
        assumed: what the vibration levels rest on, by surface, if rate or unit of the recording are inferred.
    """

    first: str
    second: str
    differences: tuple[Difference, ...]
    skipped: dict[str, str]
    tools: tuple[str, str] | None = None
    assumed: Mapping[str, str] = field(default_factory=dict)

    @property
    def largest(self) -> Difference | None:
        """Largest difference; None if no quantity was compared."""
        return max(self.differences, key=lambda d: d.distance_jnd, default=None)

    @property
    def distance_jnd(self) -> float:
        """Largest difference in JND; infinite if no quantity was compared."""
        return math.inf if self.largest is None else self.largest.distance_jnd

    @property
    def verdict(self) -> Verdict:
        """Verdict on the two surfaces."""
        return "cannot be compared" if self.largest is None else _verdict(self.distance_jnd)


def compare(first: Swatch, second: Swatch) -> Comparison:
    """Compares two surfaces.

    Textures are compared at `PLACES` of the common range of force and speed: the level by the power from 20 to 1000 Hz,
    the spectrum by the levels of the bands `spectral.BAND_EDGES_HZ` relative to the total. Friction and compliance are
    compared by the difference relative to the mean, taps by energy and frequency. Quantities that one surface lacks are
    skipped."""
    parts: tuple[tuple[Callable[[Swatch, Swatch], list[Difference]], tuple[Quantity, ...]], ...] = (
        (_textures, (LEVEL, SPECTRUM)),
        (partial(_frictions, STATIC, "friction_static"), (STATIC,)),
        (partial(_frictions, DYNAMIC, "friction_dynamic"), (DYNAMIC,)),
        (_compliances, (COMPLIANCE,)),
        (_tap_pairs, (TAP_LEVEL, TAP_FREQUENCY)),
    )
    found: list[Difference] = []
    skipped: dict[str, str] = {}
    for differences, quantities in parts:
        try:
            found += differences(first, second)
        except _NotCompared as reason:
            skipped |= {quantity.name: str(reason) for quantity in quantities}
    assumed = {s.name: s.absent["texture.level"] for s in (first, second) if "texture.level" in s.absent}
    return Comparison(first.name, second.name, tuple(found), skipped, _tools(first, second), assumed)


def _tools(first: Swatch, second: Swatch) -> tuple[str, str] | None:
    """Tools and tips of two surfaces if they are known and differ, else None."""
    pairs = [(getattr(first, what), getattr(second, what)) for what in TOOL_FIELDS]
    differ = any(one and two and one != two for one, two in pairs)
    return (touched_with(first), touched_with(second)) if differ else None


class _NotCompared(Exception):
    """Reason why a quantity is not compared."""


def rank(surface: Swatch, library: Iterable[Swatch]) -> list[Comparison]:
    """Compares a surface with those of a library; the most similar surfaces are first."""
    return sorted((compare(surface, other) for other in library), key=lambda c: (c.distance_jnd, c.second))


def _textures(first: Swatch, second: Swatch) -> list[Difference]:
    one, two = first.texture, second.texture
    if one is None or two is None:
        raise _NotCompared(_lacking(first, second, "texture"))
    power = _bands(one, two), _bands(two, one)
    total = [bands.sum(axis=1) for bands in power]
    if min(t.max() for t in total) <= 0.0:
        silent = " and ".join(s.name for s, t in zip((first, second), total, strict=True) if t.max() <= 0.0)
        raise _NotCompared(f"the texture of {silent} is silent at the compared forces and speeds")
    level = [float(np.sqrt(t.mean())) for t in total]
    decibel = [_shape(bands) for bands in power]
    distance_dB = float(np.sqrt(np.mean((decibel[1] - decibel[0]) ** 2)))
    return [
        Difference(LEVEL, level[0], level[1], 20.0 * math.log10(level[1] / level[0])),
        Difference(SPECTRUM, math.nan, math.nan, distance_dB),
    ]


def _bands(texture: Texture, other: Texture) -> Array:
    """Power (places, bands) [(m/s²)²] at `PLACES`, in the bands below both Nyquist frequencies."""
    share = np.array([(f, v) for f in PLACES for v in PLACES])
    force = share[:, 0] * min(texture.force_max_N, other.force_max_N)
    speed = share[:, 1] * min(texture.speed_max_m_s, other.speed_max_m_s)
    frequency = np.arange(spectral.BAND_EDGES_HZ[0], spectral.BAND_EDGES_HZ[-1] + 1.0)
    nyquist = 0.5 * min(texture.rate_Hz, other.rate_Hz)
    edges = [edge for edge in spectral.BAND_EDGES_HZ if edge <= nyquist]
    density = texture.density(force, speed, frequency_Hz=frequency)
    return np.stack([spectral.band_power(one, frequency, edges) for one in density])


def _shape(power: Array) -> Array:
    """Level (places, bands) [dB] of each band relative to the total, with the lower limit `QUIET_DB`."""
    share = power / np.maximum(power.sum(axis=1, keepdims=True), np.finfo(np.float64).tiny)
    return np.asarray(10.0 * np.log10(np.maximum(share, 10.0 ** (QUIET_DB / 10.0))))


def _frictions(quantity: Quantity, name: str, first: Swatch, second: Swatch) -> list[Difference]:
    one, two = _both(first, second, name)
    return [Difference(quantity, one, two, _percent(one, two))]


def _compliances(first: Swatch, second: Swatch) -> list[Difference]:
    stiffness = _both(first, second, "stiffness_N_m")
    if min(stiffness) == 0.0:
        raise _NotCompared("the compliance is infinite for a stiffness of 0")
    one, two = (1e3 / value for value in stiffness)
    return [Difference(COMPLIANCE, one, two, _percent(one, two))]


def _tap_pairs(first: Swatch, second: Swatch) -> list[Difference]:
    if first.taps is None or second.taps is None:
        raise _NotCompared(_lacking(first, second, "taps"))
    one, two = first.taps.at(APPROACH_M_S), second.taps.at(APPROACH_M_S)
    power = _energy(first.taps), _energy(second.taps)
    if min(power) <= 0.0:
        raise _NotCompared("the taps of one surface are silent")
    change = _percent(one.frequency_Hz, two.frequency_Hz)
    return [
        Difference(TAP_LEVEL, one.amplitude_m_s2, two.amplitude_m_s2, 10.0 * math.log10(power[1] / power[0])),
        Difference(TAP_FREQUENCY, one.frequency_Hz, two.frequency_Hz, change),
    ]


def _energy(taps: Taps) -> float:
    """Energy [(m/s²)² s] of the tap at `APPROACH_M_S`, of the recorded transient if there is one."""
    if taps.wave_m_s2 is None:
        return tap_energy(taps.at(APPROACH_M_S))
    return float(np.sum(taps.transient(APPROACH_M_S, taps.wave_rate_Hz) ** 2)) / taps.wave_rate_Hz


def tap_energy(tap: Tap) -> float:
    """Energy ∫ a² dt [(m/s²)² s] of a tap a = A e^(−βt) sin ωt: A² ω² / (4 β (β² + ω²))."""
    omega, decay = 2.0 * math.pi * tap.frequency_Hz, tap.decay_1_s
    return tap.amplitude_m_s2**2 * omega**2 / (4.0 * decay * (decay**2 + omega**2))


def _both(first: Swatch, second: Swatch, name: str) -> tuple[float, float]:
    """A parameter of both surfaces."""
    absent = "; ".join(f"{s.name}: {s.absent[name]}" for s in (first, second) if name in s.absent)
    if absent:
        raise _NotCompared(absent)
    return getattr(first, name), getattr(second, name)


def _lacking(first: Swatch, second: Swatch, part: Literal["texture", "taps"]) -> str:
    """States which of two surfaces have no measured texture or taps."""
    without = [s.name for s in (first, second) if getattr(s, part) is None]
    return f"{part} of {' and '.join(without)}: not measured"


def _percent(first: float, second: float) -> float:
    """Change in percent of the mean of both values, at most 200 %; antisymmetric."""
    mean = 0.5 * (first + second)
    return 100.0 * (second - first) / mean if mean > 0.0 else 0.0


def _verdict(distance_jnd: float) -> Verdict:
    if distance_jnd <= 1.0:
        return "cannot be distinguished"
    return "can be distinguished" if distance_jnd <= CLEAR_JND else "is clearly different"
