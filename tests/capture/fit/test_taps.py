"""Simulated taps at 20 dB SNR."""

from dataclasses import replace

import numpy as np
import pytest

from hapscene.capture.fit.segment import InteractionState, Segmentation, segment
from hapscene.capture.fit.taps import (
    CONTACT_WAVES,
    FADE_S,
    FITTED_MAX,
    OUTLIER,
    WAVE_S,
    MeasuredTap,
    _approach,
    _errors,
    _Impact,
    _wave,
    fit_taps,
    pooled_taps,
    weighted_mean,
)
from hapscene.capture.io.streams import Streams, clean


def parts(truth, *streams):
    channels = clean(truth.acceleration_m_s2, truth.rate_Hz, **{name: getattr(truth, name) for name in streams})
    return [(channels, segment(channels))]


@pytest.mark.parametrize("rate_Hz", [10_000.0, 2_000.0])
@pytest.mark.parametrize("seed", range(3))
def test_over_approach_speed(seed, rate_Hz, handled_recording):
    truth = handled_recording(seed, rate_Hz)
    found = fit_taps(parts(truth, "force_N", "speed_m_s", "depth_m"))
    taps = found.taps
    assert taps is not None and not found.absent
    np.testing.assert_allclose(taps.approach_m_s, sorted(truth.tap_m_s), rtol=0.15)
    np.testing.assert_allclose(taps.frequency_Hz, 180.0, rtol=0.03)
    np.testing.assert_allclose(taps.decay_1_s, 70.0, rtol=0.10)
    np.testing.assert_allclose(taps.amplitude_m_s2, 100.0 * np.array(sorted(truth.tap_m_s)), rtol=0.10)
    for i in range(4):
        low, high = found.intervals[f"taps.decay_1_s[{i}]"]
        assert 0.0 < high - low < 0.4 * 70.0


def test_intervals_contain_the_true_values(handled_recording):
    """95 % of them should; of 48, at least 40 do with a probability of 0.999."""
    inside = 0
    for seed in range(4):
        found = fit_taps(parts(handled_recording(seed), "force_N", "speed_m_s", "depth_m"))
        for name, want in (
            ("frequency_Hz", [180.0] * 4),
            ("decay_1_s", [70.0] * 4),
            ("amplitude_m_s2", [5, 10, 15, 20]),
        ):
            for i, value in enumerate(want):
                low, high = found.intervals[f"taps.{name}[{i}]"]
                inside += low <= value <= high
    assert inside >= 40


def test_stored_transients_equal_the_recording(handled_recording):
    truth = handled_recording(0)
    taps = fit_taps(parts(truth, "force_N", "speed_m_s", "depth_m")).taps
    assert taps is not None and taps.wave_rate_Hz == truth.rate_Hz
    t_s = np.arange(400) / truth.rate_Hz
    wave = 20.0 * np.exp(-70.0 * t_s) * np.sin(2 * np.pi * 180.0 * t_s)
    assert np.corrcoef(taps.transient(taps.approach_m_s[-1], truth.rate_Hz)[:400], wave)[0, 1] > 0.99


def test_an_assumed_approach_speed_is_reported(handled_recording):
    found = fit_taps(parts(handled_recording(0)))
    assert found.taps is not None
    assert found.taps.approach_m_s.tolist() == [0.1]
    assert found.taps.frequency_Hz[0] == pytest.approx(180.0, rel=0.03)
    assert found.taps.decay_1_s[0] == pytest.approx(70.0, rel=0.10)
    assert "0.1 m/s" in found.absent["taps.approach_m_s"]


def test_missing_taps_have_a_reason():
    channels = clean(np.random.default_rng(0).standard_normal(20_000), 10_000.0)
    found = fit_taps([(channels, segment(channels))])
    assert found.taps is None and found.absent == {"taps": "no tap was found in the recording"}


def test_the_reason_has_the_best_of_the_impacts(monkeypatch):
    states = np.array([0, 3, 3, 0, 3, 0, 3], np.int8)
    parts = [(Streams(1000.0, *np.zeros((4, 7))), Segmentation(1000.0, states, (), None, None))]
    one = MeasuredTap(0.1, np.ones(3), np.ones(3), 0.0, np.ones(10))
    found = iter([replace(one, explained=0.12), None, replace(one, explained=0.34)])
    monkeypatch.setattr("hapscene.capture.fit.taps.measure_tap", lambda *_: next(found))
    reason = fit_taps(parts).absent["taps"]
    assert "at most 34 % of the power of 3 impacts" in reason


