"""Regions: what of a mesh to paint. Frame: the body's.

A `Volume` cuts through faces: see `hapscene.scene.fine_paint`. Where whole faces are asked for, by `pick`, a face is in
a region when its centroid is.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import connected, edges_of, weld

__all__ = ["Box", "Facet", "PlaneSide", "Region", "Sphere", "Tube", "Volume"]


class Region(ABC):
    """Picks faces of a mesh."""

    @abstractmethod
    def pick(self, mesh: Mesh) -> NDArray[np.bool_]:
        """Faces of the mesh in this region (M,) bool."""


class Volume(Region):
    """A region of space, which knows how far from its border a point is.

    Attributes:
        is_convex: True where a triangle lies within as soon as its corners do, and as deep as they.
    """

    is_convex: ClassVar[bool] = True

    @abstractmethod
    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance (n,) [m] of points (n, 3) from the border, negative within; never more than it is."""

    def pick(self, mesh: Mesh) -> NDArray[np.bool_]:
        """Faces of the mesh in this region (M,) bool."""
        return self.distance_m(np.asarray(mesh.triangles_m.mean(axis=1))) <= 0


def _point(value: ArrayLike, what: str) -> NDArray[np.float64]:
    try:
        point = np.array(value, np.float64)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise SceneError(f"{what} must be three finite numbers, is {value!r}")
    return point


@dataclass(frozen=True)
class Box(Volume):
    """Between two corners, along the axes of B [m].

    Raises:
        SceneError: a corner is not three finite numbers, or `low_m` is above `high_m`.
    """

    low_m: ArrayLike
    high_m: ArrayLike

    def __post_init__(self) -> None:
        if (_point(self.low_m, "low_m") > _point(self.high_m, "high_m")).any():
            raise SceneError(f"a box's low_m must not be above its high_m: {self.low_m!r} and {self.high_m!r}")

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance (n,) [m] of points (n, 3) from the sides, negative within."""
        past = np.maximum(np.asarray(self.low_m) - points_m, points_m - np.asarray(self.high_m))
        return np.asarray(np.linalg.norm(np.maximum(past, 0), axis=1) + np.minimum(past.max(axis=1), 0))


@dataclass(frozen=True)
class Sphere(Volume):
    """Within a distance of a point [m].

    Raises:
        SceneError: the centre is not three finite numbers, or the radius not positive.
    """

    centre_m: ArrayLike
    radius_m: float

    def __post_init__(self) -> None:
        _point(self.centre_m, "centre_m")
        if not (math.isfinite(self.radius_m) and self.radius_m > 0):
            raise SceneError(f"a sphere's radius_m must be positive, is {self.radius_m}")

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance (n,) [m] of points (n, 3) from the surface, negative within."""
        return np.asarray(np.linalg.norm(points_m - np.asarray(self.centre_m), axis=1) - self.radius_m)


@dataclass(frozen=True)
class PlaneSide(Volume):
    """On the side of a plane that its normal points to, through a point [m]. The normal may have any length.

    Raises:
        SceneError: point or normal is not three finite numbers, or the normal is zero.
    """

    point_m: ArrayLike
    normal: ArrayLike

    def __post_init__(self) -> None:
        _point(self.point_m, "point_m")
        if not _point(self.normal, "normal").any():
            raise SceneError("a plane's normal must not be zero")

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance (n,) [m] of points (n, 3) from the plane, negative on the side the normal points to."""
        normal = np.asarray(self.normal, float)
        return np.asarray((np.asarray(self.point_m) - points_m) @ (normal / np.linalg.norm(normal)))


@dataclass(frozen=True)
class Tube(Volume):
    """Within a distance of a line through points, as a brush leaves it [m].

    Raises:
        SceneError: the points are not one or more of three finite numbers, or the radius is not positive.
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
            raise SceneError(f"a tube's points_m must be (n, 3) finite numbers, are {self.points_m!r}"[:200])
        if not (math.isfinite(self.radius_m) and self.radius_m > 0):
            raise SceneError(f"a tube's radius_m must be positive, is {self.radius_m}")

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance (n,) [m] of points (n, 3) from the surface, negative within."""
        line = np.asarray(self.points_m, np.float64)
        away = np.full(len(points_m), np.inf)
        for a, b in zip(line[: max(1, len(line) - 1)], line[-max(1, len(line) - 1) :], strict=True):
            ab = b - a
            t = np.clip((points_m - a) @ ab / (ab @ ab or 1.0), 0, 1)
            np.minimum(away, np.linalg.norm(points_m - a - t[:, None] * ab, axis=1), out=away)
        return away - self.radius_m


@dataclass(frozen=True)
class Facet(Region):
    """All faces connected with one face over edges that bend by at most an angle.

    So a flat side of a CAD part is one facet at 1°, and the barrel of a cylinder of 36 sides at 11°. Faces
    that meet only at a corner, and edges with more than two faces, do not connect.

    Attributes:
        face: index of the face to start from.
        angle_rad: largest angle between the normals of two neighbours [rad].

    Raises:
        SceneError: the angle is not between 0 and π.
    """

    face: int
    angle_rad: float = math.radians(10.0)

    def __post_init__(self) -> None:
        if not 0 <= self.angle_rad <= math.pi:
            raise SceneError(f"a facet's angle_rad must be between 0 and π, is {self.angle_rad}")

    def pick(self, mesh: Mesh) -> NDArray[np.bool_]:
        """Faces of the mesh in this region (M,) bool.

        Raises:
            SceneError: the mesh has no such face.
        """
        if not 0 <= self.face < len(mesh.faces):
            raise SceneError(
                f"no face {self.face} to start a facet from; the mesh's faces are 0 to {len(mesh.faces) - 1}"
            )
        pairs, alike = edges_of(mesh.faces, weld(mesh.vertices_m)).pairs()
        normal = mesh.normals
        # The angle between unit vectors by the chord: arccos of a product near 1 loses half its digits. A
        # neighbour that is wound the other way has its normal turned.
        chord = np.linalg.norm(normal[pairs[:, 0]] - np.where(alike, 1.0, -1.0)[:, None] * normal[pairs[:, 1]], axis=1)
        bend_rad = 2 * np.arcsin(np.minimum(chord / 2, 1.0))
        label = connected(pairs[bend_rad <= self.angle_rad + 1e-9], len(mesh.faces))
        return np.asarray(label == label[self.face])
