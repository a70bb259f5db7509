"""Bodies whose shape changes: their vertices given anew some 60 times a second, their search refitted beside the ticks.

A body has three shapes that it takes in turn: one is felt, one may wait for the next tick, the third is written, so
that neither side ever waits for the other. A tick takes one over in a microsecond.

In between, the surface would stand, and then jump with all that rests on it. So the body is led: with a new shape it
is shifted by as much as its surface went away under the proxy, and comes back evenly over the time between two shapes.
Where it is touched the surface so goes from shape to shape without a step, as a moving body that carries what rests on
it; around, it is out of place by what its parts move against each other, for a frame. Another part of the body that
comes past the proxy meanwhile, as in a fold, holds it from then on: which faces do is seen along rays (`WAYS`).
"""

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.constants import EDGE_OVERLAP, REACH_MAX_M
from hapscene.contact.embree import RefittedSearch, first_face
from hapscene.contact.passing import hold_again
from hapscene.contact.planes import copy_plane
from hapscene.contact.proxy import put
from hapscene.contact.shading import CornerGroups
from hapscene.contact.triangle import corners, lies_over_in_body, plane, to_body_before, weights
from hapscene.contact.world import ASIDE, SHAPES, WAYS, World, place_ball
from hapscene.errors import SceneError
from hapscene.geometry import Vector, along, cross, dot, norm, numbers, sub

if TYPE_CHECKING:
    from hapscene.scene.mesh import Mesh
    from hapscene.surface.surface_arrays import Surface

__all__ = ["Deformation", "reshape_bodies", "room_for", "shape_of"]

LEAD_MAX_S: Final = 0.05
"""Longest time in which a surface goes from one shape to the next [s]: three frames at 60 Hz."""

FLAT: Final = 1e-9
"""Double area of a face, over its longest edge squared, below which it has no normal [1]."""


class Deformation:
    """The shapes of one body of a world, which has room for them: see `room_for`.

    Args:
        world: whose records are written.
        index: of the body in it.
        mesh: its faces; all shapes have them.
        first: the first of its shapes' rows in `World.corners_m`.
        crease_rad: as `build_world` has it.
    """

    def __init__(self, world: World, index: int, mesh: "Mesh", *, first: int, crease_rad: float) -> None:
        self._index = index
        self._faces = np.ascontiguousarray(mesh.faces, np.int32)
        row, proxy = world.bodies[index], world.proxy[0]
        self._overlap_m = EDGE_OVERLAP * float(row.skin_m)
        self._groups = CornerGroups(mesh, crease_rad) if crease_rad > 0.0 else None
        self._searches = [RefittedSearch(self._faces) for _ in range(SHAPES)]
        row.face_count = len(self._faces)
        row.shape_face = first + len(self._faces) * np.arange(SHAPES)
        row.shape_search = [search.handle for search in self._searches]
        row.next, proxy.reshaped = proxy.reshaped, index + 1

    def post(self, world: World, vertices: NDArray[np.float64]) -> None:
        """Have the body of a world take another shape (N, 3) in its next tick: one that `shape_of` has checked."""
        row, free = world.bodies[self._index], list[int]()
        while not free:  # all three are in use for less than a microsecond, while a tick goes from one to the next
            used = row.shape_felt, row.shape_taking, row.shape_posted
            free = [k for k in range(SHAPES) if k + 1 not in used]
        to = free[0]
        first = int(row.shape_face[to])
        packed = world.corners_m[first : first + len(self._faces)]
        packed[:, :3] = vertices[self._faces]
        if self._groups is not None:
            packed[:, 3:] = self._groups.normals(packed[:, :3])
        center, radius = self._searches[to].refit(vertices, self._overlap_m)
        row.shape_center_B_m[to], row.shape_radius_m[to] = center, radius
        row.shape_posted = to + 1


def shape_of(vertices_m: ArrayLike, count: int, name: str) -> NDArray[np.float64]:
    """Places (N, 3) for the vertices of a body, checked.

    Raises:
        PathError: not numbers.
        SceneError: not as many as the mesh has vertices, or not finite ones.
    """
    vertices = numbers(vertices_m)
    if vertices.shape != (count, 3):
        raise SceneError(f"body {name!r} has {count:,} vertices, and takes as many places (n, 3), not {vertices.shape}")
    if not np.abs(vertices).max() <= REACH_MAX_M:  # NaN is not, either
        raise SceneError(f"body {name!r}: its vertices must be finite, within {REACH_MAX_M:g} m")
    return np.ascontiguousarray(vertices)


