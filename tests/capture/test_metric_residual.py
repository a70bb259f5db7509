"""What a model leaves of a signal, on signals that the model made."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from hapscene.capture import metric_residual
from hapscene.errors import CaptureError

A = np.array([1.0, -1.5, 0.8])


def made(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Noise, and what the model makes of it."""
    noise = np.random.default_rng(seed).standard_normal(count)
    return noise, np.asarray(lfilter([1.0], A, noise))


def test_the_residual_is_the_excitation() -> None:
    noise, signal = made(2000)
    assert metric_residual.residual(A, signal) == pytest.approx(noise[2:], abs=1e-10)
    with pytest.raises(CaptureError, match="too few"):
        metric_residual.residual(A, signal[:3])


def test_variance_ratio_of_a_known_model() -> None:
    noise, signal = made(400_000)
    gain = (1 + 0.8) / ((1 - 0.8) * ((1 + 0.8) ** 2 - 1.5**2))  # power gain of an AR(2), Box & Jenkins 1970
    assert metric_residual.variance_ratio(A, signal) == pytest.approx(1 / gain, rel=0.02)
    assert metric_residual.variance_ratio([1.0], signal) == pytest.approx(1.0)
    assert metric_residual.variance_ratio(A, noise) > 1.0


def test_correlation_of_a_first_order_model_falls_geometrically() -> None:
    signal = lfilter([1.0], [1.0, -0.7], np.random.default_rng(1).standard_normal(400_000))
    assert metric_residual.correlation(signal, 5) == pytest.approx(0.7 ** np.arange(1, 6), abs=0.01)


def test_ljung_box_by_hand_and_against_chance() -> None:
    x = np.array([1.0, -2.0, 3.0, 0.5, -1.5, 2.0, -2.5, 0.5])
    d = x - x.mean()
    rho = np.array([np.sum(d[k:] * d[:-k]) for k in (1, 2, 3)]) / np.sum(d**2)
    q = 8 * 10 * np.sum(rho**2 / (8 - np.array([1, 2, 3])))
    test = metric_residual.ljung_box(x, 3, fitted=1)
    assert test.statistic == pytest.approx(q)
    assert test.freedom == 2 and test.p_value == pytest.approx(np.exp(-q / 2))  # χ² of 2 degrees in closed form
    rng = np.random.default_rng(0)
    p = [metric_residual.ljung_box(rng.standard_normal(2000), 20).p_value for _ in range(1000)]
    assert stats.kstest(p, "uniform").pvalue > 0.01
    assert metric_residual.ljung_box(made(2000)[1]).p_value < 1e-12
    with pytest.raises(CaptureError, match="lags"):
        metric_residual.ljung_box(x, 8)


def test_kurtosis_of_known_distributions() -> None:
    rng = np.random.default_rng(0)
    assert metric_residual.excess_kurtosis(rng.standard_normal(200_000)) == pytest.approx(0.0, abs=0.05)
    assert metric_residual.excess_kurtosis(rng.laplace(size=400_000)) == pytest.approx(3.0, abs=0.3)
    assert metric_residual.excess_kurtosis([1.0, -1.0] * 50) == pytest.approx(-2.0)
