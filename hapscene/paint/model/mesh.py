"""A mesh prepared for painting: ray picking, and the faces that a brush or a fill reaches."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import SKIN_RATIO
from hapscene.contact.embree import Search, first_face, fronts_only, new_ray
from hapscene.geometry import Vector, along, cross, dot, sub
from hapscene.native import native
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Volume
from hapscene.scene.topology import connected, edges_of, normals_of, weld

__all__ = [
    "FACING_RAD",
    "Hit",
    "Mask",
    "PaintableMesh",
    "face_centre",
    "pick",
    "project_to_surface",
    "segment_triangle",
]

# The brush's walk over the surface, compiled: from face to face while they are under it.
#
# A brush of radius r moves along a segment. The walk starts at the faces at its two ends and goes on to every face that
# shares a vertex with one already reached, is nearer than r to the segment (triangle against segment, after Ericson,
# Real-Time Collision Detection (2005), 5.1.9 and 5.1.10), and looks the same way as one of the ends.


@native
def _share(ap: Vector, ab: Vector) -> float:
    """Where on a segment a point is nearest to, 0 to 1."""
    length2 = dot(ab, ab)
    return min(max(dot(ap, ab) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0


@native
def _off(ap: Vector, ab: Vector, t: float) -> float:
    """Squared distance from a + t ab."""
    gap = along(ap, -t, ab)
    return dot(gap, gap)


@native
def segment_segment(p: Vector, q: Vector, a: Vector, b: Vector) -> float:
    """Squared distance [m²] of two segments."""
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
    """Whether the foot of a point on a triangle's plane is inside it, and where: a + v ab + w ac."""
    bb, bc, cc, pb, pc = dot(ab, ab), dot(ab, ac), dot(ac, ac), dot(ap, ab), dot(ap, ac)
    det = bb * cc - bc * bc
    if det <= 0.0:
        return False, 0.0, 0.0
    v, w = (cc * pb - bc * pc) / det, (bb * pc - bc * pb) / det
    return bool(v >= 0.0 and w >= 0.0 and v + w <= 1.0), v, w


@native
def _over_triangle(ap: Vector, ab: Vector, ac: Vector) -> float:
    """Squared distance [m²] of a point from a triangle that it is over; infinite where it is beside it."""
    inside, v, w = _inside(ap, ab, ac)
    gap = along(along(ap, -v, ab), -w, ac)
    return dot(gap, gap) if inside else np.inf


