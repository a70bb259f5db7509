"""A fit of its own: a texture from the pieces of a recording, where its models stand, their filters, their power."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.streams import Array
from hapscene.capture.texture_pieces import Pieces, fit_level
from hapscene.capture.whittle import NoisyModel, density, refined
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, smoothed, solve, tapered
from hapscene.surface.texture import Texture

POWER_LEAST: Final = 0.1
"""Least share of its own pieces' power that a model is given [1]: silence is at no force or no speed alone."""

FLAT: Final = 1e-3
"""Share of its largest over which a force or speed must change for a texture to depend on it [1]."""

PIECES_PER_MODEL: Final = 4
"""Fewest pieces that a model is fitted to [count]."""

MODELS_MAX: Final = 12
"""Most models tried [count]."""


def fit_texture(
    pieces: Pieces,
    rate_Hz: float,
    order: int,
    model_count: int,
    interpolation: str = "lsf",
    noise: NoisyModel | None = None,
) -> Texture:
    """A texture of `model_count` filters of `order`, blended in the way that `interpolation` names.

    Force and speed, scaled by their largest, are clustered (k-means); each cluster gives the filter of its pieces, over
    the white noise of `noise` if there is such. One filter stands at the corners of what was recorded, with the power
    that the level's law gives it there (`hapscene.capture.texture_pieces`). More stand at the means of their clusters,
    with the powers that explain the pieces' best through the texture's own interpolation (least squares, none
    negative). All are scaled so that the recording as a whole keeps its power exactly.
    """
    label = _cluster(pieces, model_count)
    groups = [pieces[label == i] for i in range(label.max() + 1)]
    a = np.stack([_filter(group, rate_Hz, order, noise) for group in groups])
    if len(groups) == 1:
        force, speed = _corners(pieces)
        a = np.tile(a, (len(force), 1))
    else:
        force = np.array([group.force_N.mean() for group in groups])
        speed = np.array([group.speed_m_s.mean() for group in groups])
    level = fit_level(pieces)(force, speed)
    texture = Texture.from_models(
        rate_Hz, force, speed, a=a, variance_m2_s4=level / power_gain(a), interpolation=interpolation
    )
    return _with_power(texture, pieces)


def choose_model_count(pieces: Pieces, rate_Hz: float, order: int, noise: NoisyModel | None = None) -> int:
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
        pairs = ((fit_texture(halves[i], rate_Hz, order, count, noise=noise), halves[1 - i]) for i in (0, 1))
        scores.append(np.concatenate([_score(texture, other, noise) for texture, other in pairs]))
    if len(scores) < 2:
        return 1
    score = np.array(scores)
    best = int(np.argmax(score.mean(axis=1)))
    behind = score[best] - score
    error = behind.std(axis=1) / np.sqrt(behind.shape[1])
    return 1 + int(np.argmax(behind.mean(axis=1) <= error))


def _score(texture: Texture, pieces: Pieces, noise: NoisyModel | None) -> Array:
    """Log-likelihood per sample (k,), but for a constant, of pieces under the model at their force and speed."""
    a, variance = texture.models(pieces.force_N, pieces.speed_m_s)
    signal = tapered(pieces.acceleration_m_s2, texture.rate_Hz)
    signal *= np.sqrt(np.mean(pieces.acceleration_m_s2**2, axis=1) / np.mean(signal**2, axis=1))[:, None]
    if noise is not None:  # what the filter leaves is noise made louder: by Whittle's likelihood
        density = np.abs(np.fft.rfft(signal, axis=1)) ** 2 / signal.shape[1]
        model = variance[:, None] / np.abs(np.fft.rfft(a, signal.shape[1], axis=1)) ** 2 + np.exp(noise.log_noise)
        return np.asarray(-0.5 * np.mean(np.log(model) + density / model, axis=1))
    residual = residual_power(a, autocorrelation(signal, texture.order)) / signal.shape[1]
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


def _filter(pieces: Pieces, rate_Hz: float, order: int, noise: NoisyModel | None) -> Array:
    """The filter (order+1,) of a group; neighbouring pieces are joined, for cuts blur the spectrum."""
    runs = np.split(pieces.acceleration_m_s2, np.flatnonzero(np.diff(pieces.start) != 1) + 1)
    if noise is not None:
        return refined(noise, density([run.ravel() for run in runs], rate_Hz)).a
    r = np.sum([autocorrelation(tapered(run.ravel(), rate_Hz), order) for run in runs], axis=0)
    return solve(smoothed(r, rate_Hz))


def _corners(pieces: Pieces) -> tuple[Array, Array]:
    """Forces and speeds of the corners of what was recorded: four, or fewer where one of them hardly changed."""
    ends = [
        np.array([axis.min(), axis.max()] if np.ptp(axis) > FLAT * axis.max() else [axis.min()])
        for axis in (pieces.force_N, pieces.speed_m_s)
    ]
    force, speed = np.meshgrid(*ends)
    return force.ravel(), speed.ravel()


def _with_power(texture: Texture, pieces: Pieces) -> Texture:
    """The texture with the powers of its sounding models fitted to those of the pieces; none is silenced.

    Those of one filter keep to the law of the level but for one factor: four corners of two seconds learn chance.
    """
    from scipy.optimize import lsq_linear

    power = np.mean(pieces.acceleration_m_s2**2, axis=1)
    corner, weight = texture.locate(pieces.force_N, pieces.speed_m_s)
    share = np.zeros((len(pieces), len(texture.force_N)))
    np.add.at(share, (np.arange(len(pieces))[:, None], corner), weight)
    sounding = np.flatnonzero(texture.variance_m2_s4 > 0.0)
    before = texture.model_power_m2_s4[sounding]
    # A weak pull towards the level's law decides where the pieces do not (a corner that none is near).
    pull = 0.1 * np.sqrt(len(pieces) / len(sounding))
    matrix = np.vstack([share[:, sounding], pull * np.eye(len(sounding))])
    target = np.concatenate([power, pull * before])
    fitted = before if texture.single else lsq_linear(matrix, target, bounds=(POWER_LEAST * before, np.inf)).x
    fitted = fitted * power.sum() / (share[:, sounding] @ fitted).sum()
    variance = texture.variance_m2_s4.copy()
    variance[sounding] *= fitted / before
    return replace(texture, variance_m2_s4=variance)
