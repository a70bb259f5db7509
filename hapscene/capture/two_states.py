"""A fit of its own: whether a surface has two states, as one that squeals at times, and when it is in which.

What is seen is the shape of the spectrum, window by window: the levels in bands against their mean, without what force
and speed explain. A slow gain moves all bands together and leaves the shape; states of one shape and two levels are a
slow gain. Two models are held against each other on the half that they were not fitted to: one state, or two that a
Markov chain switches between (Hamilton 1989, "A new approach to the economic analysis of nonstationary time series and
the business cycle", Econometrica 57(2)). In either each coordinate of the shape goes on from its last value and from
its recent mean: one that wanders is no second state.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.life_fit import LifeFit, fit_life, moving_runs
from hapscene.capture.segment import runs
from hapscene.capture.streams import Array, Streams, part_of
from hapscene.capture.texture_pieces import Pieces, cut, pooled
from hapscene.errors import CaptureError
from hapscene.surface.texture import Texture

WINDOW_S: Final = 0.025
"""Length of the windows [s]: short against a squeal, long enough for a spectrum of four bands."""

EDGES_HZ: Final = (20.0, 150.0, 300.0, 550.0, 1000.0)
"""Edges of the bands [Hz]; each has three or more lines of a window."""

RECENT_S: Final = 0.2
"""Time over which the recent mean of a band is taken [s]."""

GAIN: Final = 20.0
"""Log-likelihood that two states must gain on held-out halves, together [1]: steady and living noise gained 17 at most
in 135 simulated recordings of 2 to 10 s; the project's four recordings do not come so far."""

APART_DB: Final = 4.0
"""Least difference of the states in the band that tells them best, against the mean [dB]: twice what is felt."""

DWELL_LEAST_S: Final = 0.1
"""Least mean time in a state [s]: what changes faster is a gain."""

VISITS: Final = 4
"""Fewest visits to the other state [count]: one change in a recording is another place of the surface."""

WINDOWS: Final = (40, 2400)
"""Fewest windows that are asked for two states, and most that these are learnt from [count]: a minute."""

STARTS: Final = (0.15, 0.4, 0.6, 0.85)
"""Shares of the windows that are in the first state to begin with, along the direction of largest variance [1]."""

_Seen = tuple[Array, Array]  # regressors (n, c, 3) and shapes (n, c) of a stretch


class TwoStates(NamedTuple):
    """Two states of a surface.

    Attributes:
        dwell_s: (2,) mean time in the first state, which is the more frequent, and in the other.
        other: for each stretch (n,), whether it is in the other.
        gain: log-likelihood that two states gained on held-out halves [1].
    """

    dwell_s: tuple[float, float]
    other: list[NDArray[np.bool_]]
    gain: float


class Living(NamedTuple):
    """A texture with what lives in it.

    Attributes:
        texture: with its life, and its other state if it has one.
        intervals: 95 % intervals, by their names in the swatch.
        absent: why there is no life, by its name in the swatch.
    """

    texture: Texture
    intervals: dict[str, tuple[float, float]]
    absent: dict[str, str]


def with_life(texture: Texture, stretches: Sequence[Streams], fitted: Callable[[Pieces], Texture]) -> Living:
    """The texture of stretches of sliding with its slow gain; or of each of two states, where the data ask for them.

    `fitted` makes a texture of pieces, as `texture` was made of all.
    """
    states = None if texture.layers else find_states(stretches)  # a stroke that turns would seem to change its state
    if states is not None:
        try:
            own = [~mask for mask in states.other]
            one, two = (_of_state(stretches, masks, fitted) for masks in (own, states.other))
        except CaptureError:  # a state whose stretches are all too short for a texture
            states = None
    if states is None:
        life = fit_life(texture, stretches)
        return Living(replace(texture, life=life.life), *_told(life, "texture.life"))
    (texture, life), (other, other_life) = one, two
    whole = replace(texture, other=other, dwell_s=np.array(states.dwell_s))
    told = _told(life, "texture.life"), _told(other_life, "texture.other.life")
    return Living(whole, told[0][0] | told[1][0], told[0][1] | told[1][1])


def _of_state(
    stretches: Sequence[Streams], masks: Sequence[NDArray[np.bool_]], fitted: Callable[[Pieces], Texture]
) -> tuple[Texture, LifeFit]:
    """The texture of one state, alive, and what is known of its life."""
    parts = [part_of(s, slice(*run)) for s, mask in zip(stretches, masks, strict=True) for run in runs(mask)]
    pieces = []
    for part in parts:
        with suppress(CaptureError):
            pieces.append(cut(part))
    if not pieces:
        raise CaptureError("no stretch of a state is as long as a piece")
    texture = fitted(pooled(pieces))
    life = fit_life(texture, parts)
    return replace(texture, life=life.life), life


