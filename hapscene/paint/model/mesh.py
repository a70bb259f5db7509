"""A mesh prepared for painting: ray picking, faces under a brush or a fill, and what is visible from the eye."""

import math
from collections.abc import Container, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from hapscene.compiled.native import native
from hapscene.constants import SKIN_RATIO
from hapscene.contact.embree import Search, first_face, fronts_only, new_ray
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Region, Tube
from hapscene.scene.topology import area_of, connected, edges_of, normals_of, weld

__all__ = ["FACING_RAD", "Hit", "PaintableMesh", "Visibility", "pick", "project_to_surface", "visible_points"]

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
        middle_m = points_B_m.mean(axis=0)
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


# --- visibility of a body from the eye ---

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
