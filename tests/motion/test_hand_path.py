"""The hand made from parts."""

import numpy as np
import pytest
import trimesh

from hapscene.errors import PathError
from hapscene.motion.gestures import act as gesture
from hapscene.motion.hand_path import DEPTH_M, HOVER_M, PathBuilder, explore
from hapscene.motion.look_from_above import TopView, look_from_above
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Box
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

TICK_S = 1e-3


def make_scene() -> Scene:
    """A plate with two swatches, its border at x = 0, and a ball beside it that is higher."""
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.12, 0.08, 0.01)), "m"), name="plate")
    scene.paint("plate", Swatch("rough"), [i for i, c in enumerate(_centres(scene)) if c[0] > 0])
    X_WB = np.eye(4)
    X_WB[0, 3] = 0.15
    scene.add(Mesh.from_trimesh(trimesh.creation.icosphere(3, 0.04), "m"), name="ball", pose=X_WB)
    return scene


def _centres(scene: Scene) -> np.ndarray:
    return scene.bodies[0].mesh.triangles_m.mean(axis=1)


def flat(x_m: np.ndarray, y_m: np.ndarray) -> TopView:
    """A plane at z = 0."""
    return TopView(np.zeros(len(x_m)), np.zeros(len(x_m), np.int64), np.zeros(len(x_m), np.int64))


def speed_m_s(p_WT: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(p_WT, axis=0), axis=1) / TICK_S


def test_movement_is_that_of_minimum_jerk() -> None:
    hand = PathBuilder((0.0, 0.0, 0.1), TICK_S, flat)
    hand.move((0.2, 0.0, 0.1), 0.5)
    x_m = hand.p_WT_m[:, 0]
    assert len(x_m) == 501 and x_m[-1] == pytest.approx(0.2, abs=1e-15)
    assert x_m[250] == pytest.approx(0.1, abs=1e-12)
    assert speed_m_s(hand.p_WT_m).max() == pytest.approx(1.875 * 0.2 / 0.5, rel=1e-4)


def test_acts_go_to_their_depth_and_back_in_their_time() -> None:
    """80 ms across and 80 ms down to the height at which they begin; then their own movements."""
    for act, ticks in (
        (lambda hand: hand.tap(0.01, 0.0), 100 + 100),
        (lambda hand: hand.press(0.01, 0.0, DEPTH_M), 200 + 200 + 200),
        (lambda hand: hand.stroke((0.01, 0.0), (0.06, 0.02)), 150 + 449 + 120),  # 54 mm at 0.12 m/s
        (lambda hand: hand.scrub((0.01, 0.0), (0.06, 0.02), DEPTH_M, 2), 150 + 4 * 301 - 1 + 120),
    ):
        hand = PathBuilder((0.0, 0.0, 0.02), TICK_S, flat)
        act(hand)
        x_m, _, z_m = hand.p_WT_m.T
        assert hand.tick_count == len(z_m) == 1 + 160 + ticks
        assert z_m.min() == pytest.approx(-DEPTH_M, abs=1e-9)
        assert z_m[-1] == pytest.approx(HOVER_M, abs=1e-9)
    ways = np.sign(np.diff(x_m))
    assert np.count_nonzero(np.diff(ways[ways != 0.0])) == 3  # back and forth


def test_trace_has_a_depth_in_each_row() -> None:
    hand = PathBuilder((0.0, 0.0, 0.02), TICK_S, flat)
    way = hand.line((0.01, 0.0), (0.06, 0.0), 0.1)
    start, _ = hand.trace(way, np.linspace(1e-3, 3e-3, len(way)))
    traced = hand.p_WT_m[start : start + len(way)]
    np.testing.assert_allclose(traced[50:-50, 2], np.linspace(-1e-3, -3e-3, len(way))[50:-50], atol=1e-6)
    assert hand.p_WT_m[start - 150, 2] == pytest.approx(HOVER_M, abs=2e-5)  # above the smoothed ends
    assert hand.p_WT_m[-1, 2] == pytest.approx(HOVER_M, abs=5e-5)


def test_explore_touches_every_body_smoothly_and_repeats() -> None:
    scene = make_scene()
    p_WT = explore(scene, TICK_S)
    assert np.array_equal(p_WT, explore(make_scene(), TICK_S))
    view = look_from_above(scene)(p_WT[:, 0], p_WT[:, 1])
    below = p_WT[:, 2] < view.z_m
    assert set(view.body[below]) == {0, 1}
    assert np.count_nonzero(np.diff(below.astype(int)) > 0) == 10  # two taps, a press, two strokes on each
    assert (view.z_m - p_WT[:, 2])[below].max() < 0.01
    assert not below[0] and not below[-1] and not np.ptp(p_WT[:101], axis=0).any()
    assert speed_m_s(p_WT).max() < 1.5
    assert 4.0 < len(p_WT) * TICK_S < 12.0
    assert not np.ptp(p_WT[-round(0.2 / TICK_S) :], axis=0).any()  # it waits in the air


