"""Amplitude modulation: covariance, mean power and limits."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from hapscene.dsp.noise import normal, seeded_state
from hapscene.dsp.texture_voice import BOUND, advance_gain, log_power

ROWS = np.array([9.0, 0.3, 40.0, 0.0, 0.4, 0.0, 500.0, 0.2, 20.0, 200.0])  # three processes, from 1 on
SPREAD, DECAY_1_S, DECAY_1_M = ROWS[1:].reshape(3, 3).T


def log_gain(count: int, dt_s: float, dx_m: float, life: float = 1.0, seed: int = 0) -> np.ndarray:
    rng = seeded_state(seed, "gain")
    x, mean = np.array([normal(rng) for _ in range(3)]), np.zeros(2)
    return np.log([advance_gain(rng, x, ROWS, 1, 3, dt_s, dx_m, life, mean) for _ in range(count)])


def covariance(log: np.ndarray, lag: int) -> float:
    off = log + log_power(np.sqrt(np.sum(SPREAD**2)))  # its mean is known
    return float(np.mean(off[lag:] * off[: len(off) - lag]))


@pytest.mark.parametrize(("dt_s", "dx_m"), [(2e-3, 0.0), (0.0, 4e-4), (1e-3, 2e-4)])
def test_covariance_over_time_and_distance(dt_s: float, dx_m: float) -> None:
    """Σ σ² exp(−t/τ − x/ξ) at lags of 0 to 40 steps; what does not forget is held to its own. The bound takes 2 %."""
    made = [log_gain(40_000, dt_s, dx_m, seed=seed) for seed in range(5)]
    moving = DECAY_1_S * dt_s + DECAY_1_M * dx_m > 0.0
    for lag in (0, 3, 10, 40):
        want = SPREAD**2 * np.exp(-lag * (DECAY_1_S * dt_s + DECAY_1_M * dx_m))
        if moving.all():
            assert np.mean([covariance(log, lag) for log in made]) == pytest.approx(want.sum(), abs=0.01)
        else:
            got = [np.mean(log[lag:] * log[: len(log) - lag]) - np.mean(log) ** 2 for log in made]
            assert np.mean(got) == pytest.approx(want[moving].sum(), abs=0.01)


def test_the_mean_power_is_preserved() -> None:
    for life in (0.5, 1.0, 1.5):
        power = [np.exp(2.0 * log_gain(40_000, 5e-3, 1e-3, life, seed)).mean() for seed in range(5)]
        assert np.mean(power) == pytest.approx(1.0, abs=0.03)
    assert np.all(log_gain(100, 1e-3, 1e-3, 0.0) == 0.0)


@pytest.mark.parametrize("spread", [0.05, 0.3, 0.8, 1.5])
def test_the_gain_is_limited(spread: float) -> None:
    """Mean square of the limited gain, compared with numerical integration."""
    far = min(BOUND, 2.0 / spread)
    inside = quad(lambda z: np.exp(2.0 * spread * z) * norm.pdf(z), -far, far)[0]
    square = inside + 2.0 * np.cosh(2.0 * spread * far) * norm.sf(far)
    assert 2.0 * log_power(spread) == pytest.approx(np.log(square), abs=1e-9)
    log = log_gain(40_000, 5e-3, 1e-3, spread / np.sqrt(np.sum(SPREAD**2))) + log_power(spread)
    assert log.max() == pytest.approx(far * spread) == -log.min()