def _told(found: LifeFit, name: str) -> tuple[dict[str, tuple[float, float]], dict[str, str]]:
    """Intervals and reasons by their names in the swatch."""
    if found.life is None:
        return {}, {name: found.reason}
    names = [*(f"{name}.spread[{i}]" for i in range(len(found.life.spread))), f"{name}.log_spread"]
    return dict(zip(names, found.intervals, strict=True)), {}


class _Chain(NamedTuple):
    """Two regressions, and the chance of staying with each."""

    weight: Array  # (2, c, 3)
    root: Array  # (2, c, c): the residual times it is white
    stay: Array  # (2,)


def find_states(stretches: Sequence[Streams]) -> TwoStates | None:
    """The two states of a surface in stretches of sliding, or None where one state explains them as well."""
    if min(stretch.rate_Hz for stretch in stretches) < 2.0 * EDGES_HZ[2]:
        return None  # less than two bands have no shape
    places, seen = _seen(stretches)
    count = np.cumsum([0, *(len(y) for _, y in seen)])
    if count[-1] < WINDOWS[0]:
        return None
    learnt = seen[: int(np.searchsorted(count, WINDOWS[1])) or 1]
    two, one = _fitted(learnt), _regressed(learnt)
    if _score(two, learnt) - _score(one, learnt) < two.weight[0].size + len(two.root[0]) ** 2:
        return None  # not even on what it was fitted to
    gain = 0.0
    quarters = [list(zip(np.array_split(x, 4), np.array_split(y, 4), strict=True)) for x, y in learnt]
    halves = [[part for four in quarters for part in four[i::2]] for i in (0, 1)]
    for own, held_out in (halves, halves[::-1]):
        gain += _score(_fitted(own), held_out) - _score(_regressed(own), held_out)
    chance = [_passed(two, *one)[0] for one in seen]
    first = int(np.argmax(np.sum([c.sum(axis=0) for c in chance], axis=0)))
    dwell_s = WINDOW_S / (1.0 - two.stay[[first, 1 - first]])
    inside = [c[:, 1 - first] > 0.5 for c in chance]
    level, within = np.concatenate([y for _, y in seen]), np.concatenate(inside)
    visits = sum(len(runs(mask)) for mask in inside)
    if not gain > GAIN or dwell_s.min() < DWELL_LEAST_S or visits < VISITS:
        return None
    apart = (level[within].mean(axis=0) - level[~within].mean(axis=0)) @ _contrasts(level.shape[1] + 1)
    if 10.0 / np.log(10.0) * np.abs(apart).max() < APART_DB:
        return None
    other = [np.zeros(len(stretch.force_N), dtype=np.bool_) for stretch in stretches]
    for (i, start, length), mask in zip(places, inside, strict=True):
        other[i][start : start + len(mask) * length] = np.repeat(mask, length)
    return TwoStates((float(dwell_s[0]), float(dwell_s[1])), other, gain)


def _contrasts(bands: int) -> Array:
    """Directions (bands − 1, bands) across that in which all bands move together, orthonormal."""
    return np.asarray(scipy.linalg.helmert(bands))


