"""Sweeps the proxy along a straight line and finds the first face that stops it.

Embree finds a face along the ray in float32. Whether the ray meets that face from outside, and where the proxy must
stop, is then computed in float64 from the corners of the mesh. The ray extends beyond the goal by `LOOK_AHEAD` skins:
at a grazing angle the proxy can come within one skin of a face that the ray itself only meets behind the goal.
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

__all__ = ["SATISFIED", "cast", "cast_body", "put_face"]

SATISFIED = 0.01
"""Depth inside the skin of a face at which a goal still counts as free [skins]."""


@inlined
def cast(world: "World", origin_W: Vector, goal_W: Vector) -> float:
    """Sweep the proxy against all bodies in `world.near` and keep the nearest stop.

    Returns the fraction of the way at which the proxy must stop, in [0, 1], and appends the plane of the face that
    stops it to `world.proxy[0]`. Returns 2.0 and appends nothing if the way is free.
    """
    proxy = world.proxy[0]
    best = 2.0
    for k in range(proxy.near_count):
        i = world.near[k]
        body = world.bodies[i]
        if body.punctured != 0:
            continue
        stop = cast_body(world, i, to_body(body, origin_W), to_body(body, goal_W), best)
        best = min(best, stop)
    if best <= 1.0:
        proxy.count += 1
    return best


@inlined
def cast_body(world: "World", index: int, origin_B: Vector, goal_B: Vector, best: float) -> float:
    """Sweep the proxy against one body, in the frame of that body.

    Returns the same fraction as `cast`. A stop nearer than `best` is written to the slot after the last plane; the
    caller increments the count. Other stops are not written, so the nearest one found so far is kept.
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
    if dot(n, direction) >= 0.0 and body.two_sided == 0:  # met from behind: cast again, through back faces
        face = first_face(body.search, world.ray, origin, direction, far, world.fronts_only.ctypes.data)
        if face < 0:
            return 2.0
        va, vb, vc = corners(world, body, face)
        n, offset = plane(va, vb, vc)
    side = 1.0
    if dot(n, direction) >= 0.0:
        side, offset = -1.0, -offset
        n = (-n[0], -n[1], -n[2])
    # Heights above the plane decide, not the ray's own distance: `remaining` is the height of the goal. The proxy stops
    # where its height has fallen to one skin, which is a linear interpolation between the heights of start and goal.
    remaining = dot(n, goal_B) - offset
    if remaining >= (1.0 - SATISFIED) * skin:
        return 2.0
    start = dot(n, origin_B) - offset
    stop = 0.0
    if start > skin:
        stop = (start - skin) / (start - remaining)
    if stop < best:
        _put_plane(proxy, proxy.count, body, index, face, side, n, offset)
    return stop


@inlined
def put_face(world: "World", k: int, index: int, face: int, side: float) -> None:
    """Write the plane of a face that no ray from the present proxy position met to slot `k`."""
    body = world.bodies[index]
    n, offset = plane(*corners(world, body, face))
    _put_plane(world.proxy[0], k, body, index, face, side, (side * n[0], side * n[1], side * n[2]), side * offset)
    world.proxy[0].met[k] = 0


@inlined
def _put_plane(
    proxy: np.record, k: int, body: np.record, index: int, face: int, side: float, n_B: Vector, offset_B: float
) -> None:
    """Write a plane, given in the frame of its body, to slot `k` in the world frame."""
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
