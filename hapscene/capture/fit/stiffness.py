"""A fit of its own: stiffness, the slope of normal force over depth while it is loaded, with its 95 % interval."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from hapscene.capture.fit.segment import InteractionState, Part, Segmentation, noise, runs
from hapscene.capture.io.streams import HAND_CUTOFF_HZ, Array, Streams

__all__ = ["RANGE", "Stiffness", "fit_stiffness", "jackknife_half"]

RANGE: Final = (0.1, 0.9)
"""Part of a loading that is used, as shares of its largest force [1]: below, the contact is not whole; above, it
creeps."""

SETTLE_S: Final = 0.006
"""What is left out after the beginning of a contact [s]: the low-pass mixes the approach into it."""

LOADINGS_MIN: Final = 4
"""Fewest loadings that are drawn as wholes for the interval [count]; of fewer, pieces are."""

FORCE_RATIO: Final = 4.0
"""Least largest force of a loading, as a multiple of that which tells contact [1]."""

FALLS: Final = 0.8
"""Share of its largest force to which a press that may slide falls as its loading is over [1]."""

CORRELATION_MIN: Final = 0.9
"""Least correlation of force and depth at which they are taken for a spring [1]."""


@dataclass(frozen=True)
class Stiffness:
    """The slope [N/m] with its 95 % interval, or None and the reason."""

    slope_N_m: float | None
    interval: tuple[float, float] | None = None
    reason: str = ""


def fit_stiffness(parts: Sequence[Part]) -> Stiffness:
    """The stiffness of recordings of one surface.

    A loading runs from the beginning of a contact to its largest force, as long as the tool does not slide; where it
    always does (it rolls, or nothing tells rest), as long as the force grows all the same. Force and
    depth of each are taken about their means, so that a zero of depth that drifts does no harm. Both are noisy, and a
    line of force over a noisy depth is too flat: so each is divided by its noise, and the line is the one with the
    least distances square to it (Deming), by Huber's weights. The interval is Student's, of the loadings left out one
    by one (jackknife).
    """
    with_depth = [(channels, states) for channels, states in parts if channels.depth_m is not None]
    if not with_depth:
        return Stiffness(None, reason="the recording holds no depth")
    if all(states.force_on_N is None for _, states in with_depth):
        return Stiffness(None, reason="the recording holds no force that changes")
    loadings = [found for channels, states in with_depth for found in _loadings(channels, states)]
    moving = [part for part in with_depth if part[1].speed_on_m_s is not None or "speed_m_s" in part[0].assumed]
    if not loadings:
        loadings = [found for channels, states in moving for found in _loadings(channels, states, True)]
    if not loadings:
        reason = "the tool never presses into the surface without sliding"
        if moving:
            force_on = min(states.force_on_N or np.inf for _, states in with_depth)
            reason += f": a press out of the air to {FORCE_RATIO * force_on:.2g} N or more is needed"
        return Stiffness(None, reason=reason)
    depth, force = (np.concatenate([loading[i] for loading in loadings]) for i in (0, 1))
    correlation = float((depth * force).sum() / np.sqrt((depth**2).sum() * (force**2).sum() + 1e-300))
    if correlation < CORRELATION_MIN:
        return Stiffness(None, reason=f"force and depth are no line while the tool presses (r = {correlation:.2f})")
    ratio = _noise_ratio(with_depth)
    if len(loadings) < LOADINGS_MIN:
        pieces = max(LOADINGS_MIN, 12 // len(loadings))
        loadings = [
            (d, f) for pair in loadings for d, f in zip(*(np.array_split(a, pieces) for a in pair), strict=True)
        ]
    slope = _slope(depth, force, ratio)
    sums = np.array([_weighted_sums(d, f, slope, ratio) for d, f in loadings if len(d)])
    half = float(jackknife_half(_deming(sums.sum(axis=0) - sums, ratio)))
    weight = _weight(depth, force, slope, ratio)
    half *= float(weight.mean() / np.mean(weight == 1.0))  # what is left out moves the line, and the weights with it
    return Stiffness(slope, (slope - half, slope + half))


def jackknife_half(without: Array) -> Array:
    """Half the width (...) of the 95 % interval of what comes out without each of some samples (n, ...): Student's."""
    count = len(without)
    return np.asarray(scipy.stats.t.ppf(0.975, count - 1) * np.sqrt((count - 1.0) * without.var(axis=0)))


