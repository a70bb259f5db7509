"""Moves the proxy across mesh edges by following face adjacency instead of casting rays downwards.

Without adjacency, a proxy that leaves its face needs three casts: past the edge, down to the next face, and along that
face. This module follows the faces from edge to edge until the foot of the new proxy position lies on the faces that
constrain it. Across a convex edge the next face replaces the last one; across a concave edge both can constrain the
proxy. A cast along the straight path then checks that no other face blocks it. If that path would cut through a crossed
edge, it is bent to pass above the edge, which needs a second cast. If the mesh has no usable neighbour, `cross_edges`
returns `UNKNOWN` and the caller uses casts only.
"""

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.compiled.native import inlined, native
from hapscene.constants import EDGE_OVERLAP
from hapscene.contact.cast import cast, put_face
from hapscene.contact.planes import copy_plane, drop_idle, nearest, trust
from hapscene.contact.triangle import beyond, corners, edge_past, fetch_neighbours, is_narrow, to_body, to_world
from hapscene.contact.world import DROPPED, FACES_MAX, SAVED
from hapscene.geometry import Vector, along, cross, dot, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["BLOCKED", "OVER", "PAST", "SETTLED", "UNKNOWN", "cross_edges", "lies_over_planes"]

SETTLED: Final = 0
"""The proxy is in equilibrium on other faces."""

BLOCKED: Final = 1
"""A face stopped the proxy; the search continues from there."""

UNKNOWN: Final = 2
"""Adjacency does not give the answer; the caller must search with casts."""

OVER: Final = 0
"""The foot of the point lies on the faces of all planes."""

NOT_PAST: Final = 1
"""The point is past no edge of the faces that were tested, but not all faces were tested."""

PAST: Final = 2
"""The point is past an edge of one face."""

LIFT: Final = 20.0
"""Height above an edge at which a way that would cut the edge passes over it [skins]."""

CLEAR: Final = 0.2
"""Least clearance of a way above a crossed edge [skins]. The way starts and ends at a height of one skin."""


@native
def cross_edges(world: "World", p_W: Vector, tool_W: Vector, goal_W: Vector) -> tuple[int, Vector]:
    """Follow face adjacency for a proxy at `p_W` whose unconstrained `goal_W` lies past one or more edges.

    Each round replaces or adds the faces beyond the edges and solves for the closest point again (`nearest`). The
    rounds end when that point lies on its faces. The result is rejected if it is farther from the device than before.

    Returns `SETTLED`, `BLOCKED` or `UNKNOWN`, and the proxy position.
    """
    proxy = world.proxy[0]
    count = proxy.count
    for i in range(count):
        copy_plane(proxy, i, SAVED + i)
    place_W, crossed, before = goal_W, 0, -1
    while crossed > before:
        before = crossed
        for i in range(proxy.count - 1, -1, -1):  # all in one round: along a groove both faces end here
            edge = _edge_past(world, i, place_W)
            if edge < 0:
                continue
            if crossed == FACES_MAX or not _cross(world, i, edge, crossed):
                return _give_up(proxy, count, p_W)
            crossed += 1
        if crossed > before:
            found, place_W = nearest(proxy, tool_W, 1.0)
            if not found:
                return _give_up(proxy, count, p_W)
            drop_idle(proxy)
    if norm(sub(place_W, tool_W)) > norm(sub(p_W, tool_W)):
        return _give_up(proxy, count, p_W)
    # Second phase: sweep along the way that was found. It bends above each crossed edge that it would otherwise cut.
    at_W, first = p_W, 0
    while True:
        first, to_W = _next_corner(world, first, crossed, at_W, place_W)
        stop = cast(world, at_W, to_W)
        if stop <= 1.0:
            if proxy.count == 1:  # the proxy would leave all faces: what is past the edge does not lead to the device
                return _give_up(proxy, count, p_W)
            copy_plane(proxy, proxy.count - 1, 0)
            proxy.count, proxy.met[0] = 1, 0
            return BLOCKED, along(at_W, stop, sub(to_W, at_W))
        if first > crossed:
            for i in range(proxy.count):
                if proxy.met[i] != 0:
                    trust(proxy, proxy.count, math.inf)  # the proxy is no longer where a ray met the face of a plane
                    return BLOCKED, place_W
            return SETTLED, place_W
        at_W = to_W


