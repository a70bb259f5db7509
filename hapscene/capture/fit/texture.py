"""A fit of its own: a texture from the pieces of a recording, where its models stand, their filters, their power."""

from dataclasses import replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.whittle import NoisyModel, density, refined
from hapscene.capture.fit.windows import Pieces, fit_level
from hapscene.capture.io.streams import Array
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, smoothed, solve, tapered
from hapscene.dsp.warped_prediction import lag_count, predictor, warped
from hapscene.surface.texture import EXPONENT_MAX, Texture

__all__ = ["PIECES_PER_MODEL", "choose_model_count", "fit_texture"]

POWER_LEAST: Final = 0.1
"""Least share of its own pieces' power that a model is given [1]: silence is at no force or no speed alone."""

FLAT: Final = 1e-3
"""Share of its largest over which a force or speed must change for a texture to depend on it [1]."""

PIECES_PER_MODEL: Final = 4
"""Fewest pieces that a model is fitted to [count]."""

MODELS_MAX: Final = 64
"""Most models tried [count]."""

MODEL_COUNTS: Final = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, MODELS_MAX)
"""Numbers of models that are tried [count]."""

FOLDS: Final = 4
"""Parts of a recording of which each is judged by models of the others [count]."""

FOLD_PIECES: Final = 10
"""Most pieces that lie together in one part [count]: a second. Neighbours look alike."""

JUDGED_PIECES: Final = 1200
"""Most pieces that the number of models is chosen on [count]: two minutes, of all parts of the recording."""

SURE_PIECES: Final = 15.0
"""Share of the pieces' standard deviation by which more models must be better, times their number [count]: 1.5 standard
errors at 100 pieces, half a one from 900 on. At half a one chance gave 30 pieces of one surface 4 to 9 models."""

NOISY_ORDER: Final = 24
"""Order at which plain models tell whether the spectrum of a surface beneath noise changes [count]."""

CORNER_RATIO: Final = 3.0
"""Largest ratio of neighbouring forces or speeds at which one filter stands [1]. Between them power is linear: where it
grows with the square of speed, 1.2 dB too loud at most."""


def fit_texture(
    pieces: Pieces,
    rate_Hz: float,
    order: int,
    model_count: int,
    interpolation: str = "lsf",
    noise: NoisyModel | None = None,
    warp: float = 0.0,
) -> Texture:
    """A texture of `model_count` filters of `order`, blended in the way that `interpolation` names.

    Force and speed, scaled by their largest, are clustered (k-means); each cluster gives the filter of its pieces, over
    the white noise of `noise` if there is such, on the frequency axis of `warp`. One filter stands at the corners of
    what was recorded, with the power that the level's law gives it there (`hapscene.capture.fit.windows`). More
    stand at the means of their clusters, with the powers that explain the pieces' best through the texture's own
    interpolation (least squares, none negative). All are scaled so that the recording as a whole keeps its power
    exactly. Beyond what was recorded the level goes on by its law.
    """
    label = _cluster(pieces, model_count)
    groups = [label == i for i in range(label.max() + 1)]
    a = np.stack(
        [_filter(pieces[group] if len(groups) > 1 else pieces, rate_Hz, order, noise, warp) for group in groups]
    )
    return _levelled(pieces, groups, rate_Hz, a, interpolation, warp)


def _levelled(
    pieces: Pieces, groups: list[NDArray[np.bool_]], rate_Hz: float, a: Array, interpolation: str, warp: float
) -> Texture:
    """The texture of groups of pieces (k,) and their filters (m, p+1)."""
    if len(groups) == 1:
        force, speed = _corners(pieces)
        a = np.tile(a, (len(force), 1))
    else:
        force = np.array([pieces.force_N[group].mean() for group in groups])
        speed = np.array([pieces.speed_m_s[group].mean() for group in groups])
    law = fit_level(pieces)
    variance = law(force, speed) / power_gain(a, warp)
    texture = Texture.from_models(
        rate_Hz, force, speed, a=a, variance_m2_s4=variance, interpolation=interpolation, warp=warp,
        exponents=np.clip(law.exponents, -EXPONENT_MAX, EXPONENT_MAX),
    )  # fmt: skip
    return _with_power(texture, pieces)


