"""Reaction on bodies: opposite to the contact force, shared by bodies in contact, and accumulated."""

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device.model import Limits
from hapscene.errors import PathError
from hapscene.surface.effect import Effect
from hapscene.surface.swatch import Swatch

BOX = trimesh.creation.box((0.1, 0.1, 0.1))
ROUGH = Swatch("rough", stiffness_N_m=500.0, friction_static=0.5, friction_dynamic=0.4)


def scene(*places_m, swatch=ROUGH) -> hapscene.Scene:
    built = hapscene.Scene()
    for i, p in enumerate(places_m):
        X = np.eye(4)
        X[:3, 3] = p
        built.add(BOX, name=f"box {i}", unit="m", swatch=swatch, pose=X)
    return built


def stroke(ticks=300) -> np.ndarray:
    t = np.linspace(0.0, 1.0, ticks)
    return np.c_[0.03 * t, 0.01 * np.sin(9 * t), 0.0505 - 0.003 * np.sin(np.pi * t)]


def test_reaction_is_opposite_and_accumulated():
    place = np.array([0.02, 0.01, 0.0])
    renderer = hapscene.Renderer(scene(place), ["wall", "friction"])
    path = stroke() + place
    seen = renderer.run(path)
    assert seen.touching.sum() > 200 and np.abs(seen.f_W_N[:, 0]).max() > 0.1
    np.testing.assert_array_equal(seen.f_body_W_N, -seen.f_W_N)
    linear, angular = renderer.impulse("box 0")
    np.testing.assert_allclose(linear, -1e-3 * seen.f_W_N.sum(axis=0), rtol=1e-12)
    torque = np.cross(seen.p_WP_m - place, seen.f_body_W_N)
    np.testing.assert_allclose(angular, 1e-3 * torque.sum(axis=0), rtol=1e-12, atol=1e-16)
    renderer.reset(path[0])
    assert not np.any(renderer.impulse("box 0"))


def test_contact_of_step_equals_recording():
    renderer, path = hapscene.Renderer(scene((0, 0, 0)), ["wall", "friction"]), stroke()
    seen = hapscene.Renderer(scene((0, 0, 0)), ["wall", "friction"]).run(path)
    for k, p in enumerate(path):
        contact = renderer.step(p).contact
        assert (contact is not None) == seen.touching[k]
        if contact is None:
            continue
        assert (contact.body, contact.swatch, contact.face) == ("box 0", "rough", seen.face[k])
        assert contact.began == seen.began[k] == (seen.touching[k] and not seen.touching[k - 1])
        assert contact.f_body_W_N.tolist() == seen.f_body_W_N[k].tolist()
    first = renderer.step((0.0, 0.0, 0.049)).contact
    renderer.step((0.0, 0.0, 0.048))
    assert first.depth_m == pytest.approx(0.001)  # a copy
    with pytest.raises(PathError):
        first.tau_body_W_Nm("here")


def test_body_force_excludes_limits_fields_and_device_damping():
    def push(touch, p, table, s, out):
        out.f_W_N[2] -= 3.0

    field = Effect("draw", "Draws down.", push, scope="scene")
    plain = hapscene.Renderer(scene((0, 0, 0)), ["wall"]).run(stroke())
    limits = Limits(force_N=0.7, slew_N_s=50.0, passivity_Ns_m=1.0)
    held = hapscene.Renderer(scene((0, 0, 0)), ["wall", field], limits=limits).run(stroke())
    np.testing.assert_array_equal(held.f_body_W_N, plain.f_body_W_N)
    assert np.linalg.norm(held.f_W_N, axis=1).max() < 0.71


@pytest.mark.parametrize("radius_m", [0.0, 0.002])
def test_two_bodies_in_contact_share_the_force(radius_m):
    """In the corner of a floor and a wall without friction, each receives the push of its own face at its own point."""
    renderer = hapscene.Renderer(scene((0, 0, 0), (0.1, 0.0, 0.05)), ["wall"], tip_radius_m=radius_m)
    path = np.array([(0.045, 0.0, 0.055), (0.0495, 0.0, 0.0499), (0.0503, 0.0, 0.0499), *2 * [(0.0503, 0.0, 0.0496)]])
    path += (-radius_m, 0.0, radius_m)
    renderer.run(path[:4])
    before = [np.concatenate(renderer.impulse(f"box {i}")) for i in range(2)]
    command = renderer.step(path[4])
    floor, wall = (np.concatenate(renderer.impulse(f"box {i}")) - before[i] for i in range(2))
    down, right = 500.0 * 0.0004 * 1e-3, 500.0 * 0.0003 * 1e-3
    np.testing.assert_allclose(floor, [0.0, 0.0, -down, 0.0, down * (0.05 - radius_m), 0.0], atol=1e-12)
    np.testing.assert_allclose(wall, [right, 0.0, 0.0, 0.0, right * radius_m, 0.0], atol=1e-12)
    np.testing.assert_allclose((floor + wall)[:3], -1e-3 * command.f_W_N, atol=1e-15)
    assert command.contact.body == "box 0" and command.contact.f_body_W_N == pytest.approx(1e3 * floor[:3])
