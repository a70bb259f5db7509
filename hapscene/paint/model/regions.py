"""Regions that tools paint: a turned box, an outline on the screen, and the border between two swatches."""

from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import SceneError
from hapscene.paint.model.mesh import PaintableMesh
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import NOTHING, SUBFACE_MAX, finest_of, parts, whole_faces
from hapscene.scene.region import Volume
from hapscene.scene.topology import connected

__all__ = ["Outline", "TurnedBox", "near_border"]


@dataclass(frozen=True, eq=False)
class TurnedBox(Volume):
    """A box by its pose (4, 4), its middle and axes, which may be mirrored, and its edges (3,) [m]."""

    X_BK: NDArray[np.float64]
    size_m: NDArray[np.float64]

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance (n,) [m] of points (n, 3) from the sides, negative within."""
        past = np.abs((points_m - self.X_BK[:3, 3]) @ self.X_BK[:3, :3]) - self.size_m / 2
        return np.asarray(np.linalg.norm(np.maximum(past, 0.0), axis=1) + np.minimum(past.max(axis=1), 0.0))


@dataclass(frozen=True, eq=False)
class Outline(Volume):
    """What lies behind a closed line on the screen, as an eye sees it.

    Attributes:
        X_EB: (4, 4) from the body's frame to the eye's: z goes into the picture; mirrored where the picture is.
        corners: (k, 2) of the line, x and y at z = 1.
    """

    X_EB: NDArray[np.float64]
    corners: NDArray[np.float64]
    is_convex: ClassVar[bool] = False

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance (n,) [m] of points (n, 3) from the border, negative within; at most the true one.

        A ray that differs by d at z = 1 from that of a point at depth z passes by it no nearer than z d over the
        ray's own length at z = 1.
        """
        p_E = points_m @ self.X_EB[:3, :3].T + self.X_EB[:3, 3]
        depth = p_E[:, 2]
        behind = depth <= 0.0
        seen = p_E[:, :2] / np.where(behind, 1.0, depth)[:, None]
        away = np.empty(len(seen))
        signed_distance(seen, np.ascontiguousarray(self.corners), away)
        longest = np.sqrt(1.0 + (self.corners**2).sum(axis=1).max())
        return np.where(behind, np.maximum(-depth, 0.0), depth * away / longest)


@native
def signed_distance(places: Any, corners: Any, away: Any) -> None:
    """Write how far places (n, 2) are from a closed line of corners (k, 2), negative inside, into `away` (n,)."""
    for i in range(len(places)):
        x, y = places[i, 0], places[i, 1]
        nearest2, inside = np.inf, False
        ax, ay = corners[-1, 0], corners[-1, 1]
        for k in range(len(corners)):
            bx, by = corners[k, 0], corners[k, 1]
            sx, sy, px, py = bx - ax, by - ay, x - ax, y - ay
            length2 = sx * sx + sy * sy
            t = min(max((px * sx + py * sy) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
            gap_x, gap_y = px - t * sx, py - t * sy
            nearest2 = min(nearest2, gap_x * gap_x + gap_y * gap_y)
            if (ay > y) != (by > y) and px < py * sx / sy:
                inside = not inside
            ax, ay = bx, by
        away[i] = -np.sqrt(nearest2) if inside else np.sqrt(nearest2)


FACING_COS: Final = -0.2
"""Cosine of the most that a face may be turned from the border near it [1]: not to a wall's other side."""


@dataclass(frozen=True, eq=False)
class Near(Volume):
    """Within a distance of any of some points [m], given as scipy's tree of them."""

    tree: Any
    radius_m: float
    is_convex: ClassVar[bool] = False

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance (n,) [m] of points (n, 3) from the surface, negative within."""
        return np.asarray(self.tree.query(points_m)[0] - self.radius_m)


def near_border(
    body: Body, shape: PaintableMesh, swatch: int, other: int | None, radius_m: float
) -> tuple[Near, NDArray[np.int64]] | None:
    """What lies within a distance of the border between two swatches of a body, and the faces (n,) it may reach.

    The distance is straight; only what is connected with the border by faces near it counts. Without `other`, the
    border to all that is not the swatch. None where there is no border.

    Raises:
        SceneError: the border is too long to be followed.
    """
    from scipy.spatial import cKDTree

    fine, mesh = body.fine or NOTHING, body.mesh
    plain = np.ones(len(mesh.faces), np.bool_)
    plain[fine.faces] = False
    has = []
    for wanted in (_is(swatch), _is(other, swatch)):
        found = plain & wanted(body.face_swatch)
        found[fine.face[wanted(parts(fine.paint)[0])]] = True
        has.append(found)
    a, b = shape.pairs.T
    meet = shape.pairs[(has[0][a] & has[1][b]) | (has[1][a] & has[0][b])]
    faces = np.union1d(np.flatnonzero(has[0] & has[1]), meet)
    pieces = [fine.of_faces(faces), whole_faces(faces[plain[faces]], body.face_swatch[faces[plain[faces]]])]
    corners_m = np.concatenate([leaves.corners_m(mesh) for leaves in pieces])
    face, worn = (np.concatenate(v) for v in zip(*((p.face, parts(p.paint)[0]) for p in pieces), strict=True))
    step_m = finest_of(mesh)
    mine, theirs = _is(swatch)(worn), _is(other, swatch)(worn)
    if not (mine.any() and theirs.any()):
        return None
    points_m, of = _dots(corners_m[mine], step_m)
    on = np.isfinite(
        cKDTree(_dots(corners_m[theirs], step_m)[0]).query(points_m, distance_upper_bound=1e-9 * mesh.diagonal_m)[0]
    )
    if not on.any():
        return None
    start, normal = face[mine][of[on]], shape.normal[face[mine][of[on]]]
    region = Near(cKDTree(points_m[on]), radius_m)
    near = np.union1d(shape.near(region), start)
    nearest = normal[region.tree.query(shape.centroid_m[near])[1]]
    near = near[np.einsum("ij,ij->i", nearest, shape.normal[near]) > FACING_COS]
    there = np.zeros(len(plain), np.bool_)
    there[near] = True
    label = connected(shape.pairs[there[shape.pairs].all(axis=1)], len(plain))
    return region, near[np.isin(label[near], label[start])]


def _is(swatch: int | None, but: int = -1) -> Any:
    """Which swatches (n,) are that one; without one, which are any but another."""
    return lambda worn: worn != but if swatch is None else worn == swatch


def _dots(corners_m: NDArray[np.float64], step_m: float) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Points (n, 3) along the sides of triangles (k, 3, 3), at most a step apart, and whose each is.

    Each side is halved some times, so that pieces that meet, cut more or less often, have points in common there.
    """
    a, b = corners_m.reshape(-1, 3), np.roll(corners_m, -1, axis=1).reshape(-1, 3)
    long = np.linalg.norm(b - a, axis=1)
    count = 2 ** np.ceil(np.log2(np.maximum(long / step_m, 1.0))).astype(np.int64)
    if count.sum() > 4 * SUBFACE_MAX:
        raise SceneError("this border is too long to be followed: paint, or fill, by another tool")
    side = np.repeat(np.arange(len(a)), count)
    share = (np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)) / count[side]
    return a[side] + share[:, None] * (b - a)[side], side // 3
