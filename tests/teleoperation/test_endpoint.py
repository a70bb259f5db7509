"""Endpoints: passivity with wave variables on any link, position–position controller."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.teleoperation.endpoint import (
    ALLOWANCE_J,
    Coupling,
    Endpoint,
    control,
    fill_message,
    new_endpoint,
    receive_message,
    set_start,
)
from hapscene.teleoperation.message import MESSAGE
from hapscene.teleoperation.operation import Impairment, collect, new_link, post

Array = NDArray[np.float64]

TICK_S = 1e-3


@native
def drive(
    ends: tuple[Any, Any],
    links: tuple[Any, Any],
    out: Any,
    x_m: Array,
    f_N: Array,
    energy_J: Array,
) -> None:
    """Run both ends along given paths x_m (n, 2); forces (n, 2), transmitted and applied energy (n, 4)."""
    for k in range(len(x_m)):
        for i in range(2):
            while collect(links[1 - i], k, out):
                receive_message(ends[i], k, out[0])
        for i in range(2):
            f_N[k, i] = control(ends[i], k, x_m[k, i], 0.0, 0.0)[0]
        for i in range(2):
            fill_message(ends[i], k, out)
            post(links[i], k, out)
            energy_J[k, i] = out[0].wave_J
            energy_J[k, 2 + i] = ends[i].state[0].spent_J


def run(
    x_m: Array, coupling: Coupling, line: Impairment, seed: int = 0
) -> tuple[tuple[Endpoint, Endpoint], Array, Array]:
    """The ends afterwards, their forces (n, 2), transmitted and applied energy (n, 4)."""
    ends = new_endpoint(coupling, "leader", TICK_S), new_endpoint(coupling, "follower", TICK_S)
    for i, end in enumerate(ends):
        set_start(end, x_m[0, i], 0.0, 0.0)
    links = new_link(line, TICK_S, seed, "forth"), new_link(line, TICK_S, seed, "back")
    f_N, energy_J = np.zeros((len(x_m), 2)), np.zeros((len(x_m), 4))
    drive(ends, links, records(1, MESSAGE), x_m, f_N, energy_J)
    return ends, f_N, energy_J


def wander(seed: int, count: int = 1500) -> Array:
    """Smooth random motion of two devices (n, 2)."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(count) * TICK_S
    x = np.zeros((count, 2))
    for i in range(2):
        for f_Hz in rng.uniform(0.5, 20.0, 5):
            x[:, i] += rng.normal(0.0, 0.005) / f_Hz * (np.sin(2 * np.pi * f_Hz * t_s + rng.uniform(0, 6)))
    return x


lines = st.builds(
    Impairment,
    delay_s=st.floats(0.0, 0.1),
    jitter_s=st.floats(0.0, 0.01),
    loss=st.floats(0.0, 0.5),
)


@pytest.mark.nightly
@given(lines, st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_the_link_is_passive(line: Impairment, seed: int) -> None:
    """For any loss, delay, order or repetition of messages, and any motion."""
    _, _, energy_J = run(wander(seed), Coupling(), line, seed)
    outgoing, spent = np.maximum.accumulate(energy_J[:, :2], axis=0), energy_J[:, 2:]
    assert (spent[:, 0] <= outgoing[:, 1] + 1e-12).all()
    assert (spent[:, 1] <= outgoing[:, 0] + 1e-12).all()


@pytest.mark.nightly
@given(lines, st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_transmitted_energy_was_available(line: Impairment, seed: int) -> None:
    """At most the received energy, less the work of the motors, exact for a held force, and the allowance."""
    x_m = wander(seed)
    _, f_N, energy_J = run(x_m, Coupling(), line, seed)
    work_J = np.cumsum(np.vstack((np.zeros(2), f_N[:-1] * np.diff(x_m, axis=0))), axis=0)
    assert (energy_J[:, :2] <= energy_J[:, 2:] - work_J + ALLOWANCE_J + 1e-12).all()


def test_position_controller() -> None:
    """f = K (x_peer − x) + B (v_peer − v)."""
    coupling = Coupling("position", stiffness_N_m=400.0, damping_Ns_m=2.0)
    end, outgoing = new_endpoint(coupling, "leader", TICK_S), records(1, MESSAGE)
    set_start(end, 0.01, 0.0, 0.0)
    outgoing[0].p_WT_m = (0.03, 0.0, 0.0)
    receive_message(end, 0, outgoing[0])  # engages where they are: no force
    assert abs(control(end, 0, 0.01, 0.0, 0.0)[0]) < 1e-12
    outgoing[0].tick, outgoing[0].p_WT_m, outgoing[0].v_WT_m_s = 1, (0.031, 0.002, 0.0), (0.1, 0.0, 0.0)
    receive_message(end, 1, outgoing[0])
    f = control(end, 1, 0.01, 0.0, 0.0)
    assert f == pytest.approx((400.0 * 0.001 + 2.0 * 0.1, 400.0 * 0.002, 0.0), abs=1e-12)


@given(st.floats(0.5, 5.0), st.integers(0, 100))
@settings(max_examples=20, deadline=None)
def test_force_limit(limit_N: float, seed: int) -> None:
    _, f_N, _ = run(20.0 * wander(seed, 400), Coupling(force_limit_N=limit_N), Impairment(0.02, 0.005, 0.2))
    assert np.abs(f_N).max() <= limit_N * (1.0 + 1e-12)


@pytest.mark.parametrize("wrong", [{"scheme": "naive"}, {"stiffness_N_m": 0.0}, {"damping_Ns_m": -1.0}])
def test_coupling_out_of_range(wrong: dict[str, Any]) -> None:
    with pytest.raises(HapsceneError, match=next(iter(wrong)).partition("_")[0]):
        Coupling(**wrong)
