"""The pieces of a recording that a texture is fitted to: short, of nearly one force and speed, and none that is odd."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.streams import Array, Streams
from hapscene.errors import CaptureError

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

    def __getitem__(self, chosen: slice | NDArray[np.bool_]) -> "Pieces":
        return Pieces(self.acceleration_m_s2[chosen], self.force_N[chosen], self.speed_m_s[chosen], self.start[chosen])


def cut(channels: Streams, runs: Sequence[tuple[int, int]] | None = None) -> Pieces:
    """The pieces in which the tool slides under a normal force.

    Args:
        channels: a cleaned recording.
        runs: its stretches of sliding (first sample, the one after the last), each cut by itself; None: the whole.

    Raises:
        CaptureError: there are none.
    """
    spans = [(0, len(channels.acceleration_m_s2))] if runs is None else list(runs)
    length = round(PIECE_S * channels.rate_Hz)
    if len(spans) == 1 and spans[0][1] - spans[0][0] >= length:
        size = spans[0][1] - spans[0][0]
        length = size // int(size / (PIECE_S * channels.rate_Hz))  # what is left over is less than one sample a piece
    streams = np.stack([channels.acceleration_m_s2, channels.force_N, channels.speed_m_s])
    found, numbers, number = [np.zeros((3, 0, length))], [np.zeros(0, dtype=np.intp)], 0
    for first, last in spans:
        count = (last - first) // length
        first += (last - first - count * length) // 2
        found.append(streams[:, first : first + count * length].reshape(3, count, length))
        numbers.append(np.arange(number, number + count))
        number += count + 1  # so that pieces of two stretches are no neighbours
    acceleration, force, speed = np.concatenate(found, axis=1)
    pieces = Pieces(acceleration, force.mean(axis=1), speed.mean(axis=1), np.concatenate(numbers))
    most_N, most_m_s = pieces.force_N.max(initial=0.0), pieces.speed_m_s.max(initial=0.0)
    sliding = (pieces.force_N > MOVING * most_N) & (pieces.speed_m_s > MOVING * most_m_s)
    if most_N <= 0.0 or most_m_s <= 0.0 or not np.any(sliding):
        raise CaptureError("the tool never slides under a normal force: force_N and speed_m_s must be above 0")
    return without_outliers(pieces[sliding])


def pooled(parts: Sequence[Pieces]) -> Pieces:
    """The pieces of several recordings as those of one."""
    length = min(part.acceleration_m_s2.shape[1] for part in parts)
    shift = np.cumsum([0, *(int(part.start[-1]) + 2 for part in parts[:-1])])
    return Pieces(
        np.concatenate([part.acceleration_m_s2[:, :length] for part in parts]),
        np.concatenate([part.force_N for part in parts]),
        np.concatenate([part.speed_m_s for part in parts]),
        np.concatenate([part.start + by for part, by in zip(parts, shift, strict=True)]),
    )


def without_outliers(pieces: Pieces) -> Pieces:
    """The pieces whose level force and speed explain; dropped is what is over `OUTLIER_SPREADS` away from it.

    The level in dB is taken as a robust plane over the logarithms of force and speed (least absolute deviations, by
    reweighted least squares).
    """
    level = 10.0 * np.log10(np.maximum(np.mean(pieces.acceleration_m_s2**2, axis=1), 1e-300))
    away = level - np.median(level)
    if len(pieces) >= PLANE_PIECES:
        place = np.stack([np.ones(len(pieces)), np.log(pieces.force_N), np.log(pieces.speed_m_s)], axis=1)
        for _ in range(20):
            weight = 1.0 / np.sqrt(np.maximum(np.abs(away), 1e-3))
            plane, *_ = np.linalg.lstsq(place * weight[:, None], level * weight, rcond=None)
            away = level - place @ plane
    spread = max(1.4826 * float(np.median(np.abs(away))), SPREAD_MIN_DB)
    return pieces[np.abs(away) <= OUTLIER_SPREADS * spread]


# How loud a surface is, over force and speed: the law that a recording's pieces follow.
#
# Power = c F^α v^β, fitted to the pieces' levels in dB. From one recording the exponents are hardly known: a hand that
# strokes for a second or two changes force and speed by a tenth or two, while levels scatter by 2 to 4 dB for reasons
# of the surface's own; exponents of plain least squares were off by 7 dB on the other half of a recording. So they
# start from what friction gives, and move as far as the pieces say (a Gaussian prior, the posterior mean): a sliding
# tool turns F v of power per unit of friction into heat and vibration, so that vibration of one efficiency has α = β =
# 1.


EXPONENT: Final = 1.0
"""Exponent of force and of speed that is expected [1]: power in proportion to that of friction. On halves, thirds and
quarters of wood, paper and leather, each predicted from each other, the mean square error of the level was 0.6 times
that of a level that depends on neither."""

EXPONENT_SPREAD: Final = 0.5
"""Standard deviation of an exponent about that [1]: between a half and one and a half, most likely. Halved or doubled,
the level on the held-out halves of wood, paper and leather changes by 0.25 dB at most."""

SCATTER_DB: Final = 0.5
"""Least scatter of the levels about the law [dB]: that of a tenth of a second of noise 1 kHz wide."""

_DB: Final = 10.0 / np.log(10.0)


def fit_level(pieces: Pieces) -> Callable[[Array, Array], Array]:
    """The power [(m/s²)²] that pieces have at forces [N] and speeds [m/s] (n,), their own mean power kept."""
    power = np.mean(pieces.acceleration_m_s2**2, axis=1)
    level = np.log(np.maximum(power, 1e-12 * power.mean() + 1e-300))
    place = np.stack([np.log(pieces.force_N), np.log(pieces.speed_m_s)], axis=1)
    centre = place.mean(axis=0)
    away, expected = place - centre, np.full(2, EXPONENT)
    exponent = expected
    for _ in range(3):
        scatter = max(float(np.std(level - away @ exponent)), SCATTER_DB / _DB)
        weight = (EXPONENT_SPREAD / scatter) ** 2
        information = weight * away.T @ away + np.eye(2)
        exponent = np.linalg.solve(information, weight * away.T @ (level - level.mean()) + expected)
    scale = power.sum() / np.exp(away @ exponent).sum()

    def law(force_N: Array, speed_m_s: Array) -> Array:
        return np.asarray(scale * np.exp((np.stack([np.log(force_N), np.log(speed_m_s)], axis=1) - centre) @ exponent))

    return law
