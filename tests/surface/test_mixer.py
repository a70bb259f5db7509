"""What the effects supply, inside the device's limits: cut in this order, and flagged."""

import numpy as np
import pytest
import trimesh

from hapscene.device.model import Limits
from hapscene.flags import Flag
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene
from hapscene.surface.effect import Effect, Param
from hapscene.surface.mixer import limit, render_fields
from hapscene.surface.surface_arrays import build_surface
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


def test_fields_add_their_force_and_their_samples():
    def push(touch, p, table, s, out):
        out.f_W_N[2] += 1.0
        out.a_m_s2[0] += 2.0
        out.f_inside_W_N[0, 1] += 3.0
        out.release = 1

    scene = Scene()
    scene.add(trimesh.creation.box(), unit="m")
    fields = [Effect(name, "Pushes.", push, scope="scene") for name in ("one", "two")]
    renderer = Renderer(scene, fields)
    command = renderer.step((0.0, 0.0, 9.0))
    assert command.f_W_N.tolist() == [0.0, 0.0, 2.0] and command.a_m_s2[0] == 4.0
    renderer.surface.touch[0].inside, total = 1, renderer.surface.total[0]
    assert render_fields(renderer.world, renderer.surface) == 0 and total.release == 1
    assert total.f_inside_W_N[0].tolist() == [0.0, 6.0, 0.0]


@pytest.mark.parametrize("axis", range(3))
def test_an_effect_with_nan_in_any_component_is_muted(axis):
    def fail(touch, p, table, s, out):
        out.f_W_N[int(p.axis)] = np.nan

    scene = Scene()
    scene.add(trimesh.creation.box(), unit="m")
    field = Effect("fail", "Returns NaN.", fail, params=(Param("axis", 0.0, "1", "which"),), scope="scene")
    command = Renderer(scene, [field], settings={"fail": {"axis": axis}}).step((0.0, 0.0, 9.0))
    assert command.flags == Flag.EFFECT_MUTED and command.f_W_N.tolist() == [0.0, 0.0, 0.0]
