"""How different two surfaces feel: swatches held against what a person can tell apart.

Each difference is put in units of the smallest that a person feels (a just noticeable difference, JND). Two surfaces
are as far apart as the quantity that gives them away most: what is 1 JND apart is told apart three times in four.
Differences that do not add up to more are assumed, which is on the side of saying too little.
"""

import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from hapscene import perception
from hapscene.capture.fit import distance as metric
from hapscene.capture.fit.swatch import FitOptions, fit_swatch
from hapscene.capture.io.recording import SurfaceRecording, load_recording
from hapscene.capture.io.streams import Array, part_of
from hapscene.errors import CaptureError, HapsceneError
from hapscene.io.files import refusing
from hapscene.surface.swatch import NAME_MAX, TOOL_FIELDS, Swatch, touched_with
from hapscene.surface.swatch_file import SUFFIX
from hapscene.surface.taps import Tap, Taps
from hapscene.surface.texture import Texture
from hapscene.swatches.library import library_folder, load_swatch, shipped_swatches

__all__ = [
    "ComparedSurface",
    "Comparison",
    "Difference",
    "compare",
    "load_library",
    "load_surface",
    "rank",
    "tap_energy",
]

Verdict = Literal["cannot be told apart", "could be told apart", "is clearly different", "cannot be compared"]

CLEAR_JND: Final = 2.0
"""Difference from which two surfaces are clearly different [JND]. In a choice of two, three right in four is d′ = 0.95
and twice that is nine right in ten (P = Φ(d′/√2), Green & Swets 1966)."""

PLACES: Final = (0.5, 0.75, 1.0)
"""Where textures are compared: these shares of the force and of the speed that both have models for [1]."""

APPROACH_M_S: Final = 0.1
"""Speed of approach that taps are compared at [m/s], where both have them; a light tap."""

QUIET_DB: Final = -40.0
"""Level of a band against the whole below which it counts as silent [dB]: a hundredth of the amplitude is not felt
beside the rest. Lower, and surfaces would be told apart by bands of no account."""


@dataclass(frozen=True)
class Quantity:
    """Something that surfaces differ in, and the least difference of it that is felt.

    Attributes:
        name: of the quantity.
        value_unit: of the quantity itself; "1" is none.
        unit: of a difference: "dB", or "%" of the mean of the two.
        jnd: least difference that is felt, in that unit.
        source: where that number is from.
    """

    name: str
    value_unit: str
    unit: str
    jnd: float
    source: str


_FRICTION = "Weber fraction 0.11, Gueorguiev et al. 2017"
_FREQUENCY = "13 to 38 %, Israr et al. 2006: its middle"

LEVEL = Quantity("vibration level", "m/s²", "dB", perception.BAND_DB, "1.65 to 2.98 dB, Israr et al. 2006")
SPECTRUM = Quantity("vibration spectrum", "", "dB", perception.BAND_DB, "2 dB a band, derived from Israr et al. 2006")
STATIC = Quantity("static friction", "1", "%", 100.0 * perception.FRICTION, _FRICTION)
DYNAMIC = Quantity("dynamic friction", "1", "%", 100.0 * perception.FRICTION, _FRICTION)
COMPLIANCE = Quantity("compliance", "mm/N", "%", 100.0 * perception.COMPLIANCE, "22 %, Tan et al. 1995")
TAP_LEVEL = Quantity("tap level", "m/s²", "dB", perception.BAND_DB, "1.65 to 2.98 dB, Israr et al. 2006")
TAP_FREQUENCY = Quantity("tap frequency", "Hz", "%", 100.0 * perception.FREQUENCY, _FREQUENCY)


