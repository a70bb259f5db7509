"""A mesh prepared for painting: ray picking, and selection of the faces under a brush or a fill."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hapscene.constants import SKIN_RATIO
from hapscene.contact.embree import Search, first_face, fronts_only, new_ray
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Region, Tube
from hapscene.scene.topology import area_of, connected, edges_of, normals_of, weld

__all__ = ["FACING_RAD", "Hit", "PaintableMesh", "pick", "project_to_surface"]

Row = NDArray[np.float64]
Ray32 = NDArray[np.float32]

FACING_RAD: Final = math.radians(80.0)
"""Largest angle between the normal of a painted face and the normal under the brush [rad]. Below 90°, a brush near an
edge stays on its side of the edge and never reaches the back of a wall; the noise of a scan leaves no holes."""

BEND_ROUNDING_RAD: Final = 1e-9
"""Tolerance added to the angle of a facet [rad]."""


class PaintableMesh:
    """A mesh with the data structures for picking, brush and fill.

    Attributes:
        mesh: the mesh, in the body's frame B.
        corner_m: (M, 3, 3) float64 corners of the faces [m].
        centroid_m: (M, 3) centroids of the faces [m].
        normal: (M, 3) unit normals; zero for a face without area.
        welded: (N,) int64, first vertex at the position of each vertex: see `hapscene.scene.topology.weld`.
        reach_m: (M,) largest distance of a corner from the centroid of each face [m].
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.corner_m = np.ascontiguousarray(mesh.triangles_m)
        lanes = ThreadPoolExecutor(2)  # in parallel with the rest
        welded = lanes.submit(weld, mesh.vertices_m)
        self._search = lanes.submit(Search, mesh.vertices_m, mesh.faces, SKIN_RATIO * mesh.diagonal_m)
        lanes.shutdown(wait=False)
        self.centroid_m = (self.corner_m[:, 0] + self.corner_m[:, 1] + self.corner_m[:, 2]) / 3
        self.normal = normals_of(self.corner_m)
        self._ray, self._fronts = new_ray(), fronts_only()
        self.reach_m = np.linalg.norm(self.corner_m - self.centroid_m[:, None], axis=2).max(axis=1)
        self._usual_m = 4.0 * float(np.median(self.reach_m))
        self._large = np.flatnonzero(self.reach_m > self._usual_m)  # tested one by one, so that balls stay small
        self.welded = welded.result()

    @cached_property
    def search(self) -> Search:
        """Embree search structure of the mesh."""
        return self._search.result()

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.centroid_m, compact_nodes=False, balanced_tree=False)  # four times faster to build

    @cached_property
    def area_m2(self) -> Row:
        """Areas (M,) of the faces, above 0 so that faces without area take part in choices by area [m²]."""
        return np.maximum(area_of(self.corner_m), np.finfo(np.float64).tiny)

    def prepare(self) -> None:
        """Compute what brush and fill need, instead of at their first use. Thread-safe."""
        _ = self.search, self._tree, self._edges, self.area_m2

    def pick(self, origin_B_m: Row, direction_B: Row, fronts: bool = False) -> tuple[int, float, Row] | None:
        """The first face along a ray from a point (3,) [m], its distance [m] and the hit point (3,); None if none.

        Both sides of a face are hit, or with `fronts` only the outer side. Embree finds the face in float32; the hit
        point is computed in float64 in the plane of the face.
        """
        direction = direction_B / np.linalg.norm(direction_B)
        origin = origin_B_m - self.search.center_m
        # the ray starts at the bounding sphere, where float32 has more digits
        ahead = max(0.0, float(np.linalg.norm(origin)) - 1.01 * self.search.radius_m)
        start = origin + ahead * direction
        far = float(np.linalg.norm(start)) + 2.0 * self.search.radius_m
        arguments = self._fronts.ctypes.data if fronts else 0
        x, y, z = start.tolist()
        face = int(first_face(self.search.handle, self._ray, (x, y, z), tuple(direction.tolist()), far, arguments))
        if face < 0:
            return None
        distance = ahead + float(self._ray[8])
        across = float(self.normal[face] @ direction)
        if abs(across) > 1e-6:
            exact = float(self.normal[face] @ (self.corner_m[face, 0] - origin_B_m)) / across
            if abs(exact - distance) <= 1e-4 * (distance + self.search.radius_m):
                distance = exact
        return face, distance, np.asarray(origin_B_m + distance * direction)

    def brush(self, faces: Sequence[int], points_B_m: Row, radius_m: float) -> NDArray[np.int64]:
        """Faces (n,) that a brush along points (k, 3) on the surface may reach, ascending.

        These are the faces near the line whose normals differ by at most `FACING_RAD` from that of one of `faces` (k,),
        the faces at the points. So a brush does not paint the other side of a thin wall.
        """
        middle_m = (points_B_m.min(axis=0) + points_B_m.max(axis=0)) / 2
        half_m = float(np.linalg.norm(points_B_m - middle_m, axis=1).max())
        around = self._tree.query_ball_point(middle_m, half_m + radius_m + self._usual_m)
        near = np.union1d(np.array(around, np.int64), self._large)
        near = near[Tube(points_B_m, radius_m).distance_m(self.centroid_m[near]) < self.reach_m[near]]
        turned = self.normal[near] @ self.normal[np.unique(faces)].T
        facing = (turned >= math.cos(FACING_RAD)).any(axis=1) | ~self.normal[near].any(axis=1)
        return np.union1d(near[facing], faces)

    def near(self, region: Region) -> NDArray[np.int64]:
        """Faces (n,) that a region in B may intersect, ascending."""
        slack_m = 1e-9 * self.mesh.diagonal_m  # includes faces in a boundary plane of the region
        return np.flatnonzero(region.distance_m(self.centroid_m) < self.reach_m + slack_m)

    def bary(self, face: int, p_B_m: Row) -> Row:
        """Barycentric coordinates (3,) of a point (3,) [m] in the plane of a face."""
        a, b, c = self.corner_m[face]
        v, w = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), p_B_m - a, rcond=None)[0]
        return np.array([1.0 - v - w, v, w])

    def facet(self, face: int, angle_rad: float) -> NDArray[np.bool_]:
        """Mask (M,) of the faces connected with a face over edges that bend by at most an angle."""
        pairs, bend_rad = self._edges
        label = connected(pairs[bend_rad <= angle_rad + BEND_ROUNDING_RAD], len(self.mesh.faces))
        return np.asarray(label == label[face])

    @property
    def pairs(self) -> NDArray[np.int64]:
        """(n, 2), the two faces of every edge with exactly two faces."""
        return self._edges[0]

    @cached_property
    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The two faces (n, 2) of each edge with exactly two faces, and the angle between their normals (n,) [rad]."""
        pairs, same_winding = edges_of(self.mesh.faces, self.welded).pairs()
        other = np.where(same_winding, 1.0, -1.0)[:, None] * self.normal[pairs[:, 1]]
        chord = np.linalg.norm(self.normal[pairs[:, 0]] - other, axis=1)
        return pairs, 2 * np.arcsin(np.minimum(chord / 2, 1.0))


# --- picking in a scene ---


@dataclass(frozen=True, eq=False)
class Hit:
    """A point on the surface of a scene.

    Attributes:
        body: index of the body.
        face: face of its mesh.
        p_W_m, p_B_m: (3,) position in W and in the body's frame [m].
        nhat_W: (3,) outward unit normal of the face.
        distance_m: distance from the origin of the ray [m].
    """

    body: int
    face: int
    p_W_m: NDArray[np.float64]
    p_B_m: NDArray[np.float64]
    nhat_W: NDArray[np.float64]
    distance_m: float


def pick(
    bodies: Sequence[Body],
    shapes: Sequence[PaintableMesh],
    origin_W_m: NDArray[np.float64],
    direction_W: NDArray[np.float64],
    visible_only: bool = False,
) -> Hit | None:
    """The nearest hit along a ray with origin (3,) and direction (3,); None without a hit, or for an invalid ray.

    Both sides of a face are hit; with `visible_only`, back faces of one-sided bodies are not, since they are not drawn.
    """
    if not (np.isfinite(origin_W_m).all() and np.isfinite(direction_W).all() and direction_W.any()):
        return None
    best: Hit | None = None
    for index, (body, shape) in enumerate(zip(bodies, shapes, strict=True)):
        R, p = body.X_WB[:3, :3], body.X_WB[:3, 3]
        found = shape.pick((origin_W_m - p) @ R, direction_W @ R, visible_only and not body.two_sided)
        if found is not None and (best is None or found[1] < best.distance_m):
            face, distance, p_B = found
            best = Hit(index, face, R @ p_B + p, p_B, R @ shape.normal[face], distance)
    return best


def project_to_surface(
    body: Body, shape: PaintableMesh, hit: Hit, p_W_m: NDArray[np.float64], reach_m: float
) -> NDArray[np.float64]:
    """Project points (n, 3) in the tangent plane of a hit onto the body, along the normal of the hit.

    A point moves to the first face within `reach_m` above or below the plane; else it stays.
    """
    R, p = body.X_WB[:3, :3], body.X_WB[:3, 3]
    down_B = -hit.nhat_W @ R
    projected = np.array(p_W_m)
    for i, start_B_m in enumerate((p_W_m - p) @ R - reach_m * down_B):
        found = shape.pick(start_B_m, down_B)
        if found is not None and found[1] <= 2 * reach_m:
            projected[i] = R @ found[2] + p
    return projected
