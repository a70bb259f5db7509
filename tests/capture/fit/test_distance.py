"""Metrics on signals whose answer is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.fit import distance as metric
from hapscene.errors import CaptureError


def test_distance_of_shape_and_level() -> None:
    frequency = np.linspace(0.0, 5000.0, 1001)
    flat = np.ones_like(frequency)
    assert metric.log_spectral_distance(2.0 * flat, flat, frequency) == pytest.approx(0.0, abs=1e-12)
    assert metric.log_spectral_distance(2.0 * flat, flat, frequency, level=True) == pytest.approx(3.0103, abs=1e-4)
    wavy = 10.0 ** (0.1 * np.where(np.arange(1001) % 2 == 0, 3.0, -3.0))
    assert metric.log_spectral_distance(wavy, flat, frequency) == pytest.approx(3.0, rel=1e-3)
    outside = np.where((frequency < 20.0) | (frequency > 1000.0), 100.0, 1.0)
    assert metric.log_spectral_distance(outside, flat, frequency) == 0.0


def test_model_spectrum_sums_to_the_power() -> None:
    a = np.array([1.0, -0.9])
    frequency = (np.arange(10_000) + 0.5) * 0.05  # to 500 Hz
    density = metric.model_spectrum(a, 2.0, 1000.0, frequency)
    assert density.sum() * 0.05 == pytest.approx(2.0 / (1 - 0.81), rel=1e-4)


def test_spectrum_level_and_centroid_of_a_tone() -> None:
    t = np.arange(50_000) / 5000.0
    tone = 3.0 * np.sin(2 * np.pi * 250.0 * t)
    frequency, density = metric.spectrum(tone, 5000.0)
    assert density.sum() * frequency[1] == pytest.approx(4.5, rel=1e-3)
    assert metric.spectral_centroid_Hz(density, frequency) == pytest.approx(250.0, rel=0.01)
    assert metric.level_difference_dB(2.0 * tone, tone) == pytest.approx(6.0206, abs=1e-4)


def test_goodness_of_fit_is_the_cosine_between_spectra() -> None:
    frequency = np.linspace(0.0, 2000.0, 2001)
    low = np.exp(-((frequency - 200.0) ** 2) / 200.0)
    high = np.exp(-((frequency - 700.0) ** 2) / 200.0)
    assert metric.goodness_of_fit(low, low, frequency) == pytest.approx(1.0, abs=1e-12)
    assert metric.goodness_of_fit(low, 1e-9 * low, frequency) == pytest.approx(1.0, abs=1e-12)
    assert metric.goodness_of_fit(low, high, frequency) == pytest.approx(0.0, abs=1e-12)
    assert metric.goodness_of_fit(low, low + high, frequency) == pytest.approx(np.sqrt(0.5), abs=1e-9)
    assert metric.goodness_of_fit(low + high, low, frequency) == metric.goodness_of_fit(low, low + high, frequency)
    assert metric.goodness_of_fit(0 * low, low, frequency) == 0.0


@pytest.mark.parametrize("scale", [1e-200, 1e-160, 1e200])
def test_goodness_of_fit_does_not_know_the_level_however_small(scale: float) -> None:
    frequency = np.arange(20.0, 1000.0, 10.0)
    one, two = 1.0 + np.sin(frequency / 50.0) ** 2, 1.0 + np.cos(frequency / 70.0) ** 2
    plain = metric.goodness_of_fit(one, two, frequency)
    assert metric.goodness_of_fit(scale * one, two, frequency) == pytest.approx(plain)
    assert metric.goodness_of_fit(scale * one, scale * two, frequency) == pytest.approx(plain)


def test_spectrogram_error_of_nothing_of_a_gain_and_of_other_noise() -> None:
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(100_000)
    assert metric.spectrogram_error(noise, noise, 5000.0) == 0.0
    assert metric.spectrogram_error(noise, 0.0 * noise, 5000.0) == pytest.approx(1.0)
    assert metric.spectrogram_error(noise, 1.25 * noise, 5000.0) == pytest.approx(0.25)
    assert metric.spectrogram_error(noise, -noise, 5000.0) == pytest.approx(0.0)
    other = rng.standard_normal(100_000)
    assert metric.spectrogram_error(noise, other, 5000.0) == pytest.approx(np.sqrt(2 - np.pi / 2), rel=0.01)
    with pytest.raises(CaptureError, match="one length"):
        metric.spectrogram_error(noise, noise[1:], 5000.0)
    with pytest.raises(CaptureError, match="silent"):
        metric.spectrogram_error(0.0 * noise, noise, 5000.0)
    with pytest.raises(CaptureError, match="shorter than a window"):
        metric.spectrogram_error(noise[:99], noise[:99], 5000.0)


def test_spectrogram_of_a_tone_peaks_at_half_its_amplitude() -> None:
    t = np.arange(10_000) / 5000.0
    time, frequency, magnitude = metric.spectrogram(3.0 * np.sin(2 * np.pi * 240.0 * t), 5000.0)
    assert magnitude.shape == (len(time), len(frequency)) and time[0] == 0.025 and time[1] == 0.05
    assert frequency[np.argmax(magnitude.mean(axis=0))] == pytest.approx(240.0)
    assert magnitude.max() == pytest.approx(1.5, rel=1e-3)


def test_band_power_adds_up_and_cuts_bins() -> None:
    frequency = np.linspace(0.0, 2500.0, 251)
    flat = np.full(251, 2.0)
    power = metric.band_power(flat, frequency)
    edges = np.array(metric.BAND_EDGES_HZ)
    assert power == pytest.approx(2.0 * np.diff(edges), rel=1e-12)
    assert edges[[0, -1]] == pytest.approx([20.0, 1000.0])
    assert metric.band_power(frequency, frequency, [15.0, 25.0]) == pytest.approx([0.5 * (25.0**2 - 15.0**2)])
    assert metric.band_power(flat, frequency, [2400.0, 9000.0]) == pytest.approx([200.0])


# What a model leaves of a signal, on signals that the model made.


A = np.array([1.0, -1.5, 0.8])


def made(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Noise, and what the model makes of it."""
    noise = np.random.default_rng(seed).standard_normal(count)
    return noise, np.asarray(lfilter([1.0], A, noise))


