"""Compiled vector functions on tuples of three floats; validation of numbers, positions and rigid poses."""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.constants import REACH_MAX_M
from hapscene.errors import PathError, SceneError

__all__ = [
    "RIGID_TOLERANCE",
    "Vector",
    "along",
    "columns_of",
    "cross",
    "dot",
    "norm",
    "numbers",
    "positions",
    "rigid",
    "rotation_of",
    "row",
    "sub",
    "used_by",
]

Vector = tuple[float, float, float]


@native
def row(values: NDArray[np.float64], i: int) -> Vector:
    """Row i of an array (n, 3)."""
    return values[i, 0], values[i, 1], values[i, 2]


@native
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@native
def sub(a: Vector, b: Vector) -> Vector:
    """a − b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@native
def along(a: Vector, s: float, b: Vector) -> Vector:
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@native
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@native
def norm(a: Vector) -> float:
    """Length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def used_by(faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mask of the vertices that faces use, up to the largest index."""
    used = np.zeros(faces.max(initial=-1) + 1, np.bool_)
    used[faces] = True
    return used


def columns_of(vertices_m: NDArray[np.float64], used: NDArray[np.bool_]) -> NDArray[np.float64]:
    """x, y and z (3, n) of the used vertices, no copy if all are used. Columns are ten times faster than rows."""
    vertices_m = vertices_m[: len(used)]
    return (vertices_m if used.all() else vertices_m[used]).T


def rotation_of(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrix (3, 3) of a quaternion x, y, z, w of any length; the identity for length 0."""
    norm = math.sqrt(float(q @ q)) or 1.0
    x, y, z, w = (q / norm).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


# --- validation ---


RIGID_TOLERANCE: Final = 1e-6
"""Tolerance for rigid poses [1]: the rounding of a float32 matrix, below what can be felt."""

_LAST_ROW: Final = (0.0, 0.0, 0.0, 1.0)


def numbers(values: ArrayLike) -> NDArray[np.float64]:
    """Convert to a float64 array; raises PathError if that is not possible."""
    try:
        return np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise PathError(f"expected an array of numbers, found {type(values).__name__}") from None


def positions(p_WT: NDArray[np.float64]) -> NDArray[np.float64]:
    """Validate a path (n, 3)."""
    if p_WT.ndim != 2 or p_WT.shape[1] != 3 or len(p_WT) == 0:
        raise PathError(f"a path must be (n, 3) positions in metres, n ≥ 1; it is {p_WT.shape}")
    bad = ~np.isfinite(p_WT).all(axis=1)
    if bad.any():
        raise PathError(f"the path has {bad.sum()} positions that are not finite, the first at row {bad.argmax()}")
    far = np.abs(p_WT) > REACH_MAX_M
    if far.any():
        row, axis = np.argwhere(far)[0]
        raise PathError(
            f"the path is at {'xyz'[axis]} = {p_WT[row, axis]:g} m in row {row}; expected at most {REACH_MAX_M:g} m "
            "(is it in mm?)"
        )
    return p_WT


def rigid(
    poses: ArrayLike, what: str, count: int | None = None, *, tolerance: float = RIGID_TOLERANCE
) -> NDArray[np.float64]:
    """Validate and copy a rigid pose (4, 4), or `count` poses (count, 4, 4).

    Args:
        poses: homogeneous matrices [1, m].
        what: name of the object, for messages.
        count: number of poses, one for each tick; None for a single pose.
        tolerance: largest deviation from a rotation [1].

    Raises:
        SceneError: the shape is wrong, or a matrix is not finite, scales, shears, mirrors, or translates by more than
            `REACH_MAX_M`.
    """
    shape = (4, 4) if count is None else (count, 4, 4)
    try:
        X = np.array(poses, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"{what}: a pose is a matrix (4, 4) of numbers") from None
    if X.shape != shape:
        each = "" if count is None else ", one for each tick"
        raise SceneError(f"{what}: a pose is a matrix (4, 4){each}: expected {shape}, not {X.shape}")
    flat = X.reshape(-1, 4, 4)
    R, p = flat[:, :3, :3], flat[:, :3, 3]
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        row = np.abs(flat[:, 3] - _LAST_ROW).max(axis=1)
        mirrored, reach = np.linalg.det(R) < 0.0, np.abs(p).max(axis=1)
        good = (off <= tolerance) & (row <= RIGID_TOLERANCE) & ~mirrored & (reach <= REACH_MAX_M)
    if not good.all():  # `good` is also false for values that are not finite
        k = int(good.argmin())
        pose = f"{what}: the pose" + ("" if count is None else f" of tick {k}")
        if not np.isfinite(flat[k]).all():
            fault = "has a number that is not finite"
        elif row[k] > RIGID_TOLERANCE:
            fault = "has another last row than 0 0 0 1 (is it transposed?)"
        elif off[k] > tolerance:
            fault = "scales or shears; give a rotation, and scale the mesh by its unit"
        elif mirrored[k]:
            fault = "mirrors (determinant -1); give a rotation"
        else:
            place = ", ".join(f"{v:g}" for v in p[k])
            raise SceneError(f"{pose} is at ({place}) m; expected at most {REACH_MAX_M:g} m (is it in mm?)")
        raise SceneError(f"{pose} is not a rotation and a translation: it {fault}")
    flat[:, 3] = _LAST_ROW
    return X
