"""Guided hands against hands that go their own way, in short; and that surfaces are what they are said to be."""

import numpy as np
import pytest

from hapscene.capture.coverage import FORCE_N, SPEED_M_S
from hapscene.capture.fit.synthesis import synthesize
from hapscene.surface.swatch import Swatch
from hapscene_experiments.coverage_case import HANDS, RATE_HZ, Missed, compared, missed, paired, recorded, surface


def test_a_guided_hand_for_10_s_beats_its_own_way_for_30_s() -> None:
    guided, own = (
        np.mean([missed(surface(seed), hand, seconds, seed) for seed in (0, 5)], axis=0)
        for hand, seconds in (("looks", 10.0), ("own way", 30.0))
    )
    assert guided[0] < own[0] and guided[1] < own[1]  # level and shape
    assert guided[2] > own[2]  # of the plane


def test_a_surface_has_the_level_that_it_says() -> None:
    texture = surface(3, life=0.0)
    for force, speed in ((FORCE_N[0], SPEED_M_S[1]), (1.0, 0.1)):
        heard = synthesize(Swatch("made", texture=texture), np.full(20_000, force), np.full(20_000, speed))
        power = texture.density([force], [speed], frequency_Hz=np.arange(0.0, 0.5 * RATE_HZ)).sum()
        assert 10.0 * np.log10(np.mean(heard**2) / power) == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize("hand", HANDS)
def test_hands_stay_in_what_hands_do(hand: str) -> None:
    recording, coverage = recorded(surface(0), hand, 4.0, 0)
    force, speed = recording.force_N, recording.speed_m_s
    assert force is not None and speed is not None and len(force) == 4 * RATE_HZ
    assert 0.08 < force.min() < force.max() < 8.0 and 0.0 < speed.min() < speed.max() < 0.9
    assert coverage.dropped == 0 and coverage.pieces.sum() > 20
    again, _ = recorded(surface(0), hand, 4.0, 0)
    np.testing.assert_array_equal(again.acceleration_m_s2, recording.acceleration_m_s2)


def test_what_is_told() -> None:
    assert paired(np.array([1.0, 2.0]), np.array([1.5, 2.5])) == "0.50 [0.50, 0.50], 2 of 2"
    rows = [Missed(2.0, 1.0, 0.9, 1.0)] * 2
    told = compared({("looks", 10.0): rows, ("own way", 30.0): [Missed(3.0, 1.5, 0.3, 2.0)] * 2})
    assert "| looks, 10 s, under own way, 30 s | 1.00 [1.00, 1.00], 2 of 2 | 0.50 [0.50, 0.50], 2 of 2 |" in told
