"""The renderer: run and step, reset, poses, limits, and invalid arguments."""

import gc
import warnings
import weakref

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.errors import HapsceneError, PathError, SceneError, UsageWarning
from hapscene.flags import Flag
from hapscene.surface.device_clipping import ClippedSwatches
from hapscene.surface.effect import Effect, Param
from hapscene.surface.swatch import Swatch

ALL = ["wall", "friction", "lpc_texture", "tap"]
translation = trimesh.transformations.translation_matrix
BOX = trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]])
ROWS = ("p_WT_m", "p_WP_m", "nhat_W", "depth_m", "touching", "body", "face", "swatch", "f_W_N", "flags", "a_m_s2")


def scene(swatch: str | Swatch = "wood") -> hapscene.Scene:
    built = hapscene.Scene()
    built.add(BOX, name="box", unit="m", swatch=swatch)
    return built


def stroke(ticks: int = 400) -> np.ndarray:
    """Return a path onto the box, along it with varying depth, and off again."""
    t = np.arange(ticks) / ticks
    z = np.where((t > 0.1) & (t < 0.9), -0.001 + 0.0004 * np.sin(40 * t), 0.002)
    return np.c_[0.03 * np.sin(5 * t), 0.02 * t, z]


def assert_same_bits(a: hapscene.Recording, b: hapscene.Recording) -> None:
    for name in ROWS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_step_and_run_give_the_same_bits():
    path = stroke()
    recording = hapscene.Renderer(scene(), ALL, seed=3).run(path)
    stepper = hapscene.Renderer(scene(), ALL, seed=3)
    commands = [stepper.step(p) for p in path]
    np.testing.assert_array_equal([c.f_W_N for c in commands], recording.f_W_N)
    np.testing.assert_array_equal([c.a_m_s2 for c in commands], recording.a_m_s2)
    np.testing.assert_array_equal([c.flags for c in commands], recording.flags)


def test_path_in_parts_equals_the_path():
    path = stroke()
    whole = hapscene.Renderer(scene(), ALL).run(path)
    renderer = hapscene.Renderer(scene(), ALL)
    parts = [renderer.run(path[:150]), renderer.run(path[150:151])]
    command = renderer.step(path[151])
    parts.append(renderer.run(path[152:]))
    np.testing.assert_array_equal(command.f_W_N, whole.f_W_N[151])
    np.testing.assert_array_equal(np.concatenate([p.f_W_N for p in parts]), np.delete(whole.f_W_N, 151, axis=0))
    np.testing.assert_array_equal(np.concatenate([p.t_s for p in parts]), np.delete(whole.t_s, 151))


def test_reset_replays():
    path = stroke()
    renderer = hapscene.Renderer(scene(), ALL, seed=5)
    first = renderer.run(path)
    renderer.run(path[200:250])
    renderer.reset(path[0])
    again = renderer.run(path)
    assert_same_bits(first, again)
    np.testing.assert_array_equal(first.t_s, again.t_s)


def test_seed_determines_random_numbers():
    one, same, other = (hapscene.Renderer(scene(), ALL, seed=s).run(stroke()) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.a_m_s2, same.a_m_s2)
    assert not np.array_equal(one.a_m_s2, other.a_m_s2)
    np.testing.assert_array_equal(one.f_W_N, other.f_W_N)


# --- invalid arguments


@pytest.mark.parametrize(
    ("path", "place"),
    [
        (np.zeros((0, 3)), ""),
        (np.zeros((5, 2)), "(5, 2)"),
        ([[0, 0, 1], [0, np.nan, 1]], "row 1"),
        ([[0, 0, 1], [0, -20_000, 1]], "row 1"),
    ],
)
def test_bad_path(path, place):
    with pytest.raises(PathError) as caught:
        hapscene.Renderer(scene(), ["wall"]).run(path)
    assert place in str(caught.value)


@pytest.mark.parametrize("position", [[0.0, 0.0], [0.0, 0.0, np.nan]])
def test_bad_reset(position):
    with pytest.raises(PathError):
        hapscene.Renderer(scene(), ["wall"]).reset(position)


