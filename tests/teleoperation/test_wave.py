"""Wave variables: power, and the limits on transmitted and received energy."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.records import records
from hapscene.teleoperation.endpoint import (
    Coupling,
    Endpoint,
    control,
    new_endpoint,
    receive_message,
    set_start,
)
from hapscene.teleoperation.jitter_buffer import MESSAGE
from hapscene.teleoperation.wave import (
    CREDIT_J,
    DEBT_DAMPING_NS_M,
    couple_follower,
    couple_leader,
    damp_debt,
    energy_to_send,
    limit_force,
    receive_wave,
)

TICK_S = 1e-3
AXES = range(3)

numbers = st.floats(-3.0, 3.0)
vectors = st.tuples(numbers, numbers, numbers)


def make_port(role: str = "leader", **values: float) -> Any:
    state = new_endpoint(Coupling(), role, TICK_S).state[0]
    for name, value in {"force_limit_N": math.inf, **values}.items():
        state[name] = value
    return state


def sent_wave(state: Any) -> np.ndarray:
    """The wave of the first tick [√W]."""
    return np.array(state.sent) / TICK_S


@given(vectors, vectors, st.floats(0.5, 10.0))
@settings(max_examples=50)
def test_waves_of_the_leader_transport_the_power_of_its_motors(v_m_s: Any, back: Any, b: float) -> None:
    """½u² − ½v̂² = F·v for each axis, with motor force −F."""
    state = make_port(impedance_Ns_m=b)
    state.v_m_s = v_m_s
    couple_leader(state, back)
    wave, force_N = sent_wave(state), -np.array(state.f_N)
    power_W = 0.5 * wave**2 - 0.5 * np.square(back)
    assert power_W == pytest.approx(force_N * np.array(v_m_s), abs=1e-9)
    root = math.sqrt(2.0 * b)  # and back: û of v and F is what was sent, and v̂ what arrived
    assert (b * np.array(v_m_s) + force_N) / root == pytest.approx(wave, abs=1e-9)
    assert (b * np.array(v_m_s) - force_N) / root == pytest.approx(back, abs=1e-9)
    assert state.sent_J == pytest.approx(0.5 * TICK_S * (wave**2).sum())


@given(vectors, vectors, vectors, st.floats(0.5, 10.0))
@settings(max_examples=50)
def test_waves_of_the_follower_transport_the_power_on_its_device(
    wave: Any, stretch_mm: Any, v_m_s: Any, b: float
) -> None:
    """½û² − ½v² = F·ẋ_d for each axis, with F of spring and damper at the end of the tick."""
    state = make_port("follower", impedance_Ns_m=b)
    state.v_m_s, state.x_d_m = v_m_s, np.array(stretch_mm) * 1e-3
    before = np.array(state.x_d_m)
    couple_follower(state, wave)
    back, force_N = sent_wave(state), np.array(state.f_N)
    speed = (np.array(state.x_d_m) - before) / TICK_S
    assert 0.5 * np.square(wave) - 0.5 * back**2 == pytest.approx(force_N * speed, abs=1e-8)
    drawn_N = state.stiffness_N_m * np.array(state.x_d_m) + state.damping_Ns_m * (speed - np.array(v_m_s))
    assert force_N == pytest.approx(drawn_N, abs=1e-8)


def make_end(role: str, x_m: Any, scheme: str = "wave", **values: float) -> Endpoint:
    end = new_endpoint(Coupling(scheme), role, TICK_S)
    for name, value in values.items():
        end.state[name] = value
    set_start(end, *x_m)
    return end


# Transmitted and observed energy.


def test_damping_is_active_while_there_is_an_energy_debt() -> None:
    state = make_port(allowance_J=1e-3)
    for observed_J, damped in ((0.0, True), (CREDIT_J - 1e-3 - 1e-9, True), (CREDIT_J - 1e-3 + 1e-9, False)):
        state.v_m_s, state.f_N, state.sent_J, state.observed_J = (
            (0.1, -0.2, 0.3),
            (1.0, 1.0, 1.0),
            0.05,
            observed_J + 0.05,
        )
        damp_debt(state)
        expected = 1.0 - DEBT_DAMPING_NS_M * np.array(state.v_m_s) if damped else np.ones(3)
        assert np.array(state.f_N) == pytest.approx(expected, abs=1e-15)
        taken_W = (np.ones(3) - np.array(state.f_N)) @ np.array(state.v_m_s)
        assert (taken_W > 0.0) == damped  # it only ever takes


@given(vectors, st.floats(0.1, 10.0))
@settings(max_examples=50)
def test_a_limited_force_keeps_its_direction(force_N: Any, limit_N: float) -> None:
    state = make_port(force_limit_N=limit_N)
    state.f_N = force_N
    limit_force(state)
    size = np.linalg.norm(force_N)
    expected = np.array(force_N) * (limit_N / size if size > limit_N else 1.0)
    assert np.array(state.f_N) == pytest.approx(expected, rel=1e-12, abs=1e-300)


@pytest.mark.parametrize(
    ("sent_J", "observed_J", "expected_J"),
    [(0.1, 1.0, 0.1 + CREDIT_J), (0.1, 0.05, 0.05 + 1e-3), (0.0, -0.5, -0.5 + 1e-3)],
)
def test_transmitted_energy_is_limited(sent_J: float, observed_J: float, expected_J: float) -> None:
    state = make_port(allowance_J=1e-3)
    state.sent_J, state.observed_J = sent_J, observed_J
    assert energy_to_send(state) == pytest.approx(expected_J)


# Received waves: limited by energy; position errors are made up.


def receiving_end(total: Any, total_J: float, **coupling: float) -> Endpoint:
    """A follower that has engaged and received these totals."""
    end, message = make_end("follower", (0.0, 0.0, 0.0), **coupling), records(1, MESSAGE)
    receive_message(end, 0, message[0])
    control(end, 0, 0.0, 0.0, 0.0)
    message[0].tick, message[0].wave_sqrtJs, message[0].wave_J = 1, total, total_J
    receive_message(end, 1, message[0])
    return end


def called(end: Endpoint, now: int) -> Any:
    from hapscene.teleoperation.jitter_buffer import advance_queue

    advance_queue(end.queue[0], now)
    return np.array(receive_wave(end.state[0], end.queue[0]))


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0, 4.0])
def test_a_wave_is_limited_by_its_energy(share: float) -> None:
    total = np.array([1e-3, -2e-3, 3e-3])
    needed_J = 0.5 * (total**2).sum() / TICK_S
    end = receiving_end(total, share * needed_J, reserve_J=10.0)
    wave = called(end, 1)
    assert wave * TICK_S == pytest.approx(min(math.sqrt(share), 1.0) * total, abs=1e-15)
    assert end.state[0].spent_J == pytest.approx(min(share, 1.0) * needed_J)
    assert end.state[0].observed_J == pytest.approx(min(share, 1.0) * needed_J)


@pytest.mark.parametrize("axis", AXES)
def test_position_is_made_up_when_energy_arrives(axis: int) -> None:
    """The applied integral reaches the received one."""
    total = 5e-3 * np.eye(3)[axis]
    end, message, played = receiving_end(total, 0.0, reserve_J=10.0), records(1, MESSAGE), np.zeros(3)
    for now in range(1, 400):
        played += called(end, now) * TICK_S
        message[0].tick, message[0].wave_sqrtJs, message[0].wave_J = now + 1, total, 1.0 if now > 5 else 0.0
        receive_message(end, now + 1, message[0])
    assert played == pytest.approx(total, abs=1e-7)


def test_unused_energy_beyond_the_reserve_is_discarded() -> None:
    end = receiving_end((0.0, 0.0, 0.0), 5.0, reserve_J=0.02)
    called(end, 1)
    assert end.state[0].spent_J == pytest.approx(5.0 - 0.02)