@native
def pierces(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> bool:
    """Whether a segment goes through a triangle."""
    ab, ac, pq, ap = sub(b, a), sub(c, a), sub(q, p), sub(p, a)
    n = cross(ab, ac)
    over, under = dot(n, ap), dot(n, pq)
    if under == 0.0 or over * (over + under) > 0.0:
        return False
    return _inside(along(ap, -over / under, pq), ab, ac)[0]


@native
def segment_triangle(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """Squared distance [m²] of a segment from a triangle: from an edge, if neither end is over it."""
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
    """Write the faces that the brush touches into the last array of `work`; returns how many they are.

    Args:
        shape: corners (M, 3, 3) [m] and unit normals (M, 3).
        net: welded vertices (M, 3), and face corners around each vertex: (3M,) from (N + 1,) on.
        work: of the faces and of the vertices in which round they were seen (M,), (N,); a list of faces (M,).
        number: of this round, above all before it.
        ends: faces at both ends of the way.
        points: places there [m].
        radius_m: of the brush [m].
        facing_cos: cosine of the most that a face may be turned from both ends' [1].
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
"""Most that a face may be turned from where a brush touches, to be painted by it [rad]. Under 90°, so that a brush near
an edge stays on its side of it, and never reaches the back of a wall; far enough that a scan's roughness leaves no
holes."""

BEND_ROUNDING_RAD: Final = 1e-9
"""What a facet's angle is widened by [rad], as `hapscene.scene.region.Facet` does."""


class PaintableMesh:
    """A mesh with what picking, brush and bucket need.

    Attributes:
        mesh: in the body's frame B.
        corner_m: (M, 3, 3) float64, corners of every face [m].
        centroid_m: (M, 3) of every face [m].
        normal: (M, 3) unit normals; zero where a face has no area.
        welded: (N,) int64, the first vertex at the place of each one: `hapscene.scene.topology.weld`.
        pairs: (n, 2) int64, faces on both sides of every edge that has just two.
        search: Embree's, of the mesh.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.corner_m = np.ascontiguousarray(mesh.triangles_m)
        lane = ThreadPoolExecutor(1)  # Embree builds while the rest is made
        search = lane.submit(Search, mesh.vertices_m, mesh.faces, SKIN_RATIO * mesh.diagonal_m)
        lane.shutdown(wait=False)
        self.centroid_m = (self.corner_m[:, 0] + self.corner_m[:, 1] + self.corner_m[:, 2]) / 3
        self.normal = normals_of(self.corner_m)
        self._ray, self._fronts = new_ray(), fronts_only()
        self.welded = weld(mesh.vertices_m)
        self._vertex = self.welded[mesh.faces].astype(np.int32)  # faces meet where their corners are at one place
        self._around = np.argsort(self._vertex.ravel(), kind="stable").astype(np.int32)
        count = np.bincount(self._vertex.ravel(), minlength=len(mesh.vertices_m))
        self._start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
        self._seen_face = np.zeros(len(mesh.faces), np.int32)
        self._seen_vertex = np.zeros(len(mesh.vertices_m), np.int32)
        self._queue = np.zeros(len(mesh.faces), np.int32)
        self._round = 0
        self.pairs, self._bend_rad = self._edges()
        self.search = search.result()
        here = self.centroid_m[0]
        self.brush((0, 0), (here, here), mesh.diagonal_m * 1e-9)  # compiles the walk now, not in the first stroke

    def pick(self, origin_B_m: Row, direction_B: Row, fronts: bool = False) -> tuple[int, float, Row] | None:
        """The first face along a ray from a point (3,) [m], its distance [m] and the point (3,) on it; None without.

        Faces are met from both sides, or with `fronts` from outside alone. Embree (float32) names the face; the point
        is computed in float64 on its plane.
        """
        direction = direction_B / np.linalg.norm(direction_B)
        origin = origin_B_m - self.search.center_m
        # near the mesh the ray has more digits: it starts where it enters the ball around it
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

    def brush(
        self, faces: tuple[int, int], ends_B_m: tuple[Row, Row], radius_m: float, facing_rad: float = FACING_RAD
    ) -> NDArray[np.int64]:
        """Faces (n,) under a brush that moves from one place on the surface to another, each given by face and point.

        These are the faces that the capsule of that radius about the path touches, if the surface leads there from
        either end inside the capsule and is turned by at most `facing_rad` from it. So a brush does not reach through
        a thin wall.
        """
        self._round += 1
        count = faces_under_brush(
            (self.corner_m, self.normal),
            (self._vertex, self._around, self._start),
            (self._seen_face, self._seen_vertex, self._queue),
            self._round,
            (int(faces[0]), int(faces[1])),
            (tuple(ends_B_m[0].tolist()), tuple(ends_B_m[1].tolist())),
            float(radius_m),
            math.cos(facing_rad),
        )
        return np.sort(self._queue[:count]).astype(np.int64)

    def near(self, region: Volume) -> NDArray[np.int64]:
        """Faces (n,) that a region in B may reach a part of, ascending."""
        slack_m = 1e-9 * self.mesh.diagonal_m  # a region that ends in a face's plane has it
        return np.flatnonzero(region.distance_m(self.centroid_m) < self.reach_m + slack_m)

    @cached_property
    def reach_m(self) -> Row:
        """How far corners are from the middle of each face (M,) [m]."""
        return np.asarray(np.linalg.norm(self.corner_m - self.centroid_m[:, None], axis=2).max(axis=1))

    def bary(self, face: int, p_B_m: Row) -> Row:
        """Barycentric coordinates (3,) of a point (3,) [m] in the plane of a face."""
        a, b, c = self.corner_m[face]
        v, w = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), p_B_m - a, rcond=None)[0]
        return np.array([1.0 - v - w, v, w])

    def facet(self, face: int, angle_rad: float) -> NDArray[np.bool_]:
        """Faces (M,) connected with one over edges that bend by at most an angle, as `region.Facet` picks them."""
        label = connected(self.pairs[self._bend_rad <= angle_rad + BEND_ROUNDING_RAD], len(self.mesh.faces))
        return np.asarray(label == label[face])

    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Faces on both sides (n, 2) of each edge with just two, and by how much it bends (n,) [rad]."""
        pairs, alike = edges_of(self.mesh.faces, self.welded).pairs()
        other = np.where(alike, 1.0, -1.0)[:, None] * self.normal[pairs[:, 1]]
        chord = np.linalg.norm(self.normal[pairs[:, 0]] - other, axis=1)
        return pairs, 2 * np.arcsin(np.minimum(chord / 2, 1.0))


# Where on a scene's surface a ray from the eye falls.


@dataclass(frozen=True, eq=False)
class Hit:
    """A place on the surface.

    Attributes:
        body: index of the body.
        face: of its mesh.
        p_W_m, p_B_m: (3,) the place in W and in the body's frame [m].
        nhat_W: (3,) outward normal of the face.
        distance_m: from the ray's origin [m].
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
    seen: bool = False,
) -> Hit | None:
    """The nearest place along a ray (3,), (3,); None where there is none, or no ray.

    Faces are met from both sides; with `seen`, only those that are drawn: not the backs of one-sided bodies.
    """
    if not (np.isfinite(origin_W_m).all() and np.isfinite(direction_W).all() and direction_W.any()):
        return None
    best: Hit | None = None
    for index, (body, shape) in enumerate(zip(bodies, shapes, strict=True)):
        R, p = body.X_WB[:3, :3], body.X_WB[:3, 3]
        found = shape.pick((origin_W_m - p) @ R, direction_W @ R, seen and not body.two_sided)
        if found is not None and (best is None or found[1] < best.distance_m):
            face, distance, p_B = found
            best = Hit(index, face, R @ p_B + p, p_B, R @ shape.normal[face], distance)
    return best


def face_centre(bodies: Sequence[Body], shapes: Sequence[PaintableMesh], body: int, face: int) -> Hit:
    """The middle of a face as a place."""
    shape, X_WB = shapes[body], bodies[body].X_WB
    p_B = shape.centroid_m[face]
    p_W = X_WB[:3, :3] @ p_B + X_WB[:3, 3]
    return Hit(body, face, p_W, p_B.copy(), X_WB[:3, :3] @ shape.normal[face], 0.0)


def project_to_surface(
    body: Body, shape: PaintableMesh, hit: Hit, p_W_m: NDArray[np.float64], reach_m: float
) -> NDArray[np.float64]:
    """Places (n, 3) in the plane of a hit laid down on its body, along the hit's normal; as they are beside it.

    Each goes to the first face under or over it, from `reach_m` above the plane to as much below.
    """
    R, p = body.X_WB[:3, :3], body.X_WB[:3, 3]
    down_B = -hit.nhat_W @ R
    laid = np.array(p_W_m)
    for i, start_B_m in enumerate((p_W_m - p) @ R - reach_m * down_B):
        found = shape.pick(start_B_m, down_B)
        if found is not None and found[1] <= 2 * reach_m:
            laid[i] = R @ found[2] + p
    return laid


Mask = NDArray[np.bool_]
