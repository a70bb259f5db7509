"""Bodies that change shape: new vertices arrive about 60 times a second and are refitted outside the haptic tick.

A body has three shapes (triple buffering): one in use, one posted for the next tick, one that is being written.
Neither side ever waits for the other. A tick takes over a posted shape in a microsecond.

A new shape would make the surface jump under the proxy. To avoid that, the whole body is shifted by the displacement of
its surface at the proxy, and the shift decays linearly to zero over the time between two shapes. At the contact point
the surface thus moves from shape to shape without a step, like a moving body that carries the proxy. Elsewhere the body
is displaced for the length of a frame by the relative motion of its parts. Another part of the body may pass the proxy
meanwhile, as in a fold; rays from the proxy (`WAYS`) detect that, and the part constrains the proxy from then on.

A violent new shape can enclose the proxy although no such part passed it: then most rays meet faces from behind. The
proxy is set on the nearest surface at once, and the tick has `Flag.PROXY_RESET`.
"""

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.constants import EDGE_OVERLAP, REACH_MAX_M
from hapscene.contact.embree import RefittedSearch
from hapscene.contact.face_tree import fit_cylinders
from hapscene.contact.inside import BACKS_MIN, encloses, face_along, look_direction
from hapscene.contact.planes import copy_plane, drop_planes_of
from hapscene.contact.proxy import place_proxy
from hapscene.contact.shading import CornerGroups
from hapscene.contact.triangle import blend, corners, lies_over_in_body, plane, to_body_last, weights
from hapscene.contact.world import DROPPED, SHAPES, WAYS, World, pack_faces, update_ball
from hapscene.errors import SceneError, UsageWarning, warn
from hapscene.flags import Flag
from hapscene.geometry import Vector, along, cross, dot, norm, numbers, sub

if TYPE_CHECKING:
    from hapscene.scene.mesh import Mesh
    from hapscene.surface.surface_arrays import Surface

__all__ = ["Deformation", "reshape_bodies", "room_for", "shape_of"]

SHIFT_MAX_S: Final = 0.05
"""Longest transition from one shape to the next [s]: three frames at 60 Hz."""

REVERSALS_MAX: Final = 8
"""Shapes in a row that reverse the last change, from which a body oscillates [count]: 0.13 s at 60 Hz."""

OSCILLATION_MIN_M: Final = 1e-4
"""Root mean square of the change of shape above which an oscillation is reported [m]; it is felt at 10 µm already, but
breathing noise of a simulation is not its instability."""

RESETS_MAX: Final = 4
"""Most surfaces that the proxy is moved through in a tick, in a shape that intersects itself [count]."""

_RESET: Final = int(Flag.PROXY_RESET)

FLAT: Final = 1e-9
"""Double area of a face over its longest edge squared below which its normal is undefined [1]."""


