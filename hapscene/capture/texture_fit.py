"""A texture from a cleaned recording: where its models stand, their filters, and their power."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.channel import Channels
from hapscene.capture.linear_prediction import autocorrelation, residual_power, smoothed, solve, tapered
from hapscene.errors import CaptureError
from hapscene.surface.lsf import power_gain
from hapscene.surface.texture import Texture

Array = NDArray[np.float64]

POWER_LEAST: Final = 0.1
"""Least share of its own pieces' power that a model is given [1]: silence is at no force or no speed alone."""

PIECE_S: Final = 0.1
"""Length of the pieces that a recording is cut into [s]: over one, force and speed of a hand are nearly constant."""

PIECES_PER_MODEL: Final = 4
"""Fewest pieces that a model is fitted to [count]."""

MODELS_MAX: Final = 12
"""Most models tried [count]."""

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


def cut(channels: Channels, runs: Sequence[tuple[int, int]] | None = None) -> Pieces:
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


def fit_texture(pieces: Pieces, rate_Hz: float, order: int, model_count: int, interpolation: str = "lsf") -> Texture:
    """A texture of `model_count` models of `order`, blended in the way that `interpolation` names.

    Force and speed, scaled by their largest, are clustered (k-means); each cluster gives the filter of its pieces.
    One model holds over all that was recorded: it stands at the corner of least force and speed, since what is above
    the last model is clamped. More stand at the means of their clusters. The powers are then those that explain the
    pieces' powers best through the texture's own interpolation (least squares, none negative), scaled so that the
    recording as a whole keeps its power exactly.
    """
    label = _cluster(pieces, model_count)
    groups = [label == i for i in range(label.max() + 1)]
    a = np.stack([solve(smoothed(_group_autocorrelation(pieces[group], rate_Hz, order), rate_Hz)) for group in groups])
    if len(groups) == 1:
        force, speed = np.array([pieces.force_N.min()]), np.array([pieces.speed_m_s.min()])
    else:
        force = np.array([pieces.force_N[group].mean() for group in groups])
        speed = np.array([pieces.speed_m_s[group].mean() for group in groups])
    level = np.array([np.mean(pieces.acceleration_m_s2[group] ** 2) for group in groups])
    texture = Texture.from_models(rate_Hz, force, speed, a, level / power_gain(a), interpolation)
    return _with_power(texture, pieces)


def choose_model_count(pieces: Pieces, rate_Hz: float, order: int) -> int:
    """The smallest number of models that explains data it was not fitted to as well as any.

    Each half of the pieces is fitted with 1, 2, … models; each piece of the other half is scored with the likelihood
    of its residual under the model at its force and speed. Chosen is the smallest count whose score is within one
    standard error (over the pieces) of the best.
    """
    middle = len(pieces) // 2
    halves = (pieces[:middle], pieces[middle:])
    spread = np.ptp(pieces.force_N) + np.ptp(pieces.speed_m_s) > 0.0
    most = min(MODELS_MAX, middle // PIECES_PER_MODEL) if spread else 1
    scores = []
    for count in range(1, most + 1):
        pairs = ((fit_texture(halves[i], rate_Hz, order, count), halves[1 - i]) for i in (0, 1))
        scores.append(np.concatenate([_score(texture, other) for texture, other in pairs]))
    if len(scores) < 2:
        return 1
    score = np.array(scores)
    best = int(np.argmax(score.mean(axis=1)))
    behind = score[best] - score
    error = behind.std(axis=1) / np.sqrt(behind.shape[1])
    return 1 + int(np.argmax(behind.mean(axis=1) <= error))


def _score(texture: Texture, pieces: Pieces) -> Array:
    """Log-likelihood per sample (k,), but for a constant, of pieces under the model at their force and speed."""
    a, variance = texture.models(pieces.force_N, pieces.speed_m_s)
    r = autocorrelation(tapered(pieces.acceleration_m_s2, texture.rate_Hz), texture.order)
    r *= (np.mean(pieces.acceleration_m_s2**2, axis=1) / r[:, 0])[:, None]
    residual = residual_power(a, r)
    variance = np.maximum(variance, 1e-6 * residual)  # a model that finds the piece silent scores badly, not −∞
    return np.asarray(-0.5 * (np.log(variance) + residual / variance))


def _cluster(pieces: Pieces, count: int) -> NDArray[np.intp]:
    """Number of the cluster (k,) of each piece: at most `count`, those of too few pieces joined to the nearest.

    Lloyd's k-means, started from the piece nearest the mean and then always the piece farthest from all starts.
    """
    place = np.stack([pieces.force_N / pieces.force_N.max(), pieces.speed_m_s / pieces.speed_m_s.max()], axis=1)
    centre = place[[np.argmin(np.linalg.norm(place - place.mean(axis=0), axis=1))]]
    while len(centre) < count:
        away = np.linalg.norm(place[:, None] - centre, axis=2).min(axis=1)
        if away.max() <= 1e-3:
            break  # the recording has no more than these
        centre = np.vstack([centre, place[np.argmax(away)]])
    for _ in range(50):
        label = np.argmin(np.linalg.norm(place[:, None] - centre, axis=2), axis=1)
        size = np.bincount(label, minlength=len(centre))
        if len(centre) > 1 and size.min() < PIECES_PER_MODEL:
            centre = np.delete(centre, np.argmin(size), axis=0)
            continue
        moved = np.stack([place[label == i].mean(axis=0) for i in range(len(centre))])
        if np.array_equal(moved, centre):
            break
        centre = moved
    return np.unique(label, return_inverse=True)[1]


def _group_autocorrelation(pieces: Pieces, rate_Hz: float, order: int) -> Array:
    """Autocorrelation (order+1,) over a group; neighbouring pieces are joined, for cuts blur the spectrum."""
    runs = np.split(pieces.acceleration_m_s2, np.flatnonzero(np.diff(pieces.start) != 1) + 1)
    return np.asarray(np.sum([autocorrelation(tapered(run.ravel(), rate_Hz), order) for run in runs], axis=0))


def _with_power(texture: Texture, pieces: Pieces) -> Texture:
    """The texture with the powers of its sounding models fitted to those of the pieces; none is silenced."""
    from scipy.optimize import lsq_linear

    power = np.mean(pieces.acceleration_m_s2**2, axis=1)
    corner, weight = texture.locate(pieces.force_N, pieces.speed_m_s)
    share = np.zeros((len(pieces), len(texture.force_N)))
    np.add.at(share, (np.arange(len(pieces))[:, None], corner), weight)
    sounding = np.flatnonzero(texture.variance_m2_s4 > 0.0)
    before = texture.model_power_m2_s4[sounding]
    # A weak pull towards the cluster's own power decides where the pieces do not (a corner that none is near).
    pull = 0.1 * np.sqrt(len(pieces) / len(sounding))
    matrix = np.vstack([share[:, sounding], pull * np.eye(len(sounding))])
    target = np.concatenate([power, pull * before])
    fitted = lsq_linear(matrix, target, bounds=(POWER_LEAST * before, np.inf)).x
    fitted *= power.sum() / (share[:, sounding] @ fitted).sum()
    variance = texture.variance_m2_s4.copy()
    variance[sounding] *= fitted / before
    return replace(texture, variance_m2_s4=variance)