def tap(approach_m_s, decay_1_s, error_1_s=1.0, level=1.0):
    value = np.array([20.0, 180.0, decay_1_s])
    return MeasuredTap(approach_m_s, value, np.array([1.0, 1.0, error_1_s]), 1.0, np.full(10, level))


def test_pooled_taps_have_the_error_of_the_mean():
    rng = np.random.default_rng(0)
    found = pooled_taps([tap(0.1, 70.0 + rng.standard_normal()) for _ in range(16)], 1000.0, {})
    assert len(found.taps.approach_m_s) == 1 and found.taps.decay_1_s[0] == pytest.approx(70.0, abs=1.0)
    width = np.ptp(found.intervals["taps.decay_1_s[0]"]) / (2 * 1.96)
    assert width == pytest.approx(np.sqrt(2.0) / np.sqrt(16.0), rel=0.3)  # its own error, and as much of scatter


def test_outliers_in_a_group_are_omitted():
    values = np.column_stack([np.full(9, 20.0), np.full(9, 180.0), [70, 71, 69, 70.5, 69.5, 70, 71, 69, 400.0]])
    mean, error = weighted_mean(values, np.ones((9, 3)))
    assert mean == pytest.approx([20.0, 180.0, 70.0], abs=0.1)
    alone, of_eight = weighted_mean(values[:8], np.ones((8, 3)))
    assert mean[2] == pytest.approx(alone[2], abs=0.1) and error[2] == pytest.approx(of_eight[2], rel=0.2)
    assert error[0] == pytest.approx(1.0 / 3.0)  # its amplitude is as that of the others: it counts


def test_values_are_weighted_by_their_errors():
    mean, error = weighted_mean(np.array([[1.0], [2.0], [1.0]]), np.array([[0.01], [1.0], [0.01]]))
    assert mean == pytest.approx(1.0, abs=1e-3) and error == pytest.approx(0.01 / np.sqrt(2.0), rel=1e-3)
    near, far = (np.array([[0.0], [0.0], [(OUTLIER + by) * 0.5]]) for by in (-0.01, 0.01))
    assert weighted_mean(near, np.full((3, 1), 0.5))[0] == pytest.approx(near.mean(), rel=1e-6)
    assert weighted_mean(far, np.full((3, 1), 0.5))[0] == 0.0


def test_transients_of_a_group_are_averaged():
    found = pooled_taps([tap(0.1, 70.0, level=1.0), tap(0.1, 70.0, level=3.0), tap(0.5, 70.0, level=9.0)], 1000.0, {})
    assert found.taps.wave_m_s2.tolist() == [[2.0] * 10, [9.0] * 10]
    assert found.taps.approach_m_s.tolist() == [0.1, 0.5]


def test_stored_transients_are_faded():
    rate = 10_000.0
    wave, (rise, fall) = _wave(np.ones(6000), 4000, rate), (round(span_s * rate) for span_s in FADE_S)
    assert len(wave) == round(WAVE_S * rate)
    assert wave[[0, rise - 1]] == pytest.approx([0.5 / rise, 1.0 - 0.5 / rise]) and (wave[rise:-fall] == 1.0).all()
    assert wave[[-fall, -1]] == pytest.approx([1.0, 0.0], abs=1e-3) and (np.diff(wave[-fall:]) < 0.0).all()


def approach(rate=2000.0, *, depth_m=None, speed_m_s=0.1):
    """Streams of a tool with an onset at 0.5 s."""
    t = np.arange(2000) / rate - 0.5
    speed = np.broadcast_to(speed_m_s, t.shape) if depth_m is None else np.full(len(t), 0.1)
    depth = None if depth_m is None else depth_m(t)
    return _approach(Streams(rate, np.zeros(len(t)), np.ones(len(t)), speed, None, depth), 1000)