class Deformation:
    """The shapes of one body of a world that has room for them (see `room_for`).

    Args:
        world: world whose records are written.
        index: index of the body in the world.
        name: its name.
        mesh: mesh with the faces that all shapes share.
        first: first row of the shapes in `World.corners_m`.
        crease_rad: see `build_world`.
    """

    def __init__(self, world: World, index: int, name: str, mesh: "Mesh", *, first: int, crease_rad: float) -> None:
        self._index = index
        self._faces, self._beyond = np.ascontiguousarray(mesh.faces, np.int32), mesh.neighbours.beyond
        row, proxy = world.bodies[index], world.proxy[0]
        self._overlap_m = EDGE_OVERLAP * float(row.skin_m)
        self._groups = CornerGroups(mesh, crease_rad) if crease_rad > 0.0 else None
        self._searches = [RefittedSearch(self._faces) for _ in range(SHAPES)]
        self._name, self._reversals = name, 0
        self._last = np.asarray(mesh.vertices_m, np.float64)
        self._step = np.zeros_like(self._last)
        row.face_count = len(self._faces)
        row.shape_face = first + len(self._faces) * np.arange(SHAPES)
        row.shape_tree = len(world.tree) - 2 * row.leaf_count * np.arange(SHAPES, 0, -1)
        row.shape_search = [search.handle for search in self._searches]
        row.next, proxy.reshaped = proxy.reshaped, index + 1

    def post(self, world: World, vertices: NDArray[np.float64]) -> None:
        """Post a shape (N, 3), checked by `shape_of`, that the body takes in its next tick."""
        self._check(vertices)
        row, free = world.bodies[self._index], list[int]()
        while not free:  # all three are in use for less than a microsecond, while a tick takes a shape over
            used = row.shape_used, row.shape_taking, row.shape_posted
            free = [k for k in range(SHAPES) if k + 1 not in used]
        to = free[0]
        first = int(row.shape_face[to])
        packed = world.corners_m[first : first + len(self._faces)]
        pack_faces(vertices, self._faces, self._beyond, packed)
        if self._groups is not None:
            packed[:, 4:] = self._groups.normals(packed[:, :3])
        if row.tree_count > 0:
            order = world.tree_face[row.tree_face : row.tree_face + row.tree_count]
            nodes = world.tree[row.shape_tree[to] :][: 2 * row.leaf_count]
            fit_cylinders(np.ascontiguousarray(packed[:, :3]), order, nodes)
        center, radius = self._searches[to].refit(vertices, self._overlap_m)
        row.shape_center_B_m[to], row.shape_radius_m[to] = center, radius
        row.shape_posted = to + 1

    def _check(self, vertices: NDArray[np.float64]) -> None:
        """Warn once if the body oscillates: many shapes in a row take back most of the last change."""
        step, self._last = vertices - self._last, vertices
        square, back = float(np.vdot(step, step)), -float(np.vdot(step, self._step))
        size_m = math.sqrt(square / len(vertices))
        self._reversals = self._reversals + 1 if back > 0.5 * square and size_m > OSCILLATION_MIN_M else 0
        self._step = step
        if self._reversals == REVERSALS_MAX:
            warn(
                f"body {self._name!r} oscillates: each of its last {REVERSALS_MAX} shapes took back most of the change "
                f"before, by {1e3 * size_m:.3g} mm on average. The simulation of the body is probably unstable: use "
                "shorter steps, more damping, or a softer swatch",
                UsageWarning,
            )


def shape_of(vertices_m: ArrayLike, count: int, name: str) -> NDArray[np.float64]:
    """Return the vertices (N, 3) of a new shape of a body as a contiguous array.

    Raises:
        PathError: `vertices_m` is not numeric.
        SceneError: the number of vertices is not that of the mesh, or a vertex is not finite.
    """
    vertices = numbers(vertices_m)
    if vertices.shape != (count, 3):
        raise SceneError(f"body {name!r}: vertices_m has shape {vertices.shape}, expected ({count}, 3) as its mesh has")
    if not np.abs(vertices).max() <= REACH_MAX_M:  # also False for NaN
        raise SceneError(f"body {name!r}: vertices_m must be finite and within {REACH_MAX_M:g} m of the origin")
    return np.ascontiguousarray(vertices)


def room_for(world: World, mesh: "Mesh", index: int) -> tuple[World, int]:
    """Return a world with room for the shapes of a body behind its corners and trees, and the first row of corners.

    A loop that runs on the old world continues to work; it ignores shapes beyond the end of its array.
    """
    first = len(world.corners_m)
    room = np.zeros((SHAPES * len(mesh.faces), *world.corners_m.shape[1:]))
    trees = np.zeros((2 * SHAPES * world.bodies[index].leaf_count, 8), np.float32)
    tree = np.concatenate((world.tree, trees))
    return world._replace(corners_m=np.concatenate((world.corners_m, room)), tree=tree), first


@native
def reshape_bodies(world: "World", surface: "Surface") -> None:
    """Take over posted shapes and advance the transitions; runs after `place_bodies` has placed the bodies."""
    k = world.proxy[0].reshaped
    while k > 0:
        body = world.bodies[k - 1]
        body.shape_ticks += 1
        if body.shape_posted != body.shape_used or body.shift_s > 0.0:
            _update_shape(world, surface, k - 1)
        k = body.next


