"""The contact record that effects read: start, speeds, slip, swatch, barycentric coordinates, shaded normal."""

import math

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.constants import SLIP_CUTOFF_HZ
from hapscene.surface.swatch import Swatch

TICK_S = 1e-3
SHARE = 1 - math.exp(-2 * math.pi * SLIP_CUTOFF_HZ * TICK_S)
BOX = trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]])


@pytest.fixture
def renderer():
    scene = hapscene.Scene()
    scene.add(BOX, name="box", unit="m", swatch=Swatch("soft", stiffness_N_m=200.0))
    return hapscene.Renderer(scene, ["wall"])


def touches_of(renderer, path, poses=None) -> np.ndarray:
    """Return the contact record of each step along a path."""
    rows = []
    for k, p in enumerate(path):
        renderer.step(p, poses={name: X[k] for name, X in (poses or {}).items()})
        rows.append(renderer.surface.touch[0].copy())
    return np.array(rows)


def moved(offsets_m) -> np.ndarray:
    X = np.tile(np.eye(4), (len(offsets_m), 1, 1))
    X[:, :3, 3] = offsets_m
    return X


def test_beginning_and_end_of_a_contact(renderer):
    rows = touches_of(renderer, [[0, 0, z] for z in (0.001, -0.001, -0.003, -0.002, 0.001, 0.002, -0.001)])
    assert rows["touching"].tolist() == [0, 1, 1, 1, 0, 0, 1]
    assert rows["began"].tolist() == [0, 1, 0, 0, 0, 0, 1]
    assert rows["ended"].tolist() == [0, 0, 0, 0, 1, 0, 0]
    np.testing.assert_allclose(rows["depth_m"], [0, 0.001, 0.003, 0.002, 0, 0, 0.001], atol=1e-15)
    np.testing.assert_allclose(rows["depth_rate_m_s"], [0, 0, 2, -1, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(rows["approach_m_s"][[1, 6]], [2, 3], rtol=1e-9)
    np.testing.assert_allclose(rows["v_WT_m_s"][:, 2], [0, -2, -2, 1, 3, 1, -3], atol=1e-9)


def test_first_tick_has_no_velocity(renderer):
    renderer.reset([0, 0, 0.5])
    row = touches_of(renderer, [[0, 0, -0.001]])[0]
    assert row["v_WT_m_s"].tolist() == [0, 0, 0]
    assert row["approach_m_s"] == 0.0
    assert row["tick"] == 0


def test_without_contact_normal_and_swatch_persist(renderer):
    rows = touches_of(renderer, [[0, 0, 0.001], [0, 0, -0.001], [1e-4, 0, -0.001], [1e-4, 0, 0.001]])
    assert rows["swatch"].tolist() == [-1, 1, 1, 1]
    assert rows["crossed"].tolist() == [0, 1, 0, 0]
    assert (rows["body"].tolist(), rows["face"][[0, 3]].tolist()) == ([-1, 0, 0, -1], [-1, -1])
    np.testing.assert_array_equal(rows["nhat_W"][3], [0, 0, 1])
    for name in ("depth_m", "depth_rate_m_s", "normal_force_N", "force_N", "slip_m_s", "slip_W_m", "bary"):
        assert not rows[name][3].any()


def test_normal_force_is_stiffness_times_depth_and_its_low_pass_follows(renderer):
    rows = touches_of(renderer, [[0, 0, 0.001], *[[0, 0, -0.002]] * 200])[1:]
    np.testing.assert_allclose(rows["normal_force_N"], 0.4, rtol=1e-12)
    np.testing.assert_allclose(rows["force_N"], 0.4 * (1 - (1 - SHARE) ** np.arange(1, 201)), rtol=1e-9)


def test_slip_of_a_stroke(renderer):
    """A stroke of 0.1 m/s from rest has a slip of 0.1 mm per tick, and its low-passed speed."""
    x = np.concatenate([np.zeros(3), 1e-4 * np.arange(1, 151)])
    rows = touches_of(renderer, np.c_[x, 0 * x, np.r_[0.001, np.full(152, -0.001)]])
    np.testing.assert_allclose(rows["slip_W_m"][3:], np.tile([1e-4, 0, 0], (150, 1)), atol=1e-12)
    np.testing.assert_allclose(rows["slip_m_s"][3:], 0.1 * (1 - (1 - SHARE) ** np.arange(1, 151)), rtol=1e-6)


def test_slip_starts_with_the_speed_of_the_tool(renderer):
    x = 1e-4 * np.arange(4)
    rows = touches_of(renderer, np.c_[x, 0 * x, [0.001, -0.001, -0.001, -0.001]])
    np.testing.assert_allclose(rows["slip_m_s"][1:], 0.1, rtol=1e-9)


def test_slip_is_over_the_body(renderer):
    """A tool that moves with the body has no slip; a tool at rest slips on a moving body."""
    x = 1e-4 * np.arange(100)
    poses = {"box": moved(np.c_[x, 0 * x, 0 * x])}
    z = np.r_[0.001, np.full(99, -0.001)]
    riding = touches_of(renderer, np.c_[x, 0 * x, z], poses)
    np.testing.assert_allclose(riding["slip_W_m"][2:], 0, atol=1e-12)
    renderer.reset([0, 0, 0.001])
    standing = touches_of(renderer, np.c_[0 * x, 0 * x, z], poses)
    np.testing.assert_allclose(standing["slip_W_m"][2:], np.tile([-1e-4, 0, 0], (98, 1)), atol=1e-12)


def test_contact_with_a_co_moving_body_starts_without_slip(renderer):
    """Tool and body move together when the contact begins."""
    x = 1e-4 * np.arange(50)
    rows = touches_of(
        renderer, np.c_[x, 0 * x, np.r_[0.001, np.full(49, -0.001)]], {"box": moved(np.c_[x, 0 * x, 0 * x])}
    )
    np.testing.assert_allclose(rows["slip_m_s"][1:], 0, atol=1e-9)


def test_approach_is_against_the_body(renderer):
    """The approach speed is relative to the body."""
    lift = np.array([-0.002, -0.002, 0.001])
    rows = touches_of(renderer, np.zeros((3, 3)), {"box": moved(lift[:, None] * [0, 0, 1])})
    assert rows["began"].tolist() == [0, 0, 1]
    assert rows["approach_m_s"][2] == pytest.approx(3.0)


def test_left_position_moves_with_its_body(renderer):
    """The position where the tool left the body translates and rotates with it."""
    lift = np.array([0.0, 0.0, 0.0005, 0.001, 0.002])
    poses = moved(np.c_[0 * lift, 0 * lift, lift])
    poses[4, :2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    rows = touches_of(renderer, [[0.01, 0, z] for z in (0.001, -0.001, -0.001, 0.002, 0.01)], {"box": poses})
    assert rows["left_body"].tolist() == [-1, -1, -1, 0, 0]
    assert rows["leaving_m_s"][3] == pytest.approx(3.0 - 0.5)  # the body rose when it was touched last
    assert not renderer.surface.memory["drag_m_s"].any()
    np.testing.assert_allclose(rows["left_W_m"][3:], [[0.01, 0.0, 0.001], [0.0, 0.01, 0.002]], atol=1e-12)


def test_barycentric_coordinates_place_the_proxy_on_the_face(renderer):
    rows = touches_of(renderer, [[0, 0, 0.001], *([x, 0.3 * x, -0.001] for x in np.linspace(-0.04, 0.04, 20))])[1:]
    for row in rows:
        np.testing.assert_allclose(row["bary"] @ BOX.triangles[row["face"]], row["p_WP_m"], atol=1e-12)
        assert row["bary"].min() > -1e-4


def test_crossing_from_swatch_to_swatch():
    scene = hapscene.Scene()
    scene.add(BOX, name="box", unit="m")
    faces = np.flatnonzero(np.isclose(BOX.triangles_center[:, 2], 0))
    scene.paint("box", Swatch("first", stiffness_N_m=100.0), faces[:1])
    scene.paint("box", Swatch("second", stiffness_N_m=300.0), faces[1:])
    a, b = BOX.triangles_center[faces]
    path = np.linspace(a, b, 21) - [0, 0, 0.001]
    path[0, 2] = 0.001
    rows = touches_of(hapscene.Renderer(scene, ["wall"]), path)
    assert rows["swatch"][1:].tolist() == [1] * 10 + [2] * 10 or rows["swatch"][1:].tolist() == [1] * 9 + [2] * 11
    assert rows["crossed"].sum() == 2  # at the start of the contact and at the border
    np.testing.assert_allclose(rows["normal_force_N"][[1, -1]], [0.1, 0.3], rtol=1e-9)


def test_decaying_values_reach_zero(renderer):
    """Slip and force of a tool at rest become 0 instead of denormal numbers."""
    path = np.tile((0.0, 0.0, -1e-3), (600, 1))
    path[:100, 0] = np.linspace(-0.01, 0.0, 100)
    path[0, 2] = 1e-3
    path[300:, 2] = 0.0  # on the surface, still touching
    touches = touches_of(renderer, path)
    slips, forces = touches["slip_m_s"], touches["force_N"]
    assert slips[99] > 0.05 and slips[-1] == 0.0
    assert forces[250] == pytest.approx(0.2, rel=1e-6)
    for row in (slips, forces):
        assert np.all((row == 0.0) | (np.abs(row) > 1e-15))


def test_the_axes_of_the_touched_body(renderer):
    """The axes rotate with the body, for effects that depend on the direction."""
    turned = moved(np.zeros((3, 3)))
    turned[:, :3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    rows = touches_of(renderer, [[0, 0, 0.001], [0, 0, -0.001], [0, 0, -0.001]], {"box": turned})
    np.testing.assert_allclose(rows["x_WB"][1:], [[0, 1, 0]] * 2, atol=1e-12)
    np.testing.assert_allclose(rows["y_WB"][1:], [[-1, 0, 0]] * 2, atol=1e-12)
