"""Limits of a device: what they refuse, and how a swatch beyond them is rendered and reported."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device.limit import DELAY_MAX, IDEAL, DeviceWarning, Limits
from hapscene.device.model import limits_of
from hapscene.errors import HapsceneError
from hapscene.surface.effect import Effect, Param
from hapscene.surface.swatch import Swatch

BOX = trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]])
NUMBERS = [name for name in vars(IDEAL) if name != "device"]


def scene(*swatches: Swatch) -> hapscene.Scene:
    built = hapscene.Scene()
    for i, swatch in enumerate(swatches):
        pose = np.eye(4)
        pose[0, 3] = 0.2 * i
        built.add(BOX, name=f"box {i}", unit="m", swatch=swatch, pose=pose)
    return built


def felt_N_m(renderer: hapscene.Renderer, depth_m: float = 0.001) -> float:
    """Force over depth, held still."""
    renderer.reset([0.0, 0.0, 0.001])
    return float(renderer.run([[0.0, 0.0, -depth_m]] * 3).f_W_N[-1, 2]) / depth_m


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [-1.0, math.nan])
def test_limits_that_make_no_sense(name, value):
    with pytest.raises(HapsceneError, match=name):
        Limits(**{name: value})


@pytest.mark.parametrize("delay", [0.5, DELAY_MAX + 1, math.inf])
def test_bad_delay(delay):
    with pytest.raises(HapsceneError, match="delay_ticks"):
        Limits(delay_ticks=delay)


def test_a_stiff_swatch_is_clipped_and_says_so():
    with pytest.warns(DeviceWarning) as caught:
        renderer = hapscene.Renderer(scene(Swatch("oak", stiffness_N_m=5000.0)), ["wall"], device="omni")
    assert [str(one.message) for one in caught] == [
        "swatch 'oak': 5000 N/m is more than the omni holds at 1 kHz (700 N/m): rendered at 700 N/m"
    ]
    assert caught[0].filename == __file__
    (clip,) = renderer.clips
    assert (clip.swatch, clip.number, clip.asked, clip.given) == ("oak", "stiffness_N_m", 5000.0, 700.0)
    assert felt_N_m(renderer) == pytest.approx(700.0, rel=1e-9)


def test_one_line_for_many_swatches_and_none_for_those_not_painted():
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


def test_what_a_device_holds_is_left_alone():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer = hapscene.Renderer(scene(Swatch("soft", stiffness_N_m=300.0)), device="omni")
    assert renderer.clips == ()
    assert felt_N_m(renderer) == pytest.approx(300.0, rel=1e-9)


def test_tune_is_clipped_too_and_forgets_it_when_softened():
    renderer = hapscene.Renderer(scene(Swatch("oak", stiffness_N_m=300.0)), ["wall"], device="omni")
    with pytest.warns(DeviceWarning, match="'oak': 900 N/m"):
        renderer.tune("oak", stiffness_N_m=900.0)
    assert felt_N_m(renderer) == pytest.approx(700.0, rel=1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer.tune("oak", stiffness_N_m=200.0)
    assert renderer.clips == ()
    assert felt_N_m(renderer) == pytest.approx(200.0, rel=1e-9)


def test_damping_is_clipped_and_reported():
    limits = replace(limits_of("omni", 1e-3), guard_Ns_m=0.0)
    with pytest.warns(DeviceWarning, match=r"'tar': damping_Ns_m of 40 N·s/m is more than the omni holds .*N·s/m"):
        renderer = hapscene.Renderer(scene(Swatch("tar", damping_Ns_m=40.0)), ["wall"], limits=limits)
    renderer.reset([0.0, 0.0, 0.001])
    force = renderer.run([[0, 0, -0.001], [0, 0, -0.0012]]).f_W_N[-1, 2]
    assert force == pytest.approx(500.0 * 0.0012 + limits.damping_Ns_m * 0.2, rel=1e-6)


def test_a_stiff_wall_is_given_the_damping_that_it_needs():
    limits = replace(limits_of("phantom-1.0", 1e-3), guard_Ns_m=0.0)
    assert limits.undamped_N_m < 400.0 < limits.stiffness_N_m
    renderer = hapscene.Renderer(scene(Swatch("oak", stiffness_N_m=400.0)), ["wall"], limits=limits)
    given = {(clip.swatch, clip.number): clip.given for clip in renderer.clips}
    added = limits.damping_time_s * (400.0 - limits.undamped_N_m)
    assert given["oak", "damping_Ns_m"] == pytest.approx(added) and added > 0.0
    assert ("oak", "stiffness_N_m") not in given
    renderer.reset([0.0, 0.0, 0.001])
    force = renderer.run([[0, 0, -0.001], [0, 0, -0.0012]]).f_W_N[-1, 2]
    assert force == pytest.approx(400.0 * 0.0012 + added * 0.2, rel=1e-6)


def _spring(touch, p, table, s, out):
    out.f_W_N[2] += p.stiffness_N_m * touch.depth_m


def test_where_nothing_damps_a_wall_is_as_soft_as_a_bare_one():
    limits = limits_of("phantom-1.0", 1e-3)
    stiffness = Param("stiffness_N_m", 900.0, "N/m", "how hard")
    spring = Effect("spring", "A spring of its own.", _spring, params=(stiffness,))
    with pytest.warns(DeviceWarning):
        renderer = hapscene.Renderer(scene(Swatch("oak", stiffness_N_m=400.0)), [spring], limits=limits)
    assert {clip.given for clip in renderer.clips if clip.swatch == "oak"} == {limits.undamped_N_m}
    assert felt_N_m(renderer) == pytest.approx(limits.undamped_N_m, rel=1e-9)


def test_repainting_keeps_the_limits():
    renderer = hapscene.Renderer(scene(Swatch("soft", stiffness_N_m=300.0)), ["wall"], device="omni")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        renderer.repaint(scene(Swatch("oak", stiffness_N_m=5000.0)))
    assert [clip.swatch for clip in renderer.clips] == ["oak"]
    assert felt_N_m(renderer) == pytest.approx(700.0, rel=1e-9)


def test_a_device_or_limits():
    with pytest.raises(HapsceneError, match="not both"):
        hapscene.Renderer(scene(Swatch("a")), device="omni", limits=IDEAL)
    with pytest.raises(HapsceneError, match="no device 'omini'; there are: ideal, omni"):
        hapscene.Renderer(scene(Swatch("a")), device="omini")


def test_ideal_is_the_default_to_the_bit():
    t = np.arange(400) / 400
    path = np.c_[0.03 * np.sin(5 * t), 0.02 * t, np.where(t > 0.1, -0.001, 0.002)]
    stiff = Swatch("oak", stiffness_N_m=5000.0, friction_static=0.5, friction_dynamic=0.4)
    plain, ideal = (hapscene.Renderer(scene(stiff), device=device).run(path) for device in (None, "ideal"))
    np.testing.assert_array_equal(plain.f_W_N, ideal.f_W_N)


# --- a texture in the motors


def test_a_texture_for_motors_is_limited_and_the_swatch_named():
    limits = Limits(fold_mass_kg=0.045, own_damping_Ns_m=0.1, device="omni")
    with pytest.warns(DeviceWarning, match=r"swatch 'wood': .*motors of the omni hold .* % of it") as caught:
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
    np.testing.assert_array_equal(part.a_m_s2, bare.a_m_s2)  # a handle would get all of it
    np.testing.assert_allclose(part.f_W_N - bare.f_W_N, share * (whole.f_W_N - bare.f_W_N), atol=1e-12)
