"""Metrics on signals whose answer is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.fit import distance as spectral
from hapscene.errors import CaptureError


def test_distance_of_shape_and_level() -> None:
    frequency = np.linspace(0.0, 5000.0, 1001)
    flat = np.ones_like(frequency)
    assert spectral.log_spectral_distance(2.0 * flat, flat, frequency) == pytest.approx(0.0, abs=1e-12)
    wavy = 10.0 ** (0.1 * np.where(np.arange(1001) % 2 == 0, 3.0, -3.0))
    assert spectral.log_spectral_distance(wavy, flat, frequency) == pytest.approx(3.0, rel=1e-3)
    outside = np.where((frequency < 20.0) | (frequency > 1000.0), 100.0, 1.0)
    assert spectral.log_spectral_distance(outside, flat, frequency) == 0.0


def test_model_spectrum_sums_to_the_power() -> None:
    a = np.array([1.0, -0.9])
    frequency = (np.arange(10_000) + 0.5) * 0.05  # to 500 Hz
    density = spectral.model_spectrum(a, 2.0, 1000.0, frequency)
    assert density.sum() * 0.05 == pytest.approx(2.0 / (1 - 0.81), rel=1e-4)


def test_spectrum_and_level_of_a_tone() -> None:
    t = np.arange(50_000) / 5000.0
    tone = 3.0 * np.sin(2 * np.pi * 250.0 * t)
    frequency, density = spectral.spectrum(tone, 5000.0)
    assert density.sum() * frequency[1] == pytest.approx(4.5, rel=1e-3)
    assert spectral.level_difference_dB(2.0 * tone, tone) == pytest.approx(6.0206, abs=1e-4)


def test_band_power_adds_up_and_cuts_bins() -> None:
    frequency = np.linspace(0.0, 2500.0, 251)
    flat = np.full(251, 2.0)
    power = spectral.band_power(flat, frequency)
    edges = np.array(spectral.BAND_EDGES_HZ)
    assert power == pytest.approx(2.0 * np.diff(edges), rel=1e-12)
    assert edges[[0, -1]] == pytest.approx([20.0, 1000.0])
    assert spectral.band_power(frequency, frequency, [15.0, 25.0]) == pytest.approx([0.5 * (25.0**2 - 15.0**2)])
    assert spectral.band_power(flat, frequency, [2400.0, 9000.0]) == pytest.approx([200.0])


# What a model leaves of a signal, on signals that the model made.


A = np.array([1.0, -1.5, 0.8])


def made(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Noise, and the output of the model for this input."""
    noise = np.random.default_rng(seed).standard_normal(count)
    return noise, np.asarray(lfilter([1.0], A, noise))


def test_the_residual_is_the_excitation() -> None:
    noise, signal = made(2000)
    assert spectral.residual(A, signal) == pytest.approx(noise[2:], abs=1e-10)
    with pytest.raises(CaptureError, match="too few"):
        spectral.residual(A, signal[:3])


def test_modulation_depth_of_a_modulated_tone() -> None:
    t = np.arange(40_000) / 5000.0
    gain = 1.0 + 0.5 * np.sin(2.0 * np.pi * 5.0 * t)
    depth = spectral.modulation_depth(3.0 * gain * np.sin(2.0 * np.pi * 200.0 * t), 5000.0)
    assert depth == pytest.approx(0.5 / np.sqrt(2.0), rel=0.02)
    steady = np.sin(2.0 * np.pi * 200.0 * t) + np.sin(2.0 * np.pi * 1800.0 * t)
    assert spectral.modulation_depth(steady, 5000.0) < 0.01  # 1800 Hz is outside the band
    with pytest.raises(CaptureError):
        spectral.modulation_depth(t[:500], 5000.0)
    for count, step_Hz in ((40_000, 1.0), (2500, 2.0)):  # windows of 1 s, or the whole signal
        frequency, density = spectral.envelope_spectrum(steady[:count], 5000.0)
        assert frequency[[1, -1]].tolist() == [step_Hz, 50.0] and len(density) == len(frequency)


@pytest.mark.parametrize("count", [2500, 20_000])
def test_tonal_share_separates_tones_from_noise_and_resonances(count: int) -> None:
    t, noise = np.arange(count) / 5000.0, np.random.default_rng(2).standard_normal(count)
    pole = 0.99 * np.exp(2j * np.pi * 440.0 / 5000.0)  # a resonance with a width of 16 Hz
    resonance = np.asarray(lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], noise))
    assert spectral.tonal_share(np.sin(2.0 * np.pi * 440.0 * t) + 0.1 * noise, 5000.0) > 0.9
    assert spectral.tonal_share(noise, 5000.0) < (0.1 if count == 2500 else 0.01)  # of 0.5 s, or of windows of 1 s
    assert spectral.tonal_share(resonance, 5000.0) < 0.6
