"""Stiffness of simulated springs with noise and outliers."""

import numpy as np
import pytest

from hapscene.capture.fit.segment import InteractionState, Segmentation
from hapscene.capture.fit.stiffness import (
    _deming,
    _loadings,
    _noise_ratio,
    _weight,
    fit_stiffness,
)
from hapscene.capture.io.streams import HAND_CUTOFF_HZ, Streams

RATE_HZ, FORCE_ON_N = 1000.0, 0.05


def pressed(slope_N_m, noise_N=0.0, noise_m=0.0, count=6, drift_m=0.0, seed=0):
    """Presses of 0.4 s, up and down again, 0.6 s apart; noise as that of sensors, which the low-pass has bent."""
    from scipy.signal import butter, sosfiltfilt

    rng = np.random.default_rng(seed)
    t = np.arange(count * 1000) / RATE_HZ
    force = 2.0 * np.maximum(0.0, np.sin(2.0 * np.pi * (t % 1.0 - 0.3) / 0.8)) * ((t % 1.0 > 0.3) & (t % 1.0 < 0.7))
    low = butter(4, HAND_CUTOFF_HZ, fs=RATE_HZ, output="sos")
    noise = sosfiltfilt(low, rng.standard_normal((2, len(t))))
    depth = force / slope_N_m + drift_m * np.floor(t) + noise_m * noise[1]
    force = force + noise_N * noise[0]
    states = np.where(force > FORCE_ON_N, InteractionState.STILL, InteractionState.AIR).astype(np.int8)
    streams = Streams(RATE_HZ, np.zeros(len(t)), force, np.zeros(len(t)), None, depth)
    return [(streams, Segmentation(RATE_HZ, states, (), FORCE_ON_N, None))]


@pytest.mark.parametrize("slope_N_m", [80.0, 500.0, 20_000.0])
def test_a_spring_without_noise_is_exact(slope_N_m):
    for drift_m in (0.0, 0.01):
        found = fit_stiffness(pressed(slope_N_m, drift_m=drift_m))
        assert found.slope_N_m == pytest.approx(slope_N_m, rel=1e-6)
        assert found.interval == pytest.approx((slope_N_m, slope_N_m), rel=1e-6)


def test_noise_of_the_depth_does_not_bias_the_slope():
    """Ordinary least squares would be 12 % too low."""
    found = [fit_stiffness(pressed(500.0, 0.05, 8e-4, seed=seed)) for seed in range(60)]
    slopes = np.array([one.slope_N_m for one in found])
    assert slopes.mean() == pytest.approx(500.0, rel=0.04)
    assert sum(one.interval[0] <= 500.0 <= one.interval[1] for one in found) >= 51
    spread = np.mean([np.ptp(one.interval) for one in found]) / (2 * 1.96)
    assert 1.0 < spread / slopes.std() < 1.6  # Student's t of six presses: 1.31


@pytest.mark.parametrize("ratio", [10.0, 500.0, 1e5])
def test_the_slope_is_the_deming_regression(ratio):
    from scipy.optimize import minimize_scalar

    rng = np.random.default_rng(0)
    depth = rng.uniform(-1e-3, 1e-3, 200)
    force = 500.0 * depth + 0.1 * rng.standard_normal(200)
    sums = np.array([[(depth**2).sum(), (depth * force).sum(), (force**2).sum()]])

    def distance(slope):
        return np.sum((force - slope * depth) ** 2) / (ratio**2 + slope**2)

    best = minimize_scalar(distance, bounds=(100.0, 2000.0), method="bounded", options={"xatol": 1e-6}).x
    assert _deming(sums, ratio)[0] == pytest.approx(best, rel=1e-6)
    assert _deming(sums * [1.0, -1.0, 1.0], ratio)[0] == pytest.approx(-best, rel=1e-6)


def test_the_ratio_of_the_noises_is_limited():
    """To a hundredth and to a hundred times the ratio of the ranges, so that neither stream counts as exact."""
    for noise_N, noise_m, ratio in ((0.05, 8e-4, 62.5), (0.05, 0.0, 5e4), (1e-7, 8e-4, 3.3)):
        recordings = [part for seed in range(3) for part in pressed(500.0, noise_N, noise_m, seed=seed)]
        assert _noise_ratio(recordings) == pytest.approx(ratio, rel=0.3), ratio


