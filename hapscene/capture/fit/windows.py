"""The pieces of a recording that a texture is fitted to: short, of nearly one force and speed, and none that is odd."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.io.streams import Array, Streams, part_of
from hapscene.errors import CaptureError

__all__ = ["PIECE_S", "Pieces", "cut", "fit_level", "pooled"]

PIECE_S: Final = 0.1
"""Length of the pieces that a recording is cut into [s]: over one, force and speed of a hand are nearly constant."""

MOVING: Final = 0.02
"""Force and speed below this share of their largest do not count as sliding [1]."""

OUTLIER_SPREADS: Final = 4.0
"""A piece is dropped when its level is farther than this from what its force and speed explain, in robust standard
deviations (1.48 times the median distance) [1]: the tool was lifted, caught, or knocked."""

SPREAD_MIN_DB: Final = 2.5
"""Least standard deviation that levels of pieces are taken to have [dB], so that only 10 dB off are ever dropped. A
hand's own pieces scatter by 1.5 to 3.7 dB; at 1 dB loud ones of wood were lost, and 1.3 dB of its power."""

PLANE_PIECES: Final = 20
"""Fewest pieces whose levels are explained by force and speed [count]; of fewer the median stands for all."""


@dataclass(frozen=True)
class Pieces:
    """The pieces of a recording, k of them.

    Attributes:
        acceleration_m_s2: (k, n) samples.
        force_N: (k,) mean normal force.
        speed_m_s: (k,) mean slip speed.
        start: (k,) number of the piece in the recording, so that neighbours are known.
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

    def __getitem__(self, chosen: slice | NDArray[np.bool_]) -> "Pieces":
        return part_of(self, chosen)


def cut(channels: Streams, runs: Sequence[tuple[int, int]] | None = None) -> Pieces:
    """The pieces in which the tool slides under a normal force.

    Args:
        channels: a cleaned recording.
        runs: its stretches of sliding (first sample, the one after the last), each cut by itself; None: the whole.

    Raises:
        CaptureError: there are none.
    """
    spans = [(0, len(channels.acceleration_m_s2))] if runs is None else list(runs) or [(0, 0)]
    length = round(PIECE_S * channels.rate_Hz)
    if len(spans) == 1 and spans[0][1] - spans[0][0] >= length:
        size = spans[0][1] - spans[0][0]
        length = size // int(size / (PIECE_S * channels.rate_Hz))  # what is left over is less than one sample a piece
    found: list[Pieces] = []
    number = 0
    for first, last in spans:
        count = (last - first) // length
        first += (last - first - count * length) // 2
        rows, force, speed = (
            stream[first : first + count * length].reshape(count, length)
            for stream in (channels.acceleration_m_s2, channels.force_N, channels.speed_m_s)
        )
        found.append(Pieces(rows, force.mean(axis=1), speed.mean(axis=1), np.arange(number, number + count)))
        number += count + 1  # so that pieces of two stretches are no neighbours
    pieces = found[0] if len(found) == 1 else _joined(found)
    most_N, most_m_s = pieces.force_N.max(initial=0.0), pieces.speed_m_s.max(initial=0.0)
    sliding = (pieces.force_N > MOVING * most_N) & (pieces.speed_m_s > MOVING * most_m_s)
    if most_N <= 0.0 or most_m_s <= 0.0 or not np.any(sliding):
        raise CaptureError("the tool never slides under a normal force: force_N and speed_m_s must be above 0")
    return without_outliers(pieces if sliding.all() else pieces[sliding])


def pooled(parts: Sequence[Pieces]) -> Pieces:
    """The pieces of several recordings as those of one."""
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


def _joined(parts: Sequence[Pieces]) -> Pieces:
    """Pieces one behind the other."""
    return Pieces(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Pieces)})


def without_outliers(pieces: Pieces) -> Pieces:
    """The pieces whose level force and speed explain; dropped is what is over `OUTLIER_SPREADS` away from it.

    The level in dB is taken as a robust plane over the logarithms of force and speed (least absolute deviations, by
    reweighted least squares).
    """
    level = 10.0 * np.log10(np.maximum(pieces.power_m2_s4, 1e-300))
    away = level - np.median(level)
    if len(pieces) >= PLANE_PIECES:
        place = np.stack([np.ones(len(pieces)), np.log(pieces.force_N), np.log(pieces.speed_m_s)], axis=1)
        for _ in range(20):
            weight = 1.0 / np.sqrt(np.maximum(np.abs(away), 1e-3))
            plane, *_ = np.linalg.lstsq(place * weight[:, None], level * weight, rcond=None)
            away = level - place @ plane
    spread = max(1.4826 * float(np.median(np.abs(away))), SPREAD_MIN_DB)
    usual = np.abs(away) <= OUTLIER_SPREADS * spread
    return pieces if usual.all() else pieces[usual]


# How loud a surface is, over force and speed: the law that a recording's pieces follow.
#
# Power = c F^α v^β, fitted to the pieces' levels in dB. From one recording the exponents are hardly known: a hand that
# strokes for a second or two changes force and speed by a tenth or two, while levels scatter by 2 to 4 dB for reasons
# of the surface's own; exponents of plain least squares were off by 7 dB on the other half of a recording. So they
# start from what other surfaces have, and move as far as the pieces say (a Gaussian prior, the posterior mean). Were
# all of friction's power, F v, turned into vibration alike, both would be 1; faster is louder than that.


EXPONENTS: Final = (0.47, 1.99)
"""Exponents of force and of speed that are expected [1]: the mean of 89 surfaces of the Penn Haptic Texture Toolkit
(Culbertson, López Delgado & Kuchenbecker 2014), each one's own error taken out. Of
surfaces left out the slow half told the fast one's level to 3.0 dB rms; exponents of 1 and 1 to 3.6, clamped 7.4."""