def _noise_ratio(parts: Sequence[Part]) -> float:
    """Noise of the forces over noise of the depths [N/m], bounded so that neither counts as exact."""
    ratios = []
    for channels, _ in parts:
        assert channels.depth_m is not None
        span = max(float(np.ptp(channels.force_N)), 1e-12) / max(float(np.ptp(channels.depth_m)), 1e-12)
        of_depth = max(noise(channels.depth_m, channels.rate_Hz), 1e-6 * float(np.ptp(channels.depth_m)) + 1e-15)
        ratios.append(float(np.clip(noise(channels.force_N, channels.rate_Hz) / of_depth, 0.01 * span, 100.0 * span)))
    return float(np.median(ratios))


def _loadings(channels: Streams, states: Segmentation, sliding: bool = False) -> list[tuple[Array, Array]]:
    """Depth and force (m,) of each loading about their means, thinned to what the low-pass leaves independent.

    Where it may slide, a loading ends as the force falls, and begins in the air.
    """
    assert channels.depth_m is not None and states.force_on_N is not None
    step = max(1, round(channels.rate_Hz / (4.0 * HAND_CUTOFF_HZ)))
    found = []
    contact = channels.force_N > states.force_on_N
    contact &= sliding | (states.states != InteractionState.SLIDING)
    for start, end in runs(contact):
        force = channels.force_N[start:end]
        if sliding:
            falls = np.flatnonzero(force < FALLS * np.maximum.accumulate(force))
            force = force[: falls[0]] if len(falls) else force
        top = int(np.argmax(force))
        # a range of time, of force and depth alike: the noise of the force alone would choose, and flatten the line
        share, deep = force[: top + 1] / force[top], channels.depth_m[start : start + top + 1] - channels.depth_m[start]
        if deep[-1] > 0.0:
            share = 0.5 * (share + deep / deep[-1])
        inside = np.flatnonzero((share >= RANGE[0]) & (share <= RANGE[1]))
        loading = np.arange(inside[0], inside[-1] + 1) if len(inside) else inside
        loading = loading[loading >= SETTLE_S * channels.rate_Hz]
        fresh = (start == 0 and not sliding) or channels.force_N[
            start - 1
        ] <= states.force_on_N  # else it slid into rest
        if not fresh or len(loading) < 3 * step or force[top] < FORCE_RATIO * states.force_on_N:
            continue
        chosen = start + loading[::step]
        depth, pressed = channels.depth_m[chosen], channels.force_N[chosen]
        if np.ptp(depth) > 0.0:
            found.append((depth - depth.mean(), pressed - pressed.mean()))
    return found


def _slope(depth: Array, force: Array, ratio: float) -> float:
    """The slope of the line through the origin."""
    slope = float((depth * force).sum() / (depth**2).sum())
    for _ in range(10):
        slope = float(_deming(np.array([_weighted_sums(depth, force, slope, ratio)]), ratio)[0])
    return slope


def _weighted_sums(depth: Array, force: Array, slope: float, ratio: float) -> tuple[float, float, float]:
    """Σw d², Σw d F, Σw F²."""
    weight = _weight(depth, force, slope, ratio)
    return float((weight * depth**2).sum()), float((weight * depth * force).sum()), float((weight * force**2).sum())


def _weight(depth: Array, force: Array, slope: float, ratio: float) -> Array:
    """Huber's weights (m,) for the distances from the line."""
    away = np.abs(force - slope * depth) / np.sqrt(ratio**2 + slope**2)
    bound = 1.345 * 1.4826 * float(np.median(away)) + 1e-15
    return np.asarray(np.minimum(1.0, bound / np.maximum(away, 1e-15)))


def _deming(sums: Array, ratio: float) -> Array:
    """The slopes (m,) that sums (m, 3) of `_weighted_sums` give."""
    dd, df, ff = sums.T
    half = 0.5 * (ff - ratio**2 * dd)
    return np.asarray((half + np.sqrt(half**2 + ratio**2 * df**2)) / np.where(df == 0.0, 1e-300, df))
