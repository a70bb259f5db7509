"""Casting the proxy from where it is towards a goal: the first face in the way, in float64.

Embree names faces along the ray; whether one is met from outside, and where the proxy must stop, is computed from
the mesh's own corners. The ray looks past the goal (`LOOK_AHEAD`), because a face met at a grazing angle comes
within a skin of the goal without lying on the way.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from hapscene.compiled.native import inlined
from hapscene.constants import LOOK_AHEAD
from hapscene.contact.embree import first_face
from hapscene.contact.triangle import corners, plane, to_body, turn_to_world
from hapscene.geometry import Vector, dot, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["SATISFIED", "cast", "cast_body", "put_plane"]

SATISFIED = 0.01
"""How far inside a skin the goal may be before the face counts as in the way, in skins [1]."""


@inlined
def cast(world: "World", origin_W: Vector, goal_W: Vector) -> float:
    """Cast against all bodies in `world.near`; the nearest stop wins.

    Returns the fraction of the way at which the proxy has to stop, in [0, 1], and appends the plane of the face that
    stops it to `world.proxy[0]`; 2.0, and nothing appended, where the way is free.
    """
    proxy = world.proxy[0]
    best = 2.0
    for k in range(proxy.near_count):
        i = world.near[k]
        body = world.bodies[i]
        if body.passed != 0:
            continue
        stop = cast_body(world, i, to_body(body, origin_W), to_body(body, goal_W), best)
        best = min(best, stop)
    if best <= 1.0:
        proxy.count += 1
    return best


@inlined
def cast_body(world: "World", index: int, origin_B: Vector, goal_B: Vector, best: float) -> float:
    """Cast against one body, in its frame; as `cast`, but leaves the plane in the slot after the last one.

    Only a stop nearer than `best` is written, so that the caller's nearest one stays.
    """
    body = world.bodies[index]
    proxy = world.proxy[0]
    way = sub(goal_B, origin_B)
    length = math.sqrt(dot(way, way))
    if length == 0.0:
        return 2.0
    direction = (way[0] / length, way[1] / length, way[2] / length)
    c = body.center_B_m
    origin = (origin_B[0] - c[0], origin_B[1] - c[1], origin_B[2] - c[2])
    skin = body.skin_m
    far = length + LOOK_AHEAD * skin
    face = first_face(body.search, world.ray, origin, direction, far, 0)
    if face < 0:
        return 2.0
    va, vb, vc = corners(world, body, face)
    n, offset = plane(va, vb, vc)
    if dot(n, direction) >= 0.0 and body.two_sided == 0:  # from behind: look for one that is met from outside
        face = first_face(body.search, world.ray, origin, direction, far, world.fronts_only.ctypes.data)
        if face < 0:
            return 2.0
        va, vb, vc = corners(world, body, face)
        n, offset = plane(va, vb, vc)
    side = 1.0
    if dot(n, direction) >= 0.0:
        side, offset = -1.0, -offset
        n = (-n[0], -n[1], -n[2])
    left = dot(n, goal_B) - offset
    if left >= (1.0 - SATISFIED) * skin:
        return 2.0
    start = dot(n, origin_B) - offset
    stop = 0.0
    if start > skin:
        stop = (start - skin) / (start - left)
    if stop < best:
        put_plane(proxy, proxy.count, body, index, face, side, n, offset)
    return stop


@inlined
def put_plane(
    proxy: np.record, k: int, body: np.record, index: int, face: int, side: float, n_B: Vector, offset_B: float
) -> None:
    """Write a plane, given in the body's frame, into slot k."""
    n = turn_to_world(body, n_B)
    o = body.p_WB_m
    for i in range(3):
        proxy.nhat_W[k, i] = n[i]
    proxy.offset_m[k] = offset_B + n[0] * o[0] + n[1] * o[1] + n[2] * o[2]
    proxy.skin_m[k] = body.skin_m
    proxy.body[k] = index
    proxy.face[k] = face
    proxy.side[k] = side
    proxy.met[k] = 1
