"""Kinematics of the Omni: against a product of homogeneous transforms, and against itself backwards."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from hapscene.device.sim.omni_kinematics import (
    ELBOW_RAD,
    FOREARM_M,
    NOMINAL_LEVER_M,
    NOMINAL_RAD,
    SHOULDER_M,
    SHOULDER_RAD,
    SINGULAR,
    UPPER_M,
    WAIST_RAD,
    forward,
    inverse,
    jacobian,
    reachable,
    within_limits,
)

postures = st.tuples(st.floats(*WAIST_RAD), st.floats(*SHOULDER_RAD), st.floats(*ELBOW_RAD)).map(
    lambda q: np.array([q[0], q[1], q[1] + q[2]])
)


def singular(q: ArrayLike) -> NDArray[np.bool_]:
    """Whether postures (…, 3) are close to singular: det J below `SINGULAR` of the nominal one."""
    return np.abs(np.linalg.det(jacobian(q))) < SINGULAR * math.prod(NOMINAL_LEVER_M)


def moved(x: float, y: float, z: float) -> NDArray[np.float64]:
    X = np.eye(4)
    X[:3, 3] = x, y, z
    return X


def turned(axis: str, angle: float) -> NDArray[np.float64]:
    s, c = math.sin(angle), math.cos(angle)
    X = np.eye(4)
    X[:3, :3] = {
        "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
        "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }[axis]
    return X


def urdf_tip(waist: float, shoulder: float, elbow: float) -> NDArray[np.float64]:
    """X (4, 4) of the wrist's end in the URDF's base, joint by joint as the file has it, its numbers typed anew."""
    return (
        moved(0, 0, 0.09)
        @ turned("z", waist)
        @ moved(-0.0075, 0, 0.035)
        @ turned("x", shoulder)
        @ moved(0.0075, 0.134, 0)
        @ turned("x", -1.5)
        @ turned("x", elbow)
        @ moved(0, 0.08, 0)
        @ moved(0, 0.0525, 0)
    )


@given(postures)
def test_forward_is_the_urdf_s(q: NDArray[np.float64]) -> None:
    """Its base has x to the left, y to the user, z up; its elbow is relative to the upper arm."""
    x, y, z = urdf_tip(q[0], q[1], q[2] - q[1] + 1.5 - math.pi / 2)[:3, 3]
    assert forward(q) == pytest.approx([-x, z, y], abs=1e-12)


@given(postures)
def test_inverse_undoes_forward(q: NDArray[np.float64]) -> None:
    p = forward(q)
    assert reachable(p)
    assert forward(inverse(p)) == pytest.approx(p, abs=1e-12)
    if not singular(q):
        assert inverse(p) == pytest.approx(q, abs=1e-9)


@given(postures)
def test_jacobian_is_the_derivative(q: NDArray[np.float64]) -> None:
    step = 1e-6
    for k, e in enumerate(np.eye(3) * step):
        assert jacobian(q)[:, k] == pytest.approx((forward(q + e) - forward(q - e)) / (2 * step), abs=1e-9)


@given(st.tuples(*[st.floats(-10, 10)] * 3))
def test_inverse_is_finite_everywhere(p: tuple[float, float, float]) -> None:
    q = inverse(p)
    assert np.all(np.isfinite(q))
    if reachable(p):
        assert within_limits(q)
        assert forward(q) == pytest.approx(p, abs=1e-9)


def test_on_the_waist_s_axis_it_is_singular_and_finite() -> None:
    q = inverse([0.0, 0.3, 0.0])
    assert np.all(np.isfinite(q)) and q[0] == 0.0
    assert singular(q)
    assert singular([0.0, 0.5, 0.5 + math.pi / 2])  # stretched
    assert not singular(NOMINAL_RAD)


def test_shoulder_s_angle_is_within_a_turn_behind_the_waist() -> None:
    grid = np.array(np.meshgrid([0.0, 0.01], np.linspace(0.0, 0.3, 31), np.linspace(-0.2, 0.2, 41))).reshape(3, -1).T
    q, far_m = inverse(grid), np.linalg.norm(grid - (0.0, SHOULDER_M, 0.0), axis=1)
    assert -math.pi < q[:, 1].min() < -3.0 and 3.0 < q[:, 1].max() <= math.pi
    within = (far_m > UPPER_M - FOREARM_M) & (far_m < UPPER_M + FOREARM_M)
    np.testing.assert_allclose(forward(q)[within], grid[within], atol=1e-9)


def test_data_sheet_s_workspace_is_within_reach() -> None:
    """160 × 120 × 70 mm about the tip in the nominal posture."""
    axes = [np.linspace(-w / 2, w / 2, 9) for w in (0.16, 0.12, 0.07)]
    box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) + forward(NOMINAL_RAD)
    assert np.all(reachable(box))
    assert not np.any(singular(inverse(box)))
    assert not reachable([0.0, 0.1, 0.3])  # over 0.2665 from the shoulder
