"""Every stabiliser in closed loop, against reference results."""

import pytest

from hapscene.device.model import DEVICES, IDEAL, Device
from hapscene.device.sim.point import PointMass
from hapscene_evidence.chart.stabiliser import ACTUAL, DEFAULT, REST_M_S, STABILISERS, run_case

BARE = Device("Omni without friction and encoder steps", PointMass(0.045, 0.1), IDEAL)
BOUNCING = [(BARE, gesture, 2000.0) for gesture in ("tap", "press")]


@pytest.mark.parametrize(("device", "gesture", "stiffness"), BOUNCING)
def test_stabilisers_of_an_unstable_wall(device, gesture, stiffness):
    found = {name: run_case(device, gesture, stiffness, name) for name in STABILISERS}
    assert found["none"].rest_speed_m_s > 0.05 and found["none"].energy_J > 5e-3
    for name in ("limits", "virtual damping", "passivity", "coupling", "limits, passivity"):
        assert found[name].rest_speed_m_s < REST_M_S and found[name].energy_J < 0.1e-3, name
    for name in ("limits", "virtual damping", "passivity"):
        assert found[name].kept == pytest.approx(1.0, abs=1e-3), name
    assert found["coupling"].kept == pytest.approx(200.0 / 2200.0, rel=1e-3)


@pytest.mark.parametrize("gesture", ["tap", "tour"])
def test_default_stabiliser_of_the_omni(gesture):
    row = run_case(DEVICES["omni"], gesture, 5000.0, DEFAULT)
    assert row.rest_speed_m_s < REST_M_S and row.energy_J < 0.1e-3
    assert row.kept == pytest.approx(700.0 / 5000.0, rel=0.02)


@pytest.mark.parametrize("name", STABILISERS)
def test_only_default_and_coupling_rest_on_a_late_omni_with_half_the_friction(name):
    """It taps a wall of 5 N/mm and pushes suddenly. More accurate stabilisers oscillate, and limits alone as well."""
    actual, delay_ticks = ACTUAL["half friction, 1 ms late"]
    row = run_case(DEVICES["omni"], "tap", 5000.0, name, actual, delay_ticks)
    assert (row.rest_speed_m_s < REST_M_S) == (name in (DEFAULT, "coupling"))
    assert run_case(DEVICES["omni"], "tap", 5000.0, name).rest_speed_m_s < REST_M_S
