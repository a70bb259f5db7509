"""Normalised lattices: equal to the direct form; each step is a rotation."""

import numpy as np
import pytest
from numpy.polynomial.polynomial import polymul, polypow
from scipy.signal import lfilter

from hapscene.compiled.native import native
from hapscene.dsp.ar_filter import ar_from_reflection
from hapscene.dsp.lattice import advance, advance_all, advance_warped, solve_loop


def rows(k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """k and c (p+1,) as the lattice has them, from its reflection coefficients (p,)."""
    return np.append(0.0, k), np.append(1.0, np.sqrt(1.0 - k**2))


@pytest.mark.parametrize("order", [1, 2, 7, 40])
def test_the_lattice_equals_the_scaled_direct_form(order: int) -> None:
    rng = np.random.default_rng(order)
    reflection = rng.uniform(-0.9, 0.9, order)
    k, c = rows(reflection)
    f, b = rng.standard_normal(2000), np.zeros(order + 1)
    made = [advance(k, c, b, order, x) for x in f]
    direct = lfilter([np.prod(c)], ar_from_reflection(reflection), f)
    np.testing.assert_allclose(made, direct, atol=1e-10)


def test_each_step_preserves_the_sum_of_squares() -> None:
    rng, order, b = np.random.default_rng(0), 9, np.zeros(10)
    b[:-1] = rng.standard_normal(order)
    for f in rng.standard_normal(200):
        before = f**2 + np.sum(b[:-1] ** 2)
        advance(*rows(rng.uniform(-0.99, 0.99, order)), b, order, f)
        assert np.sum(b**2) == pytest.approx(before, rel=1e-12)


@native
def all_at_once(k, c, b, order, f):
    advance_all(k, c, b, order, f, f.size)


@pytest.mark.parametrize("order", [1, 8, 9, 10, 20, 21, 22, 41, 576])
@pytest.mark.parametrize("count", [1, 4, 10, 31])
def test_vectorised_processing_gives_equal_results(order: int, count: int) -> None:
    rng = np.random.default_rng(order)
    k, c = rows(rng.uniform(-0.9, 0.9, order))
    one_by_one = rng.standard_normal(order + 1)
    b, f = one_by_one.copy(), rng.standard_normal(count)
    made = [advance(k, c, one_by_one, order, x) for x in f]
    all_at_once(k, c, b, order, f)
    np.testing.assert_array_equal(f, made)
    np.testing.assert_array_equal(b, one_by_one)


# Warped: an allpass for each delay.


def warped(reflection: np.ndarray, warp: float) -> tuple[float, np.ndarray]:
    """Variance of f_0, and the rows for `advance_warped`."""
    size = 4 * -(-len(reflection) // 4) + 1
    k, made = np.zeros(size), np.zeros((8, size))
    k[1 : len(reflection) + 1] = reflection
    return solve_loop(k, len(reflection), warp, made), made


@pytest.mark.parametrize("warp", [0.75, -0.5])
@pytest.mark.parametrize("order", [1, 2, 3, 4, 5, 7])
def test_a_warped_lattice_equals_its_rational_filter(order: int, warp: float) -> None:
    """A(D(z)) as polynomials in 1/z, by SciPy; the variance from its impulse response."""
    rng = np.random.default_rng(order)
    reflection = rng.uniform(-0.7, 0.7, order)
    over, under = (-warp, 1.0), (1.0, -warp)
    a, gain = ar_from_reflection(reflection), np.sqrt(np.prod(1.0 - reflection**2))
    numerator = gain * polypow(under, order)
    whole = sum(a[i] * polymul(polypow(over, i), polypow(under, order - i)) for i in range(order + 1))
    variance, made = warped(reflection, warp)
    assert variance == pytest.approx(np.sum(lfilter(numerator, whole, np.eye(1, 9000)[0]) ** 2), rel=1e-9)
    f, b = rng.standard_normal(2000), np.zeros(9)
    played = [advance_warped(made, b, order, warp, x) for x in f]
    np.testing.assert_allclose(played, lfilter(numerator, whole, f), atol=1e-8)


@pytest.mark.parametrize("order", [4, 9, 28])
def test_switching_warped_models_preserves_the_variance(order: int) -> None:
    """White memories of variance 1 remain so, and f_0 has the returned variance: to rounding."""
    rng, size = np.random.default_rng(order), 4 * -(-order // 4)
    for warp in rng.uniform(-0.9, 0.9, 20):
        variance, made = warped(rng.uniform(-0.99, 0.99, order), warp)
        step, output = np.zeros((size, size + 1)), np.zeros(size + 1)
        for i in range(size + 1):
            b = np.zeros(size + 1)
            b[i % (size + 1)] = 1.0 if i < size else 0.0
            output[i] = advance_warped(made, b, order, warp, float(i == size))
            step[:, i] = b[:size]
        np.testing.assert_allclose(step @ step.T, np.eye(size), atol=1e-10)
        assert np.sum(output**2) == pytest.approx(variance, rel=1e-9)


def test_a_warped_lattice_with_coefficient_0_is_plain() -> None:
    reflection, f = np.array([0.5, -0.8, 0.3, 0.2, -0.6]), np.random.default_rng(0).standard_normal(300)
    variance, made = warped(reflection, 0.0)
    b, plain = np.zeros(9), np.zeros(6)
    assert variance == pytest.approx(1.0)
    played = [advance_warped(made, b, 5, 0.0, x) for x in f]
    np.testing.assert_allclose(played, [advance(*rows(reflection), plain, 5, x) for x in f], atol=1e-12)