def room_for(world: World, mesh: "Mesh") -> tuple[World, int]:
    """A world with room for the shapes of one more mesh behind its corners, and where that begins.

    What runs on the old one goes on, and takes no shape that lies behind its end.
    """
    first = len(world.corners_m)
    room = np.zeros((SHAPES * len(mesh.faces), *world.corners_m.shape[1:]))
    return world._replace(corners_m=np.concatenate((world.corners_m, room))), first


@native
def reshape_bodies(world: "World", surface: "Surface") -> None:
    """Have bodies take the shapes that were posted, and lead them; after `place_bodies` has done its part."""
    k = world.proxy[0].reshaped
    while k > 0:
        body = world.bodies[k - 1]
        body.shape_ticks += 1
        if body.shape_posted != body.shape_felt or body.lead_s > 0.0:
            _lead(world, surface, k - 1)
        k = body.next


@native
def _lead(world: "World", surface: "Surface", index: int) -> None:
    """One tick of a body on its way from one shape to another."""
    body, proxy = world.bodies[index], world.proxy[0]
    tick_s, fresh = surface.touch[0].tick_s, surface.memory[0].fresh
    if body.moved == 0:  # no pose has put it where it is without being led
        for i in range(3):
            body.was_p_WB_m[i] = body.p_WB_m[i]
            body.p_WB_m[i] -= body.lead_W_m[i]
    if body.shape_posted != body.shape_felt:
        posted = 0
        while posted != body.shape_posted:  # said before it is read, so that nobody writes it meanwhile
            posted = body.shape_posted
            body.shape_taking = posted
        if body.shape_face[posted - 1] + body.face_count <= len(world.corners_m):
            span_s = body.shape_ticks * tick_s if body.shape_felt > 0 else LEAD_MAX_S
            _take_shape(world, index, posted)
            body.lead_s = min(span_s, LEAD_MAX_S)
            body.shape_ticks = 0
    goes_on = fresh == 0 and body.lead_s > tick_s
    fade = (body.lead_s - tick_s) / body.lead_s if goes_on else 0.0
    body.lead_s = body.lead_s - tick_s if goes_on else 0.0
    for i in range(3):
        body.lead_W_m[i] *= fade
        body.p_WB_m[i] += body.lead_W_m[i]
    if fresh == 1:
        for i in range(3):
            body.was_p_WB_m[i] = body.p_WB_m[i]
    elif body.moved == 0:
        body.moved = 1
        world.moved[0] += 1
        world.moved[world.moved[0]] = index
    proxy.near_room_m -= max(0.0, place_ball(body, world.ball_W_m[index]))
    if fresh == 1:
        at = surface.memory[0].p_WT_m
        put(world, (at[0], at[1], at[2]))


@native
def _take_shape(world: "World", index: int, posted: int) -> None:
    """Give a body a shape, and lead it by as much as that takes its surface away where that is nearest to the proxy."""
    body, proxy = world.bodies[index], world.proxy[0]
    p = to_body_before(body, (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2]))
    nearest = _look_around(world, index, p)
    at, before = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if nearest >= 0:
        triangle = corners(world, body, nearest)
        at = weights(triangle, p)
        before = _blend(triangle, at)
    k = posted - 1
    body.search, body.radius_m, body.face = body.shape_search[k], body.shape_radius_m[k], body.shape_face[k]
    for i in range(3):
        body.center_B_m[i] = body.shape_center_B_m[k, i]
    body.shape_felt = posted
    _drop_flat(world, index)
    if nearest < 0:
        return
    gone = sub(_blend(corners(world, body, nearest), at), before)
    if not math.isfinite(gone[0] + gone[1] + gone[2]):  # a face without an area
        gone = (0.0, 0.0, 0.0)
    for i in range(3):
        for j in range(3):
            body.lead_W_m[i] -= body.R_WB[i, j] * gone[j]
            body.was_p_WB_m[i] -= body.was_R_WB[i, j] * gone[j]
    _meet(world, index, along(p, 1.0, gone))


