"""Spectrograms and the spectrogram error."""

import numpy as np
import pytest

from hapscene.dsp.spectrogram import decibels, row_of, spectrogram
from hapscene.errors import HandleError
from hapscene.handle import spectrogram_error


def test_error_of_no_output_and_of_a_gain() -> None:
    noise = np.random.default_rng(0).standard_normal(20_000)
    assert spectrogram_error(noise, 0.0 * noise, 1e4) == 1.0
    assert spectrogram_error(noise, noise, 1e4) == 0.0
    assert spectrogram_error(noise, 1.3 * noise, 1e4) == pytest.approx(0.3)
    assert spectrogram_error(noise, -0.7 * noise, 1e4) == pytest.approx(0.3)


def test_a_sine_has_half_its_amplitude_at_its_frequency() -> None:
    """A Hann window of whole periods gives a quarter at both neighbours and nothing elsewhere."""
    signal = 2.0 * np.sin(2.0 * np.pi * 200.0 * np.arange(1000) / 1000.0)
    time_s, frequency_Hz, magnitude = spectrogram(signal, 1000.0)
    np.testing.assert_allclose(time_s, np.arange(1, 40) * 0.025)
    np.testing.assert_allclose(frequency_Hz, np.arange(26) * 20.0)
    want = np.zeros(26)
    want[9:12] = 0.5, 1.0, 0.5
    np.testing.assert_allclose(magnitude, np.tile(want, (39, 1)), atol=1e-12)
    assert len(spectrogram(signal[:50], 1000.0)[0]) == len(spectrogram(signal[:74], 1000.0)[0]) == 1
    assert decibels(np.array([0.0, 1.0, 10.0])).tolist() == [-180.0, 0.0, 20.0]


def test_frequencies_outside_the_band_do_not_count() -> None:
    t = np.arange(20_000) / 1e4
    inside, outside = np.sin(2 * np.pi * 200.0 * t), np.sin(2 * np.pi * 3000.0 * t)
    assert spectrogram_error(inside, inside + outside, 1e4) < 1e-3
    both = inside + np.sin(2 * np.pi * 100.0 * t)  # 100 and 120 Hz of its three, 180 and 200 Hz of the other's
    assert spectrogram_error(inside, both, 1e4, band_Hz=(100.0, 200.0)) == pytest.approx(1.0)


def test_unequal_silent_and_short_signals_are_refused() -> None:
    noise = np.random.default_rng(0).standard_normal(2000)
    with pytest.raises(HandleError, match="shapes"):
        spectrogram_error(noise, noise[1:], 1e4)
    with pytest.raises(HandleError, match="power"):
        spectrogram_error(0.0 * noise, noise, 1e4)
    with pytest.raises(HandleError, match="too short"):
        spectrogram_error(noise[:99], noise[:99], 1e4)


@pytest.mark.parametrize("rate_Hz", [0.0, -1e4, np.nan, np.inf, 79.9])
def test_invalid_sample_rates_are_refused(rate_Hz: float) -> None:
    with pytest.raises(HandleError, match="rate_Hz"):
        spectrogram_error(np.ones(1000), np.ones(1000), rate_Hz)


@pytest.mark.parametrize("signal", ["abc", 1.0, np.ones((2, 1000)), np.full(1000, np.nan), np.ones(1000) * 1j, None])
def test_invalid_signals_are_refused(signal: object) -> None:
    with pytest.raises(HandleError):
        spectrogram_error(np.sin(np.arange(1000.0)), signal, 1e4)  # type: ignore[arg-type]


@pytest.mark.parametrize("values", [[], [1, 2], [True], (1.5, np.nan), np.float32([1.0, 2.0]), range(3)])
def test_rows_of_numbers_are_signals(values: object) -> None:
    row = row_of(values, "a")  # type: ignore[arg-type]
    assert row.dtype == np.float64
    np.testing.assert_array_equal(row, np.asarray(values))


@pytest.mark.parametrize("values", ["12", ["1"], None, [None], 3.0, [[1.0]], [[1], [1, 2]], [1j], {"a": 1}, [{}]])
def test_other_values_are_refused(values: object) -> None:
    with pytest.raises(HandleError, match="acceleration"):
        row_of(values, "acceleration")  # type: ignore[arg-type]
