"""H1 and coherence against known systems, against SciPy's csd and coherence, and how often the interval holds."""

import numpy as np
import pytest
from scipy.signal import coherence, csd, lfilter, welch

from hapscene.errors import HandleError
from hapscene.handle.measure import Response, estimate_response

RATE_HZ = 2000.0


def noisy(seed: int, noise: float, count: int = 40_000) -> tuple[np.ndarray, np.ndarray]:
    """White force through a filter of two taps, at rest before and after, and noise."""
    rng = np.random.default_rng(seed)
    force = np.concatenate([rng.standard_normal(count), np.zeros(1000)])
    return force, lfilter([2.0, -1.0], [1.0], force) + noise * rng.standard_normal(len(force))


def truth(response: Response) -> np.ndarray:
    at = response.frequency_Hz + np.array([[-1.0], [1.0]]) * response.spread_Hz
    return np.asarray((2.0 - np.exp(-2j * np.pi * at / RATE_HZ)).mean(axis=0))


def test_without_noise_it_is_the_system() -> None:
    response = estimate_response(*noisy(0, 0.0), RATE_HZ, band_Hz=(10.0, 800.0))
    np.testing.assert_allclose(response.response, truth(response), rtol=1e-4)
    assert response.coherence.min() > 1.0 - 1e-6
    assert response.frequency_Hz[0] < 10.5 and response.frequency_Hz[-1] > 780.0


def test_a_flat_system_has_the_h1_and_coherence_of_scipy() -> None:
    """Where the response does not change in a band, averaging over lines equals averaging over windows."""
    rng = np.random.default_rng(1)
    force = rng.standard_normal(200_000)
    acceleration = 3.0 * force + 2.0 * rng.standard_normal(len(force))
    response = estimate_response(force, acceleration, RATE_HZ, band_Hz=(100.0, 800.0))
    frequency, cross = csd(force, acceleration, RATE_HZ, nperseg=512)
    h1 = cross / welch(force, RATE_HZ, nperseg=512)[1]
    near = (frequency > 100.0) & (frequency < 800.0)
    assert np.mean(response.response).real == pytest.approx(np.mean(h1[near]).real, rel=5e-3)
    same = coherence(force, acceleration, RATE_HZ, nperseg=512)[1][near].mean()
    assert np.median(response.coherence) == pytest.approx(same, abs=0.01)
    assert same == pytest.approx(9.0 / 13.0, abs=0.01)


def test_coherence_and_deviation_agree_as_bendat_and_piersol_say() -> None:
    """s/|h| = ((1 − γ²)/(2 γ² (n − 2)))^½, where the line's own share is left out of γ²."""
    response = estimate_response(*noisy(2, 1.0), RATE_HZ, band_Hz=(50.0, 800.0))
    lines = response.freedom / 2.0
    expected = np.sqrt((1.0 - response.coherence) / (2.0 * response.coherence * lines))
    np.testing.assert_allclose(response.deviation / np.abs(response.response), expected, rtol=0.2)


@pytest.mark.parametrize(
    ("force", "acceleration", "word"),
    [
        (np.ones(4000), np.ones(3999), "length"),
        (np.ones(4000), np.full(4000, np.nan), "finite"),
        (np.ones(100), np.ones(100), "too short"),
        (np.zeros(40_000), np.ones(40_000), "force is 0"),
    ],
)
def test_unusable_recordings_are_refused(force: np.ndarray, acceleration: np.ndarray, word: str) -> None:
    with pytest.raises(HandleError, match=word):
        estimate_response(force, acceleration, RATE_HZ, band_Hz=(10.0, 800.0))