@dataclass(frozen=True)
class Difference:
    """How two surfaces differ in one quantity.

    Attributes:
        quantity: which, with its unit and threshold.
        first: of the first surface, in the quantity's own unit; NaN where it is no single number.
        second: of the second surface.
        change: of the second over the first, in the unit of the difference, signed; a spectrum's has no sign.
    """

    quantity: Quantity
    first: float
    second: float
    change: float

    @property
    def distance_jnd(self) -> float:
        """The difference in units of the least that is felt."""
        return abs(self.change) / self.quantity.jnd

    @property
    def verdict(self) -> Verdict:
        """What a person makes of it."""
        return _verdict(self.distance_jnd)


@dataclass(frozen=True)
class Comparison:
    """Two surfaces side by side.

    Attributes:
        first: name of the first.
        second: name of the second.
        differences: in the quantities that both have.
        skipped: quantity to the reason why it was not compared.
        tools: what each was touched with, where that is known of both and differs.
    """

    first: str
    second: str
    differences: tuple[Difference, ...]
    skipped: dict[str, str]
    tools: tuple[str, str] | None = None

    @property
    def telling(self) -> Difference | None:
        """The difference that gives them away most; None where nothing could be compared."""
        return max(self.differences, key=lambda d: d.distance_jnd, default=None)

    @property
    def distance_jnd(self) -> float:
        """That difference in units of the least that is felt; infinite where nothing could be compared."""
        return math.inf if self.telling is None else self.telling.distance_jnd

    @property
    def verdict(self) -> Verdict:
        """What a person makes of the two."""
        return "cannot be compared" if self.telling is None else _verdict(self.distance_jnd)

    def as_dict(self) -> dict[str, Any]:
        """For JSON: numbers with their units beside them; what is not finite is null."""
        rows = []
        for d in self.differences:
            row = asdict(d.quantity) | {"first": d.first, "second": d.second, "change": d.change}
            rows.append(row | {"distance_jnd": d.distance_jnd, "verdict": d.verdict})
        return {
            "first": self.first,
            "second": self.second,
            "verdict": self.verdict,
            "distance_jnd": _finite(self.distance_jnd),
            "most_by": None if self.telling is None else self.telling.quantity.name,
            "differences": [{key: _finite(value) for key, value in row.items()} for row in rows],
            "skipped": self.skipped,
            "tools": self.tools,
        }


def compare(first: Swatch, second: Swatch) -> Comparison:
    """How different two surfaces feel.

    Textures are compared at `PLACES` of the force and speed that both have models for: the level by its power from 20
    to 1000 Hz, the spectrum by the bands of `metric.BAND_EDGES_HZ` after both were brought to one level. Friction and
    compliance are compared by the difference over the mean of the two, taps by energy and frequency. What is absent
    from either is not compared.
    """
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
    return Comparison(first.name, second.name, tuple(found), skipped, _tools(first, second))


def _tools(first: Swatch, second: Swatch) -> tuple[str, str] | None:
    """Tools and tips of two surfaces, where both say one and it is not the same."""
    pairs = [(getattr(first, what), getattr(second, what)) for what in TOOL_FIELDS]
    differ = any(one and two and one != two for one, two in pairs)
    return (touched_with(first), touched_with(second)) if differ else None


class _NotCompared(Exception):
    """Why surfaces are not compared in something."""


def rank(surface: Swatch, library: Iterable[Swatch]) -> list[Comparison]:
    """The comparisons of a surface with those of a library, the most alike first."""
    return sorted((compare(surface, other) for other in library), key=lambda c: (c.distance_jnd, c.second))


def _textures(first: Swatch, second: Swatch) -> list[Difference]:
    one, two = first.texture, second.texture
    if one is None or two is None:
        raise _NotCompared(_lacking(first, second, "texture", "a texture"))
    power = _bands(one, two), _bands(two, one)
    total = [bands.sum(axis=1) for bands in power]
    if min(t.max() for t in total) <= 0.0:
        silent = " and ".join(s.name for s, t in zip((first, second), total, strict=True) if t.max() <= 0.0)
        raise _NotCompared(f"the texture of {silent} is silent where both have models")
    level = [float(np.sqrt(t.mean())) for t in total]
    decibel = [_shape(bands) for bands in power]
    apart = float(np.sqrt(np.mean((decibel[1] - decibel[0]) ** 2)))
    return [
        Difference(LEVEL, level[0], level[1], 20.0 * math.log10(level[1] / level[0])),
        Difference(SPECTRUM, math.nan, math.nan, apart),
    ]


