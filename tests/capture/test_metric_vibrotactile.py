"""ST-SIM against the values of its authors' library, and where the answer is known."""

import numpy as np
import pytest

from hapscene.capture.metric_vibrotactile import st_sim, threshold_dB
from hapscene.errors import CaptureError

RATE = 8000.0
T = np.arange(4000) / RATE
TONES = 2.0 * np.sin(2 * np.pi * 150 * T) + 0.3 * np.sin(2 * np.pi * 610 * T + 1)


@pytest.mark.parametrize(
    ("distorted", "score"),  # by vibromaf 0.0.8, st_sim(distorted, reference)
    [
        (0.8 * TONES, 0.9974955253904332),
        (TONES + 0.5 * np.cos(2 * np.pi * 90 * T), 0.9799280321498682),
        (np.roll(TONES, 7), 0.739364649530086),
    ],
)
def test_the_scores_of_the_authors_library_come_out(distorted: np.ndarray, score: float) -> None:
    assert st_sim(distorted, TONES, RATE).score == pytest.approx(score, rel=1e-12)


def test_the_same_is_alike_and_the_opposite_is_not() -> None:
    assert st_sim(TONES, TONES, RATE) == pytest.approx((1.0, 1.0, 1.0))
    opposed = st_sim(-TONES, TONES, RATE)
    assert opposed.score == 0.0 and opposed.temporal == 0.0 and opposed.spectral == pytest.approx(1.0)


def test_other_noise_of_the_same_surface_is_alike_in_spectrum_only() -> None:
    rng = np.random.default_rng(0)
    one, other = rng.standard_normal((2, 50_000))
    same = st_sim(one, other, 5000.0)
    assert same.spectral > 0.9 and same.temporal < 0.05
    assert st_sim(0.01 * one, other, 5000.0).spectral < same.spectral - 0.1


def test_what_is_below_threshold_is_not_felt() -> None:
    hum = 1e-5 * np.sin(2 * np.pi * 250 * T)
    assert st_sim(TONES + hum, TONES, RATE).spectral == pytest.approx(1.0, abs=0.02)
    threshold = threshold_dB(RATE)
    assert threshold.min() == pytest.approx(-77.0, abs=0.01)
    assert np.argmin(threshold) * RATE / 1023 == pytest.approx(250.0, abs=RATE / 1023)


def test_signals_that_cannot_be_compared_are_refused() -> None:
    with pytest.raises(CaptureError, match="one length"):
        st_sim(TONES, TONES[:-1], RATE)
    with pytest.raises(CaptureError, match="512"):
        st_sim(TONES[:511], TONES[:511], RATE)
