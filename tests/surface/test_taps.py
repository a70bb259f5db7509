"""Tap transients over approach speed: between, below and above the recorded speeds."""

from unittest.mock import ANY

import numpy as np
import pytest

from hapscene.errors import SwatchError
from hapscene.surface.taps import TAP_MAX, WAVE_MAX, Taps

TAPS = Taps([0.1, 0.3], [5.0, 20.0], [100.0, 140.0], [80.0, 60.0])


def test_arrays_are_copied_and_read_only() -> None:
    given = np.array([5.0, 20.0])
    taps = Taps([0.1, 0.3], given, [100.0, 140.0], [80.0, 60.0], np.ones((2, 1)), 500)
    given[0] = 9.0
    assert taps.amplitude_m_s2[0] == 5.0 and type(taps.wave_rate_Hz) is float
    for array in (taps.amplitude_m_s2, taps.wave_m_s2):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_largest_and_smallest_taps() -> None:
    speed = np.linspace(0.1, 1.0, TAP_MAX + 1)
    assert len(Taps(speed[1:], speed[1:] - speed[1], speed[1:], speed[1:]).approach_m_s) == TAP_MAX
    assert Taps(*[speed[:2]] * 4, np.zeros((2, WAVE_MAX)), 1000.0).waves_at(1000.0).shape == (2, WAVE_MAX)
    for rows, waves in ((speed, None), (speed[:2], np.zeros((2, 0))), (speed[:2], np.zeros((2, WAVE_MAX + 1)))):
        with pytest.raises(SwatchError, match="1 to"):
            Taps(rows, rows, rows, rows, waves, 0.0 if waves is None else 1000.0)
    with pytest.raises(SwatchError, match="shape"):
        Taps(speed[:4].reshape(2, 2), *[speed[:4].reshape(2, 2)] * 3)


def test_taps_are_interpolated() -> None:
    assert TAPS.at(0.1) == (5.0, 100.0, 80.0)
    assert TAPS.at(0.3) == (20.0, 140.0, 60.0)
    assert TAPS.at(0.2) == pytest.approx((12.5, 120.0, 70.0))


def test_taps_are_equal_by_value() -> None:
    same = Taps([0.1, 0.3], [5.0, 20.0], [100.0, 140.0], [80.0, 60.0])
    assert same == TAPS and hash(same) == hash(TAPS) and TAPS == ANY  # `ANY` decides
    assert Taps([0.1, 0.3], [5.0, 20.0], [100.0, 140.0], [80.0, 61.0]) != TAPS and TAPS != 5


def test_taps_outside_the_recorded_speeds() -> None:
    assert TAPS.at(0.05) == pytest.approx((2.5, 100.0, 80.0))
    assert TAPS.at(0.0).amplitude_m_s2 == 0.0
    assert TAPS.at(-1.0).amplitude_m_s2 == 0.0
    assert TAPS.at(float("nan")).amplitude_m_s2 == 0.0
    assert TAPS.at(5.0) == TAPS.at(0.3)
    assert TAPS.at(float("inf")) == TAPS.at(0.3)


@pytest.mark.parametrize(
    ("rows", "field"),
    [
        (([], [], [], []), ""),
        (([0.1, 0.1], [1, 1], [1, 1], [1, 1]), ""),
        (([0.0], [1], [1], [1]), "approach_m_s"),
        (([0.1], [-1], [1], [1]), "amplitude_m_s2"),
        (([0.1], [1], [np.nan], [1]), "frequency_Hz"),
        (([0.1], [1], [1], [1, 2]), "decay_1_s"),
    ],
)
def test_invalid_taps_are_rejected(rows: tuple[list[float], ...], field: str) -> None:
    with pytest.raises(SwatchError) as caught:
        Taps(*rows)
    assert field in str(caught.value)


WAVES = np.array([[0.0, 2.0, -1.0, 0.5], [0.0, 8.0, -4.0, 1.0]])
MEASURED = Taps([0.1, 0.3], [5.0, 20.0], [100.0, 140.0], [80.0, 60.0], WAVES, 1000.0)


def test_measured_transients_are_cross_faded_scaled_down_and_clamped() -> None:
    np.testing.assert_array_equal(MEASURED.transient(0.1, 1000.0), WAVES[0])
    np.testing.assert_allclose(MEASURED.transient(0.15, 1000.0), 0.75 * WAVES[0] + 0.25 * WAVES[1])
    np.testing.assert_allclose(MEASURED.transient(0.025, 1000.0), 0.25 * WAVES[0])
    for speed in (0.3, 5.0, float("inf")):
        np.testing.assert_array_equal(MEASURED.transient(speed, 1000.0), WAVES[1])
    for speed in (0.0, -1.0, float("nan")):
        assert not MEASURED.transient(speed, 1000.0).any()


def test_sinusoid_without_transients() -> None:
    wave = TAPS.transient(0.1, 2000.0)
    t_s = np.arange(len(wave)) / 2000.0
    np.testing.assert_allclose(wave, 5.0 * np.exp(-80.0 * t_s) * np.sin(2 * np.pi * 100.0 * t_s))
    assert len(wave) == 175 and len(Taps([0.1], [1.0], [9.0], [1e6]).transient(0.1, 2000.0)) == 1
    assert TAPS.waves_at(2000.0).shape == (2, 0)
    assert not TAPS.transient(0.1, 150.0).any()  # above the Nyquist frequency


def test_transients_at_another_rate_keep_their_shape() -> None:
    t_s = np.arange(100) / 1000.0
    wave = np.exp(-80.0 * t_s) * np.sin(2 * np.pi * 100.0 * t_s)
    taps = Taps([0.1], [1.0], [100.0], [80.0], wave[None], 1000.0)
    fine = taps.waves_at(10_000.0)[0]
    assert len(fine) == 1000 and taps.waves_at(1.0).shape == (1, 1) and taps.waves_at(500.0).shape == (1, 50)
    t_s = np.arange(1000) / 10_000.0
    np.testing.assert_allclose(fine, np.exp(-80.0 * t_s) * np.sin(2 * np.pi * 100.0 * t_s), atol=0.07)


@pytest.mark.parametrize(
    ("waves", "rate_Hz", "field"),
    [
        (WAVES[:1], 1000.0, "wave_m_s2"),
        (np.zeros((2, 5000)), 1000.0, "wave_m_s2"),
        (np.full((2, 3), np.nan), 1000.0, "wave_m_s2"),
        (WAVES, float("nan"), "wave_rate_Hz"),
        (WAVES, float("inf"), "wave_rate_Hz"),
        (WAVES, 0.0, "wave_rate_Hz"),
        (WAVES[0], 1000.0, "wave_m_s2"),
        (None, 1000.0, "wave_m_s2"),
    ],
)
def test_invalid_transients_are_rejected(waves: np.ndarray | None, rate_Hz: float, field: str) -> None:
    with pytest.raises(SwatchError, match=field):
        Taps([0.1, 0.3], [5.0, 20.0], [100.0, 140.0], [80.0, 60.0], waves, rate_Hz)