def _bands(texture: Texture, other: Texture) -> Array:
    """Power (places, bands) [(m/s²)²] at the places that both have, in the bands below both Nyquist frequencies."""
    share = np.array([(f, v) for f in PLACES for v in PLACES])
    force = share[:, 0] * min(texture.force_max_N, other.force_max_N)
    speed = share[:, 1] * min(texture.speed_max_m_s, other.speed_max_m_s)
    frequency = np.arange(metric.BAND_EDGES_HZ[0], metric.BAND_EDGES_HZ[-1] + 1.0)
    nyquist = 0.5 * min(texture.rate_Hz, other.rate_Hz)
    edges = [edge for edge in metric.BAND_EDGES_HZ if edge <= nyquist]
    density = texture.density(force, speed, frequency_Hz=frequency)
    return np.stack([metric.band_power(one, frequency, edges) for one in density])


def _shape(power: Array) -> Array:
    """Level (places, bands) [dB] of each band under the whole; what is far below is not heard beside it."""
    share = power / np.maximum(power.sum(axis=1, keepdims=True), np.finfo(np.float64).tiny)
    return np.asarray(10.0 * np.log10(np.maximum(share, 10.0 ** (QUIET_DB / 10.0))))


def _frictions(quantity: Quantity, name: str, first: Swatch, second: Swatch) -> list[Difference]:
    one, two = _both(first, second, name)
    return [Difference(quantity, one, two, _percent(one, two))]


def _compliances(first: Swatch, second: Swatch) -> list[Difference]:
    stiffness = _both(first, second, "stiffness_N_m")
    if min(stiffness) == 0.0:
        raise _NotCompared("a stiffness of 0 yields without end")
    one, two = (1e3 / value for value in stiffness)
    return [Difference(COMPLIANCE, one, two, _percent(one, two))]


def _tap_pairs(first: Swatch, second: Swatch) -> list[Difference]:
    if first.taps is None or second.taps is None:
        raise _NotCompared(_lacking(first, second, "taps", "taps"))
    one, two = first.taps.at(APPROACH_M_S), second.taps.at(APPROACH_M_S)
    power = _energy(first.taps), _energy(second.taps)
    if min(power) <= 0.0:
        raise _NotCompared("a tap is silent")
    apart = _percent(one.frequency_Hz, two.frequency_Hz)
    return [
        Difference(TAP_LEVEL, one.amplitude_m_s2, two.amplitude_m_s2, 10.0 * math.log10(power[1] / power[0])),
        Difference(TAP_FREQUENCY, one.frequency_Hz, two.frequency_Hz, apart),
    ]


def _energy(taps: Taps) -> float:
    """Energy [(m/s²)² s] of the tap at `APPROACH_M_S`: of the measured transient where there is one."""
    if taps.wave_m_s2 is None:
        return tap_energy(taps.at(APPROACH_M_S))
    return float(np.sum(taps.transient(APPROACH_M_S, taps.wave_rate_Hz) ** 2)) / taps.wave_rate_Hz


def tap_energy(tap: Tap) -> float:
    """Energy ∫ a² dt of a tap [(m/s²)² s]: A² ω² / (4 β (β² + ω²)) for a = A e^(−βt) sin ωt."""
    omega, decay = 2.0 * math.pi * tap.frequency_Hz, tap.decay_1_s
    return tap.amplitude_m_s2**2 * omega**2 / (4.0 * decay * (decay**2 + omega**2))


def _both(first: Swatch, second: Swatch, name: str) -> tuple[float, float]:
    """A number of both surfaces."""
    absent = "; ".join(f"{s.name}: {s.absent[name]}" for s in (first, second) if name in s.absent)
    if absent:
        raise _NotCompared(absent)
    return getattr(first, name), getattr(second, name)


