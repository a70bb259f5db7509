"""The closed forms agree with each other: each is a case or a limit of another, or of the characteristic
polynomial.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.stability import closed_form as form

masses, ticks, shares = st.floats(0.01, 1.0), st.floats(1e-4, 1e-2), st.floats(1e-5, 0.5)


@settings(max_examples=10, deadline=None)
@given(masses, ticks, shares)
def test_polynomial_without_wall_damping(mass: float, tick: float, share: float) -> None:
    damping = share * mass / tick
    zero, one = form.limit_without_delay(mass, damping, tick), form.limit_with_one_delay(mass, damping, tick)
    assert form.limit_of_small_motion(mass, damping, tick) == pytest.approx(zero, rel=1e-6)
    assert form.limit_of_small_motion(mass, damping, tick, 1) == pytest.approx(one, rel=1e-6)


@settings(max_examples=10, deadline=None)
@given(masses, ticks, st.floats(0.01, 1.99))
def test_polynomial_with_wall_damping(mass: float, tick: float, beta: float) -> None:
    wall = beta * mass / tick
    expected = form.limit_with_wall_damping(mass, wall, tick)
    assert form.limit_of_small_motion(mass, 0.0, tick, 0, wall) == pytest.approx(expected, rel=1e-6)


def test_a_root_leaves_the_unit_circle_at_the_limit() -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        delay, damping = int(rng.integers(0, 6)), 10.0 ** rng.uniform(-4, 2)
        wall = rng.uniform(0.0, 0.9) / (1 + delay)
        limit = form.limit_of_small_motion(1.0, damping, 1.0, delay, wall)
        roots = [form.largest_root(share * limit, 1.0, damping, 1.0, delay, wall) for share in (0.5, 0.9999, 1.0001)]
        assert max(roots[:2]) < 1.0 < roots[2]


def test_small_damping() -> None:
    assert form.limit_without_delay(0.1, 1e-4, 1e-3) == pytest.approx(
        form.limit_of_passivity(1e-4, 0.0, 1e-3), rel=1e-5
    )
    assert form.limit_with_one_delay(0.1, 1e-4, 1e-3) == pytest.approx(1e-4 / (0.5e-3 + 1e-3), rel=1e-5)


def test_apex() -> None:
    beta = np.linspace(0.01, 1.99, 100_001)
    alpha = np.array([form.limit_with_wall_damping(1.0, b, 1.0) for b in beta])
    assert alpha.max() == pytest.approx(form.APEX_ALPHA, rel=1e-9)
    assert beta[alpha.argmax()] == pytest.approx(form.APEX_BETA, abs=2e-5)


def test_a_root_of_an_overdamped_device_leaves_through_minus_one() -> None:
    for delta, flips in ((3.7, False), (3.75, True)):
        turning = form.limit_without_delay(1.0, delta, 1.0)
        assert (form.limit_of_small_motion(1.0, delta, 1.0) < turning * (1.0 - 1e-6)) == flips


def test_the_limit_is_zero_without_damping() -> None:
    assert form.limit_without_delay(1.0, 0.0, 1.0) == form.limit_with_one_delay(1.0, 0.0, 1.0) == 0.0
    assert form.limit_of_small_motion(1.0, 0.0, 1.0) == 0.0
    assert form.limit_with_wall_damping(1.0, 2.5, 1.0) == 0.0


def test_peak_speed_and_restitution_agree_on_the_lossless_case() -> None:
    """If hold and dampers balance, a bounce keeps its speed, and there is no limit of the speed."""
    tick, damping = 1e-3, 0.1
    stiffness = 2.0 * damping / tick
    assert form.restitution(0.05, stiffness, tick, 0, damping) == pytest.approx(1.0)
    assert form.peak_speed(0.1, stiffness * (1 - 1e-9), tick, damping) == math.inf
    assert form.peak_speed(0.1, stiffness * (1 + 1e-6), tick, damping) > 1e4


def test_rest_at_half_a_step() -> None:
    stiffness = form.limit_of_rest(0.2, 5e-5)
    assert form.comes_to_rest(0.2, 0.999 * stiffness, 5e-5)
    assert not form.comes_to_rest(0.2, 1.001 * stiffness, 5e-5)
