"""Fits a texture to the analysis windows of a recording: forces and speeds of the models, filters, and power."""

from dataclasses import replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.whittle import NoisyModel, density, refined
from hapscene.capture.fit.windows import AnalysisWindows, fit_level
from hapscene.capture.io.streams import Array
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, smoothed, solve, tapered
from hapscene.dsp.warped_prediction import lag_count, predictor, warped
from hapscene.surface.texture import EXPONENT_MAX, Texture

__all__ = ["choose_model_count", "fit_texture"]

POWER_LEAST: Final = 0.1
"""Smallest power of a model relative to that of its windows [1]; a texture is silent only at zero force or speed."""

FLAT: Final = 1e-3
"""Smallest relative range of force or speed at which the texture depends on it [1]."""

WINDOWS_PER_MODEL: Final = 4
"""Fewest analysis windows per model."""

MODELS_MAX: Final = 64
"""Largest number of models."""

MODEL_COUNTS: Final = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, MODELS_MAX)
"""Numbers of models that are tried."""

FOLDS: Final = 4
"""Number of folds of the cross-validation."""

FOLD_WINDOWS: Final = 10
"""Largest number of consecutive windows in one fold: a second. Neighbouring windows are similar."""

SELECTED_WINDOWS: Final = 1200
"""Largest number of windows for the choice of the number of models: two minutes, evenly selected."""

MARGIN_WINDOWS: Final = 15.0
"""Improvement that more models must have, in standard deviations of the windows times their number: 1.5 standard errors
at 100 windows, 0.5 from 900 on. With 0.5 standard errors, 30 windows of a uniform surface had 4 to 9 models by
chance."""

NOISY_ORDER: Final = 24
"""Order of the plain models by which the number of models with sensor noise is chosen."""

CORNER_RATIO: Final = 3.0
"""Largest ratio of neighbouring forces or speeds of a texture with one filter [1]. Power is interpolated linearly; if
it is proportional to the square of the speed, the error is at most 1.2 dB."""


def fit_texture(
    windows: AnalysisWindows,
    rate_Hz: float,
    order: int,
    model_count: int,
    interpolation: str = "lsf",
    noise: NoisyModel | None = None,
    warp: float = 0.0,
) -> Texture:
    """Fits a texture of `model_count` filters of `order`.

    Force and speed, relative to their maxima, are clustered by k-means, and a filter is fitted to the windows of each
    cluster, with the sensor noise of `noise` if given and with allpass coefficient `warp`. A single filter is placed at
    the corners of the recorded forces and speeds, with the power of the level law (`hapscene.capture.fit.windows`).
    Several filters are placed at the means of their clusters, with powers fitted to those of the windows through the
    interpolation of the texture (nonnegative least squares). The total power equals that of the recording. Beyond the
    recorded forces and speeds, the level follows the level law."""
    label = _cluster(windows, model_count)
    groups = [label == i for i in range(label.max() + 1)]
    a = np.stack(
        [_filter(windows[group] if len(groups) > 1 else windows, rate_Hz, order, noise, warp) for group in groups]
    )
    return _levelled(windows, groups, rate_Hz, a, interpolation, warp)


def _levelled(
    windows: AnalysisWindows, groups: list[NDArray[np.bool_]], rate_Hz: float, a: Array, interpolation: str, warp: float
) -> Texture:
    """Texture with filters (m, p+1) of groups of windows (k,)."""
    if len(groups) == 1:
        force, speed = _corners(windows)
        a = np.tile(a, (len(force), 1))
    else:
        force = np.array([windows.force_N[group].mean() for group in groups])
        speed = np.array([windows.speed_m_s[group].mean() for group in groups])
    law = fit_level(windows)
    variance = law(force, speed) / power_gain(a, warp)
    texture = Texture.from_models(
        rate_Hz, force, speed, a=a, variance_m2_s4=variance, interpolation=interpolation, warp=warp,
        exponents=np.clip(law.exponents, -EXPONENT_MAX, EXPONENT_MAX),
    )  # fmt: skip
    return _with_power(texture, windows)


