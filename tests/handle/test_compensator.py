from typing import Any

import numpy as np
import pytest
from scipy.signal import bilinear, freqz

from hapscene.handle import Plant
from hapscene.handle.compensator import BUTTERWORTH, COUNT, CRITICAL, integrals, retune, weights

RATE_HZ = 10_000.0


def impulse_responses(corner_Hz: float, damping: tuple[float, float], count: int = 60_000) -> Any:
    g, state = np.tan(np.pi * corner_Hz / RATE_HZ), np.zeros(6)
    return np.array([integrals(state, g, *damping, 1.0 if k == 0 else 0.0) for k in range(count)])


@pytest.mark.parametrize("damping", [CRITICAL, BUTTERWORTH])
def test_the_inverse_is_tustin_of_its_formula(damping: tuple[float, float]) -> None:
    """den(s)/(m_c D(s)), by SciPy's bilinear transform, at frequencies of the band."""
    corner_Hz = 5.0
    omega = 2.0 * RATE_HZ * np.tan(np.pi * corner_Hz / RATE_HZ)  # the corner is kept where it was asked for
    d = np.convolve([1, damping[0] * omega, omega**2], [1, damping[1] * omega, omega**2])
    scaled = weights(Plant(), corner_Hz) * omega ** np.arange(COUNT)
    numerator, denominator = bilinear(scaled, d, RATE_HZ)
    frequency = np.array([20.0, 50.0, 200.0, 1000.0])
    _, wanted = freqz(numerator, denominator, worN=frequency, fs=RATE_HZ)
    h = impulse_responses(corner_Hz, damping) @ weights(Plant(), corner_Hz)
    got = np.exp(-2j * np.pi * frequency[:, None] * np.arange(len(h)) / RATE_HZ) @ h
    assert np.abs(got / wanted - 1.0).max() < 1e-6


def test_constant_acceleration_asks_for_a_finite_force() -> None:
    g, state = np.tan(np.pi * 5.0 / RATE_HZ), np.zeros(6)
    for _ in range(100_000):
        phi = integrals(state, g, *CRITICAL, 1.0)
    assert phi == pytest.approx((0.0, 0.0, 0.0, 0.0, 1.0), abs=1e-9)


@pytest.mark.parametrize("ratio", [0.8, 1.25])
def test_a_changed_corner_frequency_makes_no_step(ratio: float) -> None:
    g, state = np.tan(np.pi * 5.0 / RATE_HZ), np.zeros(6)
    x = np.sin(2.0 * np.pi * 100.0 * np.arange(5000) / RATE_HZ)
    largest = np.abs([integrals(state, g, *BUTTERWORTH, sample) for sample in x[:-1]]).max(axis=0)
    other = state.copy()
    retune(other, ratio)
    step = np.array(integrals(other, ratio * g, *BUTTERWORTH, x[-1])) / ratio ** np.arange(COUNT)
    step -= integrals(state, g, *BUTTERWORTH, x[-1])
    assert (np.abs(step) / largest < [0.05, 2e-3, 2e-5, 2e-5, 2e-8]).all()
