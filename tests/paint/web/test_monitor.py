"""Level at which the touch of the simulated hand is played."""

import numpy as np
import pytest

import hapscene
from hapscene.paint.web.monitor import PEAK, RISE_S, Loudness
from hapscene.swatches.sound import FULL_SCALE_M_S2, swatch_sound

BLOCK_S = 0.015
COUNT = 150  # samples per block


@pytest.mark.parametrize("name", ["wood", "leather", "epoxy", "paper"])
def test_strokes_on_all_swatches_are_played_as_in_the_library(name: str) -> None:
    swatch, loudness = hapscene.load_swatch(name), Loudness()
    sound = swatch_sound(swatch)
    stroke = sound.a_m_s2[sound.start :]
    for start in range(0, len(stroke) - COUNT, COUNT):
        block = stroke[start : start + COUNT].reshape(15, 10)
        first, last = loudness.take(block, swatch, BLOCK_S)
        assert np.abs(block).max() * max(first, last) <= FULL_SCALE_M_S2
    assert abs(20 * np.log10(loudness.gain / sound.loudness_gain)) < 1.0
    assert loudness.rms_m_s2 == pytest.approx(np.sqrt(np.mean(block**2)))


def test_no_sample_clips_and_the_gain_returns_with_its_time_constant() -> None:
    loudness, silence = Loudness(), np.zeros((15, 10))
    loud = np.where(np.arange(150).reshape(15, 10) == 7, -10.0 * FULL_SCALE_M_S2, 0.0)
    assert loudness.take(loud, None, BLOCK_S) == pytest.approx((PEAK / 10, PEAK / 10))
    assert loudness.rms_m_s2 == pytest.approx(10.0 * FULL_SCALE_M_S2 / np.sqrt(150.0))
    back = (PEAK / 10) ** np.exp(-BLOCK_S / RISE_S)
    assert loudness.take(silence, None, BLOCK_S) == pytest.approx((PEAK / 10, back))
    assert loudness.take(silence[:0], None, 0.0) == pytest.approx((back, back)) and loudness.rms_m_s2 == 0.0
    assert str(loudness) == f"0 m/s² rms, played {20 * np.log10(back):+.0f} dB"


def test_gain_is_continuous_and_returns_after_the_contact() -> None:
    swatch, loudness, before = hapscene.load_swatch("leather"), Loudness(), 1.0
    for touched in [swatch] * 100 + [None] * 100:
        first, last = loudness.take(np.full((15, 10), 1e-3), touched, BLOCK_S)
        assert first == before
        before = last
        assert abs(np.log(last / first)) <= np.log(100.0) * BLOCK_S / RISE_S
    assert last == pytest.approx(1.0, rel=1e-3)