STILL = np.tile(np.eye(4), (5, 1, 1))


@pytest.mark.parametrize(
    ("name", "poses", "place"),
    [
        ("bax", STILL, "bax"),
        ("box", STILL[:4], "(5, 4, 4)"),
        ("box", STILL * 2.0, "tick 0"),
        ("box", STILL * np.array([-1, 1, 1, 1]), "tick 0"),
        ("box", STILL * np.nan, "tick 0"),
        ("box", STILL + 7.0 * (np.arange(16).reshape(4, 4) == 12), "tick 0"),
        ("box", STILL + 1e5 * (np.arange(16).reshape(4, 4) == 3), "tick 0"),
    ],
)
def test_bad_poses(name, poses, place):
    with pytest.raises(SceneError) as caught:
        hapscene.Renderer(scene(), ["wall"]).run(np.ones((5, 3)), poses={name: poses})
    assert place in str(caught.value)


@pytest.mark.parametrize(
    ("tick_s", "rate_Hz"), [(1e-3, 10_500.5), (1e-3, 0.0), (0.0, 1e4), (-1e-3, 1e4), (1e-3, 3e5), (np.nan, 1e4)]
)
def test_bad_rates(tick_s, rate_Hz):
    with pytest.raises(HapsceneError):
        hapscene.Renderer(scene(), ["wall"], tick_s=tick_s, a_rate_Hz=rate_Hz)


def test_scene_without_bodies():
    with pytest.raises(SceneError):
        hapscene.Renderer(hapscene.Scene(), ["wall"])


def test_other_rates():
    recording = hapscene.Renderer(scene(), ALL, tick_s=5e-4, a_rate_Hz=8000.0).run(stroke())
    assert recording.a_m_s2.shape == (400, 4)
    np.testing.assert_allclose(recording.t_s, np.arange(400) * 5e-4)


# --- errors in a tick set flags


@pytest.mark.parametrize(("bad", "radius_m"), [(np.nan, 0.0), (np.inf, 0.003)])
def test_invalid_position_is_flagged_and_last_valid_one_used(bad, radius_m):
    renderer = hapscene.Renderer(scene(), ["wall"], tip_radius_m=radius_m)
    renderer.reset([0, 0, 0.001 + radius_m])
    good = renderer.step([0, 0, -0.001 + radius_m])
    held = renderer.step([0, bad, -0.002 + radius_m])
    after = renderer.step([0, 0, -0.001 + radius_m])
    assert (good.flags, held.flags, after.flags) == (Flag(0), Flag.TOOL_NOT_FINITE, Flag(0))
    np.testing.assert_array_equal(held.f_W_N, good.f_W_N)
    np.testing.assert_array_equal(after.f_W_N, good.f_W_N)


def _faulty(touch, p, table, s, out):
    out.f_W_N[0] += 1.0 / (touch.p_WT_m[0] - p.at_m) - 1.0 / (touch.p_WT_m[0] - p.at_m)


FAULTY = Effect("faulty", "NaN at one position.", _faulty, params=(Param("at_m", 0.01, "m", "where"),))


def test_an_effect_that_returns_nan_is_mute_until_reset_and_the_others_go_on():
    renderer = hapscene.Renderer(scene(Swatch("plain one", stiffness_N_m=500.0)), ["wall", FAULTY])
    path = np.tile([0.0, 0.0, -0.001], (6, 1))
    path[0, 2] = 0.001
    path[3, 0] = 0.01
    recording = renderer.run(path)
    assert recording.flags.tolist() == [0, 0, 0, *[Flag.EFFECT_MUTED] * 3]
    np.testing.assert_allclose(recording.f_W_N[1:], np.tile([0, 0, 0.5], (5, 1)), atol=1e-9)
    renderer.reset(path[0])
    assert renderer.run(path[:3]).flags.tolist() == [0, 0, 0]


