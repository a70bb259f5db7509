"""Gestures as intentions: how deep they aim, and where they go."""

import numpy as np
import pytest

from hapscene.device.sim.hand import GRIPS, Grip
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.motion.gestures import GESTURES, PRESS_N, STROKE_N, TOOL_KG, _without_steep_ends, act, calm_time_s
from hapscene.motion.hand_path import HOVER_M
from hapscene.motion.look_from_above import TopView
from hapscene.scene.scene import Scene
from hapscene.stability.rig import sheet
from hapscene.surface.swatch import Swatch

TICK_S = 1e-3
SPAN_M = 0.2 * 0.96 * 22 / 24
"""Length of the best lines on the sheet: its window less one cell of the grid at each end."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return sheet(Swatch("plain"))


def done(scene: Scene, name: str, grip: str = "light") -> ReferenceTrajectory:
    return act(name, scene, TICK_S, grip=grip)


def dips(intent: ReferenceTrajectory) -> list[tuple[int, int]]:
    """From when to when the hand aims below the surface."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], intent.target_W_m[:, 2] < -1e-6, [0])).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


@pytest.mark.parametrize("grip", ["light", "firm"])
@pytest.mark.parametrize(
    ("name", "force_N", "count"),
    [("tap", STROKE_N, 3), ("press", PRESS_N, 1), ("stroke", STROKE_N, 2), ("scrub", 2 * STROKE_N, 1)],
)
def test_gesture_depth_follows_from_its_force(scene: Scene, name: str, force_N: float, count: int, grip: str) -> None:
    intent = done(scene, name, grip)
    found = dips(intent)
    assert len(found) == count
    for start, end in found:
        assert intent.target_W_m[start:end, 2].min() == pytest.approx(-force_N / GRIPS[grip].k_N_m, rel=1e-6)
    assert np.all(intent.grip == GRIPS[grip].row()) and not intent.push_W_N.any()


@pytest.mark.parametrize("name", GESTURES)
def test_gesture_approaches_from_above_and_leaves_continuously(scene: Scene, name: str) -> None:
    intent = done(scene, name, "medium")
    assert intent.target_W_m[0, 2] == pytest.approx((2.0 if name == "explore" else 1.0) * HOVER_M)
    assert intent.target_W_m[-1, 2] > -PRESS_N / GRIPS["medium"].k_N_m - 1e-9
    assert np.linalg.norm(np.diff(intent.target_W_m, axis=0), axis=1).max() < 1e-3  # 1 m/s
    assert len(intent.grip) == len(intent.target_W_m)
    if name != "explore":
        assert np.ptp(intent.target_W_m[-round(0.5 / TICK_S) :], axis=0).max() == 0.0  # what buzzes is seen
        assert np.ptp(intent.target_W_m[:51], axis=0).max() == 0.0


def test_line_is_shortened_to_where_its_ends_are_gentle() -> None:
    def look(x_m: np.ndarray, y_m: np.ndarray) -> TopView:
        none = np.zeros(len(x_m), np.int64)
        return TopView(heights[kind](x_m), none, none)

    heights = {
        "steep ends": lambda x_m: 10.0 * np.maximum(np.abs(x_m) - 0.03, 0.0),
        "gentle": lambda x_m: 0.24 * x_m,
        "steep": lambda x_m: 10.0 * x_m,
    }
    for kind in heights:
        end_m = 0.03 if kind == "steep ends" else 0.05
        ends = np.ravel(_without_steep_ends(look, ((-0.05, 0.01), (0.05, 0.01))))
        np.testing.assert_allclose(ends, (-end_m, 0.01, end_m, 0.01), atol=1e-12)


def test_taps_lie_along_the_line_and_a_stroke_goes_there_and_back(scene: Scene) -> None:
    taps = done(scene, "tap")
    at = [taps.target_W_m[(a + b) // 2, 0] for a, b in dips(taps)]
    assert at == pytest.approx(SPAN_M * np.array([-0.2, 0.0, 0.2]), abs=1e-6)
    stroke = done(scene, "stroke")
    ways = [stroke.target_W_m[b - 1, 0] - stroke.target_W_m[a, 0] for a, b in dips(stroke)]
    assert ways == pytest.approx([SPAN_M, -SPAN_M], rel=0.01)


def test_looser_grip_takes_longer_to_move_in_the_air() -> None:
    light_s, medium_s, firm_s = (calm_time_s(GRIPS[grip]) for grip in ("light", "medium", "firm"))
    assert light_s > medium_s > firm_s > 0.0
    heavier = Grip(GRIPS["light"].k_N_m, 0.3, 3.0 * TOOL_KG)
    assert calm_time_s(heavier) == pytest.approx(2.0 * light_s)
