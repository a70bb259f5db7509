"""A surface that squeals at times has two states; one that only comes and goes has one."""

import numpy as np
import pytest

from hapscene.capture import fit, metric, synthesize
from hapscene.capture.two_states import find_states
from hapscene_experiments.held_out import simulated


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_stone_that_squeals_at_times_is_known_by_when_it_does(seed: int) -> None:
    channels, squeals = simulated("squeal", 10.0, seed)
    states = find_states([channels])
    assert states is not None and states.gain > 30.0
    found = states.other[0] if squeals.mean() < 0.5 else ~states.other[0]
    assert np.mean(found == squeals) > 0.95
    assert all(0.2 < dwell < 1.5 for dwell in states.dwell_s)


def test_its_swatch_plays_both_in_turn() -> None:
    channels, _ = simulated("squeal", 10.0, 1)
    swatch = fit(channels.acceleration_m_s2, 5000.0, force_N=channels.force_N, speed_m_s=channels.speed_m_s)
    texture = swatch.texture
    assert texture is not None and texture.other is not None
    loud = [float(np.mean(one.power([1.5], [0.15]))) for one in (texture, texture.other)]
    squeal = (texture, texture.other)[int(np.argmax(loud))]
    frequency = np.arange(20.0, 1000.0)
    assert frequency[np.argmax(squeal.density([1.5], [0.15], frequency_Hz=frequency))] == pytest.approx(690.0, abs=10.0)
    assert 7.0 < 10.0 * np.log10(max(loud) / min(loud)) < 15.0
    played = synthesize(swatch, np.full(50_000, 1.5), np.full(50_000, 0.15))
    levels = metric.levels_dB(metric.felt_part(played, 5000.0), 5000.0)
    assert 0.15 < np.mean(levels > 27.0) < 0.75  # both states are heard
    assert any(name.startswith("texture.other.life") for name in (*swatch.intervals, *swatch.absent))


@pytest.mark.parametrize("surface", ["steady", "bursts", "grains"])
def test_steady_and_living_surfaces_have_one_state(surface: str) -> None:
    for seed in range(6):
        assert find_states([simulated(surface, 4.0, seed)[0]]) is None


def test_one_change_of_the_surface_is_no_second_state() -> None:
    channels, _ = simulated("steady", 6.0)
    half = len(channels.force_N) // 2
    tone = np.sin(2.0 * np.pi * 690.0 / 5000.0 * np.arange(half))
    channels.acceleration_m_s2[half:] += 3.0 * channels.acceleration_m_s2.std() * tone
    assert find_states([channels]) is None


@pytest.mark.parametrize("rate_Hz", [500.0, 1000.0, 2000.0])
def test_low_rates_have_fewer_bands_or_none(rate_Hz: float) -> None:
    assert find_states([simulated("steady", 4.0, rate_Hz=rate_Hz)[0]]) is None
