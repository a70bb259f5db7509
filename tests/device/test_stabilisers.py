"""The passivity controller and the virtual coupling in the tick: what they observe, and when they act."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device.model import IDEAL, Limits
from hapscene.device.sim.point import PointMass
from hapscene.device.stabilisers import FORGET_S
from hapscene.flags import Flag
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.stability.rig import Rig
from hapscene.surface.effect import Effect
from hapscene.surface.swatch import Swatch

BOX = trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]])
WATCHING = Limits(passivity_Ns_m=1e-12)
"""Observes, and does not act to speak of."""
DAMPED = np.uint32(Flag.ENERGY_DAMPED)


def scene(*swatches: Swatch) -> hapscene.Scene:
    built = hapscene.Scene()
    built.add(BOX, name="box", unit="m", swatch=swatches[0] if swatches else Swatch("w", stiffness_N_m=800.0))
    return built


def made_J(renderer: hapscene.Renderer) -> float:
    return float(renderer.surface.memory["made_J"][0])


def down(depth_m: np.ndarray) -> np.ndarray:
    return np.column_stack((np.full(len(depth_m), 0.011), np.full(len(depth_m), 0.003), -depth_m))


def test_the_observer_is_exact():
    """What a spring that is held from tick to tick makes in a press of n even steps: Σ ½K Δd² = ½K d²/n, and again."""
    K, d, n = 800.0, 2e-3, 40
    renderer = hapscene.Renderer(scene(), ["wall"], limits=WATCHING)
    way_in = np.linspace(0.0, d, n + 1)
    renderer.reset(down(np.array([-1e-9]))[0])
    renderer.run(down(way_in))
    forgotten = (1.0 - 1e-3 / FORGET_S) ** np.arange(n)
    step = 0.5 * K * (d / n) ** 2
    assert made_J(renderer) == pytest.approx(step * forgotten.sum(), rel=1e-6)
    renderer.run(down(way_in[-2::-1]))
    assert made_J(renderer) == pytest.approx(step * ((1.0 - 1e-3 / FORGET_S) ** np.arange(2 * n)).sum(), rel=1e-6)


def test_the_observer_counts_what_was_sent_and_when():
    """Against the energy summed by hand, over a path of all sorts, for each delay."""
    rng = np.random.default_rng(3)
    path = np.cumsum(rng.normal(0.0, 2e-5, (600, 3)), axis=0) + down(np.full(600, 4e-4))
    for delay in (0, 1, 3):
        limits = Limits(passivity_Ns_m=1e-12, delay_ticks=delay, force_N=0.4)
        renderer = hapscene.Renderer(scene(), ["wall", "friction"], limits=limits)
        recording = renderer.run(path)
        normal = np.sum(recording.f_W_N * recording.nhat_W, axis=1)[:, None] * recording.nhat_W
        stored = 0.5 * recording.normal_force_N * recording.depth_m
        made = last = 0.0
        for k in range(600):
            held = normal[k - 1 - delay] if k - 1 - delay >= 0 else np.zeros(3)
            way = path[k] - path[k - 1] if k else np.zeros(3)
            made = max(0.0, made * (1.0 - 1e-3 / FORGET_S) + held @ way + stored[k] - last)
            last = stored[k]
        assert made > 1e-7
        assert made_J(renderer) == pytest.approx(made, rel=1e-5)


def test_nothing_is_made_of_a_body_that_lifts_the_tool():
    """A platform that carries the tool up does work on it, and that is no fault of the rendering."""
    X = np.tile(np.eye(4), (400, 1, 1))
    X[:, 2, 3] = 0.02 * np.sin(np.arange(400) / 60)
    path = down(np.full(400, 1e-3)) + X[:, :3, 3]
    renderer = hapscene.Renderer(scene(), ["wall"], limits=Limits(passivity_Ns_m=20.0))
    renderer.reset(path[0] + (0, 0, 2e-3))
    renderer.run(path[0] + np.linspace(2e-3, 0.0, 2000)[:, None] * (0, 0, 1))
    renderer.run(down(np.full(15_000, 1e-3)))
    recording = renderer.run(path, poses={"box": X})
    assert recording.touching.all()
    assert np.ptp(recording.f_W_N[:, 2]) < 1e-6
    assert not (recording.flags & DAMPED).any()


def test_controller_acts_only_in_contact_and_never_pulls():
    rng = np.random.default_rng(5)
    depth = 1e-3 * np.sin(np.arange(3000) / 8.0) + rng.normal(0.0, 1e-4, 3000)
    recording = hapscene.Renderer(scene(), ["wall"], limits=Limits(passivity_Ns_m=30.0)).run(down(depth))
    acted = (recording.flags & DAMPED) != 0
    assert acted.sum() > 100
    assert recording.touching[acted].all()
    assert (recording.f_W_N[:, 2] >= 0.0).all()
    assert not recording.f_W_N[~recording.touching].any()
    bare = hapscene.Renderer(scene(), ["wall"]).run(down(depth))
    np.testing.assert_array_equal(recording.f_W_N[~acted], bare.f_W_N[~acted])
    speed = np.diff(-depth, prepend=-depth[0]) / 1e-3
    most = np.maximum(bare.f_W_N[:, 2] - 30.0 * speed, 0.0)
    least = np.minimum(bare.f_W_N[:, 2], most)
    assert (recording.f_W_N[:, 2] >= least - 1e-9).all()
    assert (recording.f_W_N[:, 2] <= np.maximum(bare.f_W_N[:, 2], most) + 1e-9).all()


def _push(touch, p, table, s, out):
    if touch.touching:
        out.f_W_N[2] -= 0.3


def test_without_a_wall_there_is_nothing_to_observe():
    """An effect that pulls in takes and gives by its own: the wall's spring is not there to be reckoned with."""
    path = down(np.linspace(-1e-3, 2e-3, 300))
    for effects in (["friction"], [Effect("pull", "Pulls in.", _push)]):
        renderer = hapscene.Renderer(scene(), effects, limits=Limits(passivity_Ns_m=30.0))
        free = hapscene.Renderer(scene(), effects)
        if effects == ["friction"]:
            np.testing.assert_array_equal(renderer.run(path).f_W_N, free.run(path).f_W_N)
        else:
            assert (renderer.run(path).f_W_N[:, 2] <= 0.0).all()


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("stiffness", [700.0, 2000.0])
def test_controller_stabilises_an_oscillating_wall(delay, stiffness):
    point = PointMass(0.045, 0.1)
    guard = Limits(passivity_Ns_m=18.0 if delay == 0 else 7.5, delay_ticks=delay)
    results = {}
    for name, limits in (("none", None), ("guard", guard)):
        twin = Rig(point, 1e-3, delay, limits, stiffness).twin
        twin.reset((0.031, -0.017, 0.001), (0.0, 0.0, -0.15))
        felt = twin.run(ReferenceTrajectory.hold((0.031, -0.017, -0.005), 3000, "light"))
        late = float(np.sqrt(np.mean(felt.v_W_m_s[-1500:, 2] ** 2)))
        results[name] = late, float(np.cumsum(felt.work_J).max())
    assert results["none"][0] > 10e-3
    assert results["guard"][0] < 0.5e-3
    assert results["guard"][1] < 0.4e-3 and results["guard"][1] < 0.1 * results["none"][1]


