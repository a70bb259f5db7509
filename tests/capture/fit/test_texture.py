"""Textures from simulated analysis windows: position, power and number of the models."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.fit.distance import log_spectral_distance, model_spectrum
from hapscene.capture.fit.texture import WINDOWS_PER_MODEL, _cluster, _corners, choose_model_count, fit_texture
from hapscene.capture.fit.windows import AnalysisWindows
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import autocorrelation, smoothed, solve, tapered

RATE_HZ, LENGTH = 2000.0, 200


def filter_of(frequency_Hz):
    return np.array([1.0, -1.8 * np.cos(2 * np.pi * frequency_Hz / RATE_HZ), 0.81])


def pieces(force_N, speed_m_s, frequency_Hz=300.0, power=1.0, seed=0):
    """One window for each force and speed, with given resonance and power."""
    force, speed, frequency, power = np.broadcast_arrays(force_N, speed_m_s, frequency_Hz, power)
    rng, rows = np.random.default_rng(seed), []
    for f, p in zip(frequency, power, strict=True):
        a = filter_of(f)
        x = lfilter([1.0], a, rng.standard_normal(LENGTH + 200))[200:]
        rows.append(x * np.sqrt(p / power_gain(a)))
    return AnalysisWindows(np.array(rows), force.astype(float), speed.astype(float), np.arange(len(rows)))


SLOW_AND_FAST = np.repeat([0.1, 0.3], 20)


def test_known_clusters_are_found():
    places = np.repeat([[1.0, 0.1], [2.0, 0.1], [1.5, 0.3]], 10, axis=0)
    part = pieces(*places.T)
    label = _cluster(part, 3)
    assert [len(set(label[i : i + 10])) for i in (0, 10, 20)] == [1, 1, 1] and set(label) == {0, 1, 2}
    assert set(_cluster(part, 8)) == {0, 1, 2}  # the recording has no more
    assert set(_cluster(part, 1)) == {0}


def test_clusters_of_too_few_windows_are_merged():
    few = WINDOWS_PER_MODEL - 1
    part = pieces(np.ones(20 + few), np.array([0.1] * 10 + [0.3] * 10 + [0.27] * few))
    label = _cluster(part, 3)
    assert set(label) == {0, 1} and len(set(label[10:])) == 1 and label[0] != label[10]
    enough = pieces(np.ones(21 + few), np.array([0.1] * 10 + [0.3] * 10 + [0.27] * (few + 1)))
    assert set(_cluster(enough, 3)) == {0, 1, 2}


@pytest.mark.parametrize(
    ("force", "speed", "corners"),
    [
        ([1.0, 2.0], [0.1, 0.3], [(1.0, 0.1), (2.0, 0.1), (1.0, 0.3), (2.0, 0.3)]),
        ([1.0, 1.0005], [0.1, 0.3], [(1.0, 0.1), (1.0, 0.3)]),
        ([1.0, 1.0], [0.1, 0.1], [(1.0, 0.1)]),
        ([1.0, 1.01], [0.1, 0.1], [(1.0, 0.1), (1.01, 0.1)]),
        ([1.0, 1.0], [0.02, 0.18], [(1.0, 0.02), (1.0, 0.06), (1.0, 0.18)]),
    ],
)
def test_one_filter_is_placed_at_the_corners(force, speed, corners):
    found = _corners(pieces(force, speed))
    assert np.transpose(found).ravel() == pytest.approx(np.ravel(corners))


def test_one_filter_is_fitted_to_all_windows():
    part = pieces(np.ones(30), np.full(30, 0.1))
    texture = fit_texture(part, RATE_HZ, 2, 1)
    joined = solve(smoothed(autocorrelation(tapered(part.acceleration_m_s2.ravel(), RATE_HZ), 2), RATE_HZ))
    np.testing.assert_allclose(texture.model(1.0, 0.1)[0], joined, atol=1e-9)
    cut = AnalysisWindows(part.acceleration_m_s2, part.force_N, part.speed_m_s, 2 * part.start)  # no two are neighbours
    lags = [autocorrelation(tapered(row, RATE_HZ), 2) for row in part.acceleration_m_s2]
    np.testing.assert_allclose(
        fit_texture(cut, RATE_HZ, 2, 1).model(1.0, 0.1)[0], solve(smoothed(np.sum(lags, axis=0), RATE_HZ)), atol=1e-9
    )


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_power_of_the_recording_is_preserved(count):
    rng = np.random.default_rng(0)
    force, speed = rng.uniform(0.5, 2.0, 60), rng.uniform(0.05, 0.3, 60)
    part = pieces(force, speed, power=force * speed**2)
    texture = fit_texture(part, RATE_HZ, 2, count)
    assert texture.power(force, speed).mean() == pytest.approx(np.mean(part.acceleration_m_s2**2), rel=1e-9)


def test_filters_and_powers_per_speed():
    """The power does not follow the level law: it is highest in between."""
    known = (0.1, 200.0, 1.0), (0.2, 300.0, 25.0), (0.3, 500.0, 4.0)
    texture = fit_texture(pieces(np.ones(60), *np.repeat(known, 20, axis=0).T), RATE_HZ, 2, 3)
    for speed, f, p in known:
        a, variance = texture.model(1.0, speed)
        np.testing.assert_allclose(a, filter_of(f), atol=0.06)
        assert variance * power_gain(a) == pytest.approx(p, rel=0.15)


def test_the_number_of_models_is_that_of_different_spectra():
    same = pieces(np.ones(40), np.tile([0.1, 0.3], 20), 300.0)
    assert choose_model_count(same, RATE_HZ, 2) == 1
    speed = np.tile([0.1, 0.3], 20)
    other = pieces(np.ones(40), speed, np.where(speed < 0.2, 200.0, 500.0))
    assert choose_model_count(other, RATE_HZ, 2) == 2
    still = pieces(np.ones(40), np.full(40, 0.1), np.where(speed < 0.2, 200.0, 500.0))
    assert choose_model_count(still, RATE_HZ, 2) == 1  # nothing tells where the second would stand
    assert choose_model_count(other[:7], RATE_HZ, 2) == 1  # three pieces are too few for one model


def test_no_model_becomes_silent():
    """A quiet cluster among loud ones keeps at least a tenth of the power of the level law."""
    power = np.where(SLOW_AND_FAST < 0.2, 1e-6, 100.0)
    texture = fit_texture(pieces(np.ones(40), SLOW_AND_FAST, 300.0, power), RATE_HZ, 2, 2)
    quiet, loud = texture.power(np.ones(2), np.array([0.1, 0.3]))
    assert 1e-7 < quiet < 0.2 * loud and loud == pytest.approx(100.0, rel=0.15)


def test_a_short_stroke_over_one_surface_gets_one_model():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        force, speed = rng.uniform(1.4, 1.6, 30), rng.uniform(0.14, 0.16, 30)
        assert choose_model_count(pieces(force, speed, seed=seed), RATE_HZ, 4) == 1


def test_the_level_is_extrapolated():
    """Power proportional to force^0.5 speed^2 up to 1 N and 0.1 m/s: at twice both, the level is 7.5 dB higher."""
    rng = np.random.default_rng(4)
    force, speed = rng.uniform(0.2, 1.0, 200), rng.uniform(0.02, 0.1, 200)
    texture = fit_texture(pieces(force, speed, power=force**0.5 * speed**2), RATE_HZ, 2, 1)
    edge, far = texture.power(np.array([1.0, 2.0]), np.array([0.1, 0.2]))
    assert 10.0 * np.log10(far / edge) == pytest.approx(7.5, abs=0.5)
    assert texture.exponents == pytest.approx([0.5, 2.0], abs=0.15)


def test_a_warped_texture_has_the_recordings_power_and_spectrum():
    part = pieces(np.ones(60), np.full(60, 0.1), power=4.0)
    texture = fit_texture(part, RATE_HZ, 6, 1, warp=0.5)
    assert texture.warp == 0.5 and texture.power([1.0], [0.1])[0] == pytest.approx(np.mean(part.acceleration_m_s2**2))
    frequency = np.arange(50.0, 900.0, 10.0)
    truth = model_spectrum(filter_of(300.0), 1.0, RATE_HZ, frequency)
    found = texture.density([1.0], [0.1], frequency_Hz=frequency)[0]
    assert log_spectral_distance(found, truth, frequency) < 1.0