def _seen(stretches: Sequence[Streams]) -> tuple[list[tuple[int, int, int]], list[_Seen]]:
    """Stretch, first sample and samples a window, and what is seen there, of each run in which the tool slides."""
    places, levels, known = [], [], []
    for i, start, windows, length in moving_runs(stretches, WINDOW_S, 4.0 * RECENT_S):
        stretch = stretches[i]
        part = slice(start, start + windows * length)
        frequency = np.fft.rfftfreq(length, 1.0 / stretch.rate_Hz)
        edge = np.searchsorted(frequency, [e for e in EDGES_HZ if e < 0.5 * stretch.rate_Hz])
        bands = []
        for some in np.array_split(stretch.acceleration_m_s2[part].reshape(windows, length), 1 + windows // 100):
            power = np.abs(np.fft.rfft(some * np.hanning(length), axis=1)) ** 2  # a part: it takes five times its size
            bands.append(np.add.reduceat(power[:, : edge[-1]], edge[:-1], axis=1))
        level = np.log(np.concatenate(bands) + 1e-300)
        levels.append(level @ _contrasts(level.shape[1]).T)
        pushed = (stretch.force_N[part], stretch.speed_m_s[part])
        known.append(np.log([x.reshape(windows, length).mean(axis=1) for x in pushed]).T)
        places.append((i, start, length))
    if not places:
        return [], []
    level, place = np.concatenate(levels), np.concatenate(known)
    place = np.hstack([np.ones((len(level), 1)), place - place.mean(axis=0)])
    level = level - place @ np.linalg.lstsq(place, level, rcond=1e-6)[0]
    seen, share = [], WINDOW_S / RECENT_S
    for y in np.split(level, np.cumsum([len(one) for one in levels])[:-1]):
        before = np.vstack([y[:1], y[:-1]])
        recent, _ = scipy.signal.lfilter([share], [1.0, share - 1.0], before, axis=0, zi=(1.0 - share) * y[:1])
        seen.append((np.stack([np.ones_like(y), before, recent], axis=2), y))
    return places, seen


def _regressed(seen: Sequence[_Seen], chance: Array | None = None, stay: Sequence[float] = (0.5, 0.5)) -> _Chain:
    """The regressions of each state for the chances (n, 2) that it is there; without them, twice one of all."""
    x, y = (np.concatenate([one[i] for one in seen]) for i in (0, 1))
    chance = np.ones((len(y), 2)) if chance is None else chance
    weight, root = np.empty((2, *x.shape[1:])), np.empty((2, y.shape[1], y.shape[1]))
    pooled = np.atleast_2d(np.cov(y.T))
    for state in (0, 1):
        share = chance[:, state]
        for band in range(y.shape[1]):
            moment = (x[:, band] * share[:, None]).T
            weight[state, band] = np.linalg.solve(moment @ x[:, band] + np.eye(3), moment @ y[:, band])
        left = y - np.einsum("nbk,bk->nb", x, weight[state])
        # a few windows' worth of the whole keeps a state from shrinking to a point
        spread = ((left * share[:, None]).T @ left + 5.0 * pooled) / (share.sum() + 5.0)
        root[state] = np.linalg.cholesky(np.linalg.inv(spread))
    return _Chain(weight, root, np.asarray(stay))


def _fitted(seen: Sequence[_Seen]) -> _Chain:
    """The two states that make what is seen likeliest (expectation–maximisation), from the best of `STARTS`."""
    shape = np.concatenate([y for _, y in seen])
    along = shape @ np.linalg.eigh(np.atleast_2d(np.cov(shape.T)))[1][:, -1]
    tried = []
    for share in STARTS:
        far = (along > np.quantile(along, share)).astype(np.float64)
        tried.append(_improved(_regressed(seen, np.stack([1.0 - far, far], axis=1), (0.9, 0.9)), seen, 6))
    return _improved(max(tried, key=lambda chain: _score(chain, seen)), seen, 20)


def _improved(chain: _Chain, seen: Sequence[_Seen], steps: int) -> _Chain:
    for _ in range(steps):
        passed = [_passed(chain, *one) for one in seen]
        kept, left = np.sum([p[1] for p in passed], axis=0)
        chain = _regressed(seen, np.concatenate([p[0] for p in passed]), (kept + 1.0) / (kept + left + 2.0))
    return chain


def _score(chain: _Chain, seen: Sequence[_Seen]) -> float:
    """Log-likelihood, but for a constant."""
    return sum(_passed(chain, *one)[2] for one in seen)


def _passed(chain: _Chain, x: Array, y: Array) -> tuple[Array, Array, float]:
    """Forward and backward through a stretch: the chances (n, 2) of the states, how often each was kept and left
    (2, 2), and the log-likelihood (Rabiner 1989, Proc. IEEE 77(2))."""
    left = y[:, None] - np.einsum("nbk,sbk->nsb", x, chain.weight)
    white = np.einsum("nsb,sbc->nsc", left, chain.root)
    log = -0.5 * np.sum(white**2, axis=2) + np.log(np.abs(np.diagonal(chain.root, axis1=1, axis2=2))).sum(axis=1)
    top = log.max(axis=1)
    seen = np.maximum(np.exp(log - top[:, None]), 1e-100).tolist()
    (p, q), total = chain.stay.tolist(), 0.0
    a, b = (1.0 - q) / (2.0 - p - q), (1.0 - p) / (2.0 - p - q)
    forward, backward = [], [(1.0, 1.0)]
    for one, two in seen:
        a, b = a * one, b * two
        scale = a + b
        total += math.log(scale)
        a, b = a / scale, b / scale
        forward.append((a, b))
        a, b = a * p + b * (1.0 - q), a * (1.0 - p) + b * q
    a = b = 1.0
    for one, two in seen[:0:-1]:
        one, two = one * a, two * b
        a, b = p * one + (1.0 - p) * two, (1.0 - q) * one + q * two
        scale = a + b
        a, b = a / scale, b / scale
        backward.append((a, b))
    ahead, behind, lit = np.array(forward), np.array(backward[::-1]), np.array(seen)
    chance = ahead * behind
    chance /= chance.sum(axis=1, keepdims=True)
    step = np.array([[p, 1.0 - p], [1.0 - q, q]])
    pair = ahead[:-1, :, None] * step * (lit * behind)[1:, None]
    pair /= pair.sum(axis=(1, 2), keepdims=True)
    moved = pair.sum(axis=0)
    return chance, np.array([np.diag(moved), [moved[0, 1], moved[1, 0]]]), float(total + top.sum())
