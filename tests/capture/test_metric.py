"""Metrics on signals whose answer is known."""

import numpy as np
import pytest

from hapscene.capture import metric


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
