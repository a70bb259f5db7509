"""Which faces a fill reaches, in W: boxes and spheres. By body, facet and group they are picked by the mesh itself."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.paint.shape import Shape
from hapscene.scene.body import Body, rigid

Mask = NDArray[np.bool_]


class WorldBox:
    """A box at any pose in W.

    Args:
        X_WK: (4, 4) pose of the box: its middle, and its axes.
        size_m: (3,) its edges [m].

    Raises:
        SceneError: the pose is not rigid, or an edge not positive.
    """

    def __init__(self, X_WK: ArrayLike, size_m: ArrayLike) -> None:
        self._X_WK = rigid(X_WK, "box")
        self._size_m = np.asarray(size_m, np.float64)
        if self._size_m.shape != (3,) or not (np.isfinite(self._size_m).all() and (self._size_m > 0.0).all()):
            raise SceneError(f"a box has three edges above 0 mm, not {size_m!r}")

    def pick(self, body: Body, shape: Shape) -> Mask:
        """Faces (M,) whose centroid is inside."""
        p_K = (_centroids_W(body, shape) - self._X_WK[:3, 3]) @ self._X_WK[:3, :3]
        return np.asarray((np.abs(p_K) <= self._size_m / 2).all(axis=1))


class WorldSphere:
    """A ball in W.

    Args:
        centre_W_m: (3,) its middle [m].
        radius_m: its radius [m].

    Raises:
        SceneError: the centre is not three finite numbers, or the radius not positive.
    """

    def __init__(self, centre_W_m: ArrayLike, radius_m: float) -> None:
        self._centre_W_m, self._radius_m = np.asarray(centre_W_m, np.float64), float(radius_m)
        if self._centre_W_m.shape != (3,) or not np.isfinite(self._centre_W_m).all():
            raise SceneError(f"a sphere's centre must be three finite numbers, is {centre_W_m!r}")
        if not (math.isfinite(radius_m) and radius_m > 0.0):
            raise SceneError(f"a sphere's radius must be above 0 mm, is {radius_m * 1e3:g} mm")

    def pick(self, body: Body, shape: Shape) -> Mask:
        """Faces (M,) whose centroid is inside."""
        off = _centroids_W(body, shape) - self._centre_W_m
        return np.asarray(np.einsum("ij,ij->i", off, off) <= self._radius_m**2)


def _centroids_W(body: Body, shape: Shape) -> NDArray[np.float64]:
    return np.asarray(np.einsum("ij,kj->ik", shape.centroid_m, body.X_WB[:3, :3]) + body.X_WB[:3, 3])
