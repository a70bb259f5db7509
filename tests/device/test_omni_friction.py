"""Friction of three coupled joints: the law itself, checked joint by joint."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapscene.device.omni_friction import slow, solve

numbers = st.floats(-3, 3)
matrices = st.tuples(*[numbers] * 9).map(lambda a: np.reshape(a, (3, 3)) @ np.reshape(a, (3, 3)).T + 0.05 * np.eye(3))
vectors = st.tuples(*[numbers] * 3)
limits = st.tuples(*[st.floats(0, 3)] * 3)


def packed(A: np.ndarray) -> tuple[float, ...]:
    return tuple(float(A[i]) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


@given(matrices, vectors)
def test_solve(A: np.ndarray, b: tuple[float, float, float]) -> None:
    assert A @ np.array(solve(packed(A), b)) == pytest.approx(b, abs=1e-9)


@given(matrices, vectors, limits, vectors)
def test_coulomb_s_law_holds_in_every_joint(
    A: np.ndarray, push: tuple[float, ...], most: tuple[float, ...], before: tuple[float, ...]
) -> None:
    w = np.array(slow(packed(A), push, most, before))
    friction = np.array(push) - A @ w
    assert np.all(np.abs(friction) <= np.array(most) + 1e-9)
    for i in range(3):
        if w[i] != 0.0:
            assert friction[i] == pytest.approx(np.sign(w[i]) * most[i], abs=1e-9)


@given(matrices, vectors, vectors)
def test_answer_does_not_depend_on_the_speed_before(
    A: np.ndarray, push: tuple[float, ...], before: tuple[float, ...]
) -> None:
    most = (0.5, 0.5, 0.5)
    assert slow(packed(A), push, most, before) == pytest.approx(slow(packed(A), push, most, (0.0, 0.0, 0.0)), abs=1e-9)


def test_a_push_below_friction_is_held_exactly() -> None:
    A = packed(np.array([[2.0, 0.3, 0.0], [0.3, 2.0, -0.5], [0.0, -0.5, 1.0]]))
    assert slow(A, (0.9, -0.9, 0.9), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)


def test_without_friction_it_is_the_plain_answer() -> None:
    A = np.array([[2.0, 0.3, 0.0], [0.3, 2.0, -0.5], [0.0, -0.5, 1.0]])
    w = slow(packed(A), (1.0, -2.0, 0.5), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert w == pytest.approx(np.linalg.solve(A, [1.0, -2.0, 0.5]))