@native
def _update_shape(world: "World", surface: "Surface", index: int) -> None:
    """Advance the transition of one body by a tick, and start one if a shape was posted."""
    body, proxy = world.bodies[index], world.proxy[0]
    tick_s, fresh = surface.touch[0].tick_s, surface.memory[0].fresh
    if body.moved == 0:  # `place_bodies` has not set the pose in this tick, so the shift must be removed here
        for i in range(3):
            body.last_p_WB_m[i] = body.p_WB_m[i]
            body.p_WB_m[i] -= body.shift_W_m[i]
    if body.shape_ticks == 1:  # the tick that took the shape may not have found a way out
        _lead_out(world, index)
    if body.shape_posted != body.shape_used:
        posted = 0
        while posted != body.shape_posted:  # announce the shape before reading it, so that `post` does not overwrite it
            posted = body.shape_posted
            body.shape_taking = posted
        if body.shape_face[posted - 1] + body.face_count <= len(world.corners_m):
            span_s = body.shape_ticks * tick_s if body.shape_used > 0 else SHIFT_MAX_S
            _take_shape(world, index, posted)
            body.shift_s = min(span_s, SHIFT_MAX_S)
            body.shape_ticks = 0
    goes_on = fresh == 0 and body.shift_s > tick_s
    fade = (body.shift_s - tick_s) / body.shift_s if goes_on else 0.0
    body.shift_s = body.shift_s - tick_s if goes_on else 0.0
    for i in range(3):
        body.shift_W_m[i] *= fade
        body.p_WB_m[i] += body.shift_W_m[i]
    if fresh == 1:
        for i in range(3):
            body.last_p_WB_m[i] = body.p_WB_m[i]
    elif body.moved == 0:
        body.moved = 1
        world.moved[0] += 1
        world.moved[world.moved[0]] = index
    proxy.near_margin_m -= max(0.0, update_ball(body, world.ball_W_m[index]))
    if fresh == 1:
        at = surface.memory[0].p_WT_m
        place_proxy(world, (at[0], at[1], at[2]))


@native
def _take_shape(world: "World", index: int, posted: int) -> None:
    """Switch a body to a shape, and shift it by the displacement of its surface at the point nearest to the proxy."""
    body, proxy = world.bodies[index], world.proxy[0]
    p = to_body_last(body, (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2]))
    nearest = _look_around(world, index, p)
    backs = 0
    for way in range(WAYS):
        backs += proxy.ray_face[way] >= 0 and proxy.ray_side[way] < 0.0
    at, before, gone = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if nearest >= 0:
        triangle = corners(world, body, nearest)
        at = weights(triangle, p)
        before = blend(triangle, at)
    k = posted - 1
    body.search, body.radius_m, body.face = body.shape_search[k], body.shape_radius_m[k], body.shape_face[k]
    body.tree = body.shape_tree[k]
    for i in range(3):
        body.center_B_m[i] = body.shape_center_B_m[k, i]
    body.shape_used = posted
    _drop_flat(world, index)
    if nearest >= 0:
        gone = sub(blend(corners(world, body, nearest), at), before)
    if not math.isfinite(gone[0] + gone[1] + gone[2]):  # a face without area
        gone = (0.0, 0.0, 0.0)
    for i in range(3):
        for j in range(3):
            body.shift_W_m[i] -= body.R_WB[i, j] * gone[j]
            body.last_p_WB_m[i] -= body.last_R_WB[i, j] * gone[j]
    if body.punctured == 0:
        _meet(world, index, along(p, 1.0, gone))
        body.enclosing = backs >= BACKS_MIN
        if body.two_sided == 1 or not _is_held(world, index, along(p, 1.0, gone)):
            _lead_out(world, index)


@native
def _look_around(world: "World", index: int, p_B: Vector) -> int:
    """Record the faces that rays from a point meet in `proxy.ray_face`, and on which side of them the point is.

    Returns the face in contact with the proxy, otherwise the nearest one, or −1.
    """
    body, proxy = world.bodies[index], world.proxy[0]
    for way in range(WAYS):
        proxy.ray_face[way] = -1
    c = body.center_B_m
    near = norm(sub(p_B, (c[0], c[1], c[2]))) <= 2.0 * body.radius_m
    nearest, found = math.inf, -1
    for way in range(WAYS if near else 0):
        face, away_m, back = face_along(world, index, p_B, way)
        proxy.ray_face[way], proxy.ray_side[way] = face, -1.0 if back else 1.0
        if face >= 0 and away_m < nearest:
            nearest, found = away_m, face
    for i in range(proxy.count):
        if proxy.body[i] == index:
            return int(proxy.face[i])
    return found


