"""Frequency-warped linear prediction of known models."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from hapscene.dsp.ar_filter import ar_from_reflection, power_response
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, solve, solve_orders
from hapscene.dsp.warped_prediction import lag_count, predictor, warp_at, warped, warped_angle

WARP = 0.75
A = ar_from_reflection(np.random.default_rng(0).uniform(-0.6, 0.6, 8))
OMEGA = np.linspace(0.0, np.pi, (1 << 14) + 1)
LAGS = np.fft.irfft(power_response(A, OMEGA, WARP))[:1000]  # of the process that 1/A(D) makes of white noise


def test_the_warped_angle_is_the_phase_of_the_allpass() -> None:
    _, response = freqz([-WARP, 1.0], [1.0, -WARP], worN=OMEGA[1:-1])
    assert warped_angle(OMEGA[1:-1], WARP) == pytest.approx(-np.unwrap(np.angle(response)), abs=1e-9)
    assert warped_angle(OMEGA, 0.0) == pytest.approx(OMEGA)


def test_a_known_warped_model_is_recovered() -> None:
    assert len(LAGS) > lag_count(8, WARP)
    assert solve(warped(LAGS, 8, WARP)) == pytest.approx(A, abs=1e-6)
    assert np.array_equal(warped(LAGS, 8, 0.0), LAGS[:9])


def test_the_residual_is_the_innovation() -> None:
    """Kolmogorov 1941: its power is the geometric mean of the spectrum; and it is the chain's, sample by sample."""
    taps = predictor(A, WARP)
    new = np.exp(np.trapezoid(np.log(power_response(A, OMEGA, WARP)), OMEGA) / np.pi)
    assert taps[0] == 1.0 and len(taps) == lag_count(8, WARP) + 1
    assert residual_power(taps, LAGS) == pytest.approx(new, rel=1e-6)
    signal = np.random.default_rng(1).standard_normal(3000)
    chain, past = np.zeros(3000), signal
    for weight in A:
        chain += weight * past
        past = lfilter([-WARP, 1.0], [1.0, -WARP], past)
    assert lfilter(taps, [1.0], signal) * chain[0] / signal[0] == pytest.approx(chain, abs=1e-9)


def test_the_allpass_coefficient_depends_on_the_sample_rate() -> None:
    assert warp_at(10_000.0) == pytest.approx(0.75, abs=1e-4) and warp_at(2000.0) == warp_at(100.0) == 0.0
    middle = [warped_angle(2.0 * np.pi * 451.67 / rate, warp_at(rate)) for rate in (5000.0, 10_000.0, 44_100.0)]
    assert middle == pytest.approx([0.5 * np.pi] * 3)


def test_all_orders_at_once_equal_single_orders() -> None:
    r = autocorrelation(lfilter([1.0], [1.0, -1.6, 0.9], np.random.default_rng(2).standard_normal(4000)), 12)
    for order, row in enumerate(solve_orders(r), 1):
        assert row[: order + 1] == pytest.approx(solve(r[: order + 1]), abs=1e-9) and not row[order + 1 :].any()


def test_long_signals_are_processed_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    signal = np.random.default_rng(3).standard_normal(1000)
    whole = autocorrelation(signal, 30)
    monkeypatch.setattr("hapscene.dsp.linear_prediction.LONG", 64)
    assert autocorrelation(signal, 30) == pytest.approx(whole, abs=1e-9)
