"""Limits of a device on swatch parameters: stiffness, damping, adhesion, texture."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hapscene.device.model import Limits
from hapscene.errors import EffectError
from hapscene.scene.scene import Scene
from hapscene.surface.device_clipping import (
    WALL,
    Clip,
    ClippedSwatches,
    TextureShare,
    _in_blocks,
    changed,
    clip_to_device,
    clips,
    share_of,
)
from hapscene.surface.effect import load_effect
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch

EFFECTS = [load_effect(name) for name in ("wall", "friction")]
LIMITS = Limits(undamped_N_m=400.0, stiffness_N_m=900.0, damping_time_s=1e-3, damping_Ns_m=0.4)
NUMBERS = {
    (WALL, "stiffness_N_m"): 300.0,
    (0, "damping_Ns_m"): 0.0,
    (1, "tangential_stiffness_N_m"): 300.0,
    (1, "tangential_damping_Ns_m"): 0.0,
}


@pytest.mark.parametrize(
    ("spring", "damper"),
    [
        ((WALL, "stiffness_N_m"), (0, "damping_Ns_m")),
        ((1, "tangential_stiffness_N_m"), (1, "tangential_damping_Ns_m")),
    ],
)
@pytest.mark.parametrize(
    ("asked_N_m", "asked_Ns_m", "given_N_m", "given_Ns_m"),
    [
        (400.0, 0.0, 400.0, 0.0),
        (600.0, 0.0, 600.0, 0.2),
        (600.0, 0.3, 600.0, 0.3),
        (600.0, 9.0, 600.0, 0.4),
        (5000.0, 0.0, 900.0, 0.4),
    ],
)
def test_each_spring_has_its_own_damper(spring, damper, asked_N_m, asked_Ns_m, given_N_m, given_Ns_m):
    """Stiffness above the undamped limit gets damping up to the limit of the device; the other spring is unchanged."""
    taken = clip_to_device(LIMITS, EFFECTS, NUMBERS | {spring: asked_N_m, damper: asked_Ns_m})
    assert taken == NUMBERS | {spring: given_N_m, damper: pytest.approx(given_Ns_m)}


def test_spring_without_damper_is_reduced():
    for spring in ((WALL, "stiffness_N_m"), (1, "tangential_stiffness_N_m")):
        assert clip_to_device(LIMITS, EFFECTS, {spring: 600.0}) == {spring: 400.0}


def test_depth_damping_and_viscous_friction_are_limited():
    limits = replace(LIMITS, force_N=2.0)
    numbers = NUMBERS | {(0, "hunt_crossley_Ns_m2"): 1e3, (1, "friction_viscous_s_m"): 1.0}
    taken = clip_to_device(limits, EFFECTS, numbers | {(0, "damping_Ns_m"): 0.1})
    assert taken[0, "hunt_crossley_Ns_m2"] * 2.0 / 300.0 == pytest.approx(0.4 - 0.1)  # at the depth of 2 N
    assert taken[1, "friction_viscous_s_m"] * 2.0 == pytest.approx(0.4)
    assert clip_to_device(Limits(), EFFECTS, numbers) == numbers
    none = clip_to_device(Limits(force_N=0.0, damping_Ns_m=0.0), EFFECTS, numbers)
    assert none[0, "hunt_crossley_Ns_m2"] == none[1, "friction_viscous_s_m"] == 0.0


def test_adhesion_is_widened_at_constant_work():
    numbers = {(0, "adhesion_N"): 1.0, (0, "adhesion_range_m"): 1e-4}
    taken = clip_to_device(LIMITS, EFFECTS, numbers)
    A, delta = taken.values()
    assert math.e * A / delta == pytest.approx(LIMITS.undamped_N_m) and A * delta == pytest.approx(1e-4)
    messages = [str(clip) for clip in clips("tar", numbers, taken, replace(LIMITS, device="omni"), 1e-3)]
    assert "adhesion_N" in messages[0] and "adhesion_range_m" in messages[1]
    wide = numbers | {(0, "adhesion_range_m"): 1e-2}
    off = numbers | {(0, "adhesion_range_m"): 0.0}
    assert clip_to_device(LIMITS, EFFECTS, wide) == wide and clip_to_device(LIMITS, EFFECTS, off) == off


@pytest.mark.parametrize(
    ("number", "given", "reported"),
    [
        ("stiffness_N_m", 400.0, True),
        ("damping_Ns_m", 400.0, True),
        ("stiffness_N_m", 600.0, False),
        ("damping_Ns_m", 700.0, False),
        ("hunt_crossley_Ns_m2", 400.0, True),
        ("adhesion_range_m", 700.0, True),
    ],
)
def test_audible_changes_are_reported(number, given, reported):
    assert Clip("oak", number, 600.0, given, "omni", 1000.0).reported is reported


def test_messages_have_name_unit_and_both_values():
    numbers = {(WALL, "stiffness_N_m"): 1234.5, (0, "tangential_damping_Ns_m"): 0.1, (0, "friction_viscous_s_m"): 9.0}
    given = {(WALL, "stiffness_N_m"): 99.96, (0, "tangential_damping_Ns_m"): 0.25, (0, "friction_viscous_s_m"): 9.0}
    low, high = clips("oak", numbers, given, replace(LIMITS, device="omni"), 1e-3)[::-1]
    assert (low.swatch, low.asked, low.given, low.device, low.rate_Hz, low.whose) == (
        "oak", 0.1, 0.25, "omni", 1000.0, "swatch"
    )  # fmt: skip
    for clip, parts in ((low, ("0.1 N·s/m", "0.25 N·s/m")), (high, ("1234 N/m", "100 N/m"))):
        assert all(part in str(clip) for part in (*parts, "omni", "1 kHz", "'oak'", clip.number))
    assert str(replace(high, asked=100.0, given=99.0)).count(" 100 N/m") == 1
    share = TextureShare(0.123, 1.0, 0.05, 2e-4, 3e-2, 4e-3)
    said, of_height = share.message("oak", "omni"), replace(share, grating=False).message("oak", "omni")
    assert all(part in said for part in ("0.05 m/s", "30 mN", "0.2 mm", "(4 mN)", "12 %"))
    assert "3e+04 µm" in of_height and "(4e+03 µm)" in of_height


def test_parameters_of_a_scene_are_tuned_and_checked():
    scene = Scene()
    oak = scene.swatch_index(Swatch("oak", 300.0, effects={"friction": {"tangential_stiffness_N_m": 300.0}}))
    parameters = ClippedSwatches(scene, EFFECTS, LIMITS, 1e-3)
    assert parameters.names == ("plain", "oak") and parameters.clips(oak) == []
    parameters.tune(oak, {"stiffness_N_m": 600, "friction_dynamic": 0.2})
    assert parameters.asked[oak][WALL, "stiffness_N_m"] == 600.0 == parameters.given[oak][WALL, "stiffness_N_m"]
    assert parameters.asked[oak][1, "friction_dynamic"] == 0.2
    assert [(clip.number, clip.given) for clip in parameters.clips(oak)] == [("damping_Ns_m", pytest.approx(0.2))]
    before = dict(parameters.asked[oak])
    stiff = [{"stiffness_N_m": bad} for bad in (np.nan, -1.0, 1.01e9)]
    damped = [{"damping_Ns_m": bad} for bad in (-1.0, "hard", None)]
    for bad in (*stiff, *damped, {"mass_kg": 1.0}, {"friction_dynamic": 6.0}):
        with pytest.raises(EffectError, match=next(iter(bad))):
            parameters.tune(oak, {"stiffness_N_m": 1.0} | bad)
    assert parameters.asked[oak] == before and changed(EFFECTS, before, {"stiffness_N_m": 1e9})[WALL, "stiffness_N_m"]
    assert changed((), {}, {"stiffness_N_m": 0.0}) == {(WALL, "stiffness_N_m"): 0.0}
    scene.swatch_index(Swatch("tin", effects={"friction": {"friction_viscous_s_m": 101.0}}))
    with pytest.raises(EffectError, match="'tin'"):
        ClippedSwatches(scene, EFFECTS, LIMITS, 1e-3)


# Share of a texture that motors render.


def test_texture_is_not_limited_without_mass_or_damping():
    wood = load_swatch("wood").texture
    assert share_of(wood, 0.0, 0.1, 1e-3) == share_of(wood, 0.045, math.inf, 1e-3)
    assert share_of(wood, 0.0, 0.1, 1e-3).share == 1.0


def steady_wood():
    return replace(load_swatch("wood").texture, modulation=None, exponents=(0.0, 0.0))


def test_share_scales_with_damping_and_level():
    """The share is proportional to the damping of the device and inverse to the level of the texture."""
    texture = steady_wood()
    found = share_of(texture, 0.045, 0.1, 1e-3)
    assert 0.0 < found.share < 0.5 and found.share == pytest.approx(found.limit / found.amplitude)
    assert 0.0 < found.force_N <= texture.force_max_N and 0.0 < found.slip_m_s <= texture.speed_max_m_s
    assert share_of(texture, 0.045, 0.2, 1e-3).share == pytest.approx(2.0 * found.share)
    louder = replace(texture, variance_m2_s4=4.0 * texture.variance_m2_s4)
    assert share_of(louder, 0.045, 0.1, 1e-3).share == pytest.approx(0.5 * found.share, rel=1e-6)


@pytest.mark.parametrize("mass_kg", [0.2, 1e-5])
def test_share_of_noise_in_closed_form(mass_kg):
    """White noise whose power is proportional to the speed at the largest force: the slowest stroke is the worst."""
    white = Texture.from_models(10_000.0, [2.0], [0.2], a=[[1.0, 0.0]], variance_m2_s4=[9.0])
    rms, frequency = math.sqrt(0.1 * 9.0 * 0.02 / 0.2), 500.0 / math.sqrt(3.0)
    found, l_m = share_of(white, mass_kg, 0.1, 1e-3), 0.02 / frequency
    grating = math.sqrt(2.0) * mass_kg * rms, 0.1 * l_m / (math.pi * 1e-3)
    height = math.sqrt(2.0) * rms / (2.0 * math.pi * frequency) ** 2, 0.1 * l_m**2 / (2.0 * math.pi**2 * 2.0 * 1e-3)
    expected = min((limit / amplitude, amplitude, limit) for amplitude, limit in (grating, height))
    assert (found.share, found.amplitude, found.limit) == pytest.approx(expected, rel=0.03)
    assert (found.slip_m_s, found.wavelength_m) == (0.02, pytest.approx(l_m, rel=0.02))
    assert found.grating == (expected[1:] == grating) == (mass_kg > 0.1) and (found.grating or found.force_N == 2.0)
    slow = replace(white, speed_m_s=0.1 * white.speed_m_s)  # up to 0.02 m/s: from half of it
    assert share_of(slow, mass_kg, 0.1, 1e-3).slip_m_s == pytest.approx(0.01)


def test_share_includes_modulation_and_exponents():
    texture = steady_wood()
    found = share_of(texture, 0.045, 0.1, 1e-3).share
    alive = replace(texture, modulation=GainModulation([0.5], [20.0], [0.0]))
    assert share_of(alive, 0.045, 0.1, 1e-3).share == pytest.approx(found / np.exp(0.25))
    farther = share_of(replace(texture, exponents=(2.0, 0.0)), 0.045, 0.1, 1e-3)
    assert farther.share < found / 1.9 and farther.force_N == 2.0 * texture.force_max_N


def test_averaged_noise():
    """White noise of variance 1 at 10 kHz, averaged over 10 samples, has variance 0.1 up to half the tick rate."""
    white = Texture.from_models(10_000.0, [1.0], [0.1], a=[[1.0, 0.0]], variance_m2_s4=[1.0])
    rms, frequency = _in_blocks(white, np.ones(1), np.full(1, 0.1), 1e-3)
    assert rms[0] == pytest.approx(math.sqrt(0.1), rel=0.02)
    assert frequency[0] == pytest.approx(500.0 / math.sqrt(3.0), rel=0.02)
