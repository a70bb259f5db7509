"""Every stabiliser on the closed-loop cases: what the reference says of each."""

import math

import pytest
from hapscene_experiments.stabiliser_case import BARE, STABILISERS, cost_us, draw_stabilisers, run_case, run_cases

from hapscene.device.model import DEVICES

BOUNCING = [(BARE, gesture, 2000.0) for gesture in ("tap", "press")]


@pytest.mark.parametrize(("device", "gesture", "stiffness"), BOUNCING)
def test_what_stabilises_a_wall_that_bounces(device, gesture, stiffness):
    found = {name: run_case(device, gesture, stiffness, name) for name in STABILISERS}
    assert found["none"].late_m_s > 0.05 and found["none"].out_J > 5e-3
    for name in ("limits", "virtual damping", "passivity", "coupling", "limits, passivity"):
        assert found[name].rests and found[name].out_J < 0.1e-3, name
    for name in ("limits", "virtual damping", "passivity"):
        assert found[name].kept == pytest.approx(1.0, abs=1e-3), name
    assert found["coupling"].kept == pytest.approx(200.0 / 2200.0, rel=1e-3)
    worst = found["passivity, uncapped"]
    assert worst.out_J > 10.0 * found["passivity"].out_J  # what the cap is for
    assert not found["shading"].rests and math.isnan(found["shading"].kept)  # no stabiliser, and at times the contrary


def test_shading_turns_the_force_steadily_on_the_tour():
    sharp, smooth = (run_case(DEVICES["omni"], "tour", 2000.0, name) for name in ("none", "shading"))
    assert math.degrees(sharp.turn_rad) == pytest.approx(15.0, abs=0.1)
    assert math.degrees(smooth.turn_rad) < 1.0


@pytest.mark.parametrize("gesture", ["tap", "tour"])
def test_the_default_of_a_real_device(gesture):
    row = run_case(DEVICES["omni"], gesture, 5000.0, "limits, passivity")
    assert row.rests and row.out_J < 0.1e-3
    assert row.kept == pytest.approx(700.0 / 5000.0, rel=0.02)


def test_chart(tmp_path):
    rows = run_cases(devices=[BARE], stiffnesses_N_m=[2000.0], gestures=["tap"], stabilisers=["none", "limits"])
    costs = cost_us(["none", "passivity"], repeats=1)
    assert costs["none"] == 0.0 and set(costs) == {"none", "passivity"}
    draw_stabilisers(tmp_path / "chart.png", rows, costs)
    assert (tmp_path / "chart.png").read_bytes().startswith(b"\x89PNG")
