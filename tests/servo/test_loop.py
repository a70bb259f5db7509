"""Waiting for a tick: never before it is due, and what it comes too late for is counted."""

import numpy as np

from hapscene.clock import new_clock, now_ns
from hapscene.servo.channel import CHANNEL
from hapscene.servo.loop import LATE_MAX, await_tick

TICK_NS = 1_000_000


def test_a_tick_begins_when_it_is_due_or_later() -> None:
    channel, clock = np.zeros(1, CHANNEL).view(np.recarray)[0], new_clock()
    due = now_ns(clock)
    for k in range(1, 21):
        told, start = await_tick(channel, clock, due + k * TICK_NS, TICK_NS)
        assert start >= told >= due + k * TICK_NS
        assert channel.late.sum() == k


def test_what_it_is_much_too_late_for_is_left_out() -> None:
    channel, clock = np.zeros(1, CHANNEL).view(np.recarray)[0], new_clock()
    behind = (LATE_MAX + 30) * TICK_NS
    due = now_ns(clock) - behind
    told, start = await_tick(channel, clock, due, TICK_NS)
    assert channel.missed >= LATE_MAX + 30
    assert told == due + channel.missed * TICK_NS
    assert 0 <= start - told < TICK_NS
    assert channel.late.nonzero()[0][0] > 0  # counted as late as it was, not as late as what is left


def test_what_it_is_a_little_late_for_is_made_up() -> None:
    channel, clock = np.zeros(1, CHANNEL).view(np.recarray)[0], new_clock()
    due = now_ns(clock) - 3 * TICK_NS
    told, _ = await_tick(channel, clock, due, TICK_NS)
    assert told == due + channel.missed * TICK_NS