def test_the_approach_speed_is_the_slope_of_the_depth():
    assert approach(depth_m=lambda t: 0.2 * t) == pytest.approx(0.2)
    bent = approach(depth_m=lambda t: np.where(t > -0.006, 0.0, 0.2 * t) + 5.0 * np.minimum(t + 0.025, 0.0))
    assert bent == pytest.approx(0.2)
    assert np.isnan(approach(depth_m=lambda t: -0.2 * t)) and np.isnan(approach(depth_m=lambda t: 0.0 * t))


def test_without_depth_the_speed_is_the_approach_speed():
    t = np.arange(2000) / 2000.0 - 0.5
    assert approach(speed_m_s=np.where(np.abs(t + 0.015) < 0.01, 0.3, 0.01)) == pytest.approx(0.3)
    assert np.isnan(approach(speed_m_s=0.3))  # one number for the whole recording
    assert np.isnan(approach(speed_m_s=np.where(t > 0.0, 0.3, 0.02)))  # it came down, and its speed is that along
    assert np.isnan(_approach(Streams(2000.0, t, t, np.abs(t), None), 13))  # hardly anything lies before it


def test_of_many_impacts_a_selection_is_fitted():
    """Fifty taps with increasing speed."""
    count, each, rate = FITTED_MAX + 10, 600, 2000.0
    t = np.arange(each) / rate - 0.1
    speeds = np.geomspace(0.05, 1.0, count)
    ring = np.exp(-70.0 * np.maximum(t, 0.0)) * np.sin(2 * np.pi * 180.0 * np.maximum(t, 0.0))
    a, depth = np.concatenate([100.0 * v * ring for v in speeds]), np.concatenate([v * t for v in speeds])
    taps = np.tile((t >= 0.0) & (t < 0.08), count)
    states = np.where(taps, InteractionState.TAP, InteractionState.AIR).astype(np.int8)
    part = clean(a, rate, None, None, None, None)
    streams = Streams(rate, part.acceleration_m_s2, np.ones(len(a)), np.ones(len(a)), None, depth)
    found = fit_taps([(streams, Segmentation(rate, states, (), None, None))]).taps
    assert found.approach_m_s[[0, -1]] == pytest.approx(speeds[[0, -1]], rel=0.08)
    assert 14 <= len(found.approach_m_s) <= 18  # three of a ratio of 1.08 are one, and a ratio of 20 is spanned
    np.testing.assert_allclose(found.amplitude_m_s2, 100.0 * found.approach_m_s, rtol=0.02)
    np.testing.assert_allclose(found.frequency_Hz, 180.0, rtol=0.01)


def test_of_several_local_minima_the_best_is_found():
    """A contact of 4 ms, then ringing at 300 Hz; of three searches, one ends at twice the power of the noise."""
    t = np.arange(400) / 2000.0 - 0.05
    since = t - 0.004
    ring = 0.6 * np.exp(-70.0 * np.maximum(since, 0.0)) * np.sin(600.0 * np.pi * np.maximum(since, 0.0) + 1.0)
    a = np.where(since >= 0.0, ring, np.sin(np.pi * np.clip(t / 0.004, 0.0, 1.0)))
    impact = _Impact(a + 0.05 * np.random.default_rng(1).standard_normal(400), 100, 2000.0)
    found = impact.ring(impact.sinusoid(), CONTACT_WAVES)
    assert found.left < 1.5 * 400 * 0.05**2 and found.value[1:] == pytest.approx([300.0, 70.0], rel=0.05)


def test_standard_errors_account_for_correlated_noise():
    rng = np.random.default_rng(0)
    jacobian, white = rng.standard_normal((4000, 2)) * [1.0, 5.0], 0.3 * rng.standard_normal(4000)
    assert _errors(jacobian, white) == pytest.approx(0.3 / np.sqrt(4000.0) / np.array([1.0, 5.0]), rel=0.08)
    red = np.convolve(white, np.ones(8) / 8.0, "same")
    ratio = np.sqrt(np.mean(red**2) / np.mean(white**2))
    assert _errors(jacobian, red) / _errors(jacobian, white) == pytest.approx(ratio * np.sqrt(15.0), rel=0.1)
    assert not _errors(jacobian, np.zeros(4000)).any()
