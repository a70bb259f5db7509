"""Regions of space select the part of a mesh to paint; faces that a border cuts are subdivided, see `fine_paint`.

All coordinates are in the frame of the body.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError

__all__ = ["Box", "Region", "Sphere", "Tube"]


class Region(ABC):
    """Base class of regions: a signed distance function.

    Attributes:
        is_convex: whether the region is convex; then a triangle is inside if its corners are.
    """

    is_convex: ClassVar[bool] = True

    @abstractmethod
    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signed distance (n,) of points (n, 3) from the border [m].

        It is negative inside. Its magnitude must not exceed the true distance.
        """


def _point(value: ArrayLike, what: str) -> NDArray[np.float64]:
    try:
        point = np.array(value, np.float64)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise SceneError(f"{what} must be three finite numbers, not {value!r}")
    return point


@dataclass(frozen=True)
class Box(Region):
    """A box that is aligned with the axes of the body frame, given by two corners [m].

    Raises:
        SceneError: a corner is not three finite numbers, or `low_m` is above `high_m`.
    """

    low_m: ArrayLike
    high_m: ArrayLike

    def __post_init__(self) -> None:
        if (_point(self.low_m, "low_m") > _point(self.high_m, "high_m")).any():
            raise SceneError(f"box: low_m must not exceed high_m, got {self.low_m!r} and {self.high_m!r}")

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signed distance (n,) of points (n, 3) from the sides [m], negative inside."""
        past = np.maximum(np.asarray(self.low_m) - points_m, points_m - np.asarray(self.high_m))
        return np.asarray(np.linalg.norm(np.maximum(past, 0), axis=1) + np.minimum(past.max(axis=1), 0))


@dataclass(frozen=True)
class Sphere(Region):
    """A sphere, given by centre and radius [m].

    Raises:
        SceneError: the centre is not three finite numbers, or the radius is not positive.
    """

    centre_m: ArrayLike
    radius_m: float

    def __post_init__(self) -> None:
        _point(self.centre_m, "centre_m")
        if not (math.isfinite(self.radius_m) and self.radius_m > 0):
            raise SceneError(f"sphere: radius_m must be a positive number, not {self.radius_m}")

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signed distance (n,) of points (n, 3) from the surface [m], negative inside."""
        return np.asarray(np.linalg.norm(points_m - np.asarray(self.centre_m), axis=1) - self.radius_m)


@dataclass(frozen=True)
class Tube(Region):
    """A tube around a polyline, as a brush stroke covers it: points (n, 3) and radius [m].

    Raises:
        SceneError: `points_m` is empty or not (n, 3) finite numbers, or the radius is not positive.
    """

    points_m: ArrayLike
    radius_m: float
    is_convex: ClassVar[bool] = False

    def __post_init__(self) -> None:
        try:
            points = np.array(self.points_m, np.float64)
        except (TypeError, ValueError):
            points = np.zeros(0)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
            raise SceneError(f"tube: points_m must be one or more points (n, 3), finite, not {self.points_m!r}"[:200])
        if not (math.isfinite(self.radius_m) and self.radius_m > 0):
            raise SceneError(f"tube: radius_m must be a positive number, not {self.radius_m}")

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signed distance (n,) of points (n, 3) from the surface [m], negative inside."""
        line = np.asarray(self.points_m, np.float64)
        away = np.full(len(points_m), np.inf)
        for a, b in zip(line[: max(1, len(line) - 1)], line[-max(1, len(line) - 1) :], strict=True):
            ab = b - a
            t = np.clip((points_m - a) @ ab / (ab @ ab or 1.0), 0, 1)
            np.minimum(away, np.linalg.norm(points_m - a - t[:, None] * ab, axis=1), out=away)
        return away - self.radius_m
