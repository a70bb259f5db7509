"""Amplitude modulation of simulated textures is recovered; stationary noise has none."""

from dataclasses import replace

import numpy as np
import pytest

from hapscene.capture.fit.modulation import fit_modulation, moving_runs
from hapscene.capture.fit.texture import fit_texture
from hapscene.capture.fit.windows import cut
from hapscene.capture.io.streams import Streams
from hapscene.surface.texture import Texture
from tests.capture.strokes import simulated


def texture_of(channels: Streams) -> Texture:
    return fit_texture(cut(channels), channels.rate_Hz, 8, 1)


@pytest.mark.parametrize(("surface", "by_distance"), [("bursts", False), ("grains", True)])
def test_modulation_over_time_and_over_distance_is_recovered(surface: str, by_distance: bool) -> None:
    parts = [simulated(surface, 10.0, seed)[0] for seed in range(2)]
    fit = fit_modulation(texture_of(parts[0]), parts)
    assert fit.modulation is not None and fit.reason == ""
    assert fit.modulation.log_spread == pytest.approx(0.4, abs=0.06)
    assert fit.intervals[-1][0] < 0.4 < fit.intervals[-1][1] < fit.intervals[-1][0] + 0.25
    found = fit.modulation
    own, other = (found.decay_1_m, found.decay_1_s) if by_distance else (found.decay_1_s, found.decay_1_m)
    assert np.all(own > 0.0) and np.all(other == 0.0)
    rate = np.sum(found.spread**2 * own) / np.sum(found.spread**2)
    assert 0.5 < rate * (0.07 * 0.15 if by_distance else 0.07) < 2.0


@pytest.mark.nightly
def test_intervals_of_short_recordings_contain_the_true_value() -> None:
    held = []
    for surface in ("bursts", "grains"):
        for seed in range(10):
            channels, _ = simulated(surface, 3.0, seed)
            low, high = fit_modulation(texture_of(channels), [channels]).intervals[-1]
            held.append(low < 0.4 < high)
    assert sum(held) >= 17


def test_constant_speed_gives_modulation_over_time() -> None:
    channels, _ = simulated("bursts", 10.0, 5)
    channels = replace(channels, speed_m_s=np.full_like(channels.speed_m_s, 0.1))
    fit = fit_modulation(texture_of(channels), [channels])
    assert fit.modulation is not None and np.all(fit.modulation.decay_1_m == 0.0)


def test_light_and_slow_parts_are_not_used() -> None:
    """Below a tenth of the largest force and speed of all stretches."""
    one, speed = np.ones(1000), np.repeat([0.4, 0.03], [550, 450])
    streams = (np.repeat([1.0, 0.15], 500), one), (np.repeat([2.0, 0.5], 500), speed), (one, one)
    stretches = [Streams(1000.0, one, *each, None) for each in streams]
    assert list(moving_runs(stretches, 0.05, 0.4)) == [(0, 0, 10, 50), (1, 0, 11, 50), (2, 0, 20, 50)]
    assert list(moving_runs(stretches[:1], 0.05, 0.4)) == [(0, 0, 20, 50)]


@pytest.mark.parametrize("seconds", [1.0, 8.0])
def test_stationary_noise_has_no_modulation(seconds: float) -> None:
    for seed in range(10 if seconds < 2.0 else 1):
        channels, _ = simulated("steady", seconds, seed)
        fit = fit_modulation(texture_of(channels), [channels])
        assert fit.modulation is None and "stationary noise" in fit.reason


def test_a_dependence_on_force_and_speed_is_no_modulation() -> None:
    channels, _ = simulated("steady", 8.0)
    louder = channels.acceleration_m_s2 * channels.speed_m_s  # power goes with the third power of the speed
    channels = replace(channels, acceleration_m_s2=louder)
    assert fit_modulation(texture_of(channels), [channels]).modulation is None
