"""What the effects supply, inside the device's limits: cut in this order, and flagged."""

import numpy as np
import pytest
import trimesh

from hapscene.device.model import Limits
from hapscene.flags import Flag
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.mixer import FADE_S, fade_removed, limit, render_contact, render_fields
from hapscene.surface.surface_arrays import FAILED, SWITCHED_OFF, build_surface
from hapscene.surface.swatch import Swatch


def limited(f_W_N, a_m_s2=(0.0, 0.0, 0.0), last_N=(0.0, 0.0, 0.0), swatch=0, other=-1, **limits):
    """Force, acceleration and flags of a tick of 1 ms that adds up to these."""
    scene = Scene()
    scene.add(trimesh.creation.box(), unit="m")
    scene.swatch_index(Swatch("heavy"))
    surface = build_surface(scene, [], 1e-3, 3000.0, Limits(**limits))
    surface.fold_mass_kg[1] *= 3.0
    total, touch, memory = surface.total[0], surface.touch[0], surface.memory[0]
    total.f_W_N[:], total.a_m_s2[:3], memory.f_W_N[:] = f_W_N, a_m_s2, last_N
    touch.swatch, touch.other, touch.weight, touch.nhat_W[:] = swatch, other, 0.25, (0.0, 0.6, 0.8)
    flags = limit(surface)
    np.testing.assert_array_equal(memory.f_W_N, total.f_W_N)  # what the next tick's change is counted from
    return total.f_W_N.copy(), total.a_m_s2[:3].copy(), Flag(int(flags))


def test_values_within_limits_are_unchanged():
    f, a, flags = limited((3.0, 0.0, 4.0), (2.0, -2.0, 0.5), force_N=5.0, acceleration_m_s2=2.0, slew_N_s=5000.0)
    assert f.tolist() == [3.0, 0.0, 4.0] and a.tolist() == [2.0, -2.0, 0.5] and flags == 0


def test_samples_are_clipped():
    _, a, flags = limited((0.0, 0.0, 0.0), (3.0, -4.0, 0.5), acceleration_m_s2=2.0)
    assert a.tolist() == [2.0, -2.0, 0.5] and flags == Flag.ACCELERATION_LIMITED


@pytest.mark.parametrize(
    ("swatch", "other", "folded_N"), [(0, -1, 0.1 / 3.0), (-1, -1, 0.0), (0, 1, 0.15 / 3.0), (1, 0, 0.25 / 3.0)]
)
def test_acceleration_is_folded_into_the_force(swatch, other, folded_N):
    """The mean of the samples as they are cut, times the mass; nothing before anything was touched."""
    on = {"swatch": swatch, "other": other}
    f, _, flags = limited((1.0, 0.0, 0.0), (3.0, -1.0, 0.0), fold_mass_kg=0.1, acceleration_m_s2=2.0, **on)
    np.testing.assert_allclose(f, (1.0, 0.6 * folded_N, 0.8 * folded_N), rtol=1e-12)
    assert flags == Flag.ACCELERATION_LIMITED


def test_force_and_slew_limits():
    f, _, flags = limited((6.0, 0.0, 8.0), force_N=5.0)
    np.testing.assert_allclose(f, (3.0, 0.0, 4.0), rtol=1e-12)
    assert flags == Flag.FORCE_LIMITED
    f, _, flags = limited((6.0, 1.0, 8.0), last_N=(3.0, 1.0, 4.0), slew_N_s=1000.0)
    np.testing.assert_allclose(f, (3.6, 1.0, 4.8), rtol=1e-12)
    assert flags == Flag.SLEW_LIMITED
    f, _, flags = limited((0.0, 0.0, 80.0), last_N=(0.0, 0.0, 2.0), slew_N_s=1000.0, force_N=5.0)
    assert f.tolist() == [0.0, 0.0, 3.0] and flags == Flag.FORCE_LIMITED | Flag.SLEW_LIMITED


def write(touch, p, table, s, out):
    """Write all outputs: in proportion to the tick and to a parameter, and `bad` to one output."""
    s.ticks += 1.0
    for i in range(3):
        out.f_W_N[i] += s.ticks * p.size * (i + 1)
        for k in range(touch.inside):
            out.f_inside_W_N[k, i] += p.size * (10 * (k + 1) + i)
    for i in range(touch.block):
        out.a_m_s2[i] += p.size * (i + 1)
    out.release = 1 if p.size >= 2.0 else 0
    if p.where >= 0.0:
        if p.where < 3.0:
            out.f_W_N[int(p.where)] = p.bad
        elif p.where < 6.0:
            out.a_m_s2[int(p.where) - 3] = p.bad
        else:
            out.f_inside_W_N[1, int(p.where) - 6] = p.bad


def writer(name="write", scope="contact"):
    params = [Param(name, value, "1", "value") for name, value in (("size", 1.0), ("where", -1.0), ("bad", 0.0))]
    return Effect(name, "Writes.", write, params=tuple(params), state=(State("ticks"),), scope=scope)


def touched(effects, size=(1.0, 2.0), swatch=1, other=-1, where=-1.0, bad=0.0):
    """A surface with swatches of these sizes, touched inside two bodies, with other outputs left from before."""
    scene = Scene()
    scene.add(trimesh.creation.box(), unit="m")
    for number in size:
        given = {effect.name: {"size": number, "where": where, "bad": bad} for effect in effects}
        scene.swatch_index(Swatch(f"of size {number}", effects=given))
    surface = build_surface(scene, effects, 1e-3, 3000.0, Limits())
    touch, total = surface.touch[0], surface.total[0]
    touch.swatch, touch.other, touch.weight, touch.inside, touch.crossed = swatch, other, 0.25, 2, 1
    surface.memory[0].gain = 1.0, 0.0
    total.f_W_N[:], total.a_m_s2[:3], total.f_inside_W_N[:2], total.release = 9.0, 9.0, 9.0, 1
    return surface


