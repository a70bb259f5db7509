"""Where a reduced mesh lies over the full one, compiled: rays from points of the full mesh along their normals."""

from typing import Any, Final

from hapscene.contact.embree import first_face
from hapscene.native import native

BACK_SHARE: Final = 0.01
"""From how far behind its point a ray starts, in its length [1]: where both surfaces are one, it must meet it."""


@native
def over(
    search: int, ray: Any, points_m: Any, normals: Any, shown_normals: Any, far_m: float, faces: Any, above_m: Any
) -> None:
    """Write which shown face lies over or under each point, −1 where none does, and how high above the point.

    Args:
        search, ray: as `first_face` has them.
        points_m: (n, 3) in the centred frame of the search structure [m].
        normals: (n, 3) unit normals there; zero where none is known.
        shown_normals: (S, 3) of the shown faces; one that looks away from the point's normal is another surface.
        far_m: how far a ray goes to either side [m].
        faces, above_m: (n,), (n,), written [m].
    """
    back_m = BACK_SHARE * far_m
    for i in range(len(points_m)):
        x, y, z = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        faces[i], above_m[i] = -1, 0.0
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        nearest_m = far_m
        for way in (1.0, -1.0):
            start = (x - way * back_m * nx, y - way * back_m * ny, z - way * back_m * nz)
            direction = (way * nx, way * ny, way * nz)
            face = first_face(search, ray, start, direction, far_m + back_m, 0)
            if face < 0:
                continue
            if nx * shown_normals[face, 0] + ny * shown_normals[face, 1] + nz * shown_normals[face, 2] <= 0.0:
                continue
            away_m = float(ray[8]) - back_m
            if abs(away_m) < nearest_m:
                nearest_m = abs(away_m)
                faces[i], above_m[i] = face, way * away_m
