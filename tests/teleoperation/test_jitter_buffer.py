"""The jitter buffer: order, delay, and late or missing messages."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.records import records
from hapscene.teleoperation.jitter_buffer import (
    A_EXTRA_MAX,
    MESSAGE,
    SAMPLE_COUNT,
    advance_queue,
    new_queue,
    next_wave,
    play_samples,
    store,
)


def message(tick: int) -> Any:
    """A message whose wave totals and samples encode its tick."""
    outgoing = records(1, MESSAGE)[0]
    outgoing.tick = tick
    outgoing.wave_sqrtJs = (tick, 0.0, 0.0)
    outgoing.wave_J = tick
    outgoing.a_m_s2 = tick + np.arange(SAMPLE_COUNT) / SAMPLE_COUNT
    return outgoing


def test_a_missing_message_is_bridged_by_the_next() -> None:
    queue = new_queue()
    for tick in (0, 1, 3):
        store(queue[0], 2 + tick, message(tick))
    advance_queue(queue[0], 4)  # message 2 is due, and lost
    ticks, wave, energy = next_wave(queue[0])
    assert (ticks, wave[0], energy) == (2, 3.0, 3.0)
    advance_queue(queue[0], 4)
    assert next_wave(queue[0]) == (0, (0.0, 0.0, 0.0), 0.0)  # nothing new is due


def test_messages_are_reordered() -> None:
    queue, samples, played = new_queue(), np.zeros(SAMPLE_COUNT), []
    for now, ticks in enumerate(([0, 2, 1], [3], [5], [4], [6], [7], [8]), 2):
        for tick in ticks:
            store(queue[0], now, message(tick))
        advance_queue(queue[0], now)
        play_samples(queue[0], samples)
        played.append(int(samples[0]))
    assert played == [0, 1, 2, 3, 4, 5, 6]
    advance_queue(queue[0], 8)
    play_samples(queue[0], samples)
    assert not samples.any()  # nothing new is due


def test_lag_grows_and_shrinks_with_the_delay() -> None:
    queue = new_queue()
    for now in range(2000):
        late = 8 if now < 300 else 0
        if now >= late:
            store(queue[0], now, message(now - late))
        advance_queue(queue[0], now)
        if now == 299:
            assert queue[0].lag_ticks == 8
    assert queue[0].lag_ticks <= 1


def test_lost_samples_are_zero() -> None:
    queue, samples = new_queue(), np.ones(SAMPLE_COUNT)
    for now, tick in enumerate((0, 1, 3), 1):
        store(queue[0], now, message(tick))
    advance_queue(queue[0], 3)
    play_samples(queue[0], samples)
    assert not samples.any()


def play_late(late_ticks: int, count: int, queue: Any) -> list[float]:
    """The played samples if every tenth message is late; −1 for silence."""
    samples, played = np.zeros(SAMPLE_COUNT), []
    arrivals: dict[int, list[int]] = {}
    for tick in range(count):
        arrivals.setdefault(tick + (late_ticks if tick % 10 == 5 else 0), []).append(tick)
    for now in range(count):
        for tick in arrivals.get(now, []):
            store(queue[0], now, message(tick))
        advance_queue(queue[0], now)
        play_samples(queue[0], samples)
        played.append(samples[0] if samples.any() else -1.0)
    return played


@pytest.mark.parametrize("late_ticks", [1, 7, A_EXTRA_MAX + 1])
def test_samples_wait_for_late_messages(late_ticks: int) -> None:
    """Waves wait a tick, since they can be interpolated; samples wait until the latest have arrived."""
    queue = new_queue()
    played = np.array(play_late(late_ticks, 600, queue))
    assert (int(queue[0].lag_ticks), int(queue[0].a_extra_ticks)) == (1, late_ticks - 1)
    assert played[200:].tolist() == list(range(200 - late_ticks, 600 - late_ticks))
    assert queue[0].due_tick - queue[0].a_due_tick == late_ticks - 1


def test_the_additional_delay_ends_with_the_jitter() -> None:
    queue = new_queue()
    play_late(20, 300, queue)
    for tick in range(300, 900):
        store(queue[0], tick, message(tick))
        advance_queue(queue[0], tick)
    assert queue[0].a_extra_ticks == 0


@given(st.lists(st.tuples(st.integers(0, 30), st.booleans()), min_size=30, max_size=80))
@settings(max_examples=25, deadline=None)
def test_due_ticks_increase_and_reach_the_newest_message(
    fates: list[tuple[int, bool]],
) -> None:
    """For any delays and losses; at the end the last total is the newest one."""
    queue, due_tick, newest = new_queue(), -(2**40), -1
    arrivals: dict[int, list[int]] = {}
    for tick, (delay, lost) in enumerate(fates):
        if not lost:
            arrivals.setdefault(tick + delay, []).append(tick)
    total = None
    for now in range(len(fates) + 60):
        for tick in arrivals.get(now, []):
            store(queue[0], now, message(tick))
            newest = max(newest, tick)
        advance_queue(queue[0], now)
        if queue[0].started:
            assert queue[0].due_tick >= due_tick
            due_tick = queue[0].due_tick
        ticks, wave, _ = next_wave(queue[0])
        if ticks:
            assert ticks >= 1 and wave[0] <= newest
            total = wave[0] if ticks == 1 else total
    assert newest < 0 or total == newest
