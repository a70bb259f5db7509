"""Geometry of one face of a body in float64: frames, plane, point-over-face test and barycentric coordinates."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.entry import prefetch
from hapscene.compiled.native import inlined, native
from hapscene.geometry import Vector, along, cross, dot, norm, row, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = [
    "beyond",
    "blend",
    "closest_point",
    "corners",
    "edge_past",
    "fetch_neighbours",
    "is_narrow",
    "lies_over",
    "lies_over_in_body",
    "plane",
    "to_body",
    "to_body_last",
    "to_world",
    "turn_to_body",
    "turn_to_world",
    "weights",
]


@inlined
def to_world(body: np.record, p_B: Vector) -> Vector:
    """Transform a point from the body frame to the world frame."""
    o = body.p_WB_m
    return along((o[0], o[1], o[2]), 1.0, turn_to_world(body, p_B))


@inlined
def to_body(body: np.record, p_W: Vector) -> Vector:
    """Transform a point from the world frame to the body frame at the pose of this tick."""
    return _into(body.R_WB, body.p_WB_m, p_W)


@native
def to_body_last(body: np.record, p_W: Vector) -> Vector:
    """Transform a point from the world frame to the body frame at the pose of the last tick."""
    return _into(body.last_R_WB, body.last_p_WB_m, p_W)


@inlined
def _into(R: NDArray[np.float64], o: NDArray[np.float64] | Vector, p: Vector) -> Vector:
    """Compute Rᵀ (p − o)."""
    x, y, z = p[0] - o[0], p[1] - o[1], p[2] - o[2]
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@inlined
def turn_to_world(body: np.record, v_B: Vector) -> Vector:
    """Rotate a direction from the body frame to the world frame."""
    R = body.R_WB
    return (
        R[0, 0] * v_B[0] + R[0, 1] * v_B[1] + R[0, 2] * v_B[2],
        R[1, 0] * v_B[0] + R[1, 1] * v_B[1] + R[1, 2] * v_B[2],
        R[2, 0] * v_B[0] + R[2, 1] * v_B[1] + R[2, 2] * v_B[2],
    )


@native
def turn_to_body(body: np.record, v_W: Vector) -> Vector:
    """Rotate a direction from the world frame to the body frame."""
    return _into(body.R_WB, (0.0, 0.0, 0.0), v_W)


@inlined
def corners(world: "World", body: np.record, face: int) -> tuple[Vector, Vector, Vector]:
    """Return the three corners of a face in the body frame [m]."""
    triangle = world.corners_m[body.face + face]
    return row(triangle, 0), row(triangle, 1), row(triangle, 2)


@inlined
def beyond(world: "World", body: np.record, face: int, edge: int) -> int:
    """Return the face of the mesh across an edge of a face, −1 for none."""
    return int(world.corners_m[body.face + face, 3, edge])


@inlined
def fetch_neighbours(world: "World", body: np.record, face: int) -> None:
    """Load the rows of the neighbours of a face into the cache: the tool may go there next."""
    rows = world.corners_m
    for edge in range(3):
        start = rows.ctypes.data + (body.face + beyond(world, body, face, edge)) * rows.strides[0]
        prefetch(start)
        prefetch(start + 64)


@inlined
def plane(a: Vector, b: Vector, c: Vector) -> tuple[Vector, float]:
    """Return the unit normal of a triangle (counter-clockwise seen from outside) and the offset of its plane [m]."""
    n = cross(sub(b, a), sub(c, a))
    length = norm(n)
    n = (n[0] / length, n[1] / length, n[2] / length)
    return n, dot(n, a)


@inlined
def lies_over(world: "World", body: np.record, face: int, p_W: Vector, margin_m: float) -> bool:
    """Return whether the foot of a point on the plane of a face lies in the face or at most `margin_m` past an edge."""
    return lies_over_in_body(world, body, face, to_body(body, p_W), margin_m)


@native
def lies_over_in_body(world: "World", body: np.record, face: int, p: Vector, margin_m: float) -> bool:
    """Return the same as `lies_over` for a point in the body frame."""
    a, b, c = corners(world, body, face)
    return edge_past(a, b, c, p, margin_m) < 0


@inlined
def is_narrow(a: Vector, b: Vector, c: Vector, least_m: float) -> bool:
    """Return whether a triangle is lower than `least_m` over its longest edge; searches leave such faces out."""
    ab, bc, ca = sub(b, a), sub(c, b), sub(a, c)
    n = cross(ab, bc)
    return not dot(n, n) > least_m * least_m * max(dot(ab, ab), dot(bc, bc), dot(ca, ca))


@inlined
def edge_past(a: Vector, b: Vector, c: Vector, p: Vector, margin_m: float) -> int:
    """Return the edge that the foot of a point is farthest past, 0 being a to b, or −1 if by at most `margin_m`."""
    n = cross(sub(b, a), sub(c, a))
    most2 = margin_m * margin_m * dot(n, n)
    edge, least = -1, 0.0
    for k in range(3):
        start, end = (a, b, c)[k], (b, c, a)[k]
        way = sub(end, start)
        inside = dot(cross(n, way), sub(p, start))
        if inside < 0.0:
            far2 = inside * inside / dot(way, way)
            if far2 > most2 and far2 > least:
                edge, least = k, far2
    return edge


@inlined
def closest_point(a: Vector, b: Vector, c: Vector, p: Vector) -> Vector:
    """Return the point of a triangle closest to `p` (Ericson, Real-Time Collision Detection, 2005, 5.1.5)."""
    ab, ac, ap = sub(b, a), sub(c, a), sub(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return a
    bp = sub(p, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return b
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return along(a, d1 / (d1 - d3), ab)
    cp = sub(p, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return c
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return along(a, d2 / (d2 - d6), ac)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        return along(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), sub(c, b))
    total = va + vb + vc
    return along(along(a, vb / total, ab), vc / total, ac)


@native
def weights(triangle: tuple[Vector, Vector, Vector], p: Vector) -> Vector:
    """Return the barycentric coordinates of the foot of a point on the plane of a triangle [1]."""
    a, b, c = triangle
    ab, ac, ap = sub(b, a), sub(c, a), sub(p, a)
    n = cross(ab, ac)
    area = dot(n, n)
    v = dot(cross(ap, ac), n) / area
    w = dot(cross(ab, ap), n) / area
    return 1.0 - v - w, v, w


@native
def blend(triangle: tuple[Vector, Vector, Vector], at: Vector) -> Vector:
    """Return the point of a triangle at barycentric coordinates."""
    a, b, c = triangle
    u, v, w = at
    return (
        u * a[0] + v * b[0] + w * c[0],
        u * a[1] + v * b[1] + w * c[1],
        u * a[2] + v * b[2] + w * c[2],
    )