def choose_model_count(
    windows: AnalysisWindows, rate_Hz: float, order: int, noise: NoisyModel | None = None, warp: float = 0.0
) -> int:
    """Chooses the number of models by cross-validation.

    `FOLDS` folds, distributed over the recording, are compared with models of the other folds, for 1, 2, 3, 4, 6, …
    models: by the likelihood of the residual without level, and by the level. The smallest number that is within half a
    standard error of the best in both criteria is chosen (a larger margin applies to few windows). The result is scaled
    to the length of the whole recording.
    """
    if np.ptp(windows.force_N) + np.ptp(windows.speed_m_s) == 0.0:
        return 1
    order, warp = (order, warp) if noise is None else (max(order, NOISY_ORDER), 0.0)
    block = int(np.clip(len(windows) // (2 * FOLDS), 1, FOLD_WINDOWS))
    number = np.arange(len(windows)) // block
    stride = -(-len(windows) // SELECTED_WINDOWS)
    kept = number % stride == 0
    windows, fold = windows[kept], number[kept] // stride % FOLDS
    few = np.array_split(windows.acceleration_m_s2, 1 + len(windows) // 64)
    lags = np.concatenate([autocorrelation(tapered(rows, rate_Hz), lag_count(order, warp)) for rows in few])
    warped_lags = warped(smoothed(lags, rate_Hz), order, warp)
    missed = []
    for count in MODEL_COUNTS:
        if count > 1 and count * WINDOWS_PER_MODEL > np.bincount(fold, minlength=FOLDS).sum() - np.bincount(fold).max():
            break
        error = np.empty((2, len(windows)))
        for part in range(FOLDS):
            fitted, other = windows[fold != part], fold == part
            label = _cluster(fitted, count)
            groups = [label == i for i in range(label.max() + 1)]
            a = np.stack([solve(warped_lags[~other][group].sum(axis=0)) for group in groups])
            error[:, other] = _missed(_levelled(fitted, groups, rate_Hz, a, "lsf", warp), windows[other], lags[other])
        missed.append(error)
    total = np.array(missed).transpose(1, 0, 2)  # (criterion, number of models, window)
    behind = total - np.take_along_axis(total, np.argmin(total.mean(axis=2), axis=1)[:, None, None], axis=1)
    sure = max(0.5 / np.sqrt(len(windows)), MARGIN_WINDOWS / len(windows))
    within = behind.mean(axis=2) <= sure * behind.std(axis=2)
    chosen = MODEL_COUNTS[int(np.argmax(within, axis=1).max())]
    return chosen if chosen == 1 else min(MODELS_MAX, chosen * FOLDS // (FOLDS - 1))


def _missed(texture: Texture, windows: AnalysisWindows, lags: Array) -> Array:
    """Errors (2, k) of a texture for each window: of the shape of the spectrum and of the level.

    The first is twice the negative log-likelihood of the residual without constant; the second is the squared
    difference of the logarithms of the power."""
    a, _ = texture.models(windows.force_N, windows.speed_m_s)
    shape = np.log(residual_power(predictor(a, texture.warp), lags) / lags[:, 0])
    power = windows.power_m2_s4
    least = 1e-9 * power.mean()  # limits the logarithm of silent windows or models
    level = np.log(np.maximum(texture.power(windows.force_N, windows.speed_m_s), least) / np.maximum(power, least))
    return np.stack([shape, level**2])


def _cluster(windows: AnalysisWindows, count: int) -> NDArray[np.intp]:
    """Cluster index (k,) of each window: at most `count` clusters; clusters of too few windows are merged.

    Lloyd's k-means. The initial centres are the window nearest to the mean, and then repeatedly the window farthest
    from all centres."""
    place = np.stack([windows.force_N / windows.force_N.max(), windows.speed_m_s / windows.speed_m_s.max()], axis=1)
    centre = place[[np.argmin(np.linalg.norm(place - place.mean(axis=0), axis=1))]]
    while len(centre) < count:
        away = np.linalg.norm(place[:, None] - centre, axis=2).min(axis=1)
        if away.max() <= 1e-3:
            break  # no further distinct forces and speeds
        centre = np.vstack([centre, place[np.argmax(away)]])
    for _ in range(50):
        label = np.argmin(np.linalg.norm(place[:, None] - centre, axis=2), axis=1)
        size = np.bincount(label, minlength=len(centre))
        if len(centre) > 1 and size.min() < WINDOWS_PER_MODEL:
            centre = np.delete(centre, np.argmin(size), axis=0)
            continue
        moved = np.stack([place[label == i].mean(axis=0) for i in range(len(centre))])
        if np.array_equal(moved, centre):
            break
        centre = moved
    return np.unique(label, return_inverse=True)[1]


def _filter(windows: AnalysisWindows, rate_Hz: float, order: int, noise: NoisyModel | None, warp: float) -> Array:
    """Filter (order+1,) of a group of windows; adjacent windows are joined, because edges blur the spectrum."""
    runs = np.split(windows.acceleration_m_s2, np.flatnonzero(np.diff(windows.start) != 1) + 1)
    if noise is not None:
        return refined(noise, density([run.ravel() for run in runs], rate_Hz)).a
    r = np.sum([autocorrelation(tapered(run.ravel(), rate_Hz), lag_count(order, warp)) for run in runs], axis=0)
    return solve(warped(smoothed(r, rate_Hz), order, warp))


def _corners(windows: AnalysisWindows) -> tuple[Array, Array]:
    """Forces and speeds at the corners of the recorded range: four, or fewer if force or speed is constant.

    If one of them spans more than `CORNER_RATIO`, there are additional points in between.
    """
    ends = []
    for axis in (windows.force_N, windows.speed_m_s):
        low, high = float(axis.min()), float(axis.max())
        steps = int(np.ceil(np.log(high / low) / np.log(CORNER_RATIO) - 1e-9))
        ends.append(np.geomspace(low, high, steps + 1) if high - low > FLAT * high else np.array([low]))
    force, speed = np.meshgrid(*ends)
    return force.ravel(), speed.ravel()


def _with_power(texture: Texture, windows: AnalysisWindows) -> Texture:
    """Fits the powers of the models to those of the windows; no model becomes silent.

    A texture with one filter keeps the powers of the level law up to a common factor, because the corners would be
    fitted to the scatter of a short recording."""
    power = windows.power_m2_s4
    corner, weight = texture.locate(windows.force_N, windows.speed_m_s)
    share = np.zeros((len(windows), len(texture.force_N)))
    np.add.at(share, (np.arange(len(windows))[:, None], corner), weight)
    share *= texture.beyond(windows.force_N, windows.speed_m_s)[:, None]
    sounding = np.flatnonzero(texture.variance_m2_s4 > 0.0)
    before = texture.model_power_m2_s4[sounding]
    factor = np.ones(len(sounding))
    if not texture.single:
        # The relative scatter of all windows is equal, so errors are relative. A weak regularisation towards the level
        # law determines models without windows nearby.
        pull = 0.1 * np.sqrt(len(windows) / len(sounding))
        contribution = share[:, sounding] * before
        expected = contribution.sum(axis=1)
        matrix = np.vstack([contribution / expected[:, None], pull * np.eye(len(sounding))])
        target = np.concatenate([power / expected, np.full(len(sounding), pull)])
        factor = POWER_LEAST + scipy.optimize.nnls(matrix, target - POWER_LEAST * matrix.sum(axis=1))[0]
    factor = factor * power.sum() / (share[:, sounding] @ (factor * before)).sum()
    variance = texture.variance_m2_s4.copy()
    variance[sounding] *= factor
    return replace(texture, variance_m2_s4=variance)
