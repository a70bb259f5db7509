"""Inside or outside of a body, decided anew from the present position alone: enclosed points and punctured bodies.

A body that the tool has punctured (`Output.release`) is excluded from casts until the proxy is outside again. A ray
runs from the proxy to a point just above the place of entry, which is outside. If the first face on the way is met
from behind, the proxy is inside. A proxy that is outside but touches a face counts as inside until it is clear of the
surface, so that a cast can meet the body again.
"""

import math
from typing import TYPE_CHECKING, Final

from hapscene.compiled.native import native
from hapscene.constants import PASSED_MAX
from hapscene.contact.embree import first_face
from hapscene.contact.planes import drop_planes_of
from hapscene.contact.triangle import blend, closest_point, corners, plane, to_body, weights
from hapscene.contact.world import WAYS
from hapscene.geometry import Vector, along, dot, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = [
    "BACKS_MIN",
    "close_left_punctures",
    "close_puncture",
    "encloses",
    "face_along",
    "look_direction",
    "open_puncture",
]

BACKS_MIN: Final = 10
"""Rays out of `WAYS` that meet a face from behind at a point that a closed body encloses [count]. All do inside, and
none outside; the margin allows for holes, and for parts that a violent shape turned inside out. Under an open sheet
half of them do."""

ABOVE: Final = (4.0, 40.0)
"""Heights above the place of entry of two points that are outside [skins]. Both must be visible to leave the body: the
overlap of faces (`EDGE_OVERLAP`), which reaches into the body at a concave edge, hides one point at most."""

CLEARANCE: Final = 2.0
"""Distance from the proxy within which rays along the axes look for faces before a puncture is closed [skins]. Planes
up to 1.15 skins away are found in any direction; a proxy closer than a skin could pass the face without contact."""

BALL_CLEARANCE: Final = 1.25
"""The same distance for a ball, whose centre leaves a body before it does [radii]. Rays along the axes and diagonals
then find planes up to a radius away in any direction; a closer face would push the ball out with a jump of force."""


@native
def open_puncture(world: "World") -> None:
    """Exclude the touched body from contact, from the next tick on, and drop its planes."""
    proxy = world.proxy[0]
    if proxy.touching == 0 or proxy.puncture_count == PASSED_MAX:
        return
    index, p = proxy.body[proxy.dominant], proxy.p_WP_m
    body = world.bodies[index]
    body.punctured = 1 if proxy.side[proxy.dominant] > 0.0 else -1
    body.entry_face = proxy.face[proxy.dominant]
    a, b, c = corners(world, body, body.entry_face)
    # on the face itself, which can end below the centre of a ball
    at = weights((a, b, c), closest_point(a, b, c, to_body(body, (p[0], p[1], p[2]))))
    for i in range(3):
        body.entry_at[i] = at[i]
    proxy.punctured[proxy.puncture_count] = index
    proxy.puncture_count += 1
    _renew_front(world)
    drop_planes_of(proxy, index)


@native
def close_puncture(world: "World", index: int) -> None:
    """Include a punctured body in contact again."""
    proxy = world.proxy[0]
    kept = 0
    for i in range(proxy.puncture_count):
        if proxy.punctured[i] != index:
            proxy.punctured[kept] = proxy.punctured[i]
            kept += 1
    proxy.puncture_count = kept
    world.bodies[index].punctured = 0
    _renew_front(world)


@native
def _renew_front(world: "World") -> None:
    """Let a ball list the faces nearby again, since other bodies can be met from now on."""
    if len(world.ball) > 0:
        world.ball[0].count = 0


@native
def close_left_punctures(world: "World", p_W: Vector) -> None:
    """Close the punctures of bodies that do not enclose the proxy at `p_W`."""
    proxy = world.proxy[0]
    for i in range(proxy.puncture_count - 1, -1, -1):
        if not _is_inside(world, proxy.punctured[i], p_W):
            close_puncture(world, proxy.punctured[i])


@native
def _is_inside(world: "World", index: int, p_W: Vector) -> bool:
    """Return whether a point is beyond the surface by which the tool entered a punctured body, or touches a face."""
    body, ball, radius_m = world.bodies[index], world.ball_W_m[index], world.proxy[0].radius_m
    if norm(sub(p_W, (ball[0], ball[1], ball[2]))) > ball[3] + BALL_CLEARANCE * radius_m:
        return False
    p = to_body(body, p_W)
    triangle, at = corners(world, body, body.entry_face), body.entry_at
    n, _ = plane(*triangle)
    entry = blend(triangle, (at[0], at[1], at[2]))
    for skins in ABOVE:
        if _is_hidden(world, index, p, along(entry, skins * body.skin_m * body.punctured, n)):
            return True
    c, reach_m = body.center_B_m, CLEARANCE * body.skin_m + BALL_CLEARANCE * radius_m
    for line in range(7 if radius_m > 0.0 else 3):  # the opposite directions are on the same lines
        d = look_direction(line if line < 3 else line + 3)
        start = along((p[0] - c[0], p[1] - c[1], p[2] - c[2]), -reach_m, d)
        if first_face(body.search, world.ray, start, d, 2.0 * reach_m, 0) >= 0:
            return True
    return False


@native
def _is_hidden(world: "World", index: int, p_B: Vector, outside_B: Vector) -> bool:
    """Return whether the first face on the way from a point to a point outside is met from the inside of a body."""
    body, c = world.bodies[index], world.bodies[index].center_B_m
    way = sub(outside_B, p_B)
    length = norm(way)
    if not length > 0.0:  # also for a place of entry that is not a number: its face has no area any more
        return True
    direction = (way[0] / length, way[1] / length, way[2] / length)
    origin = (p_B[0] - c[0], p_B[1] - c[1], p_B[2] - c[2])
    face = first_face(body.search, world.ray, origin, direction, length, 0)
    if face < 0:
        return False
    n, _ = plane(*corners(world, body, face))
    return bool((dot(n, direction) >= 0.0) == (body.punctured > 0))


@native
def encloses(world: "World", index: int, p_B: Vector) -> bool:
    """Return whether a body encloses a point; a ray or two decide it for most points outside."""
    others = 0
    for way in range(WAYS):
        face, _, back = face_along(world, index, p_B, way)
        if face < 0 or not back:
            others += 1
        if others > WAYS - BACKS_MIN:
            return False
    return True


@native
def face_along(world: "World", index: int, p_B: Vector, way: int) -> tuple[int, float, bool]:
    """Return the first face along a ray from a point, −1 for none, its distance [m], and whether from behind."""
    body, c, direction = world.bodies[index], world.bodies[index].center_B_m, look_direction(way)
    origin = (p_B[0] - c[0], p_B[1] - c[1], p_B[2] - c[2])
    face = first_face(body.search, world.ray, origin, direction, norm(origin) + body.radius_m, 0)
    if face < 0:
        return face, 0.0, False
    n, _ = plane(*corners(world, body, face))
    return face, float(world.ray[8]), bool(dot(n, direction) >= 0.0)


@native
def look_direction(way: int) -> Vector:
    """Return unit vector number `way` of `WAYS`: the axes, then the diagonals of the octants."""
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
