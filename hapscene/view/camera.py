"""Placement of an orthographic camera that shows the whole scene and can move around it."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["MARGIN", "facing", "fit_cameras", "orbit", "pose_of", "visible_size"]

VIEW_FROM: Final = (0.35, -1.0, 0.75)
"""Direction from the scene to the camera: in front, above, slightly to the right."""

MARGIN: Final = 1.08
"""Ratio of the width of the picture to that of the scene [1]."""

Extent = tuple[float, float, float]


def orbit(turns_rad: Sequence[float]) -> list[NDArray[np.float64]]:
    """Return the rotations R_SC (3, 3) of a camera that is turned about z by each of these angles."""
    (x, y, z), c, s = VIEW_FROM, np.cos(turns_rad), np.sin(turns_rad)
    return [facing(back, (0.0, 0.0, 1.0)) for back in np.stack([c * x - s * y, s * x + c * y, z + 0.0 * c], axis=1)]


def visible_size(points_m: NDArray[np.float64], R_SC: Sequence[NDArray[np.float64]]) -> tuple[float, float]:
    """Return width and height of the points (k, 3) [m], seen by all these cameras."""
    low_m, high_m = _seen(points_m, R_SC)
    width_m, height_m, _ = np.maximum(high_m - low_m, 1e-9)
    return float(width_m), float(height_m)


def fit_cameras(
    points_m: NDArray[np.float64], R_SC: Sequence[NDArray[np.float64]], size: tuple[int, int]
) -> tuple[list[NDArray[np.float64]], Extent, float]:
    """Place cameras so that the points (k, 3) fill a picture of `size` pixels.

    Returns:
        The pose X_SC of each camera; half width, half height and depth of the view [m]; the size of a pixel [m].
    """
    low_m, high_m = _seen(points_m, R_SC)
    span_m = np.maximum(high_m - low_m, 1e-9)
    pixel_m = MARGIN * float(max(span_m[0] / size[0], span_m[1] / size[1]))
    far_m = 2.0 * float(span_m.max())
    middle_m = (low_m + high_m) / 2
    poses = [pose_of(R, R @ (middle_m + np.array([0.0, 0.0, far_m / 2]))) for R in R_SC]
    return poses, (pixel_m * size[0] / 2, pixel_m * size[1] / 2, far_m), pixel_m


def _seen(
    points_m: NDArray[np.float64], R_SC: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest coordinates (3,) of the points in the frames of all cameras."""
    seen_m = [R.T @ points_m.T for R in R_SC]  # one row per axis: minima along rows are ten times as fast
    return np.min([s.min(axis=1) for s in seen_m], axis=0), np.max([s.max(axis=1) for s in seen_m], axis=0)


def facing(direction: NDArray[np.float64], up: tuple[float, float, float] | None = None) -> NDArray[np.float64]:
    """Return a rotation (3, 3) whose z axis is `direction` (3,) and whose y axis is close to `up`, if given."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))] if up is None else np.array(up), z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))


def pose_of(R: NDArray[np.float64], p_m: ArrayLike = 0.0) -> NDArray[np.float64]:
    """Return the pose (4, 4) of a rotation (3, 3), which may also scale, and a position (3,) [m]."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p_m
    return X