def test_weights_are_those_of_huber():
    """1 up to 1.345 standard deviations, by the median distance; beyond it as the inverse distance."""
    away = np.array([1.0, -1.0, 1.0, -1.0, 1.0, 4.0, -8.0])
    depth = np.linspace(-1e-3, 1e-3, 7)
    for ratio in (0.0, 500.0):
        weight = _weight(depth, 500.0 * depth + away, 500.0, ratio)
        assert weight == pytest.approx([1.0] * 5 + [1.345 * 1.4826 / 4.0, 1.345 * 1.4826 / 8.0])
    assert _weight(depth, 500.0 * depth, 500.0, 1.0) == pytest.approx(1.0)


def test_sliding_and_weak_contacts_are_no_loadings():
    ((streams, states),) = pressed(500.0, count=3)
    states.states[300:330] = InteractionState.SLIDING  # the first slides to rest
    streams.force_N[1000:2000] *= 0.09  # the second's 0.18 N are less than four times what tells a contact
    assert len(_loadings(streams, states)) == 1
    states.states[2300:2700] = InteractionState.SLIDING
    assert fit_stiffness([(streams, states)]).reason == "the tool never presses into the surface without sliding"


@pytest.mark.parametrize("count", [1, 3, 4])
def test_few_loadings_have_no_interval(count):
    """Parts of one loading are not independent."""
    found = fit_stiffness(pressed(500.0, 0.05, 1e-4, count=count))
    assert found.slope_N_m == pytest.approx(500.0, rel=0.1)
    assert (found.interval is None) == (str(count) in found.reason) == (count < 4)


def slid(*levels_N: float, speed_on_m_s: float | None = 0.01, force_on_N: float = FORCE_ON_N):
    """Contacts that slide throughout, with a peak of each level and a second peak of 90 % of that level."""
    t = np.arange(1000) / RATE_HZ
    once = np.interp(t, [0.3, 0.5, 0.55, 0.6, 0.8], [0.0, 1.0, 0.7, 0.9, 0.0])
    force = np.concatenate([level * once for level in levels_N])
    states = np.where(force > force_on_N, InteractionState.SLIDING, InteractionState.AIR).astype(np.int8)
    streams = Streams(RATE_HZ, np.zeros(len(force)), force, np.ones(len(force)), None, force / 500.0)
    return streams, Segmentation(RATE_HZ, states, (), force_on_N, speed_on_m_s)


def test_without_rest_the_rise_of_a_sliding_contact_is_a_loading():
    streams, states = slid(2.0, 2.0, 0.19)
    found = fit_stiffness([(streams, states)])
    assert found.slope_N_m == pytest.approx(500.0, rel=1e-6) and found.reason.startswith("2 ")
    for depth, force in _loadings(streams, states, True):  # of the first rise alone: it ends when the force has fallen
        assert force == pytest.approx(500.0 * depth, rel=1e-9) and (np.diff(force) > 0.0).all()
    late = slice(350, None)  # the first begins before the recording: only if nothing slides, its rise counts
    part = Streams(
        RATE_HZ,
        streams.speed_m_s[late],
        streams.force_N[late],
        streams.speed_m_s[late],
        None,
        depth_m=streams.depth_m[late],
    )
    assert len(_loadings(part, Segmentation(RATE_HZ, states.states[late], (), FORCE_ON_N, None), True)) == 1
    still = np.full(len(part.force_N), InteractionState.STILL, np.int8)
    assert len(_loadings(part, Segmentation(RATE_HZ, still, (), FORCE_ON_N, None))) == 2


def test_the_force_to_record_is_that_of_the_most_sensitive_recording():
    weak = [slid(0.19), slid(0.5, force_on_N=0.2)]
    assert fit_stiffness(weak).reason.endswith("to at least 0.2 N")
    still = slid(0.19, speed_on_m_s=None)  # nothing tells whether it moves
    assert "at least" not in fit_stiffness([still]).reason