def test_invalid_first_position_does_not_start():
    renderer = hapscene.Renderer(scene())
    command = renderer.step([np.nan, 0.0, 0.0])
    assert command.flags == hapscene.Flag.TOOL_NOT_FINITE and not command.f_W_N.any()
    assert renderer.step([0.0, 0.0, 0.05]).flags == 0


def test_a_tool_far_from_all_bodies_is_reported_once():
    """A position of 20 mm that is given as 20 m, at the start and later."""
    renderer, near, far = hapscene.Renderer(scene(), ["wall"]), (0.0, 0.0, 0.02), (0.0, 0.0, 20.0)
    with pytest.warns(UsageWarning, match="far from all bodies") as warned:
        renderer.reset(far)
        assert len(warned) == 1
        assert [renderer.step(far).flags for _ in range(3)] == 3 * [Flag.TOOL_FAR]
    assert len(warned) == 1
    renderer.reset(near)
    assert renderer.step(near).flags == Flag(0)
    with pytest.warns(UsageWarning, match="far from all bodies") as warned:
        seen = [renderer.step(p).flags for p in (far, far, near, near, far)]
    assert seen == [Flag.TOOL_FAR] * 3 + [Flag(0), Flag.TOOL_FAR] and len(warned) == 1
    renderer.reset(near)
    away = np.linspace(near, (0.0, 0.0, 60.0), 2000)  # 30 m/s
    with pytest.warns(UsageWarning, match=r"\(0, 0, (5|6|7|8|9|10)[.\d]*\) m, far from all bodies") as warned:
        flags = renderer.run(np.concatenate((away, away[::-1]))).flags
    assert len(warned) == 1
    first, last = np.flatnonzero(flags == Flag.TOOL_FAR)[[0, -1]]
    assert 5.0 < away[first, 2] < 11.0 and away[::-1][last - 2000, 2] == pytest.approx(5.0, abs=0.15)
    assert (flags[:first] == 0).all() and (flags[first:last] == Flag.TOOL_FAR).all() and (flags[last + 1 :] == 0).all()


def test_far_is_in_proportion_to_a_large_body():
    hall = hapscene.Scene()
    hall.add(trimesh.creation.box((20.0, 20.0, 20.0)), name="hall", unit="m")
    renderer = hapscene.Renderer(hall)
    assert renderer.step((0.0, 0.0, 30.0)).flags == Flag(0)


def test_a_jump_past_a_body_is_reported():
    renderer = hapscene.Renderer(scene(), ["wall"], tip_radius_m=0.002)
    renderer.reset((0.0, 0.0, 4.0))
    with pytest.warns(UsageWarning, match="far from all bodies"):
        assert renderer.step((0.0, 0.0, -4.0)).flags & Flag.TOOL_FAR
    renderer.reset((0.0, 0.0, 4.0))
    assert renderer.step((0.0, 0.0, 4.0)).flags == Flag(0)


def test_a_transposed_pose_is_refused():
    renderer, X_WB = hapscene.Renderer(scene(), ["wall"]), np.eye(4)
    renderer.step((0.0, 0.0, 0.02))
    X_WB[0, 3] = 1e-3
    assert renderer.step((0.0, 0.0, 0.02), {"box": X_WB}).flags == Flag(0)
    with pytest.warns(UsageWarning, match="transposed"):
        assert renderer.step((0.0, 0.0, 0.02), {"box": X_WB.T}).flags == Flag.POSE_REFUSED


def test_a_parameter_that_the_effect_does_not_have_is_reported():
    bark = Swatch("bark", effects={"wall": {"dampng_Ns_m": 1.0}})
    with pytest.warns(UserWarning, match=r"'bark'.*'wall'.*'dampng_Ns_m'.*did you mean 'damping_Ns_m'"):
        hapscene.Renderer(scene(bark), ["wall"])


