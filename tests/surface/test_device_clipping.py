"""Limits of a device on swatch parameters: stiffness, damping, adhesion, texture."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hapscene.device.model import Limits
from hapscene.surface.device_clipping import WALL, Clip, _in_blocks, clip_to_device, clips, share_of
from hapscene.surface.effect import load_effect
from hapscene.surface.gain_modulation import GainModulation
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