@native
def _look_around(world: "World", index: int, p_B: Vector) -> int:
    """Note the faces of a body along rays from a point, in `proxy.seen`, and on which side of them it is.

    Returns the one that holds the proxy, else the nearest; −1 where there is none.
    """
    body, proxy = world.bodies[index], world.proxy[0]
    for way in range(WAYS):
        proxy.seen[way] = -1
    c = body.center_B_m
    origin = (p_B[0] - c[0], p_B[1] - c[1], p_B[2] - c[2])
    far = norm(origin) + body.radius_m
    nearest, found = far, -1
    for way in range(WAYS if far <= 3.0 * body.radius_m else 0):
        face = first_face(body.search, world.ray, origin, look_direction(way), far, 0)
        proxy.seen[way] = face
        if face < 0:
            continue
        if float(world.ray[8]) < nearest:
            nearest, found = float(world.ray[8]), face
        n, offset = plane(*corners(world, body, face))
        proxy.seen_side[way] = 1.0 if dot(n, p_B) >= offset else -1.0
    for i in range(proxy.count):
        if proxy.body[i] == index:
            return int(proxy.face[i])
    return found


@native
def look_direction(way: int) -> Vector:
    """One of `WAYS` unit vectors."""
    if way < 6:
        sign = 1.0 if way < 3 else -1.0
        return sign * (way % 3 == 0), sign * (way % 3 == 1), sign * (way % 3 == 2)
    bits = way - 6
    third = math.sqrt(1.0 / 3.0)
    return (
        third if bits & 1 else -third,
        third if bits & 2 else -third,
        third if bits & 4 else -third,
    )


@native
def _meet(world: "World", index: int, now_B: Vector) -> None:
    """Have the seen faces hold the proxy that have passed it, which is at `now_B` in the body's axes.

    A body that had let the tool in holds it again where the tool is out of it.
    """
    body, proxy = world.bodies[index], world.proxy[0]
    for way in range(WAYS):
        face = proxy.seen[way]
        for other in range(way):
            if proxy.seen[other] == face:
                face = -1
        for i in range(proxy.count):
            if proxy.body[i] == index and proxy.face[i] == face:
                face = -1
        if face < 0:
            continue
        n, offset = plane(*corners(world, body, face))
        side = proxy.seen_side[way]
        behind_m = -side * (dot(n, now_B) - offset)
        if not (behind_m > 0.0 and lies_over_in_body(world, body, face, now_B, 2.0 * behind_m + body.skin_m)):
            continue
        if body.passed != 0:
            hold_again(world, index)
        elif side > 0.0 or body.two_sided == 1:
            _hold_by(world, index, face, side)
            if body.two_sided == 1:  # or its back would hold the proxy where it is
                out_m = side * (behind_m + body.skin_m)
                for i in range(3):
                    for j in range(3):
                        proxy.p_W_m[i] += out_m * body.was_R_WB[i, j] * n[j]


@native
def _hold_by(world: "World", index: int, face: int, side: float) -> None:
    """Have one more face hold the proxy, if there is room; its plane is placed with the others of moving bodies."""
    body, proxy = world.bodies[index], world.proxy[0]
    k = proxy.count
    if k == ASIDE:
        return
    proxy.body[k], proxy.face[k], proxy.side[k] = index, face, side
    proxy.skin_m[k] = body.skin_m
    proxy.met[k] = 1
    proxy.count = k + 1


@native
def _blend(triangle: tuple[Vector, Vector, Vector], at: Vector) -> Vector:
    """The point of a triangle at barycentric coordinates."""
    a, b, c = triangle
    u, v, w = at
    return (
        u * a[0] + v * b[0] + w * c[0],
        u * a[1] + v * b[1] + w * c[1],
        u * a[2] + v * b[2] + w * c[2],
    )


@native
def _drop_flat(world: "World", index: int) -> None:
    """Let go of the planes of a body's faces that have no normal any more."""
    proxy = world.proxy[0]
    kept = 0
    count = proxy.count
    for i in range(count):
        flat = False
        if proxy.body[i] == index:
            a, b, c = corners(world, world.bodies[index], proxy.face[i])
            u, v, w = sub(b, a), sub(c, a), sub(c, b)
            flat = not norm(cross(u, v)) > FLAT * max(dot(u, u), dot(v, v), dot(w, w))
        if not flat:
            copy_plane(proxy, i, kept)
            kept += 1
    proxy.count = kept