def choose_model_count(
    pieces: Pieces, rate_Hz: float, order: int, noise: NoisyModel | None = None, warp: float = 0.0
) -> int:
    """The smallest number of models that explains data it was not fitted to as well as any.

    Each of `FOLDS` parts, cut all through the recording, is judged by models of the others: 1, 2, 3, 4, 6, … of them,
    by the likelihood of its pieces' residual, whatever their level, and by their level. Chosen is the smallest number
    that is in both within half a standard error (over the pieces) of the best, and more where there are few pieces; the
    whole holds as many more as it is longer than what they were fitted to.
    """
    if np.ptp(pieces.force_N) + np.ptp(pieces.speed_m_s) == 0.0:
        return 1
    order, warp = (order, warp) if noise is None else (max(order, NOISY_ORDER), 0.0)
    block = int(np.clip(len(pieces) // (2 * FOLDS), 1, FOLD_PIECES))
    number = np.arange(len(pieces)) // block
    stride = -(-len(pieces) // JUDGED_PIECES)
    kept = number % stride == 0
    pieces, fold = pieces[kept], number[kept] // stride % FOLDS
    few = np.array_split(pieces.acceleration_m_s2, 1 + len(pieces) // 64)
    lags = np.concatenate([autocorrelation(tapered(rows, rate_Hz), lag_count(order, warp)) for rows in few])
    heard = warped(smoothed(lags, rate_Hz), order, warp)
    missed = []
    for count in MODEL_COUNTS:
        if count > 1 and count * PIECES_PER_MODEL > np.bincount(fold, minlength=FOLDS).sum() - np.bincount(fold).max():
            break
        error = np.empty((2, len(pieces)))
        for part in range(FOLDS):
            fitted, other = pieces[fold != part], fold == part
            label = _cluster(fitted, count)
            groups = [label == i for i in range(label.max() + 1)]
            a = np.stack([solve(heard[~other][group].sum(axis=0)) for group in groups])
            error[:, other] = _missed(_levelled(fitted, groups, rate_Hz, a, "lsf", warp), pieces[other], lags[other])
        missed.append(error)
    total = np.array(missed).transpose(1, 0, 2)  # of the shape and of the level, by count and piece
    behind = total - np.take_along_axis(total, np.argmin(total.mean(axis=2), axis=1)[:, None, None], axis=1)
    sure = max(0.5 / np.sqrt(len(pieces)), SURE_PIECES / len(pieces))
    within = behind.mean(axis=2) <= sure * behind.std(axis=2)
    chosen = MODEL_COUNTS[int(np.argmax(within, axis=1).max())]
    return chosen if chosen == 1 else min(MODELS_MAX, chosen * FOLDS // (FOLDS - 1))


def _missed(texture: Texture, pieces: Pieces, lags: Array) -> Array:
    """What a texture misses of pieces (2, k): of the shape of their spectrum, but for a constant, and of their level.

    The first is twice the likelihood of the residual, the second the square of the difference in logarithm.
    """
    a, _ = texture.models(pieces.force_N, pieces.speed_m_s)
    shape = np.log(residual_power(predictor(a, texture.warp), lags) / lags[:, 0])
    power = pieces.power_m2_s4
    least = 1e-9 * power.mean()  # of a piece, or of a place where the texture is silent
    level = np.log(np.maximum(texture.power(pieces.force_N, pieces.speed_m_s), least) / np.maximum(power, least))
    return np.stack([shape, level**2])


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


def _filter(pieces: Pieces, rate_Hz: float, order: int, noise: NoisyModel | None, warp: float) -> Array:
    """The filter (order+1,) of a group; neighbouring pieces are joined, for cuts blur the spectrum."""
    runs = np.split(pieces.acceleration_m_s2, np.flatnonzero(np.diff(pieces.start) != 1) + 1)
    if noise is not None:
        return refined(noise, density([run.ravel() for run in runs], rate_Hz)).a
    r = np.sum([autocorrelation(tapered(run.ravel(), rate_Hz), lag_count(order, warp)) for run in runs], axis=0)
    return solve(warped(smoothed(r, rate_Hz), order, warp))


def _corners(pieces: Pieces) -> tuple[Array, Array]:
    """Forces and speeds of the corners of what was recorded: four, or fewer where one of them hardly changed; more
    where one changed by more than `CORNER_RATIO`, between them."""
    ends = []
    for axis in (pieces.force_N, pieces.speed_m_s):
        low, high = float(axis.min()), float(axis.max())
        steps = max(1, int(np.ceil(np.log(high / low) / np.log(CORNER_RATIO) - 1e-9)))
        ends.append(np.geomspace(low, high, steps + 1) if high - low > FLAT * high else np.array([low]))
    force, speed = np.meshgrid(*ends)
    return force.ravel(), speed.ravel()


def _with_power(texture: Texture, pieces: Pieces) -> Texture:
    """The texture with the powers of its sounding models fitted to those of the pieces; none is silenced.

    Those of one filter keep to the law of the level but for one factor: four corners of two seconds learn chance.
    """
    power = pieces.power_m2_s4
    corner, weight = texture.locate(pieces.force_N, pieces.speed_m_s)
    share = np.zeros((len(pieces), len(texture.force_N)))
    np.add.at(share, (np.arange(len(pieces))[:, None], corner), weight)
    share *= texture.beyond(pieces.force_N, pieces.speed_m_s)[:, None]
    sounding = np.flatnonzero(texture.variance_m2_s4 > 0.0)
    before = texture.model_power_m2_s4[sounding]
    factor = np.ones(len(sounding))
    if not texture.single:
        # Loud pieces scatter as much as quiet ones in proportion. A weak pull towards the level's law decides where the
        # pieces do not (a corner that none is near).
        pull = 0.1 * np.sqrt(len(pieces) / len(sounding))
        told = share[:, sounding] * before
        expected = told.sum(axis=1)
        matrix = np.vstack([told / expected[:, None], pull * np.eye(len(sounding))])
        target = np.concatenate([power / expected, np.full(len(sounding), pull)])
        factor = POWER_LEAST + scipy.optimize.nnls(matrix, target - POWER_LEAST * matrix.sum(axis=1))[0]
    factor = factor * power.sum() / (share[:, sounding] @ (factor * before)).sum()
    variance = texture.variance_m2_s4.copy()
    variance[sounding] *= factor
    return replace(texture, variance_m2_s4=variance)