EXPONENT_SPREADS: Final = (0.47, 0.74)
"""Standard deviations of the exponents about those [1], of the same surfaces."""

SCATTER_DB: Final = 0.5
"""Least scatter of the levels about the law [dB]: that of a tenth of a second of noise 1 kHz wide."""

_DB: Final = 10.0 / np.log(10.0)


@dataclass(frozen=True)
class LevelLaw:
    """Power over force and speed, scale (F/F₀)^α (v/v₀)^β.

    Attributes:
        scale_m2_s4: power at the centre [(m/s²)²].
        centre: (2,) logarithms of the force [N] and the speed [m/s] of the centre.
        exponents: (2,) α and β [1].
        spread: (2,) their standard deviations, of what the pieces leave open [1].
    """

    scale_m2_s4: float
    centre: Array
    exponents: Array
    spread: Array

    def __call__(self, force_N: Array, speed_m_s: Array) -> Array:
        """The power (n,) [(m/s²)²] at forces and speeds (n,)."""
        place = np.stack([np.log(force_N), np.log(speed_m_s)], axis=1)
        return np.asarray(self.scale_m2_s4 * np.exp((place - self.centre) @ self.exponents))


def fit_level(
    pieces: Pieces, expected: tuple[float, float] = EXPONENTS, spreads: tuple[float, float] = EXPONENT_SPREADS
) -> LevelLaw:
    """The law of the pieces' power, their own mean power kept; `expected` and `spreads` as those above."""
    power = pieces.power_m2_s4
    level = np.log(np.maximum(power, 1e-12 * power.mean() + 1e-300))
    place = np.stack([np.log(pieces.force_N), np.log(pieces.speed_m_s)], axis=1)
    centre = place.mean(axis=0)
    away, known = place - centre, np.diag(np.array(spreads) ** -2.0)
    exponents = np.array(expected)
    for _ in range(3):
        scatter = max(float(np.std(level - away @ exponents)), SCATTER_DB / _DB)
        information = away.T @ away / scatter**2 + known
        exponents = np.linalg.solve(information, away.T @ (level - level.mean()) / scatter**2 + known @ expected)
    scale = float(power.sum() / np.exp(away @ exponents).sum())
    return LevelLaw(scale, centre, exponents, np.sqrt(np.diag(np.linalg.inv(information))))
