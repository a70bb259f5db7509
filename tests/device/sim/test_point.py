"""The point mass against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.device.sim.hand import GRIPS, HAND, Grip
from hapscene.device.sim.point import PointMass, advance_point, hold_point, read_point
from hapscene.errors import HapsceneError


def make_hand(grip: Grip = GRIPS["none"], target_m: float = 0.0, target_m_s: float = 0.0) -> np.recarray:
    hand = np.zeros(1, HAND).view(np.recarray)
    hand.k_N_m, hand.b_Ns_m, hand.mass_kg = grip.row()
    hand.target_m[0, 0], hand.target_m_s[0, 0] = target_m, target_m_s
    return hand


def live(device: PointMass, v_m_s: float, f_N: float, hand: np.recarray, steps: int, h_s: float) -> tuple[float, float]:
    point = device.record((0.0, 0.0, 0.0))
    point.v_m_s[0, 0] = v_m_s
    hold_point(point[0], f_N, 0.0, 0.0)
    for _ in range(steps):
        advance_point(point[0], hand[0], h_s)
    return float(point.x_m[0, 0]), float(point.v_m_s[0, 0])


@settings(deadline=None)
@given(
    st.floats(0.02, 0.2), st.floats(0.0, 2.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.sampled_from((1, 7, 100))
)
def test_held_force_on_a_damped_mass_is_exact(m: float, b: float, v: float, f: float, steps: int) -> None:
    t = 0.01
    x, w = live(PointMass(m, b), v, f, make_hand(), steps, t / steps)
    d = b * t / m
    if d < 1e-3:  # the closed form cancels; its series to third order
        phi1, phi2 = 1 - d / 2 + d * d / 6, 1 / 2 - d / 6 + d * d / 24
    else:
        phi1, phi2 = -math.expm1(-d) / d, (d + math.expm1(-d)) / d**2
    assert w == pytest.approx(v * (1 - d * phi1) + f / m * t * phi1, rel=1e-11, abs=1e-12)
    assert x == pytest.approx(v * t * phi1 + f / m * t * t * phi2, rel=1e-11, abs=1e-14)


@settings(deadline=None)
@given(st.floats(20.0, 800.0), st.floats(0.1, 20.0), st.floats(-0.5, 0.5), st.sampled_from((1, 3, 50)))
def test_response_to_a_moving_hand_equals_the_matrix_exponential(k: float, b: float, u: float, steps: int) -> None:
    from scipy.linalg import expm

    m, own, t = 0.05, 0.1, 0.02
    hand = make_hand(Grip(k, b, 0.02), 0.003, u)
    x, w = live(PointMass(m, own), 0.2, 0.7, hand, steps, t / steps)
    mass = m + 0.02  # state: x, v, target, 1
    A = np.zeros((4, 4))
    A[0, 1] = 1.0
    A[1] = (-k / mass, -(own + b) / mass, k / mass, (b * u + 0.7) / mass)
    A[2, 3] = u
    truth = expm(A * t) @ (0.0, 0.2, 0.003, 1.0)
    assert (x, w) == (pytest.approx(truth[0], rel=1e-10), pytest.approx(truth[1], rel=1e-10, abs=1e-12))


@settings(deadline=None)
@given(st.floats(0.01, 0.5), st.floats(0.05, 1.0), st.sampled_from((1, 4, 37)))
def test_coulomb_friction_stops_a_mass_where_its_energy_is_spent(v: float, c: float, steps: int) -> None:
    m = 0.045
    stop_s, way_m = m * v / c, m * v * v / (2.0 * c)
    x, w = live(PointMass(m, 0.0, c), v, 0.0, make_hand(), steps, 1.3 * stop_s / steps)
    assert w == 0.0
    assert x == pytest.approx(way_m, rel=1e-9)


def test_friction_holds_up_to_its_limit_and_no_further() -> None:
    device = PointMass(0.045, 0.0, 0.26)
    assert live(device, 0.0, 0.2599, make_hand(), 100, 1e-4) == (0.0, 0.0)
    x, _ = live(device, 0.0, 0.36, make_hand(), 100, 1e-4)
    assert x == pytest.approx(0.1 / 0.045 * 0.01**2 / 2, rel=1e-12)


@settings(deadline=None)
@given(st.floats(0.0, 2e4), st.floats(0.0, 20.0), st.floats(-0.5, 0.5), st.floats(0.0, 0.3))
def test_many_steps_in_one_call_are_the_same_to_the_bit(k: float, b: float, u: float, c: float) -> None:
    """Whatever was known of another hand's pieces before."""
    one, other = (PointMass(0.045, 0.1, c).record((0.0, 0.0, 0.0)) for _ in range(2))
    hands = [make_hand(Grip(k, b), 0.001, u) for _ in range(2)]
    advance_point(one[0], make_hand(Grip(k + 1.0, b))[0], 1e-9)
    one.x_m = one.v_m_s = 0.0
    advance_point(one[0], hands[0][0], 1e-4, 30)
    for _ in range(30):
        advance_point(other[0], hands[1][0], 1e-4)
    assert one.tobytes() == other.tobytes() and hands[0].tobytes() == hands[1].tobytes()


def test_encoders_count_whole_steps_from_their_zero() -> None:
    point = PointMass(0.045, quantum_m=5.5e-5).record((1.23e-3, -1e-6, 0.0), zero_m=(1e-3, 0.0, 0.0))
    x, y, z = read_point(point[0])
    assert x == pytest.approx(1e-3 + 4 * 5.5e-5, abs=1e-15)
    assert (y, z) == (0.0, 0.0)


IMPOSSIBLE = (-1e-9, math.nan, math.inf)


@pytest.mark.parametrize("name", ["mass_kg", "b_Ns_m", "c_N", "quantum_m"])
@pytest.mark.parametrize("value", IMPOSSIBLE)
def test_impossible_numbers_of_a_point_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(HapsceneError, match=f"point mass: {name} must be finite and .* is {value}"):
        PointMass(**{"mass_kg": 0.1, name: value})


@pytest.mark.parametrize("name", ["k_N_m", "b_Ns_m", "mass_kg"])
@pytest.mark.parametrize("value", IMPOSSIBLE)
def test_impossible_numbers_of_a_grip_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(HapsceneError, match=f"grip: {name} must be finite and at least 0, is {value}"):
        Grip(**{"k_N_m": 0.0, "b_Ns_m": 0.0, name: value})
