"""A mesh prepared for painting: ray picking, and selection of the faces under a brush or a fill."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import SKIN_RATIO
from hapscene.contact.embree import Search, first_face, fronts_only, new_ray
from hapscene.geometry import Vector, along, cross, dot, sub
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Volume
from hapscene.scene.topology import connected, edges_of, normals_of, weld

__all__ = [
    "FACING_RAD",
    "Hit",
    "PaintableMesh",
    "pick",
    "project_to_surface",
    "segment_triangle",
]

# Faces under a brush, compiled.
#
# A brush of radius r moves along a segment. A flood fill starts at the faces at both ends and continues to every face
# that shares a vertex with a reached face, is nearer than r to the segment (distance of triangle and segment after
# Ericson, Real-Time Collision Detection (2005), 5.1.9 and 5.1.10), and faces the same way as one of the ends.


@native
def _share(ap: Vector, ab: Vector) -> float:
    """Parameter, 0 to 1, of the point of a segment that is nearest to a point."""
    length2 = dot(ab, ab)
    return min(max(dot(ap, ab) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0


@native
def _off(ap: Vector, ab: Vector, t: float) -> float:
    """Squared distance of a point from a + t ab [m²]."""
    gap = along(ap, -t, ab)
    return dot(gap, gap)


@native
def segment_segment(p: Vector, q: Vector, a: Vector, b: Vector) -> float:
    """Squared distance of two segments [m²]."""
    d1, d2, r = sub(q, p), sub(b, a), sub(p, a)
    l1, l2, f = dot(d1, d1), dot(d2, d2), dot(d2, r)
    if l1 == 0.0:
        return _off(sub(p, a), d2, _share(sub(p, a), d2))
    c = dot(d1, r)
    if l2 == 0.0:
        return _off(sub(a, p), d1, _share(sub(a, p), d1))
    both = dot(d1, d2)
    across = l1 * l2 - both * both
    s = min(max((both * f - c * l2) / across, 0.0), 1.0) if across > 1e-14 * l1 * l2 else 0.0
    t = (both * s + f) / l2
    if t < 0.0:
        t, s = 0.0, min(max(-c / l1, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((both - c) / l1, 0.0), 1.0)
    gap = along(along(r, s, d1), -t, d2)
    return dot(gap, gap)


@native
def _inside(ap: Vector, ab: Vector, ac: Vector) -> tuple[bool, float, float]:
    """Whether the projection a + v ab + w ac of a point onto the plane of a triangle is inside the triangle; v, w."""
    bb, bc, cc, pb, pc = dot(ab, ab), dot(ab, ac), dot(ac, ac), dot(ap, ab), dot(ap, ac)
    det = bb * cc - bc * bc
    if det <= 0.0:
        return False, 0.0, 0.0
    v, w = (cc * pb - bc * pc) / det, (bb * pc - bc * pb) / det
    return bool(v >= 0.0 and w >= 0.0 and v + w <= 1.0), v, w


@native
def _over_triangle(ap: Vector, ab: Vector, ac: Vector) -> float:
    """Squared distance of a point from a triangle [m²]; infinite if its projection is outside the triangle."""
    inside, v, w = _inside(ap, ab, ac)
    gap = along(along(ap, -v, ab), -w, ac)
    return dot(gap, gap) if inside else np.inf


@native
def pierces(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> bool:
    """Whether a segment intersects a triangle."""
    ab, ac, pq, ap = sub(b, a), sub(c, a), sub(q, p), sub(p, a)
    n = cross(ab, ac)
    over, under = dot(n, ap), dot(n, pq)
    if under == 0.0 or over * (over + under) > 0.0:
        return False
    return _inside(along(ap, -over / under, pq), ab, ac)[0]


@native
def segment_triangle(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """Squared distance of a segment from a triangle [m²]."""
    if pierces(p, q, a, b, c):
        return 0.0
    ab, ac = sub(b, a), sub(c, a)
    return min(
        _over_triangle(sub(p, a), ab, ac),
        _over_triangle(sub(q, a), ab, ac),
        segment_segment(p, q, a, b),
        segment_segment(p, q, b, c),
        segment_segment(p, q, c, a),
    )


@native
def _corner(corner_m: Any, face: int, k: int) -> Vector:
    return corner_m[face, k, 0], corner_m[face, k, 1], corner_m[face, k, 2]


@native
def faces_under_brush(
    shape: Any, net: Any, work: Any, number: int, ends: Any, points: Any, radius_m: float, facing_cos: float
) -> int:
    """Write the faces under the brush into the last array of `work`; returns their number.

    Args:
        shape: corners (M, 3, 3) [m] and unit normals (M, 3) of the faces.
        net: welded vertices (M, 3), and corners around each vertex: (3M,) with start indices (N + 1,).
        work: number of the call that last visited each face (M,) and vertex (N,); queue of faces (M,).
        number: number of this call, larger than all before.
        ends: faces at both ends of the segment.
        points: end points of the segment [m].
        radius_m: radius of the brush [m].
        facing_cos: cosine of the largest angle between a face's normal and that of an end [1].
    """
    corner_m, normal = shape
    vertex, around, start = net
    seen_face, seen_vertex, queue = work
    p, q = points
    radius2 = radius_m * radius_m
    waiting = 0
    for end in ends:
        if seen_face[end] != number:
            seen_face[end] = number
            queue[waiting] = end
            waiting += 1
    n0 = (normal[ends[0], 0], normal[ends[0], 1], normal[ends[0], 2])
    n1 = (normal[ends[1], 0], normal[ends[1], 1], normal[ends[1], 2])
    at = 0
    while at < waiting:
        face = queue[at]
        at += 1
        for k in range(3):
            v = vertex[face, k]
            if seen_vertex[v] == number:
                continue
            seen_vertex[v] = number
            for i in range(start[v], start[v + 1]):
                other = around[i] // 3
                if seen_face[other] == number:
                    continue
                seen_face[other] = number
                n = (normal[other, 0], normal[other, 1], normal[other, 2])
                flat = n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0
                if not flat and dot(n, n0) < facing_cos and dot(n, n1) < facing_cos:
                    continue
                a, b, c = _corner(corner_m, other, 0), _corner(corner_m, other, 1), _corner(corner_m, other, 2)
                if segment_triangle(p, q, a, b, c) <= radius2:
                    queue[waiting] = other
                    waiting += 1
    return waiting


Row = NDArray[np.float64]

FACING_RAD: Final = math.radians(80.0)
"""Largest angle between the normal of a painted face and the normal under the brush [rad]. Below 90°, a brush near an
edge stays on its side of the edge and never reaches the back of a wall; the noise of a scan leaves no holes."""

BEND_ROUNDING_RAD: Final = 1e-9
"""Tolerance added to the angle of a facet [rad], as in `hapscene.scene.region.Facet`."""


class PaintableMesh:
    """A mesh with the data structures for picking, brush and fill.

    Attributes:
        mesh: the mesh, in the body's frame B.
        corner_m: (M, 3, 3) float64 corners of the faces [m].
        centroid_m: (M, 3) centroids of the faces [m].
        normal: (M, 3) unit normals; zero for a face without area.
        welded: (N,) int64, first vertex at the position of each vertex: see `hapscene.scene.topology.weld`.
        pairs: (n, 2) int64, the two faces of every edge with exactly two faces.
        search: Embree search structure of the mesh.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.corner_m = np.ascontiguousarray(mesh.triangles_m)
        lane = ThreadPoolExecutor(1)  # Embree builds in parallel with the rest
        search = lane.submit(Search, mesh.vertices_m, mesh.faces, SKIN_RATIO * mesh.diagonal_m)
        lane.shutdown(wait=False)
        self.centroid_m = (self.corner_m[:, 0] + self.corner_m[:, 1] + self.corner_m[:, 2]) / 3
        self.normal = normals_of(self.corner_m)
        self._ray, self._fronts = new_ray(), fronts_only()
        self.welded = weld(mesh.vertices_m)
        self._vertex = self.welded[mesh.faces].astype(np.int32)  # faces are adjacent if they share a position
        self._around = np.argsort(self._vertex.ravel(), kind="stable").astype(np.int32)
        count = np.bincount(self._vertex.ravel(), minlength=len(mesh.vertices_m))
        self._start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
        self._seen_face = np.zeros(len(mesh.faces), np.int32)
        self._seen_vertex = np.zeros(len(mesh.vertices_m), np.int32)
        self._queue = np.zeros(len(mesh.faces), np.int32)
        self._call = 0  # number of calls of `brush`
        self.pairs, self._bend_rad = self._edges()
        self.search = search.result()
        start = self.centroid_m[0]
        self.brush((0, 0), (start, start), mesh.diagonal_m * 1e-9)  # compiles now instead of in the first stroke

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
        args: tuple[Any, ...] = (tuple(start.tolist()), tuple(direction.tolist()), far, arguments)
        face = int(first_face(self.search.handle, self._ray, *args))
        if face < 0:
            return None
        distance = ahead + float(self._ray[8])
        across = float(self.normal[face] @ direction)
        if abs(across) > 1e-6:
            exact = float(self.normal[face] @ (self.corner_m[face, 0] - origin_B_m)) / across
            if abs(exact - distance) <= 1e-4 * (distance + self.search.radius_m):
                distance = exact
        return face, distance, np.asarray(origin_B_m + distance * direction)

    def brush(self, faces: tuple[int, int], ends_B_m: tuple[Row, Row], radius_m: float) -> NDArray[np.int64]:
        """Faces (n,) under a brush that moves between two points on the surface, each given by face and position.

        These are the faces that intersect the capsule around the segment, are connected with an end inside the
        capsule, and whose normals differ by at most `FACING_RAD` from that at an end. So a brush does not paint the
        other side of a thin wall.
        """
        self._call += 1
        count = faces_under_brush(
            (self.corner_m, self.normal),
            (self._vertex, self._around, self._start),
            (self._seen_face, self._seen_vertex, self._queue),
            self._call,
            (int(faces[0]), int(faces[1])),
            (tuple(ends_B_m[0].tolist()), tuple(ends_B_m[1].tolist())),
            float(radius_m),
            math.cos(FACING_RAD),
        )
        return np.sort(self._queue[:count]).astype(np.int64)

    def near(self, region: Volume) -> NDArray[np.int64]:
        """Faces (n,) that a region in B may intersect, ascending."""
        slack_m = 1e-9 * self.mesh.diagonal_m  # includes faces in a boundary plane of the region
        return np.flatnonzero(region.distance_m(self.centroid_m) < self.reach_m + slack_m)

    @cached_property
    def reach_m(self) -> Row:
        """Largest distance of a corner from the centroid of each face (M,) [m]."""
        return np.asarray(np.linalg.norm(self.corner_m - self.centroid_m[:, None], axis=2).max(axis=1))

    def bary(self, face: int, p_B_m: Row) -> Row:
        """Barycentric coordinates (3,) of a point (3,) [m] in the plane of a face."""
        a, b, c = self.corner_m[face]
        v, w = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), p_B_m - a, rcond=None)[0]
        return np.array([1.0 - v - w, v, w])

    def facet(self, face: int, angle_rad: float) -> NDArray[np.bool_]:
        """Mask (M,) of the faces connected with a face over edges that bend by at most an angle; see `region.Facet`."""
        label = connected(self.pairs[self._bend_rad <= angle_rad + BEND_ROUNDING_RAD], len(self.mesh.faces))
        return np.asarray(label == label[face])

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