def test_the_residual_is_the_excitation() -> None:
    noise, signal = made(2000)
    assert metric.residual(A, signal) == pytest.approx(noise[2:], abs=1e-10)
    with pytest.raises(CaptureError, match="too few"):
        metric.residual(A, signal[:3])


def test_liveliness_of_a_tone_that_comes_and_goes() -> None:
    t = np.arange(40_000) / 5000.0
    depth = 0.5
    gain = 1.0 + depth * np.sin(2.0 * np.pi * 5.0 * t)
    lively = metric.liveliness(3.0 * gain * np.sin(2.0 * np.pi * 200.0 * t), 5000.0)
    assert lively.modulation == pytest.approx(depth / np.sqrt(2.0), rel=0.02)
    assert lively.crest == pytest.approx(1.5 * np.sqrt(2.0 / (1.0 + 0.5 * depth**2)), rel=0.02)
    power = (gain**2).reshape(-1, 250).mean(axis=1)
    assert lively.spread_dB == pytest.approx(np.std(10.0 * np.log10(power)), rel=0.02)
    steady = metric.liveliness(np.sin(2.0 * np.pi * 200.0 * t) + np.sin(2.0 * np.pi * 1800.0 * t), 5000.0)
    assert steady.modulation < 0.01 and steady.spread_dB < 0.1  # what is not felt does not count
    assert steady.crest < 1.7  # 2 with what is not felt; the ends ring a little
    with pytest.raises(CaptureError, match=r"0\.10 s are too few"):
        metric.liveliness(t[:500], 5000.0)


def test_a_long_signals_spectrum_is_taken_part_by_part(monkeypatch: pytest.MonkeyPatch) -> None:
    signal = np.random.default_rng(5).standard_normal(20_000)
    whole = metric.spectrum(signal, 2000.0)[1]
    monkeypatch.setattr(metric, "WINDOWS", 7)
    assert metric.spectrum(signal, 2000.0)[1] == pytest.approx(whole, rel=1e-9)
