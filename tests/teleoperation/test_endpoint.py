"""Endpoints: position–position controller, invalid settings."""

from typing import Any

import pytest

from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.teleoperation.endpoint import (
    Coupling,
    control,
    new_endpoint,
    receive_message,
    set_start,
)
from hapscene.teleoperation.jitter_buffer import MESSAGE

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


@pytest.mark.parametrize("wrong", [{"scheme": "naive"}, {"stiffness_N_m": 0.0}, {"damping_Ns_m": -1.0}])
def test_coupling_out_of_range(wrong: dict[str, Any]) -> None:
    with pytest.raises(HapsceneError, match=next(iter(wrong)).partition("_")[0]):
        Coupling(**wrong)
