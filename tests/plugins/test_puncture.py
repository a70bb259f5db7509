"""Puncture: threshold, drag, lateral stiffness and passivity."""

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.constants import PASSED_MAX
from hapscene.surface.swatch import Swatch
from hapscene_plugins.effects.puncture import EFFECT

BREAKS = {"puncture_force_N": 1.0, "drag_N": 0.3, "drag_stiffness_N_m": 400.0, "shaft_stiffness_N_m": 100.0}
EFFECTS = ["wall", EFFECT]


def box(size_m: float) -> trimesh.Trimesh:
    return trimesh.creation.box((size_m, size_m, size_m))


def arm(*more: tuple[float, Swatch], effects=EFFECTS, **breaks: float) -> hapscene.Renderer:
    """A cube of skin of 0.1 m with its top at z = 0.05 and further cubes inside."""
    scene = hapscene.Scene()
    skin = Swatch("skin", stiffness_N_m=200.0, effects={"puncture": BREAKS | breaks})
    for size_m, swatch in ((0.1, skin), *more):
        scene.add(box(size_m), name=swatch.name, unit="m", swatch=swatch)
    return hapscene.Renderer(scene, effects)


def press(renderer, z_m, x_m=0.0) -> np.ndarray:
    """Forces (n, 3) along a path, one position per tick."""
    places = np.broadcast_arrays(np.asarray(x_m, float), 0.0, np.asarray(z_m, float))
    return np.array([renderer.step(p).f_W_N for p in np.column_stack(places)])


def test_the_surface_breaks_at_the_puncture_force():
    z = 0.05 - 1e-5 * np.arange(-50, 1000)
    f = press(arm(), z)
    wall_N = 200.0 * np.maximum(0.0, 0.05 - z)
    broke = int(np.argmax(wall_N > 1.0 + 1e-9))
    np.testing.assert_allclose(f[: broke + 1, 2], wall_N[: broke + 1], atol=1e-9)
    assert f[broke, 2] < 1.0 + 200.0 * 1.1e-5  # within a tick's rise
    drag_N = np.minimum(0.3, 400.0 * np.maximum(0.0, z[broke + 1] - z))
    np.testing.assert_allclose(f[broke + 1 :, 2], drag_N[broke + 1 :], atol=1e-9)
    assert not f[:, :2].any()


def test_a_swatch_without_puncture_force_never_breaks():
    z = 0.05 - 1e-4 * np.arange(-10, 400)
    bare = press(arm(effects=["wall"]), z)
    assert press(arm(puncture_force_N=0.0), z).tobytes() == bare.tobytes()


def test_drag_sticks_at_a_reversal_and_ends_outside():
    renderer = arm()
    press(renderer, 0.05 - 1e-4 * np.arange(-5, 200))
    back = 0.0301 + 1e-4 * np.arange(0, 250)
    f = press(renderer, back)
    np.testing.assert_allclose(
        f[:, 2][back < 0.0499], np.maximum(-0.3, 0.3 - 400.0 * (back - 0.0301))[back < 0.0499], atol=1e-9
    )
    assert not f[back > 0.0501].any() and not renderer.surface.touch[0].inside
    again = press(renderer, 0.05 - 1e-4 * np.arange(-5, 40))
    assert again[-1, 2] == pytest.approx(200.0 * 39e-4)  # it holds again


def test_lateral_stiffness():
    renderer = arm()
    press(renderer, 0.05 - 1e-4 * np.arange(-5, 200), 0.01)
    for k in range(20):
        f_W_N = renderer.step((0.01 + 1e-4 * k, -2e-4 * k, 0.0301)).f_W_N
        np.testing.assert_allclose(f_W_N, (-100.0 * 1e-4 * k, 100.0 * 2e-4 * k, 0.3), atol=1e-9)


def test_contact_inside_a_punctured_body():
    """The punctured body keeps its parameters when another body is touched or parameters change."""
    renderer = arm((0.04, Swatch("bone", stiffness_N_m=1000.0, effects={"puncture": {"drag_N": 9.0}})))
    press(renderer, 0.05 - 1e-4 * np.arange(-5, 250))
    renderer.tune("skin", drag_N=5.0, shaft_stiffness_N_m=1.0)
    z = 0.022 - 1e-4 * np.arange(40)
    f = press(renderer, z)
    np.testing.assert_allclose(f[:, 2], 0.3 + 1000.0 * np.maximum(0.0, 0.02 - z), atol=1e-6)
    before, bone = renderer.impulse("skin").linear_N_s, renderer.impulse("bone").linear_N_s
    press(renderer, z[-1])
    np.testing.assert_allclose(renderer.impulse("skin").linear_N_s - before, (0.0, 0.0, -0.3e-3), atol=1e-9)
    np.testing.assert_allclose(
        renderer.impulse("bone").linear_N_s - bone, (0.0, 0.0, -1e-3 * (f[-1, 2] - 0.3)), atol=1e-9
    )


