"""Bodies whose shape changes: their vertices given anew some 60 times a second, their search refitted beside the ticks.

A body has three shapes that it takes in turn: one is felt, one may wait for the next tick, the third is written, so
that neither side ever waits for the other. A tick takes one over in a microsecond.

In between, the surface would stand, and then jump with all that rests on it. So the body is led: with a new shape it
is shifted by as much as its surface went away under the proxy, and comes back evenly over the time between two shapes.
Where it is touched the surface so goes from shape to shape without a step, as a moving body that carries what rests on
it; around, it is out of place by what its parts move against each other, for a frame. Shapes that change by less than
their own size from one to the next, as all do that bend, so never pass the proxy.
"""

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import EDGE_OVERLAP, REACH_MAX_M
from hapscene.contact.embree import RefittedSearch, first_face
from hapscene.contact.planes import copy_plane
from hapscene.contact.proxy import put
from hapscene.contact.shading import CornerGroups
from hapscene.contact.triangle import corners, to_body_before, weights
from hapscene.contact.world import SHAPES, World, place_ball
from hapscene.errors import SceneError
from hapscene.geometry import Vector, cross, dot, norm, numbers, sub
from hapscene.native import native

if TYPE_CHECKING:
    from hapscene.scene.mesh import Mesh

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
        self._count = len(mesh.vertices_m)
        row, proxy = world.bodies[index], world.proxy[0]
        self._overlap_m = EDGE_OVERLAP * float(row.skin_m)
        self._groups = CornerGroups(mesh, crease_rad) if crease_rad > 0.0 else None
        self._searches = [RefittedSearch(self._faces) for _ in range(SHAPES)]
        row.face_count = len(self._faces)
        row.shape_face = first + len(self._faces) * np.arange(SHAPES)
        row.shape_search = [search.handle for search in self._searches]
        row.next, proxy.reshaped = proxy.reshaped, index + 1

    def post(self, world: World, vertices_m: ArrayLike, name: str) -> None:
        """Have the body of a world, and of a name, take another shape (N, 3) in its next tick; see `shape_of`."""
        vertices = shape_of(vertices_m, self._count, name)
        row = world.bodies[self._index]
        taken = row.shape_felt, row.shape_posted  # whichever of them a tick takes meanwhile
        free = next(k for k in range(SHAPES) if k + 1 not in taken)
        first = int(row.shape_face[free])
        packed = world.corners_m[first : first + len(self._faces)]
        packed[:, :3] = vertices[self._faces]
        if self._groups is not None:
            packed[:, 3:] = self._groups.normals(packed[:, :3])
        center, radius = self._searches[free].refit(vertices, self._overlap_m)
        row.shape_center_B_m[free], row.shape_radius_m[free] = center, radius
        row.shape_posted = free + 1


def shape_of(vertices_m: ArrayLike, count: int, name: str) -> NDArray[np.float64]:
    """Places (N, 3) for the vertices of a body, checked.

    Raises:
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
def reshape_bodies(world: Any, surface: Any) -> None:
    """Have bodies take the shapes that were posted, and lead them; after `place_bodies` has done its part."""
    k = world.proxy[0].reshaped
    while k > 0:
        body = world.bodies[k - 1]
        body.shape_ticks += 1
        if body.shape_posted != body.shape_felt or body.lead_s > 0.0:
            _lead(world, surface, k - 1)
        k = body.next


@native
def _lead(world: Any, surface: Any, index: int) -> None:
    """One tick of a body on its way from one shape to another."""
    body, proxy = world.bodies[index], world.proxy[0]
    tick_s, fresh = surface.touch[0].tick_s, surface.memory[0].fresh
    if body.moved == 0:  # no pose has put it where it is without being led
        for i in range(3):
            body.was_p_WB_m[i] = body.p_WB_m[i]
            body.p_WB_m[i] -= body.lead_W_m[i]
    posted = body.shape_posted
    if posted != body.shape_felt and body.shape_face[posted - 1] + body.face_count <= len(world.corners_m):
        span_s = body.shape_ticks * tick_s if body.shape_felt > 0 else LEAD_MAX_S
        gone = _take_shape(world, index, posted)
        for i in range(3):
            for j in range(3):
                body.lead_W_m[i] -= body.R_WB[i, j] * gone[j]
                body.was_p_WB_m[i] -= body.was_R_WB[i, j] * gone[j]
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
    proxy.near_room_m -= place_ball(body, world.ball_W_m[index])
    if fresh == 1:
        at = surface.memory[0].p_WT_m
        put(world, (at[0], at[1], at[2]))


@native
def _take_shape(world: Any, index: int, posted: int) -> Vector:
    """Give a body a shape; how far that took its surface, where it is nearest to the proxy, in its own axes [m]."""
    body, proxy = world.bodies[index], world.proxy[0]
    p = to_body_before(body, (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2]))
    face = _face_at(world, index, p)
    at, before = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if face >= 0:
        at = weights(corners(world, body, face), p)
        before = _blend(corners(world, body, face), at)
    k = posted - 1
    body.search, body.radius_m, body.face = body.shape_search[k], body.shape_radius_m[k], body.shape_face[k]
    for i in range(3):
        body.center_B_m[i] = body.shape_center_B_m[k, i]
    body.shape_felt = posted
    _drop_flat(world, index)
    if face < 0:
        return before
    gone = sub(_blend(corners(world, body, face), at), before)
    return gone if math.isfinite(gone[0] + gone[1] + gone[2]) else (0.0, 0.0, 0.0)  # a face without an area


@native
def _face_at(world: Any, index: int, p_B: Vector) -> int:
    """The face of a body that holds the proxy, else one near it that is seen from there; −1 where there is none."""
    body, proxy = world.bodies[index], world.proxy[0]
    for i in range(proxy.count):
        if proxy.body[i] == index:
            return int(proxy.face[i])
    c = body.center_B_m
    origin = (p_B[0] - c[0], p_B[1] - c[1], p_B[2] - c[2])
    far = norm(origin)
    if far > 2.0 * body.radius_m:
        return -1
    nearest, found = far + body.radius_m, -1
    for axis in range(6):
        sign = 1.0 if axis < 3 else -1.0
        x, y, z = sign * (axis % 3 == 0), sign * (axis % 3 == 1), sign * (axis % 3 == 2)
        face = first_face(body.search, world.ray, origin, (x, y, z), nearest, 0)
        if face >= 0:
            nearest, found = float(world.ray[8]), face
    return found


@native
def _blend(triangle: Any, at: Vector) -> Vector:
    """The point of a triangle at barycentric coordinates."""
    a, b, c = triangle
    u, v, w = at
    return (
        u * a[0] + v * b[0] + w * c[0],
        u * a[1] + v * b[1] + w * c[1],
        u * a[2] + v * b[2] + w * c[2],
    )


@native
def _drop_flat(world: Any, index: int) -> None:
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
