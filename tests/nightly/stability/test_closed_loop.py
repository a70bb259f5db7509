"""Closed loops with the real haptic tick against closed forms: friction, deep damping, fields, fast tools, handles."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from hapscene.constants import TICK_S
from hapscene.device.model import Limits, limits_of
from hapscene.device.sim.hand import Grip
from hapscene.device.sim.omni import Omni, stand
from hapscene.device.sim.point import PointMass
from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.handle.handle_loop import play
from hapscene.handle.plant import ACCELEROMETER_HZ, Plant, Sensor
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.loop.twin import Twin
from hapscene.render.renderer import Renderer
from hapscene.stability.rig import AT_M, sheet
from hapscene.surface.field_frame import EASE_S, FADED_MOST
from hapscene.surface.swatch import Swatch
from hapscene_evidence.bench.handle import PARAMETERS, signals
from tests.stability.closed_form import limit_of_small_motion
from tests.stability.critical import DEPTH_M, growth, limit_of_motion
from tests.stability.free_rig import FreeRig

LEAD = Grip(2e3, 20.0)
"""The hand that guides the tool onto the surface."""

PRESS = (0.0, 0.0, -1.0)
"""Push of the hand while the tool slides [N]."""

COULOMB = 0.3


def rough(device: PointMass | Omni, damping_Ns_m: float = 0.0) -> Twin:
    """A device pressed onto a surface with friction, at rest."""
    sticking = {"friction": {"tangential_stiffness_N_m": 500.0, "tangential_damping_Ns_m": damping_Ns_m}}
    swatch = Swatch("rough", 500.0, 2.0, friction_static=COULOMB, friction_dynamic=COULOMB, effects=sticking)
    at: Any = stand((*AT_M, 0.0)) if isinstance(device, Omni) else None
    twin = Twin(sheet(swatch), device, ("wall", "friction"), a_rate_Hz=1.0 / TICK_S, X_WD=at)
    twin.reset((*AT_M, 1e-4))
    twin.run(ReferenceTrajectory.hold((*AT_M, -2e-3), 1000, LEAD, push_W_N=PRESS))
    return twin


@pytest.mark.parametrize("speed_m_s", [0.05, 0.103, 0.2037])
def test_stopping_time_of_a_sliding_mass(speed_m_s: float) -> None:
    """F4: ⌈v₀m/(F_cT)⌉ ticks, no reversal of the force, then rest (Kikuuwe et al. 2006)."""
    twin = rough(PointMass(0.045), 9.0)
    ramp = np.linspace(0.0, 1.0, 300)
    path = np.tile((*AT_M, -2e-3), (301, 1))
    path[:300, 0] += speed_m_s * 0.3 * (ramp**3 - 0.5 * ramp**4) - 0.5 * speed_m_s * 0.3
    path[300] = 2.0 * path[299] - path[298]
    grip = np.tile(LEAD.row(), (301, 1))
    grip[-1] = 0.0
    twin.run(ReferenceTrajectory.hold(path[0], 500, LEAD, push_W_N=PRESS))
    twin.run(ReferenceTrajectory.along(path, grip, PRESS))
    twin.tool.arm.point.v_m_s[0, 0] = speed_m_s  # to the last digit
    felt = twin.run(ReferenceTrajectory.hold(path[-1], 800, "none", push_W_N=PRESS))
    v = felt.v_W_m_s[:, 0]
    limit_N = COULOMB * float(felt.recording.normal_force_N[0])
    assert np.argmax(v <= 0.0) == math.ceil(speed_m_s * 0.045 / (limit_N * TICK_S))
    assert np.abs(v[400:]).max() < 1e-6


def test_an_omni_at_half_its_friction_is_at_rest() -> None:
    felt = rough(Omni()).run(
        ReferenceTrajectory.hold((*AT_M, 0.0), 12_000, "none", push_W_N=(0.5 * COULOMB, 0.0, -1.0))
    )
    assert np.linalg.norm(felt.p_W_m[-1, :2] - felt.p_W_m[2000, :2]) < 1e-6
    assert np.sqrt((felt.v_W_m_s[-2000:] ** 2).sum(1).mean()) < 1e-4


class DeepRig(FreeRig):
    """A rig whose wall damping depends on depth, with the given value at the depth of small motion."""

    def tune(self, stiffness_N_m: float, damping_Ns_m: float = 0.0) -> None:
        super().tune(stiffness_N_m)
        self.twin.renderer.tune("wall", hunt_crossley_Ns_m2=damping_Ns_m / DEPTH_M)
        self.damping_Ns_m = damping_Ns_m


@pytest.mark.parametrize("delay", [0, 1])
def test_stability_with_depth_dependent_damping(delay: int) -> None:
    for damping_Ns_m in (5e-3, 0.5):
        known = limit_of_small_motion(0.045, 0.1, TICK_S, delay, damping_Ns_m)
        found = limit_of_motion(DeepRig(PointMass(0.045, 0.1), TICK_S, delay), damping_Ns_m)
        assert found == pytest.approx(known, rel=1e-4)


@pytest.mark.parametrize("speed_m_s", [0.2, 1.0])
def test_restitution_of_hunt_and_crossley(speed_m_s: float) -> None:
    """a − ln(1 + a) = −a e − ln(1 − a e), a = χ v/K, of a free mass."""
    a = 500.0 * speed_m_s / 500.0
    known = brentq(lambda e: a - math.log1p(a) + a * e + math.log1p(-a * e), 1e-9, min(1.0, (1.0 - 1e-12) / a))
    rig = FreeRig(PointMass(0.045), 1e-5)
    rig.tune(500.0)
    rig.twin.renderer.tune("wall", hunt_crossley_Ns_m2=500.0)
    assert rig.throw(1e-4, speed_m_s, 8000).v_W_m_s[-1, 2] / speed_m_s == pytest.approx(known, rel=2e-3)


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("field", ["guide", "magnet"])
def test_a_field_has_the_stability_limit_of_a_wall(field: str, delay: int) -> None:
    """W1 and W2: small motion in a field is that on a spring."""
    here, reach_m = (0.0, 0.0, 0.05), 0.01
    name, scale = ("stiffness_N_m", 1.0) if field == "guide" else ("strength_N", FADED_MOST * reach_m)
    settings = {field: {"points_m": here if field == "guide" else [here], "reach_m": reach_m}}
    scene, device = sheet(Swatch("wall")), PointMass(0.045, 0.1)
    twin = Twin(scene, device, (field,), settings=settings, a_rate_Hz=1.0 / TICK_S, delay_ticks=delay)

    def grows(stiffness_N_m: float) -> float:
        twin.renderer.tune_field(field, **{name: scale * stiffness_N_m})
        start = (1e-5 * reach_m, *here[1:])
        twin.reset(start)
        twin.run(ReferenceTrajectory.hold(start, round(1.2 * EASE_S / TICK_S) + delay, Grip(1e7, 1e3)))
        return growth(twin.run(ReferenceTrajectory.hold(start, 240, "none")).p_W_m[:, 0], delay + 2)

    known = limit_of_small_motion(0.045, 0.1, TICK_S, delay, 0.0)
    assert brentq(grows, 0.5 * known, 2.0 * known, rtol=1e-9) == pytest.approx(known, rel=1e-6)


@pytest.mark.parametrize("speed_m_s", [1.0, 4.0])
def test_energy_of_fast_tools_is_bounded(speed_m_s: float) -> None:
    """F v T on average with the force limit alone; at most K v² T² + F Δ with the passivity controller."""
    limits, way = limits_of("omni", TICK_S), speed_m_s * TICK_S
    deep = math.ceil(3.0 * limits.force_N / 500.0 / way)

    def gained_J(limits: Limits) -> np.ndarray:
        renderer = Renderer(sheet(Swatch("wall", 500.0)), ["wall"], a_rate_Hz=1.0 / TICK_S, limits=limits)
        made = []
        for phase in (np.arange(16) + 0.5) / 16:
            depth = np.concatenate((np.arange(-2, deep), np.arange(deep, -4, -1))) * way + phase * way
            path = np.column_stack((np.full(len(depth), AT_M[0]), np.full(len(depth), AT_M[1]), -depth))
            renderer.reset(path[0])
            made.append(float((renderer.run(path).f_W_N[:-1, 2] * np.diff(path[:, 2])).sum()))
        return np.array(made)

    assert gained_J(Limits(limits.force_N)).mean() == pytest.approx(limits.force_N * speed_m_s * TICK_S, rel=1e-9)
    assert gained_J(limits).max() <= 500.0 * way**2 + limits.force_N * limits.quantum_m


@pytest.mark.parametrize(("late_s", "bandwidth", "most"), [(1e-4, 0.5, 0.25), (3e-4, 0.5, 1.05), (2e-3, 1.0, 1.05)])
def test_adaptive_compensator_with_a_wrong_sensor_model(late_s: float, bandwidth: float, most: float) -> None:
    """Error of the adaptive compensator relative to `flat`, which has no sensor, on a handle 30 % off."""
    desired, believed = signals()["white"][:10_000], Sensor(delay_s=5e-4)
    plant = replace(Plant(), **{name: 0.7 * getattr(Plant(), name) for name in PARAMETERS})
    sensor = Sensor(delay_s=5e-4 + late_s, bandwidth_Hz=bandwidth * ACCELEROMETER_HZ)
    half = len(desired) // 2
    errors = [
        spectrogram_error(desired[half:], play(desired, 10_000.0, plant, **how).acceleration_m_s2[half:], 10_000.0)
        for how in ({"compensator": "adaptive", "sensor": sensor, "nominal_sensor": believed}, {"compensator": "flat"})
    ]
    assert errors[0] <= most * errors[1]
