"""The queue: order, turns, and what is late or missing."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.teleoperation.datagram import MESSAGE, SAMPLE_COUNT
from hapscene.teleoperation.jitter_buffer import MARGIN_MAX, call, new_queue, next_wave, play_samples, store


def message(tick: int) -> Any:
    """A message whose wave totals and samples tell its tick."""
    told = records(1, MESSAGE)[0]
    told.tick = tick
    told.wave_sqrtJs = (tick, 0.0, 0.0)
    told.wave_J = tick
    told.a_m_s2 = tick + np.arange(SAMPLE_COUNT) / SAMPLE_COUNT
    return told


def test_a_margin_delays_by_so_many_ticks_and_plays_in_order() -> None:
    queue, samples, played = new_queue(3), np.zeros(SAMPLE_COUNT), []
    for now in range(100, 120):
        store(queue[0], now, message(now - 100))
        call(queue[0], now)
        play_samples(queue[0], samples)
        played.append(samples[0])
    assert played == [0.0, 0.0, 0.0, *range(17)]


def test_a_missing_message_is_bridged_by_the_next() -> None:
    queue = new_queue(2)
    for tick in (0, 1, 3):
        store(queue[0], tick, message(tick))
    call(queue[0], 4)  # the turn of 2, which is lost
    ticks, wave, energy = next_wave(queue[0])
    assert (ticks, wave[0], energy) == (2, 3.0, 3.0)


def test_what_comes_out_of_order_is_put_in_order() -> None:
    queue, samples, played = new_queue(2), np.zeros(SAMPLE_COUNT), []
    for now, tick in enumerate((0, 2, 1, 3, 5, 4, 6, 7, 8)):
        store(queue[0], now, message(tick))
        call(queue[0], now)
        play_samples(queue[0], samples)
        played.append(int(samples[0]))
    assert played == [0, 0, 0, 1, 2, 3, 4, 5, 6]


def test_turns_move_back_when_nothing_came_in_time_and_forward_again() -> None:
    queue = new_queue(0)
    for now in range(2000):
        late = 8 if now < 300 else 0
        if now >= late:
            store(queue[0], now, message(now - late))
        call(queue[0], now)
        if now == 299:
            assert queue[0].lag_ticks == 8
    assert queue[0].lag_ticks <= 1


def test_silence_is_played_where_samples_are_lost() -> None:
    queue, samples = new_queue(1), np.ones(SAMPLE_COUNT)
    for now, tick in enumerate((0, 1, 3)):
        store(queue[0], now, message(tick))
    call(queue[0], 3)
    play_samples(queue[0], samples)
    assert not samples.any() and queue[0].missed == 1


@given(st.lists(st.tuples(st.integers(0, 30), st.booleans()), min_size=30, max_size=80), st.integers(0, 10))
@settings(max_examples=25, deadline=None)
def test_whatever_the_line_does_turns_only_go_forward_and_reach_the_newest(
    fates: list[tuple[int, bool]], margin: int
) -> None:
    """Each message has a delay and may be lost; when the line falls still, the queue has come to the newest total."""
    queue, turn, newest = new_queue(margin), -(2**40), -1
    arrivals: dict[int, list[int]] = {}
    for tick, (delay, lost) in enumerate(fates):
        if not lost:
            arrivals.setdefault(tick + delay, []).append(tick)
    total = None
    for now in range(len(fates) + 60):
        for tick in arrivals.get(now, []):
            store(queue[0], now, message(tick))
            newest = max(newest, tick)
        call(queue[0], now)
        if queue[0].started:
            assert queue[0].turn >= turn
            turn = queue[0].turn
        ticks, wave, _ = next_wave(queue[0])
        if ticks:
            assert ticks >= 1 and wave[0] <= newest
            total = wave[0] if ticks == 1 else total
    assert newest < 0 or total == newest


def test_a_margin_too_long_is_refused() -> None:
    with pytest.raises(HapsceneError, match=f"0 to {MARGIN_MAX} ticks"):
        new_queue(MARGIN_MAX + 1)
