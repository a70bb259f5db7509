"""Named devices and the walls they hold: against the reference, and against the closed loop."""

import json
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import hapscene
from hapscene.device.model import (
    BORDER_COUNT,
    DELAY_TICKS_MAX,
    DEVICES,
    IDEAL,
    PASSIVITY_SHARE,
    DeviceWarning,
    Limits,
    damping_for,
    damping_max,
    device_named,
    limits_of,
    stability_border,
    wall_limit,
)
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.stability.rig import Rig
from hapscene.surface.swatch import Swatch

REAL = ("omni", "phantom-1.0", "premium-1.5")


def held_N_m(m: float, b: float, T: float, d: int, B: float, count: int = BORDER_COUNT) -> float:
    K, damping = stability_border(m, b, T, d, count)
    return float(np.interp(B, damping, K))


FINITE = ("fold_mass_kg", "damping_time_s", "quantum_m", "coupling_N_m", "coupling_Ns_m", "delay_ticks")


@pytest.mark.parametrize("name", [name for name in vars(IDEAL) if name != "device"])
def test_invalid_limits_are_refused_by_name(name: str) -> None:
    for value in (-1.0, math.nan, *([math.inf] if name in FINITE else [])):
        with pytest.raises(HapsceneError, match=f"limits: {name} must be "):
            Limits(**{name: value})
    if name not in FINITE:
        assert getattr(Limits(**{name: math.inf}), name) == math.inf
    assert getattr(Limits(**{name: 0}), name) == 0


def test_border_meets_the_reference(shared):
    tried = 0
    for case in json.loads((shared / "reference" / "wall_cases.json").read_text()):
        at = case["setup"]
        if case["id"][:2] in ("W1", "W2", "W5") and "critical K" in case["what"] and not at.get("c"):
            got = held_N_m(at["m"], at["b"], at["T"], at["delay"], at["B"])
            assert got == pytest.approx(case["expected"], rel=5e-6), case["id"]
            tried += 1
    assert tried >= 20


@pytest.mark.parametrize(("d", "apex"), [(0, 4 * (math.sqrt(2) - 1) ** 2), (1, 0.1445), (2, 0.0624), (3, 0.0348)])
def test_stiffest_wall_of_virtual_damping(d, apex):
    K, B = stability_border(1.0, 0.0, 1.0, d)
    assert K.max() == pytest.approx(apex, rel=1e-3 if d else 1e-6)
    assert damping_max(1.0, 1.0, d) == pytest.approx((2.0, 0.8284, 0.5359, 0.3978)[d], rel=1e-4)
    assert B[-1] == pytest.approx(damping_max(1.0, 1.0, d), rel=2e-3)


@given(
    name=st.sampled_from(REAL), T=st.sampled_from((2e-3, 1e-3, 5e-4, 1e-4)), d=st.integers(0, 8), damped=st.booleans()
)
def test_limits_are_consistent(name, T, d, damped):
    device = DEVICES[name]
    K, B = wall_limit(name, T, d, damped=damped)
    assert 0.0 < K <= device.limits.stiffness_N_m and 0.0 <= B <= device.limits.damping_Ns_m
    with_damper, _ = wall_limit(name, T, d)
    sooner, _ = wall_limit(name, T, max(0, d - 1), damped=damped)
    assert with_damper >= K - 1e-9  # a damper does not reduce the stiffness
    assert sooner >= K - 1e-9  # a delay does not increase it
    limits = limits_of(name, T, d)
    needed = damping_for(device, limits.stiffness_N_m, T, delay_ticks=d)
    assert needed <= limits.damping_Ns_m * (1 + 1e-3) + 1e-9
    assert limits.damping_time_s * (limits.stiffness_N_m - limits.undamped_N_m) == pytest.approx(needed, abs=1e-9)
    assert (limits.stiffness_N_m + limits.damping_Ns_m / T) * device.point.quantum_m <= device.point.c_N * (1 + 1e-9)
    point, most = device.point, PASSIVITY_SHARE * damping_max(device.point.mass_kg, T, d)
    assert limits.passivity_Ns_m == pytest.approx(min(most, point.c_N * T / point.quantum_m))
    assert (limits.own_damping_Ns_m, limits.quantum_m, limits.delay_ticks) == (point.b_Ns_m, point.quantum_m, d)
    for smooth in (replace(point, c_N=0.0), replace(point, quantum_m=0.0)):
        assert limits_of(smooth, T, d).passivity_Ns_m == pytest.approx(most)


def test_limits_at_1_kHz_match_published_ones():
    """At 1 kHz the closed form allows what CHAI3D does for the Omni, and two thirds of it or more for the others."""
    assert limits_of("omni", 1e-3).stiffness_N_m == 700.0
    for name, cap in (("phantom-1.0", 1000.0), ("premium-1.5", 800.0)):
        assert 0.6 * cap < limits_of(name, 1e-3).stiffness_N_m <= cap


def test_ideal_and_unknown_devices():
    assert replace(limits_of("ideal", 1e-3), device="device") == Limits()
    with pytest.raises(HapsceneError, match=r"there are: ideal, omni, phantom-1\.0, premium-1\.5"):
        device_named("onmi")


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("delay", [0, 1, 2])
@pytest.mark.parametrize("damped", [True, False])
def test_walls_at_the_limit_rest_after_a_brisk_tap(name, delay, damped):
    """With a light grip, at 0.5 m/s into the wall, without the passivity controller."""
    device, T = DEVICES[name], 1e-3
    K, _ = wall_limit(name, T, delay, damped=damped)
    B = damping_for(device, K, T, delay_ticks=delay) if damped else 0.0
    felt = tap(device.point, K, B, delay)
    assert np.abs(felt.v_W_m_s[-400:]).max() < 5e-3
    assert np.cumsum(felt.work_J).max() < 2e-3