def test_nested_bodies_are_punctured_independently():
    within = Swatch("organ", stiffness_N_m=200.0, effects={"puncture": BREAKS | {"drag_N": 0.2}})
    renderer = arm((0.06, within))
    f = press(renderer, 0.05 - 1e-4 * np.arange(-5, 400))
    assert renderer.surface.touch[0].inside == 2 and f[-1, 2] == pytest.approx(0.5, abs=1e-9)
    before = [renderer.impulse(name).linear_N_s for name in ("skin", "organ")]
    press(renderer, 0.0101)
    given = [renderer.impulse(n).linear_N_s - b for n, b in zip(("skin", "organ"), before, strict=True)]
    np.testing.assert_allclose(given, [(0.0, 0.0, -0.3e-3), (0.0, 0.0, -0.2e-3)], atol=1e-12)
    f = press(renderer, 0.0102 + 1e-4 * np.arange(300))
    assert f[-1, 2] == pytest.approx(-0.3, abs=1e-9)  # out of the organ


def test_the_forces_move_with_the_body():
    """If body and tool move together, the force rotates with them."""
    renderer = arm()
    press(renderer, 0.05 - 1e-4 * np.arange(-5, 200))
    local = np.array([0.001, 0.0, 0.0301])
    first = renderer.step(local).f_W_N
    X = np.eye(4)
    for k in range(1, 101):
        turn = 0.003 * k
        X[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        X[:3, 3] = (1e-4 * k, 0.0, 2e-4 * k)
        f = renderer.step(X[:3, :3] @ local + X[:3, 3], {"skin": X}).f_W_N
    assert renderer.surface.touch[0].inside == 1
    np.testing.assert_allclose(f, X[:3, :3] @ first, atol=1e-9)


def test_the_number_of_punctured_bodies_is_limited(bench, ticks):
    """The drag is that of all punctured bodies; a further surface does not break."""
    one = bench(EFFECT, Swatch("skin", effects={"puncture": BREAKS}))
    poses = np.concatenate((np.eye(3).ravel(), np.zeros(3)))
    rows = ticks(PASSED_MAX + 12, inside_body=np.arange(PASSED_MAX), inside_X_WB=poses, normal_force_N=2.0)
    rows["body"] = np.minimum(np.arange(len(rows)), PASSED_MAX)
    rows["inside"] = rows["body"]
    rows["p_WT_m"][:, 2] = -1e-3 * np.arange(len(rows))
    out = one.run(rows)
    assert out["release"].tolist() == [1] * PASSED_MAX + [0] * 12
    np.testing.assert_allclose(out["f_W_N"][-1], (0.0, 0.0, 0.3 * PASSED_MAX), atol=1e-12)
    np.testing.assert_allclose(out["f_inside_W_N"][-1, :, 2], 0.3, atol=1e-12)


def test_puncture_forces_are_passive(bench, ticks):
    """For slow motion along and across the axis, the work on the hand never exceeds 0."""
    turn = 2.0 * np.pi * np.linspace(0.0, 1.0, 50_001)[:, None]
    p = 0.004 * np.sin(turn * (7, 5, 11)) + 0.003 * np.sin(turn * (31, 17, 23))
    rows = ticks(len(p), p_WT_m=p, touching=0, inside=1, inside_X_WB=np.concatenate((np.eye(3).ravel(), np.zeros(3))))
    rows["inside"][0], rows["touching"][0], rows["normal_force_N"][0] = 0, 1, 2.0
    out = bench(EFFECT, Swatch("skin", effects={"puncture": BREAKS})).run(rows)
    assert out["release"][0] == 1 and not out["release"][1:].any() and not out["f_W_N"][:2].any()
    f = out["f_W_N"]
    work_J = np.cumsum((0.5 * (f[1:] + f[:-1]) * np.diff(p, axis=0)).sum(axis=1))
    assert work_J.max() < 1e-7 and work_J[-1] < -0.05
