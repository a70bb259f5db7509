"""Just-noticeable differences, against what follows from their definitions."""

import math

import numpy as np
import pytest

from hapscene import perception
from hapscene.perception import band_edges_Hz, band_rms_m_s2, bands_jnd, force_jnd, vibration_least_m_s2

EDGES_HZ = band_edges_Hz()


def test_a_force_seven_percent_larger_or_turned_by_the_threshold_is_one_jnd_away() -> None:
    turn = math.radians(perception.DIRECTION_DEG)
    forces = [[0.0, 0.0, 2.14], [0.0, 2.0 * math.sin(turn), 2.0 * math.cos(turn)], [0.0, 0.0, 2.0]]
    np.testing.assert_allclose(force_jnd(forces, [[0.0, 0.0, 2.0]] * 3), [1.0, 1.0, 0.0], atol=1e-12)


def test_small_forces_are_judged_by_what_is_felt_of_them() -> None:
    least_N = perception.FORCE * perception.FORCE_LEAST_N
    assert force_jnd([0.0, 0.0, least_N], np.zeros(3)) == pytest.approx(1.0)
    assert force_jnd([0.0, 0.0, 1e-3], [0.0, 1e-3, 0.0]) < 0.1  # no direction is felt of nothing
    assert force_jnd([0.0, 0.0, 0.5 * least_N], [0.0, 0.0, -3.0 * least_N]) == pytest.approx(2.5)


def test_bands_hold_the_power_of_white_noise() -> None:
    signal = np.random.default_rng(15).standard_normal(400_000)
    wanted = np.sqrt(np.diff(EDGES_HZ) / 5000.0)
    np.testing.assert_allclose(band_rms_m_s2(signal, 10_000.0, EDGES_HZ), wanted, rtol=0.05)


def test_a_line_is_in_its_band() -> None:
    t_s = np.arange(40_000) / 10_000.0
    rms = band_rms_m_s2(np.sin(2.0 * np.pi * 250.0 * t_s), 10_000.0, EDGES_HZ)
    at = int(np.searchsorted(EDGES_HZ, 250.0)) - 1
    assert rms[at] == pytest.approx(math.sqrt(0.5), rel=1e-3) and np.delete(rms, at).max() < 5e-3


def test_a_band_takes_the_part_of_a_line_that_it_covers() -> None:
    """Lines of 5 Hz width: one at 10 Hz, one at half of the rate."""
    at = np.arange(40)
    line, fastest = np.cos(2.0 * np.pi * 0.1 * at), (-1.0) ** at
    rms = band_rms_m_s2(line, 100.0, [2.5, 7.5, 8.75, 10.0, 12.5, 17.5], "boxcar")
    np.testing.assert_allclose(rms, np.sqrt([0.0, 0.125, 0.125, 0.25, 0.0]), atol=1e-7)
    assert band_rms_m_s2(fastest, 100.0, [47.5, 50.0], "boxcar") == pytest.approx([math.sqrt(0.5)])
    assert vibration_least_m_s2([30.0, 300.0, 600.0]) == pytest.approx([0.1, 0.1, 0.4])


def test_two_decibels_in_every_band_are_one_jnd_and_what_is_not_felt_is_none() -> None:
    loud = 100.0 * vibration_least_m_s2(np.sqrt(EDGES_HZ[1:] * EDGES_HZ[:-1]))
    assert bands_jnd(loud * 10.0**0.1, loud, EDGES_HZ) == pytest.approx(1.0)
    assert bands_jnd(loud * 1e-3, loud * 5e-3, EDGES_HZ) == 0.0
