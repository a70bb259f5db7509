"""The Omni in time: energy, convergence, sticking, and that nothing a loop can hand it makes it blow up."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import INTERPRETED
from hapscene.device.sim.omni import Omni, advance_omni, hold_omni, read_omni, tip_omni
from hapscene.device.sim.omni_kinematics import (
    ELBOW_RAD,
    NOMINAL_RAD,
    SHOULDER_RAD,
    WAIST_RAD,
    forward,
    inverse,
    jacobian,
    turns_at,
)
from hapscene.device.sim.omni_record import OMNI, OmniFlag
from hapscene.device.sim.omni_step import (
    K8,
    K9,
    K10,
    SPEED_MAX_RAD_S,
    STEP_MAX_S,
    STOP_NM_RAD,
    STOP_NMS,
    STOP_OVER_RAD,
    _stop,
    coriolis_at,
    gravity,
    mass_matrix,
    slopes_at,
    slow,
)
from tests.device.sim.test_omni import ORIGIN, hand

FREE = Omni(friction_N=0.0, damping_Ns_m=0.0, damping_ratio=0.0, gravity=False, resolution_m=0.0)
SHORT = 5 if INTERPRETED else 1
"""Divides the length of runs."""


def potential_J(q: ArrayLike) -> float:
    """Potential energy of gravity and counterbalance [J], whose gradient is G."""
    _, q2, q3 = np.asarray(q, float)
    return float(K8 * math.sin(q2) + 0.5 * K10 * (q2 - math.pi / 2.0) ** 2 - K9 * math.cos(q3))


def energy_J(omni: Any, hands: Any) -> float:
    """Kinetic energy, springs of structure and hand, weight."""
    q, dq, p = omni.q[0], omni.dq[0], omni.p_DT_m[0]
    away = hands.target_m[0] - np.array(tip_omni(omni[0]))
    E = 0.5 * dq @ mass_matrix(q) @ dq + 0.5 * hands.k_N_m[0] * away @ away
    kg = omni.tool_kg[0] + hands.mass_kg[0]
    E += 0.5 * kg * omni.v_DT_m_s[0] @ omni.v_DT_m_s[0]
    E += 0.5 * np.sum(omni.stiffness_N_m[0] * (p - forward(q)) ** 2)
    if omni.gravity[0]:
        E += potential_J(q)
    return float(E)


def test_energy_is_kept_to_second_order() -> None:
    """A frictionless arm, let fall on a hand's spring: the error is small, and a quarter at half the step."""
    free = {"friction_N": 0.0, "damping_Ns_m": 0.0, "damping_ratio": 0.0}
    device = Omni(**free, resolution_m=0.0, gravity_compensated=False)
    drift_J = []
    for count in (1, 2):
        omni = device.record(ORIGIN)
        spring = hand(k_N_m=60.0, target_m=(0.02, 0.01, 0.005))
        start_J, worst_J, moved_J = energy_J(omni, spring), 0.0, 0.0
        for _ in range(500 // SHORT):
            for _ in range(5 * count):
                advance_omni(omni[0], spring[0], STEP_MAX_S / count)
            worst_J = max(worst_J, abs(energy_J(omni, spring) - start_J))
            dq = omni.dq[0]
            moved_J = max(moved_J, 0.5 * dq @ mass_matrix(omni.q[0]) @ dq)
            assert not omni.trouble[0] & OmniFlag.AT_STOP
        drift_J.append(worst_J)
        assert worst_J < 2e-3 * moved_J
    assert drift_J[1] < 0.3 * drift_J[0]


def wall(device: Omni, grip: tuple[float, float, float], count: int, ticks: int) -> NDArray[np.float64]:
    """Tip and wall force (ticks, 4): a hand taps a wall of 500 N/m and strokes along it, `count` steps a tick."""
    omni = device.record((0.0, 0.0, 0.003))
    holder = hand(k_N_m=grip[0], b_Ns_m=grip[1], mass_kg=grip[2], target_m=(0.0, 0.0, 0.003))
    rows = np.zeros((ticks, 4))
    for k in range(ticks):
        z = read_omni(omni[0])[2]
        force_N = 500.0 * max(0.0, -z)
        hold_omni(omni[0], 0.0, 0.0, force_N)
        turn = 2.0 * np.pi * k * 1e-3
        holder.target_m_s = (0.1 * np.sin(2.0 * turn), 0.0, -0.1 * np.sin(3.0 * turn))
        for _ in range(count):
            advance_omni(omni[0], holder[0], 1e-3 / count)
        rows[k] = *tip_omni(omni[0]), force_N
    return rows


@pytest.mark.parametrize("grip", [(60.0, 0.3, 0.0), (200.0, 2.0, 0.01), (500.0, 5.0, 0.03)])
def test_halving_the_step_changes_nothing(grip: tuple[float, float, float]) -> None:
    """Tip within 1 µm and force within 1 % over half a second of tapping and stroking, friction and all.

    Encoders are exact here: a count that falls a microsecond later into the next tick is not the integrator's doing.
    """
    device = Omni(resolution_m=0.0)
    coarse, fine = (wall(device, grip, count, 500 // SHORT) for count in (10, 20))
    change = np.abs(coarse - fine).max(axis=0)
    print(f"{grip}: tip {change[:3].max() * 1e6:.3f} µm, force {change[3] * 1e3:.3f} mN")
    assert coarse[:, 3].max() > 0.3 or SHORT > 1
    assert change[:3].max() < 1e-6
    assert change[3] < 0.01 * coarse[:, 3].max() + 1e-9


def test_one_long_call_equals_many_short_calls() -> None:
    a, b, c = (Omni().record(ORIGIN) for _ in range(3))
    one, other, third = (hand(k_N_m=200.0, b_Ns_m=2.0, target_m_s=(0.1, 0.0, 0.0)) for _ in range(3))
    advance_omni(a[0], one[0], 1e-3)
    advance_omni(c[0], third[0], 1e-4, 10)
    for _ in range(10):
        advance_omni(b[0], other[0], 1e-4)
    for same, with_hand in ((b, other), (c, third)):
        assert np.array(tip_omni(a[0])) == pytest.approx(np.array(tip_omni(same[0])), abs=1e-15)
        assert one.target_m == pytest.approx(with_hand.target_m)
    before = a.copy()
    for h_s in (0.0, -1.0, np.nan, np.inf):
        advance_omni(a[0], one[0], h_s)
    assert a.tobytes() == before.tobytes()


def test_static_friction_holds_without_creep_under_vibration() -> None:
    """Reference F3: half of friction's force, and a fifth of it on top at 20 Hz: no joint moves, ever."""
    omni = Omni().record(ORIGIN)
    pusher = hand()
    for k in range(500):  # the push comes on slowly, so that the structure does not ring
        pusher.push_N = (0.13 * k / 500, 0.0, 0.0)
        advance_omni(omni[0], pusher[0], 1e-3)
    rest = omni.q[0].copy()
    for k in range(3000 // SHORT):
        pusher.push_N = (0.13 + 0.052 * np.sin(2.0 * np.pi * 20.0 * k * 1e-3), 0.0, 0.0)
        advance_omni(omni[0], pusher[0], 1e-3)
        assert np.array_equal(omni.q[0], rest)
        assert np.array_equal(omni.dq[0], np.zeros(3))


def test_sliding_joint_stops_at_once_and_stays() -> None:
    """Reference F4, a waist that slides to rest: it slows at c / M11 to exactly 0, without one change of sign."""
    omni = Omni(damping_Ns_m=0.0, gravity=False, tool_kg=1e-9, resolution_m=0.0).record(ORIGIN)
    omni.dq = (1.0, 0.0, 0.0)
    omni.v_DT_m_s = jacobian(omni.q[0])[:, 0]
    no_hand, speeds = hand(), []
    for _ in range(900):
        advance_omni(omni[0], no_hand[0], STEP_MAX_S)
        speeds.append(float(omni.dq[0, 0]))
    moving = np.count_nonzero(speeds)
    assert np.all(np.diff(speeds) <= 0.0) and np.all(np.array(speeds) >= 0.0)
    slowing = omni.friction_Nm[0, 0] / mass_matrix(inverse(forward(omni.q[0])))[0, 0]
    assert moving == pytest.approx(1.0 / (slowing * STEP_MAX_S), rel=0.1)
    assert speeds[-1] == 0.0


@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)])
def test_stops_hold_a_firm_push(axis: int, sign: int) -> None:
    omni = Omni().record(ORIGIN)
    push_N = np.zeros(3)
    push_N[axis] = sign * 10.0
    pusher = hand(b_Ns_m=5.0, push_N=push_N)
    advance_omni(omni[0], pusher[0], 2.0 / SHORT)
    q = omni.q[0]
    free = (q[0], q[1], q[2] - q[1])
    for angle, (low, high) in zip(free, (WAIST_RAD, SHOULDER_RAD, ELBOW_RAD), strict=True):
        assert low - STOP_OVER_RAD - 1e-12 <= angle <= high + STOP_OVER_RAD + 1e-12
    assert omni.trouble[0] & OmniFlag.AT_STOP
    if not INTERPRETED:
        assert np.all(np.abs(omni.dq) < 0.5)


def test_stops_push_back_and_damp_compression_only() -> None:
    for angle, speed, torque in (
        *((0.7, 9.0, 0.0), (0.72, 2.0, -0.02 * STOP_NM_RAD - 2.0 * STOP_NMS), (0.72, -2.0, -0.02 * STOP_NM_RAD)),
        *((-0.5, -9.0, 0.0), (-0.52, -2.0, 0.02 * STOP_NM_RAD + 2.0 * STOP_NMS), (-0.52, 2.0, 0.02 * STOP_NM_RAD)),
    ):
        assert _stop(angle, speed, -0.5, 0.7) == pytest.approx(torque)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_speed_of_a_joint_is_limited(sign: float) -> None:
    omni, no_hand = FREE.record(ORIGIN), hand()
    omni.dq = (sign * 1000.0, 0.0, 0.0)
    advance_omni(omni[0], no_hand[0], STEP_MAX_S)
    assert omni.dq[0, 0] == sign * SPEED_MAX_RAD_S and omni.trouble[0] & OmniFlag.SPEED_LIMITED
    advance_omni(omni[0], no_hand[0], 1.0)
    assert abs(omni.q[0, 0]) <= WAIST_RAD[1] + STOP_OVER_RAD


anything = st.floats(allow_nan=True, allow_infinity=True)
nasty = st.one_of(anything, st.sampled_from([1e9, -1e9, 1e300, -1e300, np.nan, np.inf, -np.inf, 0.0]))


@settings(max_examples=40 // SHORT, deadline=None)
@given(
    st.tuples(*[nasty] * 3),
    st.tuples(*[nasty] * 3),
    st.tuples(*[nasty] * 3),
    st.tuples(*[nasty] * 3),
    st.tuples(*[nasty] * 3),
    st.sampled_from([Omni(), FREE, Omni(tool_kg=1e-4, stiffness_N_m=(1e5, 1e5, 1e5))]),
)
def test_any_input_leaves_it_finite_and_within_its_stops(
    force: tuple[float, ...],
    grip: tuple[float, ...],
    target: tuple[float, ...],
    rate: tuple[float, ...],
    push: tuple[float, ...],
    device: Omni,
) -> None:
    omni = device.record(ORIGIN)
    holder = hand(k_N_m=grip[0], b_Ns_m=grip[1], mass_kg=grip[2], target_m=target, target_m_s=rate, push_N=push)
    for _ in range(30):
        hold_omni(omni[0], *force)
        if not np.all(np.isfinite(force)):
            assert omni.trouble[0] & OmniFlag.FORCE_NOT_FINITE
        advance_omni(omni[0], holder[0], 1e-3)
        for name in OMNI.names or ():
            if name != "thermal_s":
                assert np.all(np.isfinite(omni[name])), name
        assert np.all(np.isfinite(read_omni(omni[0]) + tip_omni(omni[0])))
    if not np.all(np.isfinite(grip + push)):
        assert omni.trouble[0] & OmniFlag.HAND_NOT_FINITE
    q1, q2, q3 = omni.q[0]
    for angle, (low, high) in zip((q1, q2, q3 - q2), (WAIST_RAD, SHOULDER_RAD, ELBOW_RAD), strict=True):
        assert low - STOP_OVER_RAD - 1e-9 <= angle <= high + STOP_OVER_RAD + 1e-9


# Dynamics of the Omni: the published matrix, positive definite; Coriolis and gravity from energy.


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


@given(postures, speeds)
def test_coriolis_is_lagrange_s(q: NDArray[np.float64], dq: NDArray[np.float64]) -> None:
    """C q̇ = Ṁ q̇ − ∂T/∂q, T the kinetic energy, by differences of T alone."""
    step = 1e-6
    rate = (mass_matrix(q + dq * step) - mass_matrix(q - dq * step)) / (2 * step)
    slope = [dq @ (mass_matrix(q + e) - mass_matrix(q - e)) @ dq / (4 * step) for e in np.eye(3) * step]
    assert coriolis_at(slopes_at(q[1], q[2], turns_at(*q)), *dq) == pytest.approx(rate @ dq - slope, abs=1e-6)


@given(postures)
def test_gravity_is_the_slope_of_the_potential(q: NDArray[np.float64]) -> None:
    step = 1e-6
    slope = [(potential_J(q + e) - potential_J(q - e)) / (2 * step) for e in np.eye(3) * step]
    assert gravity(q) == pytest.approx(slope, abs=1e-8)
    assert gravity(q)[1:] == pytest.approx(
        [k8 * math.cos(q[1]) + k10 * (q[1] - math.pi / 2), k9 * math.sin(q[2])], abs=1e-15
    )


# Friction of three coupled joints: the law itself, checked joint by joint.


numbers = st.floats(-3, 3)
matrices = st.tuples(*[numbers] * 9).map(lambda a: np.reshape(a, (3, 3)) @ np.reshape(a, (3, 3)).T + 0.05 * np.eye(3))
vectors = st.tuples(*[numbers] * 3)
limits = st.tuples(*[st.floats(0, 3)] * 3)


def packed(A: np.ndarray) -> tuple[float, ...]:
    return tuple(float(A[i]) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


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
