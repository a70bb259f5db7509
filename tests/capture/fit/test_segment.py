"""States and changes of recordings whose truth is known."""

import numpy as np
import pytest

from hapscene.capture.fit.segment import (
    LEVEL_S,
    TAP_S,
    InteractionState,
    _mark_bursts,
    _remove_ripple,
    _rung_out,
    _switched,
    _without_brief,
    noise,
    onset,
    runs,
    segment,
)
from hapscene.capture.io.streams import clean

TOLERANCE_S = 0.02


def borders(states):
    """(sample, state that begins there), without taps' ends: those are where the ringing ends."""
    places = np.flatnonzero(np.diff(states)) + 1
    return [(int(p), int(states[p])) for p in places if states[p - 1] != InteractionState.TAP]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("streams", [("force_N", "speed_m_s"), ("force_N",)])
def test_states_are_found_within_20_ms(seed, streams, handled_recording):
    truth = handled_recording(seed)
    channels = clean(truth.acceleration_m_s2, truth.rate_Hz, **{name: getattr(truth, name) for name in streams})
    states = segment(channels).states
    assert np.mean(states == truth.states) > 0.97
    for place, state in borders(truth.states):
        near = slice(place - round(TOLERANCE_S * truth.rate_Hz), place + round(TOLERANCE_S * truth.rate_Hz))
        assert state in states[near]
    assert len(runs(states == InteractionState.TAP)) == len(truth.tap_m_s)
    assert len(runs(states == InteractionState.SLIDING)) == 2


@pytest.mark.parametrize("seed", range(3))
def test_only_the_change_of_surface_is_found(seed, handled_recording):
    truth = handled_recording(seed)
    found = segment(clean(truth.acceleration_m_s2, truth.rate_Hz, truth.force_N, truth.speed_m_s))
    assert len(found.changes) == 1
    assert abs(found.changes[0] - truth.change) < TOLERANCE_S * truth.rate_Hz
    assert len(found.stationary()) == 3
    assert sum(end - start for start, end in found.stationary()) == np.count_nonzero(
        found.states == InteractionState.SLIDING
    )


def test_a_recording_of_one_state_is_sliding():
    rng = np.random.default_rng(0)
    assert np.all(segment(clean(rng.standard_normal(20_000), 5_000.0)).states == InteractionState.SLIDING)
    assert not np.any(segment(clean(rng.standard_normal(20_000), 5_000.0, force_N=0.0)).states)


def test_noise_is_estimated_from_the_quietest_windows():
    rng = np.random.default_rng(0)
    hand = np.concatenate([np.zeros(20_000), 1.0 - np.cos(np.arange(20_000) / 1000.0)])
    force = clean(rng.standard_normal(40_000), 10_000.0, hand + 0.1 * rng.standard_normal(40_000)).force_N
    assert noise(force, 10_000.0) == pytest.approx(0.1 * np.sqrt(100 / 5000), rel=0.4)


@pytest.mark.parametrize(
    ("start_s", "length_s", "loudest_s", "rest", "tap"),
    [
        (0.3, 2.4 * LEVEL_S, 0.0, 1.0, True),
        (0.3, 2.4 * LEVEL_S, 0.9 * LEVEL_S, 1.0, True),  # no later than a level is known to
        (0.3, 2.4 * LEVEL_S, 1.5 * LEVEL_S, 1.0, False),
        (0.3, 0.95 * TAP_S, 0.3 * TAP_S, 1.0, True),
        (0.3, 0.95 * TAP_S, 0.4 * TAP_S, 1.0, False),
        (0.3, 1.05 * TAP_S, 0.0, 1.0, False),
        (0.0, 2.4 * LEVEL_S, 0.0, 1.0, False),  # it began before the recording
        (0.3, 2.4 * LEVEL_S, 0.0, 2.5, False),  # its last quarter is too loud
    ],
)
@pytest.mark.parametrize("rate_Hz", [1_000.0, 10_000.0])
def test_brief_bursts_with_a_strong_start_are_taps(rate_Hz, start_s, length_s, loudest_s, rest, tap):
    level = np.zeros(round(rate_Hz))
    start, count = round(start_s * rate_Hz), round(length_s * rate_Hz)
    level[start : start + count] = 1.0
    level[start + 3 * count // 4 : start + count] = rest
    level[start + round(loudest_s * rate_Hz)] = 10.0
    vibrating, states = level > 0.0, np.zeros(len(level), np.int8)
    level[: max(0, start - round(0.05 * rate_Hz))] = 5.0  # too early to count as the level before it
    _mark_bursts(states, vibrating, level, rate_Hz)
    found = np.flatnonzero(states == InteractionState.TAP)
    assert found.tolist() == (list(range(start, start + count)) if tap else [])


def test_the_ripple_before_an_impact_is_no_vibration() -> None:
    """Half a period of the high-pass of 20 Hz, and the window of the level; at 1 kHz, 35 samples."""
    for start, peak, rest in ((100, 135, 125), (100, 136, 100), (100, 105, 100), (0, 30, 0)):
        vibrating = (np.arange(400) >= start) & (np.arange(400) < 300)
        _remove_ripple(vibrating, np.where(np.arange(400) == peak, 1.0, 0.1), 1000.0)
        assert runs(vibrating) == [(rest, 300)]


def test_an_impact_begins_above_the_threshold_without_a_gap() -> None:
    size = np.zeros(100)
    size[[10, 23, 35, 45, 60]] = 0.3, -0.26, 0.24, 0.3, 0.9  # 13 samples, then 22: at most 12 are no gap
    size[[48, 50]] = 0.2, -1.0
    assert [onset(size, quiet, 1000.0) for quiet in (0.0, 0.08, 0.1, 1.0)] == [45, 45, 50, 50]
    size[35] = 0.25
    assert onset(size, 0.0, 1000.0) == 23


def test_an_impact_ends_at_the_level_before_it_or_at_a_share_of_its_peak() -> None:
    level = np.array([0.0, 1.0, 10.0, 5.0, 0.3, 0.21, 0.19, 0.1])
    assert [_rung_out(level, 1, quiet, 8) for quiet in (0.0, 0.15, 4.0, 2.0)] == [6, 5, 3, 4]
    assert (_rung_out(level, 1, 0.0, 5), _rung_out(level, 3, 0.0, 3)) == (5, 4)


def test_a_switch_has_hysteresis() -> None:
    stream = np.array([0.7, 0.7, 0.9, 0.7, 0.4, 0.7, 0.9, 0.5])
    assert _switched(stream, 0.8, 0.5).tolist() == [True, True, True, True, False, False, True, True]
    assert not _switched(stream[:2], 0.8, 0.5).any()
    kept = _without_brief(np.array([1, 0, 1, 1, 0, 1, 1, 1, 0, 1], bool), 3)
    assert runs(kept) == [(0, 1), (5, 8), (9, 10)]
