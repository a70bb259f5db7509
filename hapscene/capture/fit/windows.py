"""Analysis windows of a recording, to which a texture is fitted: short, with nearly constant force and speed."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.io.streams import Array, Streams, part_of
from hapscene.errors import CaptureError

__all__ = ["WINDOW_S", "AnalysisWindows", "cut", "fit_level", "pooled"]

WINDOW_S: Final = 0.1
"""Length of an analysis window [s]; force and speed of a hand are nearly constant over it."""

MOVING: Final = 0.02
"""Smallest force and speed of sliding, relative to the largest [1]."""

OUTLIER_SPREADS: Final = 4.0
"""Largest deviation of the level of a window from the level expected for its force and speed, in robust standard
deviations (1.48 times the median deviation) [1]. In other windows the tool was lifted, caught or knocked; they are
omitted."""

SPREAD_MIN_DB: Final = 2.5
"""Smallest standard deviation of the levels for the rejection of outliers [dB]; only deviations above 10 dB are
omitted. The levels of hand-held recordings scatter by 1.5 to 3.7 dB; with 1 dB, loud windows of wood and 1.3 dB of its
power were lost."""

PLANE_WINDOWS: Final = 20
"""Fewest windows for a regression of the level on force and speed; with fewer, the median level is used."""


@dataclass(frozen=True)
class AnalysisWindows:
    """k analysis windows of a recording.

    Attributes:
        acceleration_m_s2: (k, n) samples.
        force_N: (k,) mean normal force.
        speed_m_s: (k,) mean slip speed.
        start: (k,) index of the window in the recording; adjacent windows have consecutive indices.
    """

    acceleration_m_s2: Array
    force_N: Array
    speed_m_s: Array
    start: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.start)

    @cached_property
    def power_m2_s4(self) -> Array:
        """(k,) mean square of the acceleration [(m/s²)²]."""
        rows = self.acceleration_m_s2
        return np.asarray(np.einsum("kn,kn->k", rows, rows) / rows.shape[1])

    def __getitem__(self, chosen: slice | NDArray[np.bool_]) -> "AnalysisWindows":
        return part_of(self, chosen)


def cut(channels: Streams, runs: Sequence[tuple[int, int]] | None = None) -> AnalysisWindows:
    """Divides the sliding of a recording into analysis windows and omits outliers.

    Args:
        channels: a filtered recording.
        runs: runs of sliding (first sample, sample after the last); None: the whole recording.

    Raises:
        CaptureError: the tool never slides under a normal force.
    """
    spans = [(0, len(channels.acceleration_m_s2))] if runs is None else list(runs) or [(0, 0)]
    length = round(WINDOW_S * channels.rate_Hz)
    if len(spans) == 1 and spans[0][1] - spans[0][0] >= length:
        size = spans[0][1] - spans[0][0]
        length = size // int(size / (WINDOW_S * channels.rate_Hz))  # the rest is less than one sample per window
    found: list[AnalysisWindows] = []
    number = 0
    for first, last in spans:
        count = (last - first) // length
        first += (last - first - count * length) // 2
        rows, force, speed = (
            stream[first : first + count * length].reshape(count, length)
            for stream in (channels.acceleration_m_s2, channels.force_N, channels.speed_m_s)
        )
        found.append(AnalysisWindows(rows, force.mean(axis=1), speed.mean(axis=1), np.arange(number, number + count)))
        number += count + 1  # a gap, so that windows of two runs are not adjacent
    windows = found[0] if len(found) == 1 else _joined(found)
    most_N, most_m_s = windows.force_N.max(initial=0.0), windows.speed_m_s.max(initial=0.0)
    sliding = (windows.force_N > MOVING * most_N) & (windows.speed_m_s > MOVING * most_m_s)
    if most_N <= 0.0 or most_m_s <= 0.0 or not np.any(sliding):
        raise CaptureError("the tool never slides under a normal force; expected force_N and speed_m_s above 0")
    return without_outliers(windows if sliding.all() else windows[sliding])


def pooled(parts: Sequence[AnalysisWindows]) -> AnalysisWindows:
    """Pools the windows of several recordings."""
    if len(parts) == 1:
        return parts[0]
    length = min(part.acceleration_m_s2.shape[1] for part in parts)
    shift = np.cumsum([0, *(int(part.start[-1]) + 2 for part in parts[:-1])])
    return _joined(
        [
            replace(part, acceleration_m_s2=part.acceleration_m_s2[:, :length], start=part.start + by)
            for part, by in zip(parts, shift, strict=True)
        ]
    )


def _joined(parts: Sequence[AnalysisWindows]) -> AnalysisWindows:
    """Concatenates windows."""
    return AnalysisWindows(
        **{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(AnalysisWindows)}
    )


def without_outliers(windows: AnalysisWindows) -> AnalysisWindows:
    """Omits windows whose level deviates by more than `OUTLIER_SPREADS` from that expected for their force and speed.

    The expected level in dB is a plane over the logarithms of force and speed (least absolute deviations by reweighted
    least squares).
    """
    level = 10.0 * np.log10(np.maximum(windows.power_m2_s4, 1e-300))
    away = level - np.median(level)
    if len(windows) >= PLANE_WINDOWS:
        place = np.stack([np.ones(len(windows)), np.log(windows.force_N), np.log(windows.speed_m_s)], axis=1)
        for _ in range(20):
            weight = 1.0 / np.sqrt(np.maximum(np.abs(away), 1e-3))
            plane, *_ = np.linalg.lstsq(place * weight[:, None], level * weight, rcond=None)
            away = level - place @ plane
    spread = max(1.4826 * float(np.median(np.abs(away))), SPREAD_MIN_DB)
    usual = np.abs(away) <= OUTLIER_SPREADS * spread
    return windows if usual.all() else windows[usual]


# The level law: power of the vibration over force and speed.
#
# Power = c F^α v^β, fitted to the levels of the windows in dB. A short recording determines the exponents poorly: force
# and speed of a stroke change by 10 to 20 %, while the levels scatter by 2 to 4 dB. Ordinary least squares had errors
# of 7 dB on the other half of a recording. Therefore a Gaussian prior from other surfaces is used, and the exponents
# are the posterior mean.


EXPONENTS: Final = (0.47, 1.99)
"""Prior mean of the exponents of force and speed [1]: the mean of 89 surfaces of the Penn Haptic Texture Toolkit
(Culbertson, López Delgado & Kuchenbecker 2014), corrected for estimation errors. In cross-validation over surfaces
(`evidence/paper/penn_toolkit.py`), the slow half of a surface predicted the level of the fast half with 3.2 dB rms;
exponents of 1 and 1 gave 4.7 dB, a constant level 7.9 dB."""

EXPONENT_SPREADS: Final = (0.47, 0.74)
"""Prior standard deviations of the exponents [1], from the same surfaces."""

SCATTER_DB: Final = 0.5
"""Smallest scatter of the levels about the law [dB]: that of 0.1 s of noise with a bandwidth of 1 kHz."""

_DB: Final = 10.0 / np.log(10.0)


@dataclass(frozen=True)
class LevelLaw:
    """Power of the vibration over force and speed: scale (F/F₀)^α (v/v₀)^β.

    Attributes:
        scale_m2_s4: power at the centre [(m/s²)²].
        centre: (2,) logarithms of force F₀ [N] and speed v₀ [m/s].
        exponents: (2,) α and β [1].
        spread: (2,) posterior standard deviations of α and β [1].
    """

    scale_m2_s4: float
    centre: Array
    exponents: Array
    spread: Array

    def __call__(self, force_N: Array, speed_m_s: Array) -> Array:
        """Power (n,) [(m/s²)²] at forces and speeds (n,)."""
        place = np.stack([np.log(force_N), np.log(speed_m_s)], axis=1)
        return np.asarray(self.scale_m2_s4 * np.exp((place - self.centre) @ self.exponents))


def fit_level(windows: AnalysisWindows) -> LevelLaw:
    """Fits the level law with the prior `EXPONENTS` ± `EXPONENT_SPREADS`; preserves the mean power of the windows."""
    power = windows.power_m2_s4
    level = np.log(np.maximum(power, 1e-12 * power.mean() + 1e-300))
    place = np.stack([np.log(windows.force_N), np.log(windows.speed_m_s)], axis=1)
    centre = place.mean(axis=0)
    away, known = place - centre, np.diag(np.array(EXPONENT_SPREADS) ** -2.0)
    exponents = np.array(EXPONENTS)
    for _ in range(3):
        scatter = max(float(np.std(level - away @ exponents)), SCATTER_DB / _DB)
        information = away.T @ away / scatter**2 + known
        exponents = np.linalg.solve(information, away.T @ (level - level.mean()) / scatter**2 + known @ EXPONENTS)
    scale = float(power.sum() / np.exp(away @ exponents).sum())
    return LevelLaw(scale, centre, exponents, np.sqrt(np.diag(np.linalg.inv(information))))
