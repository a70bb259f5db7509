"""Histograms of times: no time is told too short, or more than a bin too long."""

import numpy as np
import pytest

from hapscene.servo.lateness import BIN_COUNT, BIN_NS, BINS_PER_OCTAVE, Lateness, count, percentile_us

BIN = 2.0 ** (1 / BINS_PER_OCTAVE)
LAST_NS = BIN_NS * 2.0 ** ((BIN_COUNT - 1) / BINS_PER_OCTAVE)


@pytest.mark.parametrize("span_ns", [101, 150, 999, 1000, 12_345, 1_000_000, 20_000_001, 1_600_000_000])
def test_a_time_is_found_again_to_a_bin(span_ns: int) -> None:
    histogram = np.zeros(BIN_COUNT, np.int64)
    count(histogram, span_ns)
    assert histogram.sum() == 1
    assert span_ns / 1e3 <= percentile_us(histogram, 0.5) * (1 + 1e-9) <= BIN * span_ns / 1e3 * (1 + 2e-9)


@pytest.mark.parametrize("span_ns", [-5, 0, 1, 100])
def test_what_is_shorter_than_the_first_bin_is_in_it(span_ns: int) -> None:
    histogram = np.zeros(BIN_COUNT, np.int64)
    count(histogram, span_ns)
    assert histogram[0] == 1
    assert percentile_us(histogram, 0.5) == BIN_NS / 1e3


def test_what_is_longer_than_the_last_bin_is_in_it() -> None:
    histogram = np.zeros(BIN_COUNT, np.int64)
    count(histogram, 10**15)
    assert histogram[-1] == 1
    assert percentile_us(histogram, 0.5) == pytest.approx(LAST_NS / 1e3)


def test_percentiles_are_those_of_the_times() -> None:
    span_ns = np.random.default_rng(0).lognormal(np.log(20_000), 2.0, 5000).astype(np.int64)
    histogram = np.zeros(BIN_COUNT, np.int64)
    for span in span_ns:
        count(histogram, span)
    for share in (0.5, 0.9, 0.99, 0.999):
        true_us = np.quantile(span_ns, share, method="inverted_cdf") / 1e3
        assert true_us <= percentile_us(histogram, share) <= BIN * true_us


def test_nothing_counted_is_no_time() -> None:
    assert percentile_us(np.zeros(BIN_COUNT, np.int64), 0.5) == 0.0


def test_what_came_after_an_earlier_look() -> None:
    late, busy = np.zeros(BIN_COUNT, np.int64), np.zeros(BIN_COUNT, np.int64)
    for _ in range(9):
        count(late, 50)
        count(busy, 10_000)
    before = Lateness(late.copy(), busy.copy(), 3)
    count(late, 1_000_000)
    after = Lateness(late, busy, 5)
    assert after.late_us() == BIN_NS / 1e3
    since = after.since(before)
    assert since.late.sum() == 1 and since.late_us() == pytest.approx(1000.0, rel=BIN - 1)
    assert since.busy_us() == 0.0 and after.busy_us() == pytest.approx(10.0, rel=BIN - 1)
    assert since.missed == 2