def test_explore_goes_no_deeper_into_a_small_body_than_befits_it() -> None:
    for size_m, deep_m in ((0.01, 0.05 * 0.01), (0.2, DEPTH_M)):
        scene = Scene()
        scene.add(Mesh.from_trimesh(trimesh.creation.box((size_m,) * 3), "m"))
        z_m, hover_m = explore(scene, TICK_S)[:, 2] - 0.5 * size_m, min(HOVER_M, 0.2 * 0.96 * size_m)
        assert -z_m.min() == pytest.approx(2 * deep_m, rel=0.1)  # the press
        assert (z_m[0], z_m[-1]) == pytest.approx((2 * hover_m, hover_m), rel=1e-3)
        assert gesture("tap", scene, TICK_S).target_W_m[0, 2] - 0.5 * size_m == pytest.approx(hover_m, rel=1e-3)
        assert 0.5 * size_m - explore(scene, TICK_S, 1e-4)[:, 2].min() == pytest.approx(2e-4, rel=0.1)


def test_explore_strokes_across_the_border_of_two_swatches() -> None:
    scene = Scene()
    plate = trimesh.creation.box((0.12, 0.08, 0.01)).subdivide().subdivide()
    scene.add(Mesh.from_trimesh(plate, "m"), name="plate")
    scene.paint("plate", Swatch("rough"), Box((-1.0, 0.02, -1.0), (1.0, 1.0, 1.0)))
    p_WT = explore(scene, TICK_S)
    view = look_from_above(scene)(p_WT[:, 0], p_WT[:, 1])
    below = p_WT[:, 2] < view.z_m
    assert np.any((np.diff(view.swatch) != 0) & below[1:] & below[:-1])


def test_scene_that_shows_nothing_upwards_is_one_error() -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 1, 2]], process=False)
    scene = Scene()
    scene.add(Mesh.from_trimesh(sheet, "m"), name="sheet")
    with pytest.raises(PathError, match="--two-sided"):
        explore(scene, TICK_S)


def test_calm_path_starts_later_and_is_equal_on_a_flat_surface() -> None:
    brisk, calm = (PathBuilder((0.0, 0.0, 0.02), TICK_S, flat, calm_s=calm_s) for calm_s in (0.0, 0.4))
    (start, rows), (later, calm_rows) = (
        hand.trace(hand.line((0.01, 0.0), (0.06, 0.0), 0.1), 1e-3) for hand in (brisk, calm)
    )
    assert np.array_equal(rows, calm_rows) and later > start
    assert np.array_equal(brisk.p_WT_m[start : start + len(rows)], calm.p_WT_m[later : later + len(rows)])
    assert later >= 2 * 400  # across, and down


def test_walls_are_climbed_in_the_air_at_the_same_slope_from_both_sides() -> None:
    def plateau(x_m: np.ndarray, y_m: np.ndarray) -> TopView:
        none = np.zeros(len(x_m), np.int64)
        return TopView(np.where(np.abs(x_m) < 0.00995, 0.02, 0.0), none, none)

    x_m = np.concatenate((np.arange(-0.03, 0.0, 1e-4), np.arange(0.0, 0.03, 2e-4)))  # faster on the way down
    hand = PathBuilder((-0.03, 0.0, 0.04), TICK_S, plateau)
    start, rows = hand.trace(np.column_stack((x_m, 0.0 * x_m)), 1e-3)
    z_m = np.interp((-0.025, -0.0133, 0.0, 0.0133, 0.025), x_m, hand.p_WT_m[start : start + len(rows), 2])
    up_m, down_m = 0.0205 - 3.0 * (0.0133 - 0.0099), 0.0205 - 3.0 * (0.0133 - 0.0098)
    assert z_m == pytest.approx([-1e-3, up_m, 0.019, down_m, -1e-3], abs=2e-5)


def test_calm_path_climbs_at_most_at_stroke_speed() -> None:
    def step(x_m: np.ndarray, y_m: np.ndarray) -> TopView:
        return TopView(np.where(x_m > 0.03, 0.02, 0.0), np.zeros(len(x_m), np.int64), np.zeros(len(x_m), np.int64))

    hand = PathBuilder((0.0, 0.0, 0.04), TICK_S, step, calm_s=0.3)
    way = hand.line((0.01, 0.0), (0.06, 0.0), 0.1)
    start, rows = hand.trace(way, 1e-3)
    traced = hand.p_WT_m[start : start + len(rows)]
    level_m_s = speed_m_s(np.column_stack((way, 0.0 * way[:, 0]))).max()
    assert speed_m_s(traced).max() <= level_m_s * (1.0 + 1e-6)
    assert len(rows) > len(way) + 50
    np.testing.assert_allclose(traced[:, 0], np.interp(rows, np.arange(len(way)), way[:, 0]), atol=1e-15)
    assert traced[-1, 0] == pytest.approx(0.06)
