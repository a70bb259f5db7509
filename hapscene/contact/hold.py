"""The planes that hold the proxy: dropped when they push no more or reach under it no more, taken back when they do."""

from typing import Any

from hapscene.contact.cast import SATISFIED
from hapscene.contact.face import corners, lies_over, plane, turn_to_world
from hapscene.contact.geometry import Vector
from hapscene.contact.world import ASIDE, SLOTS
from hapscene.native import native

NEARBY = 10.0
"""How far the proxy moves before a plane that was taken back must lie under it again, in skins [1]."""


@native
def trust(proxy: Any, first: int, moved_m: float) -> None:
    """The proxy has moved: only planes from `first` on were met on the way it is on.

    A plane that was taken back is trusted for a little longer, or near a corner it could be dropped and taken back
    for ever.
    """
    for i in range(first):
        if proxy.met[i] == 1 or moved_m > NEARBY * proxy.skin_m[i]:
            proxy.met[i] = 0


@native
def drop_idle(proxy: Any) -> None:
    """Drop the planes that do not push; at most three are left."""
    kept = 0
    for i in range(proxy.count):
        if proxy.push_m[i] > 0.0:
            if kept != i:
                copy_plane(proxy, i, kept)
            kept += 1
    proxy.count = kept


@native
def drop_unsupported(world: Any, p_W: Vector) -> bool:
    """Drop the planes whose faces do not reach under the proxy; True where there was one.

    A plane that was met from where the proxy is holds it wherever its face lies: in a narrow groove the face below
    the proxy's foot may be another one.
    """
    proxy = world.proxy[0]
    kept = 0
    count = proxy.count
    for i in range(count):
        body = world.bodies[proxy.body[i]]
        if proxy.met[i] != 0 or lies_over(world, body, proxy.face[i], p_W, proxy.skin_m[i]):
            if kept != i:
                copy_plane(proxy, i, kept)
            kept += 1
        else:
            copy_plane(proxy, i, ASIDE + proxy.aside % (SLOTS - ASIDE))
            proxy.aside += 1
    proxy.count = kept
    return bool(kept < count)


@native
def take_back(world: Any, p_W: Vector, goal_W: Vector) -> bool:
    """Take a dropped plane back where the next goal lies under it and over its face, and the proxy still above it.

    So it is at a concave edge of a fraction of a degree: too flat for a ray a skin above one face to meet the other.
    """
    proxy = world.proxy[0]
    for k in range(min(proxy.aside, SLOTS - ASIDE)):
        i = ASIDE + k
        skin = proxy.skin_m[i]
        if _above(proxy, i, goal_W) >= (1.0 - SATISFIED) * skin or _above(proxy, i, p_W) < 0.0 or _holds(proxy, i):
            continue
        if lies_over(world, world.bodies[proxy.body[i]], proxy.face[i], goal_W, skin):
            copy_plane(proxy, i, proxy.count)
            proxy.met[proxy.count] = 2
            proxy.count += 1
            return True
    return False


@native
def _above(proxy: Any, slot: int, p_W: Vector) -> float:
    """Height of a point over the plane in a slot [m]."""
    n = proxy.nhat_W[slot]
    return float(n[0] * p_W[0] + n[1] * p_W[1] + n[2] * p_W[2] - proxy.offset_m[slot])


@native
def _holds(proxy: Any, slot: int) -> bool:
    """Whether the face in a slot is among those that hold the proxy."""
    for i in range(proxy.count):
        if proxy.face[i] == proxy.face[slot] and proxy.body[i] == proxy.body[slot]:
            return True
    return False


@native
def forget_oldest(proxy: Any) -> None:
    """Drop the plane that has held the proxy longest."""
    for i in range(proxy.count - 1):
        copy_plane(proxy, i + 1, i)
    proxy.count -= 1


@native
def place_plane(world: Any, i: int) -> None:
    """Compute plane i of the proxy anew from its face at the body's present pose."""
    proxy = world.proxy[0]
    body = world.bodies[proxy.body[i]]
    a, b, c = corners(world, body, proxy.face[i])
    n_B, offset = plane(a, b, c)
    side = proxy.side[i]
    n = turn_to_world(body, n_B)
    for k in range(3):
        proxy.nhat_W[i, k] = side * n[k]
    o = body.p_WB_m
    proxy.offset_m[i] = side * (offset + n[0] * o[0] + n[1] * o[1] + n[2] * o[2])


@native
def copy_plane(proxy: Any, source: int, target: int) -> None:
    for k in range(3):
        proxy.nhat_W[target, k] = proxy.nhat_W[source, k]
    proxy.offset_m[target] = proxy.offset_m[source]
    proxy.skin_m[target] = proxy.skin_m[source]
    proxy.body[target] = proxy.body[source]
    proxy.face[target] = proxy.face[source]
    proxy.side[target] = proxy.side[source]
    proxy.met[target] = proxy.met[source]
