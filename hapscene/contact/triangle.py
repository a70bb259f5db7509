"""One face of one body, in float64 and in the world: its plane, whether the proxy lies over it, its coordinates."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import inlined, native
from hapscene.geometry import Vector, along, cross, dot, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = [
    "barycentric",
    "corners",
    "edge_past",
    "is_narrow",
    "lies_over",
    "lies_over_in_body",
    "plane",
    "to_body",
    "to_body_before",
    "to_world",
    "turn_to_body",
    "turn_to_world",
    "weights",
]


@inlined
def to_world(body: np.record, p_B: Vector) -> Vector:
    """Point from the body's frame to the world's."""
    o = body.p_WB_m
    return along((o[0], o[1], o[2]), 1.0, turn_to_world(body, p_B))


@inlined
def to_body(body: np.record, p_W: Vector) -> Vector:
    """Point from the world's frame to the body's, at this tick's pose."""
    return _into(body.R_WB, body.p_WB_m, p_W)


@native
def to_body_before(body: np.record, p_W: Vector) -> Vector:
    """Point from the world's frame to the body's, at the last tick's pose."""
    return _into(body.was_R_WB, body.was_p_WB_m, p_W)


@inlined
def _into(R: NDArray[np.float64], o: Any, p: Vector) -> Vector:
    """Rᵀ (p − o)."""
    x, y, z = p[0] - o[0], p[1] - o[1], p[2] - o[2]
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@inlined
def turn_to_world(body: np.record, v_B: Vector) -> Vector:
    """Direction from the body's frame to the world's."""
    R = body.R_WB
    return (
        R[0, 0] * v_B[0] + R[0, 1] * v_B[1] + R[0, 2] * v_B[2],
        R[1, 0] * v_B[0] + R[1, 1] * v_B[1] + R[1, 2] * v_B[2],
        R[2, 0] * v_B[0] + R[2, 1] * v_B[1] + R[2, 2] * v_B[2],
    )


@native
def turn_to_body(body: np.record, v_W: Vector) -> Vector:
    """Direction from the world's frame to the body's."""
    return _into(body.R_WB, (0.0, 0.0, 0.0), v_W)


@inlined
def corners(world: "World", body: np.record, face: int) -> tuple[Vector, Vector, Vector]:
    """The three corners of a face in the body's frame [m]."""
    row = body.face + face
    return _corner(world, row, 0), _corner(world, row, 1), _corner(world, row, 2)


@inlined
def _corner(world: "World", row: int, k: int) -> Vector:
    return world.corners_m[row, k, 0], world.corners_m[row, k, 1], world.corners_m[row, k, 2]


@inlined
def plane(a: Vector, b: Vector, c: Vector) -> tuple[Vector, float]:
    """Unit normal of a triangle, counter-clockwise outward, and the plane's offset [m]."""
    n = cross(sub(b, a), sub(c, a))
    length = norm(n)
    n = (n[0] / length, n[1] / length, n[2] / length)
    return n, dot(n, a)


@inlined
def lies_over(world: "World", body: np.record, face: int, p_W: Vector, margin_m: float) -> bool:
    """Whether the foot of a point on the face's plane is inside the face, or at most `margin_m` past an edge."""
    return lies_over_in_body(world, body, face, to_body(body, p_W), margin_m)


@native
def lies_over_in_body(world: "World", body: np.record, face: int, p: Vector, margin_m: float) -> bool:
    """The same of a point in the body's axes."""
    a, b, c = corners(world, body, face)
    return edge_past(a, b, c, p, margin_m) < 0


@inlined
def is_narrow(a: Vector, b: Vector, c: Vector, least_m: float) -> bool:
    """Whether a triangle is lower than `least_m` over its longest edge, as those are that a search leaves out."""
    ab, bc, ca = sub(b, a), sub(c, b), sub(a, c)
    n = cross(ab, bc)
    return not dot(n, n) > least_m * least_m * max(dot(ab, ab), dot(bc, bc), dot(ca, ca))


@inlined
def edge_past(a: Vector, b: Vector, c: Vector, p: Vector, margin_m: float) -> int:
    """The edge of a triangle, 0 being a to b, that a point's foot is farthest past; −1 where by at most a margin."""
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


@native
def barycentric(world: "World", body: np.record, face: int, p_W: Vector) -> Vector:
    """Barycentric coordinates on the face of a point's foot on its plane [1]."""
    return weights(corners(world, body, face), to_body(body, p_W))


@native
def weights(triangle: tuple[Vector, Vector, Vector], p: Vector) -> Vector:
    """Barycentric coordinates of a point's foot on a triangle's plane [1]."""
    a, b, c = triangle
    ab, ac, ap = sub(b, a), sub(c, a), sub(p, a)
    n = cross(ab, ac)
    area = dot(n, n)
    v = dot(cross(ap, ac), n) / area
    w = dot(cross(ab, ap), n) / area
    return 1.0 - v - w, v, w
