"""The search for changes against one that tries all, and against changes that are known to the sample."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.fit.change_point import (
    ORDER,
    _cheapest,
    _floor,
    _product_sums,
    _residual,
    change_points,
)

RATE_HZ = 2500.0


def signal(*parts, seed=0):
    """Noise of a resonance and a level after the other: (frequency [Hz], gain, samples)."""
    rng, out = np.random.default_rng(seed), []
    for frequency_Hz, gain, count in parts:
        a = [1.0, -1.8 * np.cos(2 * np.pi * frequency_Hz / RATE_HZ), 0.81]
        part = lfilter([1.0], a, rng.standard_normal(count + 500))[500:]
        out.append(gain * part / part.std())
    return np.concatenate(out)


def test_cumulative_sums_give_the_regression_of_a_segment():
    """The residual is that of the least squares of each sample on the `ORDER` before it."""
    x, block = signal((300, 1.0, 2000)), 25
    sums = _product_sums(x, block)
    start, end = 40, 70
    found = _residual((sums[end] - sums[start] + _floor(sums))[None])[0]
    rows = np.arange(start * block, end * block)
    past = np.stack([x[rows - k] for k in range(1, ORDER + 1)], axis=1)
    left = x[rows] - past @ np.linalg.lstsq(past, x[rows], rcond=None)[0]
    assert found == pytest.approx(np.sum(left**2), rel=1e-4)
    assert sums[end, 0, 0] == pytest.approx(np.sum(np.append(np.zeros(ORDER), x)[: end * block] ** 2))


def test_a_change_of_a_silent_vibration_is_exact():
    """By 120 dB: the likelihoods of the places about it differ by more than the largest number."""
    (found,) = change_points(signal((300, 1e-6, 2500), (300, 1.0, 2500)), RATE_HZ)
    assert abs(found - 2500) <= 13  # one block of 5 ms


def everything(sums, block, shortest, penalty):
    """The least cost by trying every last piece, with nothing pruned."""
    count, floor = len(sums) - 1, _floor(sums)
    best, last = np.full(count + 1, np.inf), np.zeros(count + 1, int)
    best[0] = -penalty
    for end in range(shortest, count + 1):
        for start in range(end - shortest + 1):
            length = (end - start) * block
            power = _residual((sums[end] - sums[start] + floor)[None])[0] / length
            cost = best[start] + 0.5 * length * np.log(power) + penalty
            if cost < best[end]:
                best[end], last[end] = cost, start
    places, end = [], count
    while last[end] > 0:
        end = last[end]
        places.append(int(end))
    return places[::-1]


@pytest.mark.parametrize("penalty", [2.0, 10.0, 60.0])
@pytest.mark.parametrize("seed", range(3))
def test_pruning_finds_the_minimum(seed, penalty):
    x = signal((300, 1.0, 1000), (500, 1.0, 600), (500, 2.0, 900), (300, 1.0, 500), seed=seed)
    sums = _product_sums(x, 50)
    found = _cheapest(sums, 50, 4, penalty)
    assert found == everything(sums, 50, 4, penalty)
    assert np.diff([0, *found, 60]).min() >= 4 and (penalty > 2.0 or len(found) > 3)


@pytest.mark.parametrize("rate_Hz", [2500.0, 10_000.0])
def test_a_change_in_a_long_recording_is_found_to_a_few_ms(rate_Hz):
    """Longer than the windows of the search, with changes on both sides of their ends."""
    factor = round(rate_Hz / RATE_HZ)
    parts = [(300, 1.0, 9.5), (500, 1.0, 1.2), (500, 2.0, 8.6), (300, 1.0, 6.0)]
    x = signal(*((f, g, round(s * RATE_HZ)) for f, g, s in parts), seed=1)
    if factor > 1:
        from scipy.signal import resample_poly

        x = resample_poly(x, factor, 1)
    found = change_points(x, rate_Hz)
    assert np.array(found) / rate_Hz == pytest.approx([9.5, 10.7, 19.3], abs=0.01)


@pytest.mark.parametrize("seed", range(2))
def test_bursts_are_not_change_points(seed):
    """Noise of Student's t with 3 degrees of freedom: at the price for Gaussian noise each would have two or more."""
    x = np.random.default_rng(seed).standard_t(3, 30_000)
    assert change_points(x, RATE_HZ) == []
