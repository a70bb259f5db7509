"""Endpoints: position–position controller, invalid settings."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.teleoperation.endpoint import (
    ALLOWANCE_J,
    CUTOFF_HZ,
    RESERVE_J,
    Coupling,
    control,
    fill_message,
    new_endpoint,
    receive_message,
    set_start,
)
from hapscene.teleoperation.jitter_buffer import MESSAGE
from hapscene.teleoperation.wave import CREDIT_J

TICK_S = 1e-3


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
    outgoing[0].tick, outgoing[0].p_WT_m = 0, (9.0, 9.0, 9.0)
    receive_message(end, 2, outgoing[0])  # overtaken by the newer one
    assert control(end, 2, 0.01, 0.0, 0.0) == f
    outgoing[0].tick, outgoing[0].p_WT_m, outgoing[0].v_WT_m_s = 2, (0.03, 0.0, -0.3), (0.0, 0.0, 0.0)
    receive_message(end, 3, outgoing[0])
    assert control(end, 3, 0.01, 0.0, 0.0) == pytest.approx((0.0, 0.0, -coupling.force_limit_N))


def test_what_an_end_measures_and_sends() -> None:
    """Low-passed velocity, work of the held force, and the energy that it may send."""
    end, message = new_endpoint(Coupling("position", 200.0, 0.0), "follower", TICK_S), records(1, MESSAGE)
    path = np.cumsum(np.random.default_rng(0).normal(0.0, 1e-4, (40, 3)), axis=0)
    set_start(end, *path[0])
    assert [control(end, 0, *path[0]), int(end.state[0].received_tick)] == [(0.0, 0.0, 0.0), -1]
    message[0].p_WT_m = path[0] + (1.0, 2.0, 3.0)  # only its changes count
    receive_message(end, 0, message[0])
    forces = np.array([control(end, now, *p) for now, p in enumerate(path)])
    np.testing.assert_allclose(forces, -200.0 * (path - path[0]), atol=1e-12)
    state, share = end.state[0], 1.0 - math.exp(-2.0 * math.pi * CUTOFF_HZ * TICK_S)
    smooth = lfilter([share], [1.0, share - 1.0], path - path[0], axis=0)
    np.testing.assert_allclose(state.v_m_s, (smooth[-1] - smooth[-2]) / TICK_S, atol=1e-12)
    work_J = np.sum(forces[:-1] * np.diff(path, axis=0))
    assert state.work_J == pytest.approx(work_J) and state.observed_J == pytest.approx(-work_J)
    fill_message(end, 7, message)
    assert message[0].tick == 7 and message[0].p_WT_m.tolist() == path[-1].tolist()
    assert message[0].v_WT_m_s.tolist() == state.v_m_s.tolist() and not message[0].wave_sqrtJs.any()
    assert message[0].wave_J == pytest.approx(min(CREDIT_J, ALLOWANCE_J - work_J))
    state.observed_J, state.sent_J = 1.0, 0.25
    control(end, 40, *path[-1])
    assert state.observed_J == pytest.approx(0.25 + RESERVE_J)


@pytest.mark.parametrize(
    "wrong",
    [{"scheme": "naive"}, *({name: 0.0} for name in ("stiffness_N_m", "impedance_Ns_m", "force_limit_N")),
     {"stiffness_N_m": math.inf}, {"damping_Ns_m": -1.0}, {"damping_Ns_m": math.inf}],
)  # fmt: skip
def test_coupling_out_of_range(wrong: dict[str, Any]) -> None:
    with pytest.raises(HapsceneError, match=next(iter(wrong)).partition("_")[0]):
        Coupling(**wrong)
    assert Coupling(damping_Ns_m=0.0).damping_Ns_m == 0.0
