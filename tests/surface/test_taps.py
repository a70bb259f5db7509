"""Taps over approach speed: between, below and beyond what was recorded."""

import numpy as np
import pytest

from hapscene.errors import SwatchError
from hapscene.surface.taps import Taps

TAPS = Taps([0.1, 0.3], [5.0, 20.0], [100.0, 140.0], [80.0, 60.0])


def test_at_the_speeds_and_between() -> None:
    assert TAPS.at(0.1) == (5.0, 100.0, 80.0)
    assert TAPS.at(0.3) == (20.0, 140.0, 60.0)
    assert TAPS.at(0.2) == pytest.approx((12.5, 120.0, 70.0))


def test_below_the_lowest_it_fades_and_beyond_the_highest_it_stays() -> None:
    assert TAPS.at(0.05) == pytest.approx((2.5, 100.0, 80.0))
    assert TAPS.at(0.0).amplitude_m_s2 == 0.0
    assert TAPS.at(-1.0).amplitude_m_s2 == 0.0
    assert TAPS.at(float("nan")).amplitude_m_s2 == 0.0
    assert TAPS.at(5.0) == TAPS.at(0.3)
    assert TAPS.at(float("inf")) == TAPS.at(0.3)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (([], [], [], []), "1 to 1024"),
        (([0.1, 0.1], [1, 1], [1, 1], [1, 1]), "ascend"),
        (([0.0], [1], [1], [1]), "approach_m_s must be finite and above 0"),
        (([0.1], [-1], [1], [1]), "not negative"),
        (([0.1], [1], [np.nan], [1]), "frequency_Hz must be finite"),
        (([0.1], [1], [1], [1, 2]), "decay_1_s must have shape"),
    ],
)
def test_what_does_not_fit_is_refused(rows: tuple[list[float], ...], message: str) -> None:
    with pytest.raises(SwatchError, match=message):
        Taps(*rows)