@native
def _meet(world: "World", index: int, now_B: Vector) -> None:
    """Add the recorded faces that have passed the proxy, which is at `now_B` in the body's frame, to its planes."""
    body, proxy = world.bodies[index], world.proxy[0]
    for way in range(WAYS):
        face = proxy.ray_face[way]
        for other in range(way):
            if proxy.ray_face[other] == face:
                face = -1
        held = False
        for i in range(proxy.count):
            held |= proxy.body[i] == index and proxy.face[i] == face
        if face < 0 or (held and body.two_sided == 0):  # a plane of a one-sided face moves the proxy out by itself
            continue
        n, offset = plane(*corners(world, body, face))
        side = proxy.ray_side[way]
        behind_m = -side * (dot(n, now_B) - offset)
        if not (behind_m > 0.0 and lies_over_in_body(world, body, face, now_B, 2.0 * behind_m + body.skin_m)):
            continue
        if side > 0.0 or body.two_sided == 1:
            if not held:
                _hold_by(world, index, face, side)
            if body.two_sided == 1:  # a two-sided face would otherwise constrain the proxy on its back
                out_m = side * (behind_m + body.skin_m)
                for i in range(3):
                    for j in range(3):
                        proxy.p_W_m[i] += out_m * body.last_R_WB[i, j] * n[j]


@native
def _is_held(world: "World", index: int, now_B: Vector) -> bool:
    """Return whether the proxy, which is at `now_B`, is behind a plane of a body, so that the plane moves it out."""
    body, proxy = world.bodies[index], world.proxy[0]
    for i in range(proxy.count):
        if proxy.body[i] == index:
            n, offset = plane(*corners(world, body, proxy.face[i]))
            if dot(n, now_B) < offset and lies_over_in_body(world, body, proxy.face[i], now_B, body.skin_m):
                return True
    return False


@native
def _lead_out(world: "World", index: int) -> None:
    """Set the proxy on the nearest surface if the new shape has put it on the other side of a closed surface."""
    body, proxy = world.bodies[index], world.proxy[0]
    was_inside = body.enclosing == 1
    if body.punctured != 0 or (was_inside and body.two_sided == 0):
        return
    side = -1.0 if was_inside else 1.0
    p = to_body_last(body, (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2]))
    for _ in range(RESETS_MAX):
        if encloses(world, index, p) == was_inside:
            return
        nearest, found, q = math.inf, -1, p
        for way in range(WAYS):
            face, away_m, back = face_along(world, index, p, way)
            if face >= 0 and back != was_inside and away_m < nearest:
                n, _ = plane(*corners(world, body, face))
                q = along(along(p, away_m, look_direction(way)), side * body.skin_m, n)
                nearest, found = away_m, face
        if found < 0:
            return
        drop_planes_of(proxy, index)
        _hold_by(world, index, found, side)
        proxy.moving_flags |= _RESET
        proxy.placed = 1  # a ball makes room for itself
        p = q
        for i in range(3):
            proxy.p_W_m[i] = body.last_p_WB_m[i]
            for j in range(3):
                proxy.p_W_m[i] += body.last_R_WB[i, j] * p[j]


@native
def _hold_by(world: "World", index: int, face: int, side: float) -> None:
    """Add one more face to the planes of the proxy if there is room; `_carry` computes the plane itself."""
    body, proxy = world.bodies[index], world.proxy[0]
    k = proxy.count
    if k == DROPPED:
        return
    proxy.body[k], proxy.face[k], proxy.side[k] = index, face, side
    proxy.skin_m[k] = body.skin_m
    proxy.met[k] = 1
    proxy.count = k + 1


@native
def _drop_flat(world: "World", index: int) -> None:
    """Drop the planes of faces of a body whose normal is undefined in its new shape."""
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
