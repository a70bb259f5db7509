"""What the eye sees of a scene: the tools paint that alone, unless they are told to paint through."""

from collections.abc import Container, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.contact.embree import first_face, fronts_only, new_ray
from hapscene.native import native
from hapscene.paint.paintable_mesh import PaintableMesh
from hapscene.scene.body import Body

NEAR_SHARE: Final = 3e-4
"""How far before a place a surface must be to hide it, in radii of the body that hides [1]: more than a ray's rounding;
nearer is the place itself, or what is drawn as one with it."""

CORNER_SHARE: Final = 0.8
"""Where besides its middle a face is looked at, from there towards its corners [1]: what is half hidden is seen."""


def seen_faces(
    bodies: Sequence[Body],
    shapes: Sequence[PaintableMesh],
    body: int,
    faces: NDArray[np.integer],
    eye_W_m: ArrayLike,
    hidden: Container[str] = (),
) -> NDArray[np.integer]:
    """Those of a body's faces (n,) that are seen from a point (3,) in W [m]: drawn, and not hidden altogether.

    Bodies named in `hidden` are not drawn, nor are backs of one-sided bodies: these hide nothing. A face is looked at
    in its middle and near its corners.
    """
    shape, X_WB = shapes[body], bodies[body].X_WB
    eye_B_m = (np.asarray(eye_W_m, np.float64) - X_WB[:3, 3]) @ X_WB[:3, :3]
    if not bodies[body].two_sided:
        towards_m = eye_B_m - shape.centroid_m[faces]
        faces = faces[np.einsum("ij,ij->i", towards_m, shape.normal[faces]) > 0.0]
    there = [i for i, other in enumerate(bodies) if other.name not in hidden]
    bodies, shapes = [bodies[i] for i in there], [shapes[i] for i in there]
    seen = seen_places(bodies, shapes, shape.centroid_m[faces] @ X_WB[:3, :3].T + X_WB[:3, 3], eye_W_m)
    left = np.flatnonzero(~seen)
    if len(left):
        middle_m = shape.centroid_m[faces[left], None]
        corner_m = (middle_m + CORNER_SHARE * (shape.corner_m[faces[left]] - middle_m)).reshape(-1, 3)
        any_seen = seen_places(bodies, shapes, corner_m @ X_WB[:3, :3].T + X_WB[:3, 3], eye_W_m).reshape(-1, 3)
        seen[left] = any_seen.any(axis=1)
    return faces[seen]


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
