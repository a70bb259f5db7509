"""A scene seen from above: heights, sides and borders that are known."""

import numpy as np
import pytest
import trimesh

from hapscene.motion.look_from_above import (
    GRID,
    WINDOW_M,
    TopView,
    lines_of,
    look_from_above,
    places_to_feel,
    window_of,
)
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene


def posed(x_m: float = 0.0, z_m: float = 0.0, turn: float = 0.0) -> np.ndarray:
    """A pose at x and z, turned about y."""
    X_WB = trimesh.transformations.rotation_matrix(turn, (0.0, 1.0, 0.0))
    X_WB[0, 3], X_WB[2, 3] = x_m, z_m
    return X_WB


def box(*size_m: float) -> Mesh:
    return Mesh.from_trimesh(trimesh.creation.box(size_m), "m")


def sheet(up: bool) -> Mesh:
    corners = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]) * 0.05
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    return Mesh(corners, faces if up else faces[:, ::-1].copy())


def look(scene: Scene, *places: tuple[float, float]) -> TopView:
    return look_from_above(scene)(*np.transpose(places))


def test_highest_body_is_visible_in_any_list_order() -> None:
    for order in (1, -1):
        bodies = [("low", posed()), ("high", posed(0.03, 0.04)), ("far up", posed(-0.03, 3.0))]
        scene = Scene()
        for name, pose in bodies[::order]:
            scene.add(box(0.1 if name == "low" else 0.02, 0.02, 0.02), name=name, pose=pose)
        seen = look(scene, (0.0, 0.0), (0.03, 0.0), (-0.03, 0.0), (0.2, 0.0))
        assert seen.z_m == pytest.approx([0.01, 0.05, 3.01, np.nan], abs=1e-6, nan_ok=True)
        assert [scene.bodies[i].name if i >= 0 else "" for i in seen.body] == ["low", "high", "far up", ""]
        assert seen.swatch[3] == -1


def test_rotated_body_is_visible_at_its_pose() -> None:
    """A box on its edge: its top lies half a diagonal up, its sides fall at 45°."""
    scene = Scene()
    scene.add(box(0.02, 0.1, 0.02), name="roof", pose=posed(0.01, 0.005, np.pi / 4))
    seen = look(scene, (0.01, 0.0), (0.013, 0.02), (0.006, 0.0))
    assert seen.z_m - 0.005 - 0.01 * np.sqrt(2.0) == pytest.approx([0.0, -0.003, -0.004], abs=1e-5)
    corner_m = 0.01 * np.sqrt(2.0) * np.array([(-1.0, 0.0, -1.0), (1.0, 0.0, 1.0)]) + [
        (0.0, -0.05, 0.0),
        (0.0, 0.05, 0.0),
    ]
    np.testing.assert_allclose(scene.bodies[0].bounds_W_m, np.add(corner_m, (0.01, 0.0, 0.005)))


def test_body_is_visible_up_to_its_borders_and_its_size_is_the_smaller() -> None:
    scene = Scene()
    scene.add(box(0.12, 0.04, 0.02), name="plate", pose=posed(0.01))
    for x_m, y_m in ((0.0699, 0.0), (-0.0499, 0.0), (0.01, 0.0199), (0.01, -0.0199)):
        assert look(scene, (x_m, y_m)).body.tolist() == [0]
    ((lines, size_m),) = places_to_feel(scene, look_from_above(scene))
    assert len(lines) == 2 and size_m == pytest.approx(0.96 * 0.04)


@pytest.mark.parametrize(("up", "two_sided", "seen"), [(True, False, 0), (False, False, -1), (False, True, 0)])
def test_back_faces_are_visible_only_if_two_sided(up: bool, two_sided: bool, seen: int) -> None:
    scene = Scene()
    scene.add(sheet(up), name="sheet", two_sided=two_sided)
    assert look(scene, (0.01, 0.02)).body.tolist() == [seen]
    assert len(list(places_to_feel(scene, look_from_above(scene)))) == 1 + seen


def test_window_excludes_unreachable_points_and_the_border() -> None:
    bounds_m = np.array([(-1.0, 0.0, 0.0), (3.0, 0.1, 0.5)])
    np.testing.assert_allclose(window_of(bounds_m), [(1.0 - WINDOW_M / 2, 0.002), (1.0 + WINDOW_M / 2, 0.098)])


def view_of(swatch: np.ndarray, seen: np.ndarray):
    """A look at a grid over 0 … 24 in x and y, as its two masks say."""

    def look(x_m: np.ndarray, y_m: np.ndarray) -> TopView:
        at = np.rint(y_m).astype(int), np.rint(x_m).astype(int)
        return TopView(np.zeros(len(x_m)), np.where(seen[at], 0, -1), np.where(seen[at], swatch[at], -1))

    return look


WINDOW = np.array([(0.0, 0.0), (GRID - 1.0, GRID - 1.0)])
ALL = np.ones((GRID, GRID), bool)
PLAIN = np.zeros((GRID, GRID), np.int64)


def test_lines_go_through_the_middle_and_keep_off_the_edge() -> None:
    assert lines_of(view_of(PLAIN, ALL), 0, WINDOW) == [((1.0, 12.0), (23.0, 12.0)), ((12.0, 1.0), (12.0, 23.0))]
    assert lines_of(view_of(PLAIN, ALL), 1, WINDOW) == [] == lines_of(view_of(PLAIN, ~ALL), 0, WINDOW)


def test_lines_are_ranked_by_borders_then_length_then_distance_from_the_centre() -> None:
    swatch, seen = PLAIN.copy(), ALL.copy()
    swatch[3, 10:] = 1  # one border along x in row 3; two along y in each column from 10 on
    assert lines_of(view_of(swatch, seen), 0, WINDOW) == [((1.0, 3.0), (23.0, 3.0)), ((12.0, 1.0), (12.0, 23.0))]
    swatch[3], seen[10:15, 0:12] = 0, False
    assert lines_of(view_of(swatch, seen), 0, WINDOW)[0] == ((1.0, 9.0), (23.0, 9.0))


@pytest.mark.parametrize(("width", "line"), [(2, None), (3, (5.0, 7.0)), (6, (5.0, 10.0)), (7, (6.0, 10.0))])
def test_narrow_region_has_no_line_or_a_complete_line(width: int, line: tuple[float, float] | None) -> None:
    seen = ~ALL
    seen[:, 5 : 5 + width] = True
    lines = lines_of(view_of(PLAIN, seen), 0, WINDOW)
    along_x = [(start[0], end[0]) for start, end in lines if start[1] == end[1]]
    assert along_x == ([] if line is None else [line]) and len(lines) == 1 + len(along_x)