def _lacking(first: Swatch, second: Swatch, part: Literal["texture", "taps"], one: str) -> str:
    """Which of two surfaces have no such part."""
    without = [s.name for s in (first, second) if getattr(s, part) is None]
    return f"neither has {one}" if len(without) == 2 else f"{without[0]} has no {part}"


def _percent(first: float, second: float) -> float:
    """Change in percent of the mean of the two: the same both ways but for its sign; 200 % at most."""
    mean = 0.5 * (first + second)
    return 100.0 * (second - first) / mean if mean > 0.0 else 0.0


def _verdict(distance_jnd: float) -> Verdict:
    if distance_jnd <= 1.0:
        return "cannot be told apart"
    return "could be told apart" if distance_jnd <= CLEAR_JND else "is clearly different"


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


# Where the surfaces that are compared come from: swatches, recordings, libraries.


@dataclass(frozen=True)
class ComparedSurface:
    """A surface to compare.

    Attributes:
        swatch: how it feels.
        repeat_jnd: how far two halves of its recording are apart, in units of what is felt; None for a swatch, and for
            a recording too short to be halved. Differences below it may be the recording's own.
    """

    swatch: Swatch
    repeat_jnd: float | None = None


def load_surface(
    name_or_path: str | os.PathLike[str],
    rate_Hz: float | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> ComparedSurface:
    """The surface of a swatch's name or file, or of a recording, to which a swatch is fitted.

    Text that ends in ".swatch", and text that names no file, is a swatch; every other file is a recording, of which
    `rate_Hz`, `columns` and `units` are as in `load_recording`.

    Raises:
        SwatchError: no such swatch, or a broken one.
        CaptureError: no swatch can be fitted to the recording.
    """
    path = Path(name_or_path)
    if path.suffix == SUFFIX or not path.is_file():
        return ComparedSurface(load_swatch(name_or_path))
    recording = load_recording(path, rate_Hz, columns=columns, units=units)
    with refusing(CaptureError, path):
        swatch = _fitted(recording, path.stem)
    try:
        middle = len(recording.acceleration_m_s2) // 2
        halves = [_fitted(part_of(recording, part), path.stem, swatch) for part in (slice(middle), slice(middle, None))]
    except CaptureError:
        return ComparedSurface(swatch)  # the halves are too short, the whole was not
    return ComparedSurface(swatch, compare(*halves).distance_jnd)


def load_library(folder: str | os.PathLike[str] | None = None) -> tuple[list[Swatch], dict[str, str]]:
    """The swatches of a folder, and file to reason of those that cannot be read; without a folder those shipped and
    those of the user's own library.

    Raises:
        CaptureError: the folder is missing, or holds no swatch that can be read.
    """
    if folder is None:
        own, broken = _folder(library_folder())
        return [load_swatch(name) for name in shipped_swatches()] + own, broken
    path = Path(folder)
    if not path.is_dir():
        raise CaptureError(f"{path}: no such folder of swatches")
    found, broken = _folder(path)
    if not found:
        raise CaptureError(f"{path}: holds no swatch that can be read ({len(broken)} broken)")
    return found, broken


def _folder(path: Path) -> tuple[list[Swatch], dict[str, str]]:
    """As `load_library`; of a folder that is not there, nothing."""
    found, broken = [], {}
    for file in sorted(path.rglob("*" + SUFFIX)):
        try:
            found.append(load_swatch(file))
        except HapsceneError as error:
            broken[str(file)] = str(error)
    return found, broken


def _fitted(recording: SurfaceRecording, name: str, like: Swatch | None = None) -> Swatch:
    printable = "".join(c for c in name if c.isprintable())[:NAME_MAX] or "unnamed"
    options = FitOptions(printable)
    if like is not None and like.texture is not None:
        options = replace(options, order=like.texture.order)
    return fit_swatch(recording, options)
