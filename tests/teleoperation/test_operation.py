"""Teleoperation in closed loop: passivity, equilibrium, rendered stiffness."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.constants import TICK_S
from hapscene.device.sim.hand import Grip
from hapscene.device.sim.point import PointMass
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.endpoint import ALLOWANCE_J, Coupling
from hapscene.teleoperation.operation import Impairment, Operation
from hapscene.teleoperation.plate import START_M, explore, plate
from tests.teleoperation.delays import (
    BAD,
    ENERGY_MAX_J,
    REST_MAX_M_S,
    energy_out_J,
    final_speed_m_s,
    measure_stiffness,
    operate_landing,
    predict_stiffness,
)


@pytest.mark.nightly
@pytest.mark.parametrize("bad", [False, True])
def test_waves_are_stable_at_50_ms_and_the_position_controller_is_not(bad: bool) -> None:
    plain, waves = (operate_landing(scheme, 0.05, bad) for scheme in ("position", "wave"))
    assert final_speed_m_s(plain) > 0.1 and energy_out_J(plain) > 0.1
    assert final_speed_m_s(waves) < REST_MAX_M_S and energy_out_J(waves) < ENERGY_MAX_J
    assert waves.touching[-1000:].all()


def test_the_position_controller_is_stable_without_delay() -> None:
    plain = operate_landing("position", 0.0)
    assert final_speed_m_s(plain) < REST_MAX_M_S and plain.touching[-1000:].all()


@given(
    st.builds(
        Impairment,
        delay_s=st.floats(0.0, 0.1),
        jitter_s=st.floats(0.0, 0.01),
        loss=st.floats(0.0, 0.3),
    ),
    st.builds(
        PointMass,
        mass_kg=st.floats(0.04, 0.2),
        b_Ns_m=st.floats(0.05, 0.5),
        c_N=st.sampled_from([0.0, 0.05, 0.26]),
        quantum_m=st.sampled_from([0.0, 55e-6]),
    ),
    st.builds(Grip, st.floats(0.0, 600.0), st.floats(0.1, 6.0)),
    st.floats(100.0, 2000.0),
    st.floats(-0.03, 0.0),
)
@settings(max_examples=20, deadline=None)
def test_the_motors_are_passive(
    line: Impairment, device: PointMass, grip: Grip, stiffness_N_m: float, z_m: float
) -> None:
    """For any link, device, hand and wall, the energy output stays within the allowances of both ends."""
    start = (0.0, 0.0, 0.01)
    scene = plate(Swatch("wall", stiffness_N_m=stiffness_N_m))
    operation = Operation(
        scene, start, coupling=Coupling(), line=line, device=device, compensator="none", effects=("wall",), seed=1
    )
    operated = operation.run(ReferenceTrajectory.hold((0.0, 0.0, z_m), 1500, grip, push_W_N=(0.0, 0.0, -1.0)))
    assert energy_out_J(operated) <= 2.0 * ALLOWANCE_J


@pytest.mark.parametrize("delay_s", [0.0, 0.005, 0.02])
def test_rendered_stiffness_is_that_of_springs_in_series(delay_s: float) -> None:
    """1/K = 1/K_wall + 1/K_c + d/b, if there is enough energy."""
    measured_N_m, line_s = measure_stiffness(Coupling(), delay_s)
    assert measured_N_m == pytest.approx(predict_stiffness(line_s), rel=1e-3)


def test_recorded_quantities_of_two_runs() -> None:
    """Time, work and acceleration continue; the tip's acceleration, summed twice, is its position."""
    device = PointMass(0.05, 0.2)
    operation = Operation(plate("wood"), START_M, line=Impairment(0.003), device=device, compensator="inverse", seed=2)
    way = np.linspace(0.006, -0.004, 250)
    intents = [np.column_stack((0.1 * np.clip(0.0 - z, 0.0, 1.0), 0.0 * z, z)) for z in (way, way[::-1])]
    runs = [operation.run(ReferenceTrajectory.along(intent, "medium")) for intent in intents]
    one = {name: np.concatenate([getattr(run, name) for run in runs]) for name in vars(runs[0]) if name != "latency_s"}
    np.testing.assert_allclose(one["t_s"], np.arange(500) * TICK_S)
    assert one["touching"].dtype == bool and 50 < one["touching"].sum() < 400
    assert one["f_contact_W_N"][one["touching"]][:, 2].max() > 0.4 and not one["f_contact_W_N"][:30].any()
    for run in runs:
        done = np.zeros(250)
        for end in ("leader", "follower"):
            p, f = getattr(run, f"{end}_W_m"), getattr(run, f"f_{end}_W_N")
            done[1:] += np.cumsum((f[:-1] * np.diff(p, axis=0)).sum(axis=1))
        np.testing.assert_allclose(run.work_J, done, atol=1e-15)
    speed = np.cumsum(one["a_tip_m_s2"].ravel()) * 1e-4
    np.testing.assert_allclose(one["leader_W_m"][1:, 2] - 0.006, np.cumsum(speed)[9:-1:10] * 1e-4, atol=1e-10)
    for end in ("leader", "follower"):  # the first message arrives in tick 3
        assert not one[f"f_{end}_W_N"][:3].any() and one[f"f_{end}_W_N"][4:9].any()
    assert one["a_handle_m_s2"].any() and one["a_follower_m_s2"].any()
    assert runs[0].latency_s == pytest.approx(0.001 + 0.003 + int(operation.leader.handle[0].delay) * 1e-4)
    assert int(operation.leader.handle[0].delay) > 0


def test_positions_do_not_drift_apart() -> None:
    """The position error by friction is the same after one and after five explorations."""
    operation = Operation(plate("wood"), START_M, coupling=Coupling(), line=Impairment(0.02, **BAD), compensator="none")
    intent = explore("medium", 500.0).intent
    apart = [operation.run(intent) for _ in range(5)]
    apart_m = [float(np.linalg.norm(o.leader_W_m[-1] - o.follower_W_m[-1])) for o in apart]
    assert max(apart_m) - min(apart_m) < 0.5e-3