def tap(point: PointMass, K: float, B: float, delay: int):
    twin = Rig(point, 1e-3, delay, stiffness_N_m=K, damping_Ns_m=B).twin
    twin.reset((0.031, -0.017, 0.0005), (0.0, 0.0, -0.5))
    return twin.run(ReferenceTrajectory.hold((0.031, -0.017, -0.003), 3000, "light"))


@pytest.mark.parametrize(("tick_s", "delay"), [(0.0, 0), (math.nan, 0), (1e-3, -1), (1e-3, 64), (1e-3, math.nan)])
def test_invalid_periods_and_delays_are_refused(tick_s: float, delay: float) -> None:
    with pytest.raises(HapsceneError, match=r"limits: (tick_s|delay_ticks)"):
        limits_of("omni", tick_s, delay)  # type: ignore[arg-type]


# Limits of a device: what they refuse, and how a swatch beyond them is rendered and reported.


BOX = trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]])


def scene(*swatches: Swatch) -> hapscene.Scene:
    built = hapscene.Scene()
    for i, swatch in enumerate(swatches):
        pose = np.eye(4)
        pose[0, 3] = 0.2 * i
        built.add(BOX, name=f"box {i}", unit="m", swatch=swatch, pose=pose)
    return built


def felt_N_m(renderer: hapscene.Renderer, depth_m: float = 0.001) -> float:
    """Force over depth, at rest."""
    renderer.reset([0.0, 0.0, 0.001])
    return float(renderer.run([[0.0, 0.0, -depth_m]] * 3).f_W_N[-1, 2]) / depth_m


@pytest.mark.parametrize("delay", [0.5, DELAY_TICKS_MAX + 1, math.inf])
def test_bad_delay(delay):
    with pytest.raises(HapsceneError, match="delay_ticks"):
        Limits(delay_ticks=delay)


def test_a_stiff_swatch_is_clipped_with_a_warning():
    with pytest.warns(DeviceWarning) as caught:
        renderer = hapscene.Renderer(scene(Swatch("oak", stiffness_N_m=5000.0)), ["wall"], device="omni")
    (warning,) = caught
    assert "'oak'" in str(warning.message) and "5000 N/m" in str(warning.message) and "700 N/m" in str(warning.message)
    assert caught[0].filename == __file__
    (clip,) = renderer.clips
    assert (clip.swatch, clip.number, clip.asked, clip.given) == ("oak", "stiffness_N_m", 5000.0, 700.0)
    assert felt_N_m(renderer) == pytest.approx(700.0, rel=1e-9)


def test_one_warning_for_all_painted_swatches():
    stiff = [Swatch(f"s{i}", stiffness_N_m=2000.0 + i) for i in range(3)]
    with pytest.warns(DeviceWarning) as caught:
        renderer = hapscene.Renderer(scene(*stiff), ["wall"], device="omni")
    (one,) = caught
    assert "'s0'" in str(one.message) and "2 more" in str(one.message)
    assert [clip.swatch for clip in renderer.clips] == ["s0", "s1", "s2"]
    over = Limits(stiffness_N_m=400.0)  # the plain swatch has more, but nothing is painted with it
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer = hapscene.Renderer(scene(Swatch("soft", stiffness_N_m=100.0)), ["wall"], limits=over)
    assert [clip.swatch for clip in renderer.clips] == ["plain"]


def test_tuning_is_clipped_too():
    renderer = hapscene.Renderer(scene(Swatch("oak", stiffness_N_m=300.0)), ["wall"], device="omni")
    with pytest.warns(DeviceWarning, match=r"'oak'.*900 N/m"):
        renderer.tune("oak", stiffness_N_m=900.0)
    assert felt_N_m(renderer) == pytest.approx(700.0, rel=1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer.tune("oak", stiffness_N_m=200.0)
    assert renderer.clips == ()
    assert felt_N_m(renderer) == pytest.approx(200.0, rel=1e-9)


def test_a_device_or_limits():
    with pytest.raises(HapsceneError, match="limits"):
        hapscene.Renderer(scene(Swatch("a")), device="omni", limits=IDEAL)
    with pytest.raises(HapsceneError, match="omini"):
        hapscene.Renderer(scene(Swatch("a")), device="omini")


# --- a texture in the motors


def test_a_texture_for_motors_is_limited_and_the_swatch_named():
    limits = Limits(fold_mass_kg=0.045, own_damping_Ns_m=0.1, device="omni")
    with pytest.warns(DeviceWarning, match=r"'wood'.*omni") as caught:
        renderer = hapscene.Renderer(scene(hapscene.load_swatch("wood")), limits=limits)
    assert len(caught) == 1
    index = renderer._swatch_names.index("wood")
    share = renderer.surface.fold_mass_kg[index] / 0.045
    assert 0.0 < share < 0.2
    assert renderer.surface.fold_mass_kg[0] == 0.045  # the plain one has no texture
    t = np.arange(2000) / 1000
    path = np.c_[0.04 * np.sin(3 * t), 0 * t, np.where(t > 0.1, -0.002, 0.002)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing to limit where the damping is not known
        whole = hapscene.Renderer(scene(hapscene.load_swatch("wood")), limits=Limits(fold_mass_kg=0.045)).run(path)
    bare = hapscene.Renderer(scene(hapscene.load_swatch("wood"))).run(path)
    part = renderer.run(path)
    np.testing.assert_array_equal(part.a_m_s2, bare.a_m_s2)  # the acceleration channel is not limited
    np.testing.assert_allclose(part.f_W_N - bare.f_W_N, share * (whole.f_W_N - bare.f_W_N), atol=1e-12)
