"""Linear prediction by the autocorrelation method."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import (
    SMOOTHING_HZ,
    TAPER_S,
    autocorrelation,
    residual_power,
    smoothed,
    solve,
    tapered,
)

RATE_HZ = 5000.0
A = np.convolve([1.0, -1.7, 0.9], [1.0, -1.1, 0.8])


@pytest.mark.parametrize(("count", "lag_max"), [(7, 3), (8, 20), (300, 299), (1000, 24)])
def test_autocorrelation_is_the_sum_of_products_and_zero_outside(count: int, lag_max: int) -> None:
    signal = np.random.default_rng(count).standard_normal((2, count))
    padded = np.pad(signal, ((0, 0), (0, lag_max)))
    sums = [[padded[i, :count] @ padded[i, lag : lag + count] for lag in range(lag_max + 1)] for i in (0, 1)]
    np.testing.assert_allclose(autocorrelation(signal, lag_max), sums, atol=1e-10)


def test_a_model_is_recovered_from_its_autocorrelation() -> None:
    impulse = lfilter([1.0], A, np.append(1.0, np.zeros(20_000)))
    r = autocorrelation(impulse, 4)
    np.testing.assert_allclose(solve(r), A, atol=1e-4)  # −90 dB of white noise
    assert residual_power(A, r) == pytest.approx(1.0) and r[0] == pytest.approx(power_gain(A))


def test_residual_power_is_that_of_the_filtered_signals() -> None:
    rng = np.random.default_rng(1)
    signal, a = rng.standard_normal((3, 100)), np.stack([A, A[::-1] / A[-1], np.eye(5)[0]])
    filtered = [np.convolve(x, one) for x, one in zip(signal, a, strict=True)]
    np.testing.assert_allclose(residual_power(a, autocorrelation(signal, 9)), np.sum(np.square(filtered), axis=1))


def test_smoothing_widens_a_line_to_a_gaussian() -> None:
    lag, line_Hz = np.arange(2000), 600.0
    r = smoothed(np.cos(2.0 * np.pi * line_Hz / RATE_HZ * lag), RATE_HZ)
    assert r[0] == 1.0
    density = np.fft.rfft(np.concatenate([r, r[-2:0:-1]])).real
    frequency = np.fft.rfftfreq(2 * len(lag) - 2, 1.0 / RATE_HZ)
    mean = np.average(frequency, weights=density)
    spread = np.sqrt(np.average((frequency - mean) ** 2, weights=density))
    assert (mean, spread) == pytest.approx((line_Hz, SMOOTHING_HZ), rel=1e-3)


@pytest.mark.parametrize("count", [5000, 60])
def test_only_the_ends_are_faded(count: int) -> None:
    weight = tapered(np.ones((2, count)), RATE_HZ)[0]
    faded = min(round(TAPER_S * RATE_HZ), count // 4)
    assert np.all(weight[faded:-faded] == 1.0) and np.all(weight == weight[::-1])
    np.testing.assert_allclose(np.diff(np.arccos(1.0 - 2.0 * weight[:faded])), np.pi / faded)
    assert 0.0 < weight[0] < 0.01 and tapered(np.ones(3), RATE_HZ).tolist() == [1.0, 1.0, 1.0]
