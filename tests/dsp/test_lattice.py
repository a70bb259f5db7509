"""The normalised lattice against the direct form, and its law: every step is a rotation."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.dsp.ar_filter import ar_from_reflection
from hapscene.dsp.lattice import advance, run_lattice
from hapscene.dsp.noise import normal, seeded_state


def rows(k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """k and c (p+1,) as the lattice has them, from its reflection coefficients (p,)."""
    return np.append(0.0, k), np.append(1.0, np.sqrt(1.0 - k**2))


@pytest.mark.parametrize("order", [1, 2, 7, 40])
def test_it_is_the_direct_form_at_the_power_of_its_excitation(order: int) -> None:
    rng = np.random.default_rng(order)
    reflection = rng.uniform(-0.9, 0.9, order)
    k, c = rows(reflection)
    f, b = rng.standard_normal(2000), np.zeros(order + 1)
    made = [advance(k, c, b, order, x) for x in f]
    direct = lfilter([np.prod(c)], ar_from_reflection(reflection), f)
    np.testing.assert_allclose(made, direct, atol=1e-10)


def test_each_step_keeps_the_sum_of_the_squares_whatever_models_follow_one_another() -> None:
    rng, order, b = np.random.default_rng(0), 9, np.zeros(10)
    b[:-1] = rng.standard_normal(order)
    for f in rng.standard_normal(200):
        before = f**2 + np.sum(b[:-1] ** 2)
        advance(*rows(rng.uniform(-0.99, 0.99, order)), b, order, f)
        assert np.sum(b**2) == pytest.approx(before, rel=1e-12)


def run(k: np.ndarray, level: np.ndarray, block: int, count: int, last: float = 0.0) -> np.ndarray:
    state, out = np.zeros((3, k.shape[1] + 1)), np.zeros(count)
    run_lattice(k, level, last, block, seeded_state(1, "texture"), state, out)
    return out


def test_the_level_is_ramped_over_each_block_to_its_own() -> None:
    k, level = np.array([[0.5, -0.3]]), np.array([2.0, 2.0, 0.0, 3.0])
    ramp = np.interp(np.arange(1, 37), [0, 10, 20, 30, 40], [1.0, *level])  # the last block is cut off
    np.testing.assert_allclose(run(k, level, 10, 36, 1.0), ramp * run(k, np.ones(4), 10, 36, 1.0), atol=1e-12)


def test_each_block_has_its_own_model_and_the_memory_goes_on() -> None:
    first, second = np.array([0.9, -0.5]), np.array([-0.7, 0.2])
    made = run(np.stack([first, second]), np.ones(2), 50, 100, 1.0)
    rng, b = seeded_state(1, "texture"), np.zeros(3)
    step = [advance(*rows(first if t < 50 else second), b, 2, normal(rng)) for t in range(100)]
    np.testing.assert_array_equal(made, step)


def test_a_texture_that_is_cut_in_two_runs_is_the_same() -> None:
    k, level = np.array([[0.4, 0.8, -0.2]]), np.array([1.0, 2.0, 0.5, 1.5])
    state, rng, parts = np.zeros((3, 4)), seeded_state(1, "texture"), np.zeros((2, 20))
    for i, last in enumerate((0.0, level[1])):
        run_lattice(k, level[2 * i : 2 * i + 2], last, 10, rng, state, parts[i])
    np.testing.assert_array_equal(parts.ravel(), run(k, level, 10, 40))
