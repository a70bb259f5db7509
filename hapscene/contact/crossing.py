"""Gliding over edges: what lies beyond one is known from the mesh, and a ray proves that nothing else is in the way.

Else a proxy that leaves its face casts three rays: over the edge, down until a face stops it, and along that one. Here
the faces are followed from edge to edge, until those that hold the proxy lie under it: over a convex edge the next one
takes the place of the last, over a concave one both may hold. Where the straight way there is free it is one ray; one
more for each edge that it would cut, above which they meet. What a ray meets holds the proxy, as ever. Where the mesh
does not say what comes, the proxy is moved by rays alone.
"""

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.compiled.native import inlined, native
from hapscene.constants import EDGE_OVERLAP
from hapscene.contact.cast import cast, put_plane
from hapscene.contact.planes import copy_plane, drop_idle, nearest, trust
from hapscene.contact.triangle import corners, edge_past, is_narrow, plane, to_body, to_world
from hapscene.contact.world import ASIDE, FACES_MAX, SAVED
from hapscene.geometry import Vector, along, cross, dot, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["MET", "OVER", "PAST", "RESTS", "UNKNOWN", "cross_edges", "lies_over_planes"]

RESTS: Final = 0
"""The proxy has come to rest, on other faces."""

MET: Final = 1
"""It has met a face, and goes on from there."""

UNKNOWN: Final = 2
"""Rays have to find out what holds it."""

OVER: Final = 0
"""A point lies over the faces of all planes."""

NOT_PAST: Final = 1
"""It is past no edge of those faces that were looked at."""

PAST: Final = 2
"""It is past an edge of one."""

LIFT: Final = 20.0
"""How far above an edge the way passes that would cut it [skins]."""

CLEAR: Final = 0.2
"""How far off an edge a way must pass to be tried [skins]: it starts and ends one skin off."""


@native
def cross_edges(world: "World", p_W: Vector, tool_W: Vector, goal_W: Vector) -> tuple[int, Vector]:
    """Move a proxy at `p_W`, whose planes allow `goal_W`, on over the edges that this is past.

    Returns `RESTS`, `MET` or `UNKNOWN`, and where it is.
    """
    proxy = world.proxy[0]
    count = proxy.count
    for i in range(count):
        copy_plane(proxy, i, SAVED + i)
    place_W, crossed, where = goal_W, 0, PAST
    while where == PAST:
        for i in range(proxy.count - 1, -1, -1):  # all at one place: along a groove both go on
            edge = _edge_past(world, i, place_W)
            if edge < 0:
                continue
            if crossed == FACES_MAX or not _cross(world, i, edge, crossed):
                return _give_up(proxy, count, p_W)
            crossed += 1
        found, place_W = nearest(proxy, tool_W, 1.0)
        if not found:
            return _give_up(proxy, count, p_W)
        drop_idle(proxy)
        where = lies_over_planes(world, place_W)
    if norm(sub(place_W, tool_W)) > norm(sub(p_W, tool_W)):
        return _give_up(proxy, count, p_W)
    at_W, first = p_W, 0
    while True:
        first, to_W = _next_corner(world, first, crossed, at_W, place_W)
        stop = cast(world, at_W, to_W)
        if stop <= 1.0:
            if proxy.count == 1:  # it would have come off all faces: what is past the edge is no way to the tool
                return _give_up(proxy, count, p_W)
            copy_plane(proxy, proxy.count - 1, 0)
            proxy.count, proxy.met[0] = 1, 0
            return MET, along(at_W, stop, sub(to_W, at_W))
        if first > crossed:
            if where == OVER:
                return RESTS, place_W
            trust(proxy, proxy.count, math.inf)  # it is no more where a ray met the face of a plane
            return MET, place_W
        at_W = to_W


@inlined
def _next_corner(world: "World", first: int, crossed: int, p_W: Vector, place_W: Vector) -> tuple[int, Vector]:
    """The first crossed edge, from `first` on, that the straight way to a place would cut, and a point above it.

    Returns the number of the edge after it, and the point; more than `crossed`, and the place, where it is straight.
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
    """Have the planes hold the proxy that did before."""
    for i in range(count):
        copy_plane(proxy, SAVED + i, i)
    proxy.count = count
    return UNKNOWN, p_W


@inlined
def lies_over_planes(world: "World", p_W: Vector) -> int:
    """Whether a point lies over the faces of all planes: `OVER`, `NOT_PAST` or `PAST`.

    A plane that was met from where the proxy is holds it wherever its face lies: that is not looked at.
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
    """The edge of the face of plane i that a point is past, −1 for none; none of one that a ray has just met."""
    proxy = world.proxy[0]
    if proxy.met[i] != 0:
        return -1
    body = world.bodies[proxy.body[i]]
    a, b, c = corners(world, body, proxy.face[i])
    return edge_past(a, b, c, to_body(body, p_W), proxy.skin_m[i])


@inlined
def _cross(world: "World", i: int, edge: int, crossed: int) -> bool:
    """Take the face beyond an edge in the place of plane i, or to it where it rises; False where that is not known."""
    proxy = world.proxy[0]
    index, side = proxy.body[i], proxy.side[i]
    body = world.bodies[index]
    face: Any = np.int64(world.beyond[body.mesh_row + proxy.face[i], edge])
    if face < 0:
        return False
    here = proxy.crossed[crossed]
    here[0], here[1], here[2] = index, 3 * proxy.face[i] + edge, int(side)
    holds = False
    for j in range(proxy.count):
        holds |= proxy.face[j] == face and proxy.body[j] == index
    for j in range(crossed):  # it was there
        holds |= proxy.crossed[j, 1] // 3 == face and proxy.crossed[j, 0] == index
    if holds:
        copy_plane(proxy, proxy.count - 1, i)
        proxy.count -= 1
        return bool(proxy.count > 0)
    a, b, c = corners(world, body, face)
    if is_narrow(a, b, c, EDGE_OVERLAP * body.skin_m):
        return False
    o, u, v = corners(world, body, proxy.face[i])
    n = cross(sub(u, o), sub(v, o))
    slot = i
    if side * (dot(n, sub(a, o)) + dot(n, sub(b, o)) + dot(n, sub(c, o))) > 0.0:
        slot = proxy.count
        if slot == ASIDE:
            return False
        proxy.count += 1
    n, offset = plane(a, b, c)
    put_plane(proxy, slot, body, index, face, side, (side * n[0], side * n[1], side * n[2]), side * offset)
    proxy.met[slot] = 0
    return True
