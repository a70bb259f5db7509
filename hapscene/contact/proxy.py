"""The proxy (god-object): a point that follows the device and never enters a body (Zilles & Salisbury 1995).

The proxy moves towards the point closest to the device position that its planes allow. A face in the way stops it and
becomes a plane. A plane is dropped when it no longer pushes, or when its face no longer lies below the proxy. The
proxy is in equilibrium when neither happens. Planes are kept from tick to tick, so a proxy that slides over one face
costs one ray, and one or two more where it crosses an edge (`hapscene.contact.crossing`).

During the search the proxy stays one skin above every face, so that no ray starts on a face. The reported position is
the solution of the same planes without the skin, which lies on the surface itself.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from hapscene.compiled.native import inlined, native
from hapscene.constants import CAST_MAX, LOOK_AHEAD, NEAR_MAX, PASS_MAX, REACH_MAX_M
from hapscene.contact.cast import cast, cast_body, put_face
from hapscene.contact.crossing import BLOCKED, OVER, PAST, SETTLED, cross_edges, lies_over_planes
from hapscene.contact.inside import close_left_punctures, encloses, look_direction
from hapscene.contact.planes import (
    copy_plane,
    drop_idle,
    drop_oldest,
    drop_unsupported,
    nearest,
    restore_plane,
    trust,
)
from hapscene.contact.triangle import lies_over, to_body, to_body_last, to_world
from hapscene.contact.world import DROPPED, SAVED
from hapscene.flags import Flag
from hapscene.geometry import Vector, along, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["carried_position", "list_bodies", "move_proxy", "place_proxy"]

MOVE_MIN = 1e-3
"""Shortest distance that counts as a move [skins]."""

EDGE_TRIES_MAX = 2
"""Most times per tick that the proxy follows face adjacency before it uses casts only [count]."""

EDGE_BODIES_MAX = 16
"""Most nearby bodies with which adjacency is followed [count]: one attempt may cast 17 times, which would exceed
`CAST_MAX` with more bodies."""

_CROWDED = int(Flag.CROWDED)
_FAR = int(Flag.TOOL_FAR)

MOVED = 0
"""The proxy has moved or its planes have changed; the search continues."""

AT_REST = 1
"""The proxy is as close to the device as its planes allow."""

TRAPPED = 2
"""No point satisfies the planes."""

DEPTH_MAX_M = 1e3
"""Larger than any penetration depth [m]."""


@native
def place_proxy(world: "World", p_W: Vector) -> None:
    """Place the proxy at `p_W` without contact, and move it out of the skin of any face that it starts in.

    A one-sided body that encloses the point is reported in `enclosing`.
    """
    proxy = world.proxy[0]
    proxy.count = 0
    proxy.touching = 0
    proxy.placed = 1
    skin = world.bodies[0].skin_m  # all bodies have the same skin
    list_bodies(world, p_W, (LOOK_AHEAD + 4.0) * skin)
    proxy.near_margin_m = 0.0
    # A short cast from each side of the point finds the faces within a skin, and `nearest` moves the point off these.
    # Repeat until no cast moves it: it can leave the skin of one face by entering that of another.
    for _ in range(min(len(world.bodies), PASS_MAX)):
        before = p_W
        for axis in range(6):
            proxy.count = 0
            if cast(world, along(p_W, 2.0 * skin, look_direction(axis)), p_W) <= 1.0:
                _, p_W = nearest(proxy, p_W, 1.0)
        if p_W == before:
            break
    proxy.count = proxy.enclosing = 0
    for k in range(proxy.near_count):
        body = world.bodies[world.near[k]]
        if body.two_sided == 0 and encloses(world, world.near[k], to_body(body, p_W)):
            proxy.enclosing = 1 + world.near[k]
    for i in range(3):
        proxy.p_W_m[i] = p_W[i]
        proxy.p_WP_m[i] = p_W[i]


@inlined
def move_proxy(world: "World", tool_W: Vector) -> bool:
    """Advance the proxy by one tick: with the moving bodies first, then towards the device position.

    Writes `p_WP_m` [m], `touching`, `dominant` and the planes to `world.proxy[0]`. Returns False if the proxy did not
    reach equilibrium within `PASS_MAX` moves, or fewer if it is cast against many bodies (`Flag.UNSETTLED`).
    """
    proxy = world.proxy[0]
    carried_W = carried_position(world)
    _list_near(world, tool_W, carried_W)
    _carry(world, carried_W)
    settled = _solve(world, tool_W)
    found, p = nearest(proxy, tool_W, 0.0)
    held = 0
    for i in range(proxy.count):
        if proxy.push_m[i] > 0.0:
            held = 1
    dominant = _dominant_plane(world, p)
    if not (settled and found):  # report the proxy of the search: a skin above the surface, outside every body
        p = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
        held = 1 if proxy.count > 0 else 0
    for i in range(3):
        proxy.p_WP_m[i] = p[i]
    proxy.touching = held
    proxy.dominant = dominant
    if proxy.puncture_count > 0:
        close_left_punctures(world, (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2]))
    return settled


@inlined
def _dominant_plane(world: "World", p_W: Vector) -> int:
    """Return the plane with the largest constraint force, preferring planes with their face below the proxy."""
    proxy = world.proxy[0]
    dominant, most = 0, -1.0
    for i in range(proxy.count):
        push = proxy.push_m[i]
        if proxy.count > 1 and not lies_over(world, world.bodies[proxy.body[i]], proxy.face[i], p_W, proxy.skin_m[i]):
            push -= DEPTH_MAX_M
        if push > most or i == 0:
            dominant, most = i, push
    return dominant


@inlined
def carried_position(world: "World") -> Vector:
    """Return where the body that the proxy touches carries it in this tick."""
    proxy = world.proxy[0]
    p = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    if proxy.count > 0:
        body = world.bodies[proxy.body[0]]
        if body.moved == 1:
            return to_world(body, to_body_last(body, p))
    return p


@inlined
def _list_near(world: "World", tool_W: Vector, carried_W: Vector) -> None:
    """List the bodies whose bounding balls intersect a ball around the device that contains all rays of this tick.

    The list stays valid until the device and the bodies have moved as far as the nearest unlisted body was away.
    `place_bodies` subtracts the motion of the bodies from that margin.
    """
    proxy = world.proxy[0]
    at = proxy.near_at_W_m
    ride = norm(sub(carried_W, (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])))
    reach = norm(sub(carried_W, tool_W)) + ride
    gone = norm((at[0] - tool_W[0], at[1] - tool_W[1], at[2] - tool_W[2]))
    if gone + reach >= proxy.near_margin_m:
        list_bodies(world, tool_W, reach)


@native
def list_bodies(world: "World", tool_W: Vector, reach_m: float) -> None:
    """List the bodies whose bounding balls lie within `reach_m` of the device position.

    If more than `NEAR_MAX` do, the first of the scene and those in contact are listed. The choice is thus the same from
    tick to tick, and a body in contact stays in contact. A device position that is far from all bodies, or from the
    proxy, is reported in `near_flags`.
    """
    proxy = world.proxy[0]
    found = flags = 0
    room = math.inf
    for k in range(len(world.bodies)):
        ball = world.ball_W_m[k]
        away = norm((ball[0] - tool_W[0], ball[1] - tool_W[1], ball[2] - tool_W[2])) - ball[3]
        if away > reach_m:
            room = min(room, away)
        elif found < NEAR_MAX or _is_held_by(proxy, k):
            world.near[found] = k
            found += 1
        else:
            flags = _CROWDED
            room = 0.0
    if reach_m > proxy.far_m:  # the next tick tests again
        flags, room = flags | _FAR, 0.0
    elif found > 0:
        room = min(room, proxy.far_m)
    elif proxy.far_m < room < REACH_MAX_M:  # beyond are removed bodies
        flags, room = flags | _FAR, room - proxy.far_m
    proxy.near_count = found
    proxy.near_margin_m = room
    proxy.near_flags = flags
    for i in range(3):
        proxy.near_at_W_m[i] = tool_W[i]


@native
def _is_held_by(proxy: np.record, index: int) -> bool:
    """Return whether a body is in contact with the proxy."""
    for i in range(proxy.count):
        if proxy.body[i] == index:
            return True
    return False


@inlined
def _carry(world: "World", carried_W: Vector) -> None:
    """Let moving bodies take the proxy along: the body it touches carries it, other bodies push it."""
    proxy = world.proxy[0]
    rests_on = proxy.body[0] if proxy.count > 0 else -1
    before = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    p = carried_W
    trust(proxy, proxy.count, math.inf)
    for i in range(proxy.count):
        if world.bodies[proxy.body[i]].moved == 1:
            put_face(world, i, proxy.body[i], proxy.face[i], proxy.side[i])
    carried = norm(sub(p, before)) > 0.0
    # In the frame of each other body, the proxy moves from where it was relative to the last pose to where it is now
    # relative to the present pose. A cast along that motion finds faces that ran into the proxy.
    for k in range(proxy.near_count):
        index = world.near[k]
        body = world.bodies[index]
        if index == rests_on or body.punctured != 0 or not (carried or body.moved == 1):
            continue
        if proxy.count == 4:  # a tick that reached no equilibrium may leave four planes
            drop_oldest(proxy)
        start = to_body_last(body, before)
        goal = to_body(body, p)
        stop = cast_body(world, index, start, goal, 2.0)
        if stop <= 1.0:
            proxy.count += 1
            met = along(start, stop, sub(goal, start))
            found, p = nearest(proxy, carried_W, 1.0)
            # the plane of the face extends past the face, where another face of the body can be in front of it
            if not found or cast_body(world, index, met, to_body(body, p), 2.0) <= 1.0:
                p = to_world(body, met)
    for i in range(3):
        proxy.p_W_m[i] = p[i]


@inlined
def _solve(world: "World", tool_W: Vector) -> bool:
    """Move the proxy until it is in equilibrium; return False if the moves of one tick do not suffice."""
    proxy = world.proxy[0]
    p = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    met, halt_m = p, math.inf
    tries = EDGE_TRIES_MAX if proxy.near_count <= EDGE_BODIES_MAX else 0
    outcome = MOVED
    proxy.dropped_count = 0
    for _ in range(min(PASS_MAX, CAST_MAX // max(1, proxy.near_count))):
        outcome, p, met, halt_m, tries = _advance(world, tool_W, p, met, halt_m, tries)
        if outcome != MOVED:
            break
    settled = bool(outcome == AT_REST)
    if proxy.count == 0 and proxy.dropped_count > 0 and not settled:  # past the last face, not yet above the next
        copy_plane(proxy, DROPPED + (proxy.dropped_count - 1) % (SAVED - DROPPED), 0)
        proxy.count = 1
        p = met
    for i in range(3):
        proxy.p_W_m[i] = p[i]
    return settled


@inlined
def _advance(
    world: "World", tool_W: Vector, p_W: Vector, met_W: Vector, halt_m: float, tries: int
) -> tuple[int, Vector, Vector, float, int]:
    """Make one move of the proxy at `p_W`, or one change of its planes.

    Args:
        world: the scene as the contact reads it.
        tool_W: device position.
        p_W: proxy position.
        met_W: where a face last stopped the proxy.
        halt_m: distance from the proxy to the device when it last halted, infinite before.
        tries: how often face adjacency may still be followed.

    Returns:
        `MOVED`, `AT_REST` or `TRAPPED`, and the new `p_W`, `met_W`, `halt_m` and `tries`.
    """
    proxy = world.proxy[0]
    found, goal = nearest(proxy, tool_W, 1.0)
    if not found:  # the planes enclose nothing: they have moved apart, so drop the oldest
        if proxy.count < 2:
            return TRAPPED, p_W, met_W, halt_m, tries
        drop_oldest(proxy)
        return MOVED, p_W, met_W, halt_m, tries
    drop_idle(proxy)
    if proxy.dropped_count > 0 and restore_plane(world, p_W, goal):
        return MOVED, p_W, met_W, halt_m, tries
    where = lies_over_planes(world, goal)
    if where == PAST and tries > 0:
        outcome, place = cross_edges(world, p_W, tool_W, goal)
        if outcome == SETTLED:
            return AT_REST, place, met_W, halt_m, tries
        if outcome == BLOCKED:
            return MOVED, place, place, halt_m, tries - 1
        tries = 0
    p = p_W
    way = sub(goal, p)
    if norm(way) > MOVE_MIN * _skin(world):
        stop = cast(world, p, goal)
        if stop > 0.0:
            moved = min(stop, 1.0) * norm(way)
            trust(proxy, proxy.count - 1 if stop <= 1.0 else proxy.count, moved)
        if stop <= 1.0:
            p = along(p, stop, way)
            return MOVED, p, p, halt_m, tries
        p = goal
    if where == OVER:
        return AT_REST, p, met_W, halt_m, tries
    left_m = norm(sub(tool_W, p))
    if left_m >= halt_m or not drop_unsupported(world, p):  # no closer than at the last halt: the surface is flat here
        return AT_REST, p, met_W, halt_m, tries
    return MOVED, p, met_W, left_m - MOVE_MIN * proxy.skin_m[DROPPED], tries


@inlined
def _skin(world: "World") -> float:
    """Return the skin of the first plane, 0 without contact: then every move counts."""
    proxy = world.proxy[0]
    return proxy.skin_m[0] if proxy.count > 0 else 0.0
