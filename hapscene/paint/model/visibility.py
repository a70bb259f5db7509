"""Visibility of a scene from the eye: by default the tools paint visible surface only."""

from collections.abc import Container, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.contact.embree import first_face, fronts_only, new_ray
from hapscene.native import native
from hapscene.paint.model.mesh import PaintableMesh
from hapscene.scene.body import Body

__all__ = ["Sight", "seen_places"]

NEAR_SHARE: Final = 3e-4
"""How far before a place a surface must be to hide it, in radii of the body that hides [1]: more than a ray's rounding;
nearer is the place itself, or what is drawn as one with it."""

WIDE: Final = 1 / 32
"""Widest piece that is looked at as it is, in its distance from the eye [1]; a wider one is cut first."""

PIXEL: Final = 1 / 1000
"""Width of a face that is looked at in its middle alone, in its distance from the eye [1]: a pixel of a window."""

LATTICE_COUNT: Final = 6
"""Steps along a side at which a wide piece is looked at [count]: what hides it is missed if it is smaller than a
200th of its distance from the eye, 6 pixels of a window."""

MANY_SHARE: Final = 2 / LATTICE_COUNT
"""From what size on a piece is looked at so, of the widest [1]; a smaller one in its middle and near its corners."""

MANY: Final = 8000
"""Most pieces that are looked at so [count]: the more a mesh has, long slivers say, the wider they may be."""

STEPS: Final = range(LATTICE_COUNT + 1)
INSET: Final = 0.1
"""How far from the corners towards the middle a piece is looked at [1]: on the edge itself the face beyond is seen."""

CORNERS: Final = (1 - INSET) * np.eye(3) + INSET / 3
LATTICE: Final = (
    np.array([(i, j, LATTICE_COUNT - i - j) for i in STEPS for j in STEPS[: LATTICE_COUNT + 1 - i]])
    @ CORNERS
    / LATTICE_COUNT
)


class Sight:
    """What an eye sees of one body: drawn, and hidden by nothing.

    Args:
        bodies, shapes: of the scene.
        body: index of the one that is looked at.
        eye_W_m: (3,) in W [m].
        hidden: names of bodies that are not drawn. They hide nothing, nor do backs of one-sided bodies.
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
        self._there = [(b, shape) for b, shape in zip(bodies, shapes, strict=True) if b.name not in hidden]

    def facing(self, faces: NDArray[np.integer]) -> NDArray[np.integer]:
        """Those of the body's faces (n,) that are drawn, seen from there: a one-sided body's backs are not."""
        if self._body.two_sided:
            return faces
        towards_m = self._eye_B_m - self._shape.centroid_m[faces]
        return np.asarray(faces[np.einsum("ij,ij->i", towards_m, self._shape.normal[faces]) > 0.0])

    def __call__(
        self, where_m: NDArray[np.float64], level: NDArray[np.uint8]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Of pieces of its faces (n, 3, 3) [m], cut so often (n,): whether the middle is seen, and a part not alike."""
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
        bodies, shapes = zip(*self._there, strict=True) if self._there else ((), ())
        return seen_places(bodies, shapes, p_B_m @ self._X_WB[:3, :3].T + self._X_WB[:3, 3], self._eye_W_m)


def seen_places(
    bodies: Sequence[Body], shapes: Sequence[PaintableMesh], p_W_m: NDArray[np.float64], eye_W_m: ArrayLike
) -> NDArray[np.bool_]:
    """Which of places (n, 3) on the surface nothing that is drawn hides from a point (3,) in W [m]."""
    seen = np.ones(len(p_W_m), np.bool_)
    ray, fronts = new_ray(), fronts_only()
    for body, shape in zip(bodies, shapes, strict=True):
        R, p, search = body.X_WB[:3, :3], body.X_WB[:3, 3], shape.search
        points_m = np.ascontiguousarray((p_W_m - p) @ R - search.center_m)
        eye_m = np.ascontiguousarray((np.asarray(eye_W_m, np.float64) - p) @ R - search.center_m)
        hide_places(
            search.handle, ray, points_m, eye_m, search.radius_m, 0 if body.two_sided else fronts.ctypes.data, seen
        )
    return seen


@native
def hide_places(search: int, ray: Any, points_m: Any, eye_m: Any, radius_m: float, arguments: int, seen: Any) -> None:
    """Clear `seen` (n,) of points (n, 3) that a surface lies before, as looked at from `eye_m` (3,), centred [m]."""
    ex, ey, ez = eye_m[0], eye_m[1], eye_m[2]
    ahead = max(0.0, np.sqrt(ex * ex + ey * ey + ez * ez) - 1.01 * radius_m)  # rays start near: they have more digits
    for i in range(len(points_m)):
        x, y, z = points_m[i, 0] - ex, points_m[i, 1] - ey, points_m[i, 2] - ez
        away = np.sqrt(x * x + y * y + z * z)
        far = away - ahead - NEAR_SHARE * radius_m
        if not seen[i] or far <= 0.0:
            continue
        x, y, z = x / away, y / away, z / away
        start = (ex + ahead * x, ey + ahead * y, ez + ahead * z)
        seen[i] = first_face(search, ray, start, (x, y, z), far, arguments) < 0