@pytest.mark.parametrize("keys", [{"seed": -1}, {"seed": 1.5}, {"effects": "wall"}, {"a_rate_Hz": np.inf}])
def test_invalid_arguments_are_rejected(keys):
    with pytest.raises(hapscene.HapsceneError):
        hapscene.Renderer(scene(), **keys)


def test_repainting_equals_a_new_renderer(monkeypatch):
    """Its parameters are clipped to the device once, and can be tuned afterwards."""
    fitted = []

    def counted(*arguments):
        fitted.append(ClippedSwatches(*arguments))
        return fitted[-1]

    renderer = hapscene.Renderer(scene("wood"), device="omni")
    renderer.run(stroke())
    monkeypatch.setattr("hapscene.render.renderer.ClippedSwatches", counted)
    other = scene(Swatch("oak", stiffness_N_m=333.0))
    renderer.repaint(other)
    assert len(fitted) == 1 and renderer.surface.touch["swatch"] == renderer.surface.touch["other"] == -1
    monkeypatch.undo()
    fresh = hapscene.Renderer(other, device="omni")
    for either in (renderer, fresh):
        either.reset(stroke()[0])
        either.tune("oak", stiffness_N_m=222.0)
    assert renderer.clips == fresh.clips
    assert_same_bits(renderer.run(stroke()), fresh.run(stroke()))


def test_bodies_are_added_and_removed_in_contact():
    box = trimesh.creation.box((0.1, 0.1, 0.02))
    built = hapscene.Scene()
    built.add(box, name="plate", unit="m")
    renderer = hapscene.Renderer(built, ["wall"])
    bound = renderer.moving_bodies(["plate"])
    renderer.run(np.linspace([0.0, 0.0, 0.02], [0.0, 0.0, 0.008], 50))
    renderer.deform("plate", built.body("plate").mesh.vertices_m)
    built.add(box, name="lid", unit="m", swatch="wood", pose=trimesh.transformations.translation_matrix([0, 0, 0.1]))
    renderer.repaint(built)
    felt = renderer.run(np.tile([0.0, 0.0, 0.008], (5, 1)))
    assert felt.touching.all() and not felt.began.any() and felt.depth_m[-1] == pytest.approx(0.002)
    renderer.step((0.0, 0.0, 0.008), bound)  # still valid
    renderer.deform("plate", built.body("plate").mesh.vertices_m * (1.0, 1.0, 0.9))
    assert renderer.run(np.tile([0.0, 0.0, 0.008], (60, 1))).depth_m[-1] == pytest.approx(0.001)
    up = np.linspace([0.0, 0.0, 0.008], [0.0, 0.0, 0.095], 100)
    felt = renderer.run(up)
    assert felt.body_names[felt.body[-1]] == "lid" and felt.swatch_names[felt.swatch[-1]] == "wood"
    assert renderer.impulse("lid").linear_N_s[2] > 0.0
    renderer.remove("lid")
    felt = renderer.run(up[-1:])
    assert not felt.touching.any()
    for gone in (renderer.impulse, renderer.remove, lambda name: renderer.moving_bodies([name])):
        with pytest.raises(SceneError, match="lid"):
            gone("lid")
    with pytest.raises(SceneError):
        renderer.step((0.0, 0.0, 0.1), [np.eye(4)])
    for invalid in ("plate", 5):
        with pytest.raises(SceneError, match="list of names"):
            renderer.moving_bodies(invalid)
    for others in (hapscene.Scene(), scene()):
        with pytest.raises(SceneError, match="bodies differ"):
            renderer.repaint(others)


def test_added_bodies_share_search_structures():
    ball = hapscene.Mesh.from_trimesh(trimesh.creation.icosphere(2, radius=0.05), "m")
    built = hapscene.Scene()
    built.add(ball, name="one")
    first, second = hapscene.Renderer(built), hapscene.Renderer(built)
    built.add(ball, name="two")
    built.add(BOX, name="box", unit="m")
    for renderer in (first, second):
        renderer.repaint(built)
    assert first.world.bodies["search"].tolist() == second.world.bodies["search"].tolist()
    assert first.world.bodies["search"][0] == first.world.bodies["search"][1]
    for size in (1e4, 1e-5):
        built.add(trimesh.creation.icosphere(1, radius=0.05 * size), name="odd", unit="m")
        with pytest.raises(SceneError, match="odd"):
            first.repaint(built)
        built.bodies.pop()
    first.repaint(built)


