"""Limits hold for every input, and are kept by fading, not by clipping."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import butter, chirp, sosfilt

from hapscene.handle import COMPENSATORS, Plant, play
from hapscene.handle.handle_loop import PlaybackResult
from hapscene_evidence.bench.handle import PARAMETERS, firm

RATE_HZ = 10_000.0
T_S = np.arange(6000) / RATE_HZ

LOUD = {
    "step": np.where(T_S > 0.1, 1.0, 0.0),
    "noise": np.random.default_rng(0).standard_normal(len(T_S)),
    "chirp": chirp(T_S, 1.0, T_S[-1], 1000.0, "logarithmic"),
    "tone at the coil's resonance": np.sin(2 * np.pi * 21.8 * T_S),
    "slow square": np.sign(np.sin(2 * np.pi * 15.0 * T_S)),
    "burst": np.where((T_S > 0.2) & (T_S < 0.3), np.sin(2 * np.pi * 30.0 * T_S), 0.0),
    "one sample": np.where(np.arange(len(T_S)) == 3000, 1.0, 0.0),
    "walk": np.cumsum(np.random.default_rng(1).standard_normal(len(T_S))) / 30.0,
    "growing": np.exp(30.0 * (T_S - T_S[-1])),
    "on and off": np.sin(2 * np.pi * 25.0 * T_S) * np.where((T_S * 5.0) % 1.0 > 0.5, 1.0, 0.01),
}

signal = st.one_of(
    st.sampled_from(list(LOUD)).map(lambda name: LOUD[name]),
    st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=40).map(lambda knots: np.repeat(knots, 6000 // len(knots))),
)
FAR_BEYOND_M_S2 = 1e4
"""Two hundred times what the actuator can do: up to there a handle that learns meets no stop, either."""

gain = st.floats(-1.0, 7.0).map(lambda power: 10.0**power)


def assert_inside(played: PlaybackResult, plant: Plant) -> None:
    assert np.abs(played.force_N).max(initial=0.0) <= plant.force_limit_N
    assert np.abs(played.travel_m).max(initial=0.0) <= plant.travel_limit_m
    assert np.isfinite(played.acceleration_m_s2).all()


@settings(max_examples=60, deadline=None)
@given(signal, gain, st.sampled_from(sorted(COMPENSATORS)))
def test_limits_of_the_nominal_handle_hold_without_stop_or_clip(
    shape: NDArray[np.float64], gain: float, compensator: str
) -> None:
    played = play(gain * shape, RATE_HZ, compensator=compensator)
    assert_inside(played, Plant())
    far_beyond = compensator == "adaptive" and gain > FAR_BEYOND_M_S2  # what it learnt wants more travel there is
    assert (played.hits == 0 or far_beyond) and played.clips == 0


@settings(max_examples=60, deadline=None)
@given(
    signal,
    gain,
    st.sampled_from(sorted(COMPENSATORS)),
    st.lists(st.floats(0.5, 1.5), min_size=6, max_size=6),
    st.floats(0.25, 4.0),
    st.floats(0.001, 0.01),
)
def test_limits_of_any_handle_hold(
    shape: NDArray[np.float64], gain: float, compensator: str, off: list[float], grip: float, travel_m: float
) -> None:
    there = {name: getattr(Plant(), name) * factor for name, factor in zip(PARAMETERS, off, strict=True)}
    plant = firm(replace(Plant(), travel_limit_m=travel_m, **there), grip)
    assert_inside(play(gain * shape, RATE_HZ, plant, compensator=compensator), plant)


@pytest.mark.parametrize("compensator", sorted(COMPENSATORS))
def test_non_finite_samples_count_as_zero(compensator: str) -> None:
    desired = LOUD["noise"].copy()
    zeroed = desired.copy()
    desired[1000:1100], zeroed[1000:1100] = np.nan, 0.0
    desired[2000], zeroed[2000] = np.inf, 0.0
    got, wanted = (play(d, RATE_HZ, compensator=compensator) for d in (desired, zeroed))
    assert_inside(got, Plant())
    assert got.acceleration_m_s2.tolist() == wanted.acceleration_m_s2.tolist()


@pytest.mark.parametrize("compensator", ["flat", "adaptive"])
def test_overload_is_attenuated_without_a_click(compensator: str) -> None:
    """What spills over 1 kHz when the force limit is in the way: of the faded signal, and of one that is clipped."""
    window = np.clip(np.minimum((T_S - 0.2) / 0.02, (0.4 - T_S) / 0.02), 0.0, 1.0)
    desired = 300.0 * np.sin(2 * np.pi * 150.0 * T_S) * 0.5 * (1.0 - np.cos(np.pi * window))
    above = butter(4, 1000.0, "high", fs=RATE_HZ, output="sos")

    def spill(a: NDArray[np.float64]) -> float:
        return float(np.sqrt(np.sum(sosfilt(above, a) ** 2) / np.sum(a**2)))

    played = play(desired, RATE_HZ, compensator=compensator)
    reach = 6.6 / Plant().m_h_kg
    assert np.abs(played.force_N).max() > 4.0  # it is faded to what there is, not away
    assert played.hits == 0 and played.clips == 0
    assert spill(played.acceleration_m_s2) < 0.01 < 0.05 < spill(np.clip(desired, -reach, reach))
    steepest = np.abs(np.diff(played.acceleration_m_s2)).max()
    assert steepest < 1.5 * reach * 2 * np.pi * 150.0 / RATE_HZ  # no faster than the tone itself at full reach
