"""Vectors and rotations against NumPy and SciPy; what is no path and no pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hapscene.constants import REACH_MAX_M
from hapscene.errors import PathError, SceneError
from hapscene.geometry import (
    along,
    columns_of,
    cross,
    dot,
    norm,
    numbers,
    positions,
    rigid,
    rotation_of,
    row,
    sub,
    used_by,
)

TURN = np.eye(4)
TURN[:3, :3] = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
TURN[:3, 3] = 0.1, -0.2, REACH_MAX_M


def test_vectors_are_those_of_numpy() -> None:
    values = np.random.default_rng(0).standard_normal((5, 3))
    a, b = (row(values, i) for i in (1, 3))
    assert a == tuple(values[1])
    for got, wanted in (
        (dot(a, b), values[1] @ values[3]),
        (sub(a, b), values[1] - values[3]),
        (along(a, 0.7, b), values[1] + 0.7 * values[3]),
        (cross(a, b), np.cross(values[1], values[3])),
        (norm(a), np.linalg.norm(values[1])),
    ):
        assert got == pytest.approx(wanted, rel=1e-12)


def test_rotation_of_any_quaternion() -> None:
    for q in np.random.default_rng(1).standard_normal((5, 4)):
        assert rotation_of(q) == pytest.approx(Rotation.from_quat(q).as_matrix(), abs=1e-12)
    assert rotation_of(np.zeros(4)).tolist() == np.eye(3).tolist()


def test_vertices_that_faces_use() -> None:
    used, vertices = used_by(np.array([[0, 3, 1]])), np.arange(15.0).reshape(5, 3)
    assert used.tolist() == [True, True, False, True] and used_by(np.zeros((0, 3), int)).tolist() == []
    assert columns_of(vertices, used).T.tolist() == vertices[[0, 1, 3]].tolist()
    assert np.shares_memory(columns_of(vertices, used_by(np.array([0, 1]))), vertices)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (np.zeros(3), r"\(3,\)"),
        (np.zeros((2, 2)), r"\(2, 2\)"),
        (np.zeros((0, 3)), r"\(0, 3\)"),
        ([[0, 0, 0], [0, np.nan, 0], [np.inf, 0, 0]], "2 positions .* row 1"),
        ([[0, 0, 0], [0, 0, -1.001 * REACH_MAX_M]], "z = .* in row 1"),
        ([[0, "x", 0]], "list"),
    ],
)
def test_what_is_no_path_is_refused(path: object, words: str) -> None:
    with pytest.raises(PathError, match=words):
        positions(numbers(path))
    assert positions(numbers([[0, 0, REACH_MAX_M]])).tolist() == [[0, 0, REACH_MAX_M]]


@pytest.mark.parametrize(
    ("at", "value", "words"),
    [
        ((1, 2), np.nan, "not finite"),
        ((3, 0), 2e-6, "last row"),
        ((0, 1), 1e-3, "scales or shears"),
        ((slice(3), 0), -TURN[:3, 0], "mirrors"),
        ((0, 3), -1.01 * REACH_MAX_M, "is at "),
        (..., 2.0 * TURN, "last row"),
    ],
)
def test_what_is_no_pose_is_refused(at: object, value: object, words: str) -> None:
    wrong = TURN.copy()
    wrong[at] = value
    with pytest.raises(SceneError, match=f"tool: the pose .*{words}"):
        rigid(wrong, "tool")
    with pytest.raises(SceneError, match=f"tool: the pose of tick 1 .*{words}"):
        rigid([TURN, wrong, wrong], "tool", 3)


def test_a_pose_is_copied_and_rounded() -> None:
    near = TURN + np.diag([1e-7, 0.0, 0.0, 5e-7])
    for given, count in ((near, None), (near[None], 1)):
        X = rigid(given, "tool", count)
        assert X[..., :3, :] == pytest.approx(given[..., :3, :], abs=0.0) and X[..., 3, :].ravel().tolist() == [
            0,
            0,
            0,
            1,
        ]
    sheared = TURN + 1e-3 * np.eye(4)[[1, 0, 2, 3]] * (np.arange(4) < 1)
    assert rigid(sheared, "tool", tolerance=0.01).tolist() == sheared.tolist()
    for given, count in ((np.eye(3), None), (TURN, 1), ("x", None)):
        with pytest.raises(SceneError, match=r"tool: a pose is a matrix \(4, 4\)"):
            rigid(given, "tool", count)