INSIDE = np.array([[10.0, 11.0, 12.0], [20.0, 21.0, 22.0]])


def test_effects_of_one_swatch_are_added():
    surface = touched([writer("one"), writer("two")])
    surface.muted[1] = SWITCHED_OFF
    for tick in (1.0, 2.0):
        assert render_contact(surface) == 0
        total = surface.total[0]
        assert total.f_W_N.tolist() == [tick, 2.0 * tick, 3.0 * tick] and total.a_m_s2[:3].tolist() == [1.0, 2.0, 3.0]
        assert total.f_inside_W_N[:2].tolist() == INSIDE.tolist() and total.release == 0
    surface.muted[1] = 0
    surface.touch[0].swatch = 2
    assert render_contact(surface) == 0 and surface.total[0].release == 1
    np.testing.assert_allclose(surface.total[0].f_W_N, 2.0 * 4.0 * np.arange(1, 4))  # in ticks 3 and 1
    surface.touch[0].swatch = -1
    assert render_contact(surface) == 0 and not surface.total[0].f_W_N.any() and not surface.total[0].a_m_s2[:3].any()
    assert not surface.total[0].f_inside_W_N[:2].any() and surface.total[0].release == 0


@pytest.mark.parametrize(("size", "release"), [((1.0, 2.0), 0), ((2.0, 1.0), 1)])
def test_two_swatches_are_added_by_weight(size, release):
    """Accelerations are ramped from the gains of the last tick; each swatch has its state."""
    surface = touched([writer()], size, other=2)
    assert render_contact(surface) == 0
    total, touch, memory = surface.total[0], surface.touch[0], surface.memory[0]
    mean = 0.75 * size[0] + 0.25 * size[1]
    np.testing.assert_allclose(total.f_W_N, mean * np.arange(1, 4))
    np.testing.assert_allclose(total.f_inside_W_N[:2], mean * INSIDE)
    gain = [1.0 + (np.sqrt(0.75) - 1.0) * np.arange(1, 4) / 3.0, 0.5 * np.arange(1, 4) / 3.0]
    np.testing.assert_allclose(total.a_m_s2[:3], (size[0] * gain[0] + size[1] * gain[1]) * np.arange(1, 4))
    assert memory.gain.tolist() == [np.sqrt(0.75), 0.5] and total.release == release
    assert (touch.swatch, touch.other, touch.crossed) == (1, 2, 1)
    memory.bank, memory.other_crossed = 1, 0
    surface.states[:] = 0
    render_contact(surface)
    np.testing.assert_allclose(total.f_W_N, mean * np.arange(1, 4))
    ticks = surface.states.view(np.float64)
    assert ticks.tolist() == [1.0, 1.0]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("where", range(9))
def test_an_effect_with_any_output_that_is_not_finite_is_muted(where, bad):
    surface = touched([writer("fails"), writer("works")])
    for effect in (0, 1):
        dtype, start = writer().param_dtype, surface.param_start[1, effect]
        row = surface.params[start : start + dtype.itemsize].view(dtype)
        row["where"], row["bad"] = (where, bad) if effect == 0 else (-1.0, 0.0)
    for _ in range(2):
        assert render_contact(surface) == Flag.EFFECT_MUTED
        assert surface.muted.tolist() == [FAILED, 0] and np.isfinite(surface.total[0].a_m_s2[:3]).all()
    assert surface.total[0].f_W_N.tolist() == [2.0, 4.0, 6.0]


def test_effects_of_the_scene_are_added_to_those_of_contact():
    scene = Scene()
    scene.add(trimesh.creation.box(), unit="m")
    renderer = Renderer(scene, [writer("one", "scene"), writer("two", "scene")], settings={"two": {"size": 2.0}})
    surface = renderer.surface
    touch, total = surface.touch[0], surface.total[0]
    touch.inside, touch.block = 2, 3
    total.f_W_N[:], total.a_m_s2[:3], total.f_inside_W_N[:2], total.release = 1.0, 2.0, 3.0, 0
    assert render_fields(renderer.world, surface) == 0 and total.release == 1
    assert total.f_W_N.tolist() == [4.0, 7.0, 10.0] and total.a_m_s2[:3].tolist() == [5.0, 8.0, 11.0]
    assert total.f_inside_W_N[:2].tolist() == (3.0 + 3.0 * INSIDE).tolist()
    surface.muted[0] = FAILED
    assert render_fields(renderer.world, surface) == Flag.EFFECT_MUTED and total.f_W_N.tolist() == [8.0, 15.0, 22.0]


def test_the_force_of_a_removed_body_fades_out_linearly():
    surface = touched([])
    total, memory = surface.total[0], surface.memory[0]
    total.f_W_N[:], memory.f_W_N[:] = 0.0, (1.0, -2.0, 3.0)
    assert fade_removed(surface) == 0 and not total.f_W_N.any()
    memory.fading_s = FADE_S
    for share in (0.8, 0.6, 0.4, 0.2, 0.0):
        total.f_W_N[:] = 0.5
        assert fade_removed(surface) == Flag.BODY_REMOVED
        np.testing.assert_allclose(total.f_W_N, 0.5 + share * np.array([0.5, -2.5, 2.5]), atol=1e-12)
