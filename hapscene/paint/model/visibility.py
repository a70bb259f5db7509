"""Visibility of a body from the eye. By default the tools paint only visible surface."""

from collections.abc import Container, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.contact.embree import first_face, fronts_only, new_ray
from hapscene.paint.model.mesh import PaintableMesh, Ray32, Row
from hapscene.scene.body import Body

__all__ = ["Visibility", "visible_points"]

NEAR_SHARE: Final = 3e-4
"""Smallest distance between a point and a surface that hides it, in radii of the hiding body [1]: above the rounding of
a ray, so that a point is not hidden by its own face."""

WIDE: Final = 1 / 32
"""Largest subface that is tested, in distances from the eye [1]; a larger one is subdivided first."""

PIXEL: Final = 1 / 1000
"""Size of a face that is tested at its centroid only, in distances from the eye [1]: a pixel of a window."""

LATTICE_COUNT: Final = 6
"""Number of steps along a side at which a large subface is tested [count]. An occluder smaller than 1/200 of its
distance from the eye, 6 pixels of a window, may be missed."""

MANY_SHARE: Final = 2 / LATTICE_COUNT
"""Size from which a subface is tested on the lattice, relative to the largest [1]; smaller ones are tested at the
centroid and near the corners."""

MANY: Final = 8000
"""Largest number of subfaces that are tested on the lattice [count]: beyond, the size limits grow in proportion."""

STEPS: Final = range(LATTICE_COUNT + 1)
INSET: Final = 0.1
"""Distance of the test points from the corners towards the centroid [1]: a ray to an edge may hit the adjacent face."""

CORNERS: Final = (1 - INSET) * np.eye(3) + INSET / 3
LATTICE: Final = (
    np.array([(i, j, LATTICE_COUNT - i - j) for i in STEPS for j in STEPS[: LATTICE_COUNT + 1 - i]])
    @ CORNERS
    / LATTICE_COUNT
)


class Visibility:
    """Tests which parts of a body are visible from a point. Back faces of one-sided bodies hide nothing.

    Args:
        bodies, shapes: bodies and prepared meshes of the scene.
        body: index of the body.
        eye_W_m: (3,) position of the eye [m].
        hidden: names of hidden bodies, which hide nothing.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        shapes: Sequence[PaintableMesh],
        body: int,
        eye_W_m: ArrayLike,
        hidden: Container[str] = (),
    ) -> None:
        self._body, self._shape = bodies[body], shapes[body]
        self._eye_W_m = np.asarray(eye_W_m, np.float64)
        self._X_WB = self._body.X_WB
        self._eye_B_m = (self._eye_W_m - self._X_WB[:3, 3]) @ self._X_WB[:3, :3]
        self._drawn = [(b, shape) for b, shape in zip(bodies, shapes, strict=True) if b.name not in hidden]

    def facing(self, faces: NDArray[np.integer]) -> NDArray[np.integer]:
        """The subset of faces (n,) whose outer side is turned to the eye; all faces of a two-sided body."""
        if self._body.two_sided:
            return faces
        towards_m = self._eye_B_m - self._shape.centroid_m[faces]
        return np.asarray(faces[np.einsum("ij,ij->i", towards_m, self._shape.normal[faces]) > 0.0])

    def __call__(
        self, where_m: NDArray[np.float64], level: NDArray[np.uint8]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Test subfaces (n, 3, 3) [m] of subdivision levels (n,).

        Returns:
            Whether the centroid of each is visible, and whether another part of it has the opposite visibility.
        """
        middle_m = where_m.mean(axis=1)
        side_m = np.linalg.norm(where_m - np.roll(where_m, 1, axis=1), axis=2).max(axis=1)
        away_m = np.linalg.norm(middle_m - self._eye_B_m, axis=1)
        wide_m = WIDE * away_m
        wide_m *= max(1.0, np.count_nonzero(side_m > MANY_SHARE * wide_m) / MANY)
        seen, partly = self._see(middle_m), side_m > wide_m
        many, one = side_m > MANY_SHARE * wide_m, (level == 0) & (side_m < PIXEL * away_m)
        for chosen, places in ((many & ~partly, LATTICE), (~many & ~one, CORNERS)):
            found = self._see((places @ where_m[chosen]).reshape(-1, 3)).reshape(-1, len(places))
            partly[chosen] = (found != seen[chosen, None]).any(axis=1)
        return seen, partly

    def _see(self, p_B_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        bodies, shapes = zip(*self._drawn, strict=True) if self._drawn else ((), ())
        return visible_points(bodies, shapes, p_B_m @ self._X_WB[:3, :3].T + self._X_WB[:3, 3], self._eye_W_m)


def visible_points(
    bodies: Sequence[Body], shapes: Sequence[PaintableMesh], p_W_m: NDArray[np.float64], eye_W_m: ArrayLike
) -> NDArray[np.bool_]:
    """Whether each point (n, 3) on the surface is visible from an eye (3,), both in W [m]."""
    seen = np.ones(len(p_W_m), np.bool_)
    ray, fronts = new_ray(), fronts_only()
    for body, shape in zip(bodies, shapes, strict=True):
        R, p, search = body.X_WB[:3, :3], body.X_WB[:3, 3], shape.search
        points_m = np.ascontiguousarray((p_W_m - p) @ R - search.center_m)
        eye_m = np.ascontiguousarray((np.asarray(eye_W_m, np.float64) - p) @ R - search.center_m)
        mark_hidden_points(
            search.handle, ray, points_m, eye_m, search.radius_m, 0 if body.two_sided else fronts.ctypes.data, seen
        )
    return seen


@native
def mark_hidden_points(
    search: int, ray: Ray32, points_m: Row, eye_m: Row, radius_m: float, arguments: int, seen: NDArray[np.bool_]
) -> None:
    """Clear `seen` (n,) for points (n, 3) hidden from `eye_m` (3,), both in the centred frame of the search [m]."""
    ex, ey, ez = eye_m[0], eye_m[1], eye_m[2]
    # rays start near the mesh, where float32 has more digits
    ahead = max(0.0, np.sqrt(ex * ex + ey * ey + ez * ez) - 1.01 * radius_m)
    for i in range(len(points_m)):
        x, y, z = points_m[i, 0] - ex, points_m[i, 1] - ey, points_m[i, 2] - ez
        away = np.sqrt(x * x + y * y + z * z)
        far = away - ahead - NEAR_SHARE * radius_m
        if not seen[i] or far <= 0.0:
            continue
        x, y, z = x / away, y / away, z / away
        start = (ex + ahead * x, ey + ahead * y, ez + ahead * z)
        seen[i] = first_face(search, ray, start, (x, y, z), far, arguments) < 0
