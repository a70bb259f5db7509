"""Waiting for a tick: never before it is due, and what it comes too late for is counted."""

import ctypes
import os
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from hapscene.clock import new_clock, now_ns
from hapscene.native import INTERPRETED
from hapscene.servo import servo_loop
from hapscene.servo.servo_loop import (
    BIN_COUNT,
    BIN_NS,
    BINS_PER_OCTAVE,
    LATE_MAX,
    SLACK_NS,
    Lateness,
    await_tick,
    count_in_bin,
    percentile_us,
    request_realtime_priority,
)
from hapscene.servo.shared_memory import CHANNEL

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


# What the system grants is told, and to the asking thread alone.


on_linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux is asked")

PR_GET_TIMERSLACK = 30


def slack_ns() -> int:
    return int(ctypes.CDLL(None).prctl(PR_GET_TIMERSLACK))


@on_linux
def test_what_is_told_is_so_for_the_thread_that_asked() -> None:
    before = os.sched_getscheduler(0), slack_ns()

    def ask() -> tuple[bool, int]:
        return request_realtime_priority(), os.sched_getscheduler(0)

    with ThreadPoolExecutor(1) as lane:
        granted, policy = lane.submit(ask).result()
    assert granted == (policy == os.SCHED_FIFO)
    assert (os.sched_getscheduler(0), slack_ns()) == before


@on_linux
def test_without_the_right_it_waits_among_the_others_but_is_woken_promptly(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with ThreadPoolExecutor(1) as lane:
        assert lane.submit(lambda: (request_realtime_priority(), slack_ns())).result() == (False, SLACK_NS)


@on_linux
@pytest.mark.skipif(INTERPRETED, reason="is the case anyway")
def test_interpreted_ticks_never_go_before_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(servo_loop, "INTERPRETED", True)
    with ThreadPoolExecutor(1) as lane:
        granted, policy = lane.submit(lambda: (request_realtime_priority(), os.sched_getscheduler(0))).result()
    assert not granted and policy == os.sched_getscheduler(0)


# Histograms of times: no time is told too short, or more than a bin too long.


BIN = 2.0 ** (1 / BINS_PER_OCTAVE)
LAST_NS = BIN_NS * 2.0 ** ((BIN_COUNT - 1) / BINS_PER_OCTAVE)


@pytest.mark.parametrize("span_ns", [101, 150, 999, 1000, 12_345, 1_000_000, 20_000_001, 1_600_000_000])
def test_a_time_is_found_again_to_a_bin(span_ns: int) -> None:
    histogram = np.zeros(BIN_COUNT, np.int64)
    count_in_bin(histogram, span_ns)
    assert histogram.sum() == 1
    assert span_ns / 1e3 <= percentile_us(histogram, 0.5) * (1 + 1e-9) <= BIN * span_ns / 1e3 * (1 + 2e-9)


@pytest.mark.parametrize("span_ns", [-5, 0, 1, 100])
def test_what_is_shorter_than_the_first_bin_is_in_it(span_ns: int) -> None:
    histogram = np.zeros(BIN_COUNT, np.int64)
    count_in_bin(histogram, span_ns)
    assert histogram[0] == 1
    assert percentile_us(histogram, 0.5) == BIN_NS / 1e3


def test_what_is_longer_than_the_last_bin_is_in_it() -> None:
    histogram = np.zeros(BIN_COUNT, np.int64)
    count_in_bin(histogram, 10**15)
    assert histogram[-1] == 1
    assert percentile_us(histogram, 0.5) == pytest.approx(LAST_NS / 1e3)


def test_percentiles_are_those_of_the_times() -> None:
    span_ns = np.random.default_rng(0).lognormal(np.log(20_000), 2.0, 5000).astype(np.int64)
    histogram = np.zeros(BIN_COUNT, np.int64)
    for span in span_ns:
        count_in_bin(histogram, span)
    for share in (0.5, 0.9, 0.99, 0.999):
        true_us = np.quantile(span_ns, share, method="inverted_cdf") / 1e3
        assert true_us <= percentile_us(histogram, share) <= BIN * true_us


def test_nothing_counted_is_no_time() -> None:
    assert percentile_us(np.zeros(BIN_COUNT, np.int64), 0.5) == 0.0


def test_what_came_after_an_earlier_look() -> None:
    late, busy = np.zeros(BIN_COUNT, np.int64), np.zeros(BIN_COUNT, np.int64)
    for _ in range(9):
        count_in_bin(late, 50)
        count_in_bin(busy, 10_000)
    before = Lateness(late.copy(), busy.copy(), 3)
    count_in_bin(late, 1_000_000)
    after = Lateness(late, busy, 5)
    assert after.late_us() == BIN_NS / 1e3
    since = after.since(before)
    assert since.late.sum() == 1 and since.late_us() == pytest.approx(1000.0, rel=BIN - 1)
    assert since.busy_us() == 0.0 and after.busy_us() == pytest.approx(10.0, rel=BIN - 1)
    assert since.missed == 2
