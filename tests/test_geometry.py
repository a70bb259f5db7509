"""Vectors and rotations against NumPy and SciPy; what is no path and no pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hapscene.constants import REACH_MAX_M
from hapscene.errors import PathError, SceneError
from hapscene.geometry import along, cross, numbers, positions, rigid, rotation_of, row, used_by

TURN = np.eye(4)
TURN[:3, :3] = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
TURN[:3, 3] = 0.1, -0.2, REACH_MAX_M


def test_vectors_and_rotations_are_those_of_numpy_and_scipy() -> None:
    values = np.random.default_rng(0).standard_normal((5, 4))
    a, b = row(values, 1), row(values, 3)
    assert cross(a, b) == pytest.approx(np.cross(values[1, :3], values[3, :3]), rel=1e-12)
    assert along(a, 0.7, b) == pytest.approx(values[1, :3] + 0.7 * values[3, :3], rel=1e-12)
    for q in values:
        assert rotation_of(q) == pytest.approx(Rotation.from_quat(q).as_matrix(), abs=1e-12)
    assert rotation_of(np.zeros(4)).tolist() == np.eye(3).tolist()
    assert used_by(np.array([[0, 3, 1]])).tolist() == [True, True, False, True]


def test_what_is_no_path_is_refused() -> None:
    wrong = {
        "2 positions .* row 1": [[0, 0, 0], [0, np.nan, 0], [np.inf, 0, 0]],
        r"\(1, 2\)": [[0.0, 0.0]],
        "list": ["x"],
    }
    for words, path in (wrong | {"z = .* in row 1": [[0, 0, 0], [0, 0, -1.001 * REACH_MAX_M]]}).items():
        with pytest.raises(PathError, match=words):
            positions(numbers(path))


def test_what_is_no_pose_is_refused_and_a_pose_is_rounded() -> None:
    wrong = {"not finite": ((1, 2), np.nan), "last row": ((3, 0), 2e-6), "scales or shears": ((0, 1), 1e-3)}
    wrong |= {"mirrors": ((slice(3), 0), -TURN[:3, 0]), "is at ": ((0, 3), -1.01 * REACH_MAX_M)}
    for words, (at, value) in wrong.items():
        poses = np.array([TURN, TURN, TURN])
        poses[(slice(1, 3), *at)] = value
        with pytest.raises(SceneError, match=f"tool: the pose of tick 1 .*{words}"):
            rigid(poses, "tool", 3)
    near = TURN + np.diag([1e-7, 0.0, 0.0, 5e-7])
    assert rigid(near, "tool").tolist() == [*near[:3].tolist(), [0, 0, 0, 1]]
