"""Fits stiffness, the slope of normal force over depth during loading, with its 95 % interval."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from hapscene.capture.fit.segment import InteractionState, Segmentation, SegmentedRecording, noise, runs
from hapscene.capture.io.streams import HAND_CUTOFF_HZ, Array, Streams

__all__ = ["fit_stiffness", "jackknife_half"]

RANGE: Final = (0.1, 0.9)
"""Range of a loading that is used, relative to its largest force [1]. Below it, the contact is incomplete; above it,
the material creeps."""

SETTLE_S: Final = 0.006
"""Time that is omitted after the start of a contact [s], because the low-pass mixes in the approach."""

LOADINGS_MIN: Final = 4
"""Fewest loadings for an interval: with parts of loadings, 45 % of the intervals contained the true value."""

FORCE_RATIO: Final = 4.0
"""Smallest peak force of a loading, relative to the contact threshold [1]."""

FALLS: Final = 0.8
"""Fraction of its peak to which the force must fall to end a loading that may include sliding [1]."""

CORRELATION_MIN: Final = 0.9
"""Smallest correlation of force and depth that counts as a spring [1]."""


@dataclass(frozen=True)
class Stiffness:
    """Stiffness [N/m] with its 95 % interval, or None for one or both, and the reason."""

    slope_N_m: float | None
    interval: tuple[float, float] | None = None
    reason: str = ""


def fit_stiffness(recordings: Sequence[SegmentedRecording]) -> Stiffness:
    """Fits the stiffness to recordings of one surface.

    A loading extends from the start of a contact to its largest force, without sliding; if there is no such contact, a
    loading may include sliding while the force increases. Force and depth of each loading are centred, so that a drift
    of the zero of depth has no effect. Both are noisy, and ordinary regression on a noisy depth would give too small a
    slope. The slope is therefore fitted by Deming regression with the noise of both streams and Huber weights. The
    interval is Student's t of a jackknife over the loadings.
    """
    with_depth = [(channels, states) for channels, states in recordings if channels.depth_m is not None]
    if not with_depth:
        return Stiffness(None, reason="the depth was not recorded")
    if all(states.force_on_N is None for _, states in with_depth):
        return Stiffness(None, reason="the force was not recorded or is constant")
    loadings = [found for channels, states in with_depth for found in _loadings(channels, states)]
    moving = [part for part in with_depth if part[1].speed_on_m_s is not None or "speed_m_s" in part[0].assumed]
    if not loadings:
        loadings = [found for channels, states in moving for found in _loadings(channels, states, True)]
    if not loadings:
        reason = "the tool never presses into the surface without sliding"
        if moving:
            force_on = min(states.force_on_N or np.inf for _, states in with_depth)
            reason += f": record presses from the air to at least {FORCE_RATIO * force_on:.2g} N"
        return Stiffness(None, reason=reason)
    depth, force = (np.concatenate([loading[i] for loading in loadings]) for i in (0, 1))
    correlation = float((depth * force).sum() / np.sqrt((depth**2).sum() * (force**2).sum() + 1e-300))
    if correlation < CORRELATION_MIN:
        return Stiffness(
            None, reason=f"force and depth are not proportional while the tool presses (r = {correlation:.2f})"
        )
    ratio = _noise_ratio(with_depth)
    slope = _slope(depth, force, ratio)
    if len(loadings) < LOADINGS_MIN:
        return Stiffness(slope, reason=f"{len(loadings)} presses from the air (expected at least {LOADINGS_MIN})")
    sums = np.array([_weighted_sums(d, f, slope, ratio) for d, f in loadings])
    half = float(jackknife_half(_deming(sums.sum(axis=0) - sums, ratio)))
    weight = _weight(depth, force, slope, ratio)
    # corrects for outliers: omitting data also changes the weights
    half *= float(weight.mean() / np.mean(weight == 1.0))
    return Stiffness(slope, (slope - half, slope + half))


def jackknife_half(without: Array) -> Array:
    """Half-width (...) of the 95 % interval of jackknife estimates (n, ...), by Student's t."""
    count = len(without)
    return np.asarray(scipy.stats.t.ppf(0.975, count - 1) * np.sqrt((count - 1.0) * without.var(axis=0)))