def test_table_of_bodies_is_freed_when_another_replaces_it():
    built = scene()
    renderer = hapscene.Renderer(built, ["wall"])
    tables = []
    for number in range(3):
        built.add(
            trimesh.creation.icosphere(1, radius=0.05), name=f"ball {number}", unit="m", pose=translation([1, 0, 0])
        )
        renderer.repaint(built)
        tables.append(weakref.ref(renderer.world.bodies))
    gc.collect()
    assert [table() is None for table in tables] == [True, True, False]
    for at_m, depth_m in (((0.0, 0.0, -0.001), 0.001), ((1.0, 0.0, 0.048), 0.002)):  # search structures are kept
        renderer.reset((at_m[0], 0.0, 0.06))
        path = np.linspace([at_m[0], 0.0, 0.06], at_m, 100)
        assert renderer.run(path).depth_m[-1] == pytest.approx(depth_m, abs=5e-4)


def test_force_of_a_removed_body_fades_out():
    renderer = hapscene.Renderer(scene(), ["wall"])
    renderer.run(np.linspace([0.0, 0.0, 0.02], [0.0, 0.0, -0.002], 50))
    before = renderer.step((0.0, 0.0, -0.002))
    assert before.f_W_N[2] > 0.5 and before.flags == Flag(0)
    renderer.remove("box")
    after = [renderer.step((0.0, 0.0, -0.002)) for _ in range(7)]
    np.testing.assert_allclose(
        [c.f_W_N for c in after], np.outer([0.8, 0.6, 0.4, 0.2, 0, 0, 0], before.f_W_N), atol=1e-12
    )
    assert [c.flags for c in after] == 5 * [Flag.BODY_REMOVED] + 2 * [Flag(0)]
    assert all(c.contact is None for c in after)


def test_removal_of_an_untouched_body_changes_nothing():
    built = scene()
    built.add(BOX, name="far", unit="m", pose=trimesh.transformations.translation_matrix([0, 0, 1]))
    renderer = hapscene.Renderer(built, ["wall"])
    renderer.run(np.linspace([0.0, 0.0, 0.02], [0.0, 0.0, -0.002], 50))
    before = renderer.step((0.0, 0.0, -0.002))
    renderer.remove("far")
    after = renderer.step((0.0, 0.0, -0.002))
    assert after.flags == Flag(0) and after.f_W_N.tolist() == before.f_W_N.tolist()