@inlined
def _next_corner(world: "World", first: int, crossed: int, p_W: Vector, place_W: Vector) -> tuple[int, Vector]:
    """Find the next crossed edge, from number `first` on, that the straight way to `place_W` would cut.

    Returns the number of the edge after it and a point above the edge, or `crossed + 1` and `place_W` if the way is
    free of edges.
    """
    proxy = world.proxy[0]
    for i in range(first, crossed):
        body, face, k = world.bodies[proxy.crossed[i, 0]], proxy.crossed[i, 1] // 3, proxy.crossed[i, 1] % 3
        triangle = corners(world, body, face)
        p, place = to_body(body, p_W), to_body(body, place_W)
        o = triangle[k]
        n = cross(sub(triangle[1], triangle[0]), sub(triangle[2], triangle[0]))
        inwards = cross(n, sub(triangle[(k + 1) % 3], o))
        inside, outside = dot(inwards, sub(p, o)), -dot(inwards, sub(place, o))
        if inside > 0.0 and outside > 0.0:
            double_area = norm(n)
            here, there = dot(n, sub(p, o)) / double_area, dot(n, sub(place, o)) / double_area
            side = float(proxy.crossed[i, 2])
            part = inside / (inside + outside)
            height = side * (here + part * (there - here))
            if height < CLEAR * body.skin_m:
                lift = side * (LIFT * body.skin_m - height) / double_area
                return i + 1, to_world(body, along(along(p, part, sub(place, p)), lift, n))
    return crossed + 1, place_W


@native
def _give_up(proxy: np.record, count: int, p_W: Vector) -> tuple[int, Vector]:
    """Restore the planes that constrained the proxy before, and report that adjacency gives no answer."""
    for i in range(count):
        copy_plane(proxy, SAVED + i, i)
    proxy.count = count
    return UNKNOWN, p_W


@inlined
def lies_over_planes(world: "World", p_W: Vector) -> int:
    """Return whether the feet of a point lie on the faces of all planes: `OVER`, `NOT_PAST` or `PAST`.

    A plane whose face was met by a ray from the present proxy position constrains it wherever that face ends, and is
    not tested.
    """
    where = OVER
    for i in range(world.proxy[0].count):
        if world.proxy[0].met[i] != 0:
            where = NOT_PAST
        elif _edge_past(world, i, p_W) >= 0:
            return PAST
    return where


@inlined
def _edge_past(world: "World", i: int, p_W: Vector) -> int:
    """Return the edge of the face of plane `i` that a point is past, −1 for none or if a ray has just met the face."""
    proxy = world.proxy[0]
    if proxy.met[i] != 0:
        return -1
    body = world.bodies[proxy.body[i]]
    a, b, c = corners(world, body, proxy.face[i])
    return edge_past(a, b, c, to_body(body, p_W), proxy.skin_m[i])


@inlined
def _cross(world: "World", i: int, edge: int, crossed: int) -> bool:
    """Replace plane `i` by the face beyond an edge, or add that face if the edge is concave.

    Returns False if the mesh has no usable face there, or if no plane is left.
    """
    proxy = world.proxy[0]
    index, side = proxy.body[i], proxy.side[i]
    body = world.bodies[index]
    face = beyond(world, body, proxy.face[i], edge)
    if face < 0:
        return False
    here = proxy.crossed[crossed]
    here[0], here[1], here[2] = index, 3 * proxy.face[i] + edge, int(side)
    holds = False
    for j in range(proxy.count):
        holds |= proxy.face[j] == face and proxy.body[j] == index
    for j in range(crossed):  # a face that was left in this tick: to return to it could loop for ever
        holds |= proxy.crossed[j, 1] // 3 == face and proxy.crossed[j, 0] == index
    if holds:
        copy_plane(proxy, proxy.count - 1, i)
        proxy.count -= 1
        return bool(proxy.count > 0)
    fetch_neighbours(world, body, face)
    a, b, c = corners(world, body, face)
    if is_narrow(a, b, c, EDGE_OVERLAP * body.skin_m):
        return False
    o, u, v = corners(world, body, proxy.face[i])
    n = cross(sub(u, o), sub(v, o))
    slot = i
    # The edge is concave if the corners of the next face lie above the plane of this one: then both are constraints.
    if side * (dot(n, sub(a, o)) + dot(n, sub(b, o)) + dot(n, sub(c, o))) > 0.0:
        slot = proxy.count
        if slot == DROPPED:
            return False
        proxy.count += 1
    put_face(world, slot, index, face, side)
    return True
