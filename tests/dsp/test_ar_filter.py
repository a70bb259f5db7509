"""Conversions between forms of all-pole filters, compared with SciPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from hapscene.dsp.ar_filter import ar_from_lsf, ar_from_reflection, lsf_from_ar, power_gain, reflection_from_ar
from hapscene.dsp.linear_prediction import solve
from hapscene.errors import SwatchError


def random_filter(order: int, seed: int) -> np.ndarray:
    """A stable filter (order+1,) with a power gain of 1e2 to 1e4, as in recordings."""
    rng = np.random.default_rng(seed)
    k = rng.uniform(-0.6, 0.6, order) * np.exp(-np.arange(order) / 30)
    k[:2] = [-0.97, 0.9][:order]
    return ar_from_reflection(k)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 20, 21, 40, 119, 120, 121, 256, 423, 576])
def test_conversion_to_lsf_and_back(order: int) -> None:
    for seed in range(5):
        a = random_filter(order, seed)
        assert np.abs(ar_from_lsf(lsf_from_ar(a)) - a).max() < 1e-9


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 256), st.integers(0, 2**32 - 1))
def test_ascending_frequencies_give_a_stable_filter(order: int, seed: int) -> None:
    gap = np.random.default_rng(seed).uniform(0.5, 1.0, order + 1)  # power gains up to 1e6
    lsf = np.pi * np.cumsum(gap)[:-1] / gap.sum()
    a = ar_from_lsf(lsf)
    assert a[0] == 1.0
    assert np.all(np.abs(reflection_from_ar(a)) < 1.0)
    assert np.abs(ar_from_lsf(lsf_from_ar(a)) - a).max() < 1e-9 * np.abs(a).max()


@pytest.mark.parametrize(("gap_rad", "others"), [(1e-4, 16), (1e-7, 4)])
def test_roots_between_grid_points_are_found(gap_rad: float, others: int) -> None:
    """Two resonances that near: two roots of P, and two of Q, fall between two points of the finest grid.

    Four such roots make the coefficients tell them to 1e-7 only, whatever the method.
    """
    for seed in range(5):
        lsf = np.sort(np.append(np.random.default_rng(seed).uniform(0.1, 3.0, others), 1.0 + gap_rad * np.arange(4)))
        a = ar_from_lsf(lsf)
        assert np.abs(ar_from_lsf(lsf_from_ar(a)) - a).max() < 1e-6 * np.abs(a).max()


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 160), st.integers(0, 10), st.floats(1e-5, 0.1), st.integers(0, 2**32 - 1))
def test_conversion_of_filters_with_sharp_resonances(order: int, count: int, width: float, seed: int) -> None:
    """Filters from the autocorrelation of spectra with peaks of up to 60 dB."""
    rng = np.random.default_rng(seed)
    w = np.linspace(0.0, np.pi, 8193)
    density = np.exp(3.0 * rng.normal() * np.cos(w))
    for place, height in zip(rng.uniform(0.02, 3.1, count), 10.0 ** rng.uniform(0.0, 6.0, count), strict=True):
        density += height * width**2 / np.abs(1.0 - (1.0 - width) * np.exp(1j * (place - w))) ** 2
    a = solve(np.fft.irfft(density)[: order + 1])
    assert np.abs(ar_from_lsf(lsf_from_ar(a)) - a).max() < 1e-9


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 200), st.integers(0, 2**32 - 1))
def test_conversion_to_reflection_coefficients_and_back(order: int, seed: int) -> None:
    k = np.random.default_rng(seed).uniform(-0.3, 0.3, (3, order))
    assert np.allclose(reflection_from_ar(ar_from_reflection(k)), k, atol=1e-9)


def test_stacks_equal_single_filters() -> None:
    a = np.stack([random_filter(40, seed) for seed in range(7)])
    lsf = np.stack([lsf_from_ar(one) for one in a])
    assert np.allclose(ar_from_lsf(lsf), [ar_from_lsf(one) for one in lsf], atol=1e-14, rtol=0)
    assert np.array_equal(power_gain(a), [power_gain(one) for one in a])
    many = np.pi * (np.arange(1, 121) + np.random.default_rng(0).uniform(-0.3, 0.3, (4, 15, 120))) / 121
    each = [[ar_from_lsf(one) for one in row] for row in many]  # more than are converted at once
    assert np.allclose(ar_from_lsf(many), each, atol=1e-14, rtol=0)
    white = np.pi * np.arange(1, 801) / 801  # evenly spaced: A = 1
    assert np.allclose(ar_from_lsf(np.tile(white, (3, 1))), np.eye(3, 801)[[0, 0, 0]], atol=1e-12)


def test_power_gain_is_the_sum_of_the_squared_impulse_response() -> None:
    for seed in range(3):
        a = random_filter(30, seed)
        impulse = np.zeros(50_000)
        impulse[0] = 1.0
        assert power_gain(a) == pytest.approx(np.sum(lfilter([1.0], a, impulse) ** 2), rel=1e-9)


def test_unstable_filters_are_detected() -> None:
    unstable = np.array([1.0, -2.1, 1.05])
    assert power_gain(unstable) == np.inf
    assert not np.all(np.abs(reflection_from_ar(unstable)) < 1.0)
    for one in (unstable, [1.0, -1.2], [1.0, 1.2], [1.0, 0.0, 1.2], [1.0, 2.1, 1.05]):
        with pytest.raises(SwatchError, match="unstable"):
            lsf_from_ar(one)