def test_reset_forgets():
    depth = 1e-3 * np.sin(np.arange(200) / 3.0)
    renderer = hapscene.Renderer(scene(), ["wall"], limits=Limits(passivity_Ns_m=30.0))
    renderer.reset(down(depth)[0])
    first = renderer.run(down(depth))
    renderer.reset(down(depth)[0])
    np.testing.assert_array_equal(renderer.run(down(depth)).f_W_N, first.f_W_N)


# --- virtual coupling


def test_coupling_is_a_spring_in_series():
    for kept, depth in ((200.0, 2e-3), (1000.0, 1e-3)):
        renderer = hapscene.Renderer(scene(), ["wall"], limits=Limits(coupling_N_m=kept))
        renderer.reset((0.0, 0.0, 0.001))
        recording = renderer.run(down(np.full(20, depth)))
        series = 1.0 / (1.0 / 800.0 + 1.0 / kept)
        np.testing.assert_allclose(recording.f_W_N[3:, 2], series * depth, rtol=1e-9)
        np.testing.assert_allclose(recording.depth_m[3:], series * depth / 800.0, rtol=1e-9)


def test_coupling_in_the_air_is_not_there():
    path = down(-1e-3 - 1e-3 * np.abs(np.random.default_rng(0).normal(size=200)))
    renderer = hapscene.Renderer(scene(), ["wall"], limits=Limits(coupling_N_m=200.0, coupling_Ns_m=1.0))
    np.testing.assert_allclose(renderer.run(path).p_WT_m, path, atol=1e-15)


def test_coupling_slides_with_the_tool():
    """A stroke drags the virtual tool along without lag: nothing holds it in the plane."""
    path = down(np.full(500, 1e-3))
    path[:, 0] = np.linspace(-0.03, 0.03, 500)
    renderer = hapscene.Renderer(scene(), ["wall"], limits=Limits(coupling_N_m=200.0))
    renderer.reset(path[0] + (0, 0, 2e-3))
    recording = renderer.run(path)
    np.testing.assert_allclose(recording.p_WT_m[5:, :2], path[5:, :2], atol=1e-12)


def test_coupling_damper_fades():
    """A damper beside the spring lets the virtual tool lag: the force starts as that of the wall itself, and falls to
    that of the two springs."""
    renderer = hapscene.Renderer(scene(), ["wall"], limits=Limits(coupling_N_m=200.0, coupling_Ns_m=20.0))
    renderer.reset((0.0, 0.0, 0.0))
    force = renderer.run(down(np.full(400, 1e-3))).f_W_N[:, 2]
    assert force[0] == pytest.approx(0.8, rel=1e-6)
    assert (np.diff(force) < 1e-12).all()
    assert force[-1] == pytest.approx(0.16, rel=1e-3)


def test_bad_reading_with_coupling_uses_the_last_measured_tool():
    renderer = hapscene.Renderer(scene(), ["wall"], limits=Limits(coupling_N_m=200.0))
    renderer.reset((0.0, 0.0, 0.001))
    for _ in range(10):
        good = renderer.step((0.0, 0.0, -0.002))
    bad = renderer.step((0.0, np.nan, 0.0))
    assert bad.flags == Flag.TOOL_NOT_FINITE
    np.testing.assert_allclose(bad.f_W_N, good.f_W_N, rtol=1e-9)


# --- all that is off


def test_off_is_off_to_the_bit():
    path = down(1e-3 * np.sin(np.arange(500) / 20.0))
    plain = hapscene.Renderer(scene()).run(path)
    off = hapscene.Renderer(scene(), limits=replace(IDEAL, delay_ticks=4)).run(path)
    for name in ("f_W_N", "a_m_s2", "flags", "depth_m"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(off, name))
