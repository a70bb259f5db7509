"""Spectrograms and the spectrogram error."""

import numpy as np
import pytest

from hapscene.dsp.spectrogram import row_of
from hapscene.errors import HandleError
from hapscene.handle import spectrogram_error


def test_error_of_no_output_and_of_a_gain() -> None:
    noise = np.random.default_rng(0).standard_normal(20_000)
    assert spectrogram_error(noise, 0.0 * noise, 1e4) == 1.0
    assert spectrogram_error(noise, noise, 1e4) == 0.0
    assert spectrogram_error(noise, 1.3 * noise, 1e4) == pytest.approx(0.3)
    assert spectrogram_error(noise, -0.7 * noise, 1e4) == pytest.approx(0.3)


def test_frequencies_outside_the_band_do_not_count() -> None:
    t = np.arange(20_000) / 1e4
    inside, outside = np.sin(2 * np.pi * 200.0 * t), np.sin(2 * np.pi * 3000.0 * t)
    assert spectrogram_error(inside, inside + outside, 1e4) < 1e-3


def test_unequal_silent_and_short_signals_are_refused() -> None:
    noise = np.random.default_rng(0).standard_normal(2000)
    with pytest.raises(HandleError, match="shapes"):
        spectrogram_error(noise, noise[1:], 1e4)
    with pytest.raises(HandleError, match="power"):
        spectrogram_error(0.0 * noise, noise, 1e4)
    with pytest.raises(HandleError, match="too short"):
        spectrogram_error(noise[:99], noise[:99], 1e4)


@pytest.mark.parametrize("rate_Hz", [0.0, -1e4, np.nan, np.inf, 10.0])
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
