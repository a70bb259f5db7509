"""Dynamics of the Omni: the published matrix, positive definite; Coriolis and gravity from energy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from hapscene.device.omni_dynamics import (
    apparent_mass,
    coriolis_at,
    coriolis_matrix,
    gravity,
    mass_matrix,
    potential_J,
    slopes_at,
)
from hapscene.device.omni_kinematics import (
    ELBOW_RAD,
    NOMINAL_RAD,
    SHOULDER_RAD,
    WAIST_RAD,
    forward,
    inverse,
    jacobian,
    turns_at,
)
from hapscene.device.omni_step import STOP_OVER_RAD

k1, k2, k3, k4, k5, k6, k7, k8, k9, k10 = (
    k * 1e-3 for k in (1.798, 0.864, 0.486, 2.766, 0.308, 2.526, 0.652, 164.158, 94.050, 117.294)
)
over = STOP_OVER_RAD
postures = st.tuples(
    st.floats(*WAIST_RAD),
    st.floats(SHOULDER_RAD[0] - over, SHOULDER_RAD[1] + over),
    st.floats(ELBOW_RAD[0] - over, ELBOW_RAD[1] + over),
).map(lambda q: np.array([q[0], q[1], q[1] + q[2]]))
speeds = st.tuples(*[st.floats(-20, 20)] * 3).map(np.array)


def workspace() -> NDArray[np.float64]:
    """Postures (n, 3) over the data sheet's box."""
    axes = [np.linspace(-w / 2, w / 2, 7) for w in (0.16, 0.12, 0.07)]
    box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return inverse(box + forward(NOMINAL_RAD))


def test_mass_matrix_is_the_published_one_all_over_the_workspace() -> None:
    for q in workspace():
        _, q2, q3 = q
        m11 = k1 + k2 * math.cos(2 * q2) + k3 * math.cos(2 * q3) + k4 * math.cos(q2) * math.sin(q3)
        m12, m23 = k5 * math.sin(q2), -0.5 * k4 * math.sin(q2 - q3)
        assert mass_matrix(q) == pytest.approx(np.array([[m11, m12, 0], [m12, k6, m23], [0, m23, k7]]), abs=1e-15)


@given(postures)
def test_mass_matrix_is_positive_definite_as_far_as_a_joint_goes(q: NDArray[np.float64]) -> None:
    M = mass_matrix(q)
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M)[0] > 5e-5


@given(postures, speeds)
def test_coriolis_makes_no_energy(q: NDArray[np.float64], dq: NDArray[np.float64]) -> None:
    """Ṁ − 2C is skew, Ṁ by difference along the motion."""
    step = 1e-6
    rate = (mass_matrix(q + dq * step) - mass_matrix(q - dq * step)) / (2 * step)
    N = rate - 2 * coriolis_matrix(q, dq)
    assert pytest.approx(np.zeros((3, 3)), abs=1e-6) == N + N.T


@given(postures, speeds)
def test_coriolis_is_lagrange_s(q: NDArray[np.float64], dq: NDArray[np.float64]) -> None:
    """C q̇ = Ṁ q̇ − ∂T/∂q, T the kinetic energy, by differences of T alone."""
    step = 1e-6
    rate = (mass_matrix(q + dq * step) - mass_matrix(q - dq * step)) / (2 * step)
    slope = [dq @ (mass_matrix(q + e) - mass_matrix(q - e)) @ dq / (4 * step) for e in np.eye(3) * step]
    assert coriolis_matrix(q, dq) @ dq == pytest.approx(rate @ dq - slope, abs=1e-6)


@given(postures, speeds)
def test_the_loop_s_coriolis_is_the_matrix_s(q: NDArray[np.float64], dq: NDArray[np.float64]) -> None:
    slopes = slopes_at(q[1], q[2], turns_at(*q))
    assert coriolis_at(slopes, *dq) == pytest.approx(coriolis_matrix(q, dq) @ dq, abs=1e-12)


@given(postures)
def test_gravity_is_the_slope_of_the_potential(q: NDArray[np.float64]) -> None:
    step = 1e-6
    slope = [(potential_J(q + e) - potential_J(q - e)) / (2 * step) for e in np.eye(3) * step]
    assert gravity(q) == pytest.approx(slope, abs=1e-8)
    assert gravity(q)[1:] == pytest.approx(
        [k8 * math.cos(q[1]) + k10 * (q[1] - math.pi / 2), k9 * math.sin(q[2])], abs=1e-15
    )


def test_apparent_mass_is_the_published_range() -> None:
    """39 to 155 g over four postures, which the source does not name: these four stand about the workspace's middle."""
    masses = np.array([apparent_mass(q) for q in ([0, 0.3, 0.3], [0, 0.5, 0.2], [0, 0.65, 0.65], [0, 0.5, 1.0])])
    assert masses.min() == pytest.approx(0.039, rel=0.03)
    assert masses.max() == pytest.approx(0.155, rel=0.03)


def test_lightest_direction_with_orthogonal_arms_is_the_forearm_s() -> None:
    """The forearm moves the tip alone there: k7 / l2²."""
    for angle in (0.2, 0.65, 1.2):
        q = np.array([0.0, angle, angle])
        J = jacobian(q)
        lightest = 1.0 / np.linalg.eigvalsh(J @ np.linalg.solve(mass_matrix(q), J.T))[-1]
        assert lightest == pytest.approx(k7 / 0.1325**2, rel=1e-9)