def test_start_inside_a_body_is_reported():
    inside, outside = np.tile([0.0, 0.0, -0.01], (3, 1)), np.tile([0.0, 0.0, 0.1], (3, 1))
    with pytest.warns(UsageWarning, match="box"):
        hapscene.Renderer(scene(), ["wall"]).run(inside)
    with pytest.warns(UsageWarning, match="box"):
        hapscene.Renderer(scene(), ["wall"]).step(inside[0])
    with pytest.warns(UsageWarning, match="box"):
        renderer = hapscene.Renderer(scene(), ["wall"])
        renderer.reset(inside[0])
        renderer.step(inside[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hapscene.Renderer(scene(), ["wall"]).run(outside)
        hapscene.Renderer(scene(), ["wall"]).run(
            inside, poses={"box": np.tile(translation([0.0, 0.0, 1.0]), (3, 1, 1))}
        )  # elsewhere at the start


def test_removed_body_ignores_old_moving_bodies():
    built = scene()
    renderer = hapscene.Renderer(built, ["wall"])
    bound = renderer.moving_bodies(["box"])
    renderer.reset((0.0, 0.0, 0.01))
    renderer.step((0.0, 0.0, 0.01), {"box": np.eye(4)})
    renderer.remove("box")
    with pytest.raises(SceneError, match="box"):
        renderer.step((0.0, 0.0, 0.01), {"box": np.eye(4)})
    bound.X_WB[0, :3, :3] = np.diag([1.0, -1.0, -1.0])
    felt = [renderer.step((0.0, 0.0, z), bound) for z in np.linspace(0.03, -0.01, 40)]
    assert all(command.contact is None for command in felt)
    assert renderer.run(stroke(10)).body_names == ("box",)


def test_only_bodies_that_moved_in_the_scene_are_placed() -> None:
    """The pose of another that a tick was given stays."""
    built = scene()
    for name in ("lid", "door", "gone"):
        built.add(BOX, name=name, unit="m", pose=trimesh.transformations.translation_matrix((0.0, 0.0, -1.0)))
    renderer = hapscene.Renderer(built, ["wall"])
    aside, up, far = (trimesh.transformations.translation_matrix(p) for p in ((0.3, 0, 0), (0, 0, 0.1), (0, 0.5, 0)))
    renderer.reset((0.0, 0.0, 0.2))
    renderer.step((0.0, 0.0, 0.2), {"box": aside})
    renderer.remove("gone")
    for name in ("lid", "gone"):
        built.pose(name, up)
    for _ in range(2):
        renderer.step((0.0, 0.0, 0.2))
        placed = renderer.world.bodies.p_WB_m[:3].tolist()
        assert placed == [[0.3, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, -1.0]]
    built.pose("door", far)
    assert renderer.run([(0.0, 0.0, 0.2), (0.0, 0.0, 0.098)]).body.tolist() == [-1, 1]
    assert renderer.world.bodies.p_WB_m[2].tolist() == [0.0, 0.5, 0.0]
    renderer.reset((0.0, 0.0, 0.2))
    renderer.step((0.0, 0.0, 0.2))
    built.pose("door", aside)
    assert np.array_equal(renderer.moving_bodies(["door"]).X_WB, [aside])
    built.pose("lid", trimesh.transformations.translation_matrix((0.0, 0.0, 0.3)))
    assert renderer.step((0.0, 0.0, 0.2)).contact is None  # it jumped past the tool


def test_poses_by_name_are_matrices_of_any_numbers() -> None:
    renderer, X_WB = hapscene.Renderer(scene(), ["wall"]), np.eye(4, dtype=int)
    X_WB[0, 3] = 2
    assert renderer.step((0.0, 0.0, 0.1), {"box": X_WB}).flags == 0
    assert renderer.world.bodies.p_WB_m.tolist() == [[2.0, 0.0, 0.0]]
    for bad in (np.eye(4).reshape(2, 8), np.full((4, 4), "a")):
        with pytest.raises(SceneError, match="'box'"):
            renderer.step((0.0, 0.0, 0.1), {"box": bad})


def test_mute_and_unmute() -> None:
    scene = hapscene.Scene()
    scene.add(hapscene.Mesh.from_trimesh(trimesh.creation.box((0.1, 0.1, 0.02)), "m"), name="plate", swatch="wood")
    renderer = hapscene.Renderer(scene)
    renderer.reset((0.0, 0.0, 0.02))
    pressed = [renderer.step((0.0, 0.0, 0.009)).f_W_N[2] for _ in range(2)][1]
    renderer.mute("wall")
    command = renderer.step((0.0, 0.0, 0.009))
    assert pressed > 0.1 and command.f_W_N[2] == pytest.approx(0.0, abs=1e-9) and command.flags == 0
    renderer.reset((0.0, 0.0, 0.02))  # muted effects stay muted
    renderer.step((0.0, 0.0, 0.02))
    assert renderer.step((0.0, 0.0, 0.009)).f_W_N[2] == pytest.approx(0.0, abs=1e-9)
    renderer.mute("wall", False)
    assert renderer.step((0.0, 0.0, 0.009)).f_W_N[2] > 0.1
    with pytest.raises(HapsceneError, match="wal"):
        renderer.mute("wal")