def _noise_ratio(recordings: Sequence[SegmentedRecording]) -> float:
    """Ratio of force noise to depth noise [N/m], limited so that neither counts as exact."""
    ratios = []
    for channels, _ in recordings:
        assert channels.depth_m is not None
        span = max(float(np.ptp(channels.force_N)), 1e-12) / max(float(np.ptp(channels.depth_m)), 1e-12)
        of_depth = max(noise(channels.depth_m, channels.rate_Hz), 1e-6 * float(np.ptp(channels.depth_m)) + 1e-15)
        ratios.append(float(np.clip(noise(channels.force_N, channels.rate_Hz) / of_depth, 0.01 * span, 100.0 * span)))
    return float(np.median(ratios))


def _loadings(channels: Streams, states: Segmentation, sliding: bool = False) -> list[tuple[Array, Array]]:
    """Centred depth and force (m,) of each loading, decimated to independent samples.

    With `sliding`, a loading may include sliding; it then starts without contact and ends when the force falls.
    """
    assert channels.depth_m is not None and states.force_on_N is not None
    step = round(channels.rate_Hz / (4.0 * HAND_CUTOFF_HZ))
    found = []
    contact = channels.force_N > states.force_on_N
    contact &= sliding | (states.states != InteractionState.SLIDING)
    for start, end in runs(contact):
        force = channels.force_N[start:end]
        if sliding:
            falls = np.flatnonzero(force < FALLS * np.maximum.accumulate(force))
            force = force[: falls[0]] if len(falls) else force
        top = int(np.argmax(force))
        # selecting by force alone would depend on its noise and bias the slope, so the depth is used as well
        share, deep = force[: top + 1] / force[top], channels.depth_m[start : start + top + 1] - channels.depth_m[start]
        if deep[-1] > 0.0:
            share = 0.5 * (share + deep / deep[-1])
        inside = np.flatnonzero((share >= RANGE[0]) & (share <= RANGE[1]))
        loading = np.arange(inside[0], inside[-1] + 1) if len(inside) else inside
        loading = loading[loading >= SETTLE_S * channels.rate_Hz]
        # else the contact began with sliding
        fresh = channels.force_N[start - 1] <= states.force_on_N if start > 0 else not sliding
        if not fresh or len(loading) < 3 * step or force[top] < FORCE_RATIO * states.force_on_N:
            continue
        chosen = start + loading[::step]
        depth, pressed = channels.depth_m[chosen], channels.force_N[chosen]
        if np.ptp(depth) > 0.0:
            found.append((depth - depth.mean(), pressed - pressed.mean()))
    return found


def _slope(depth: Array, force: Array, ratio: float) -> float:
    """Slope of the regression line through the origin."""
    slope = float((depth * force).sum() / (depth**2).sum())
    for _ in range(10):
        slope = float(_deming(np.array([_weighted_sums(depth, force, slope, ratio)]), ratio)[0])
    return slope


def _weighted_sums(depth: Array, force: Array, slope: float, ratio: float) -> tuple[float, float, float]:
    """Weighted sums Σw d², Σw d F, Σw F²."""
    weight = _weight(depth, force, slope, ratio)
    return float((weight * depth**2).sum()), float((weight * depth * force).sum()), float((weight * force**2).sum())


def _weight(depth: Array, force: Array, slope: float, ratio: float) -> Array:
    """Huber weights (m,) for the distances from the line."""
    distance = np.abs(force - slope * depth) / np.sqrt(ratio**2 + slope**2)
    bound = 1.345 * 1.4826 * float(np.median(distance)) + 1e-15
    return np.asarray(np.minimum(1.0, bound / np.maximum(distance, 1e-15)))


def _deming(sums: Array, ratio: float) -> Array:
    """Deming slopes (m,) from sums (m, 3) of `_weighted_sums`."""
    dd, df, ff = sums.T
    half = 0.5 * (ff - ratio**2 * dd)
    return np.asarray((half + np.sqrt(half**2 + ratio**2 * df**2)) / np.where(df == 0.0, 1e-300, df))
