"""The god-object: a point that follows the tool and never enters a body (Zilles & Salisbury 1995).

The proxy moves towards the point closest to the tool that its planes allow. A face in the way stops it and becomes a
plane; a plane that does not push any more, or whose face does not reach under the proxy any more, is dropped. It
rests where neither happens. Planes are kept from tick to tick, so that a proxy that glides over one face costs one
ray; over an edge it costs one or two (`hapscene.contact.crossing`).

While it is searched for, the proxy stays one skin off every face: rays never start on one. What is reported is the
solution of the same planes without the skin, which lies on the surface itself.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from hapscene.compiled.native import inlined, native
from hapscene.constants import CAST_MAX, LOOK_AHEAD, NEAR_MAX, PASS_MAX
from hapscene.contact.cast import cast, cast_body
from hapscene.contact.crossing import MET, OVER, PAST, RESTS, cross_edges, lies_over_planes
from hapscene.contact.passing import leave
from hapscene.contact.planes import (
    copy_plane,
    drop_idle,
    drop_unsupported,
    forget_oldest,
    nearest,
    place_plane,
    take_back,
    trust,
)
from hapscene.contact.triangle import lies_over, to_body, to_body_before, to_world
from hapscene.contact.world import ASIDE, SAVED
from hapscene.geometry import Vector, along, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["move", "put"]

STILL = 1e-3
"""A move shorter than this is none, in skins [1]."""

TRIES = 2
"""How often in a tick the faces beyond edges are tried before rays are asked for them [count]."""

FEW = 16
"""Most bodies near with which they are [count]: a try may cast 17 times, and with more `CAST_MAX` would not hold."""

MOVED = 0
"""The proxy has moved, or its planes have changed: the search goes on."""

AT_REST = 1
"""The proxy is as near to the tool as its planes allow."""

TRAPPED = 2
"""No point satisfies the planes."""

DEPTH_MAX_M = 1e3
"""More than any plane pushes [m]."""


@native
def put(world: "World", p_W: Vector) -> None:
    """Start anew with the proxy at `p_W`, touching nothing; off any face that it starts within a skin of."""
    proxy = world.proxy[0]
    proxy.count = 0
    proxy.held = 0
    skin = world.bodies[0].skin_m  # one for all
    _list(world, p_W, (LOOK_AHEAD + 4.0) * skin)
    proxy.near_room_m = 0.0
    for _ in range(min(len(world.bodies), PASS_MAX)):
        before = p_W
        for axis in range(6):
            step = 2.0 * skin if axis < 3 else -2.0 * skin
            x, y, z = p_W
            if axis % 3 == 0:
                x += step
            elif axis % 3 == 1:
                y += step
            else:
                z += step
            proxy.count = 0
            if cast(world, (x, y, z), p_W) <= 1.0:
                _, p_W = nearest(proxy, p_W, 1.0)
        if p_W == before:
            break
    proxy.count = 0
    for i in range(3):
        proxy.p_W_m[i] = p_W[i]
        proxy.p_WP_m[i] = p_W[i]


@inlined
def move(world: "World", tool_W: Vector) -> bool:
    """Move the proxy for one tick, bodies first, then towards the tool.

    Results are left in `world.proxy[0]`: `p_WP_m` [m], `held`, and the planes. Returns False where the proxy did not
    come to rest within `PASS_MAX` moves (`Flag.UNSETTLED`), fewer where it is cast against many bodies.
    """
    proxy = world.proxy[0]
    before_W = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    carried_W = _ride(world)
    _list_near(world, tool_W, carried_W)
    _carry(world, carried_W)
    settled = _settle(world, tool_W)
    found, p = nearest(proxy, tool_W, 0.0)
    held = 0
    for i in range(proxy.count):
        if proxy.push_m[i] > 0.0:
            held = 1
    by = _chief(world, p)
    if not (settled and found):  # where it has got to: a skin off the surface, and outside every body
        p = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
        held = 1 if proxy.count > 0 else 0
    for i in range(3):
        proxy.p_WP_m[i] = p[i]
    proxy.held = held
    proxy.by = by
    if proxy.passed_count > 0:
        leave(world, before_W, (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2]))
    return settled


@inlined
def _chief(world: "World", p_W: Vector) -> int:
    """Of the planes that hold the proxy, the one that pushes most, before all of those whose face it lies over."""
    proxy = world.proxy[0]
    by, most = 0, -1.0
    for i in range(proxy.count):
        push = proxy.push_m[i]
        if proxy.count > 1 and not lies_over(world, world.bodies[proxy.body[i]], proxy.face[i], p_W, proxy.skin_m[i]):
            push -= DEPTH_MAX_M
        if push > most or i == 0:
            by, most = i, push
    return by


@inlined
def _ride(world: "World") -> Vector:
    """Where the body that the proxy rests on takes it in this tick."""
    proxy = world.proxy[0]
    p = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    if proxy.count > 0:
        body = world.bodies[proxy.body[0]]
        if body.moved == 1:
            return to_world(body, to_body_before(body, p))
    return p


@inlined
def _list_near(world: "World", tool_W: Vector, carried_W: Vector) -> None:
    """List the bodies whose ball meets the ball around the tool that holds all rays of this tick.

    The list stays good until the tool, and the bodies, have moved as far as the nearest body that is not listed was
    away. `place_bodies` takes what the bodies moved off that room.
    """
    proxy = world.proxy[0]
    at = proxy.near_at_W_m
    ride = norm(sub(carried_W, (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])))
    reach = norm(sub(carried_W, tool_W)) + ride
    gone = norm((at[0] - tool_W[0], at[1] - tool_W[1], at[2] - tool_W[2]))
    if gone + reach >= proxy.near_room_m:
        _list(world, tool_W, reach)


@native
def _list(world: "World", tool_W: Vector, reach_m: float) -> None:
    """List the bodies whose ball comes within `reach_m` of the tool; of more than `NEAR_MAX` the first, and what holds.

    So which they are does not change from tick to tick, and nothing lets go of the proxy that holds it.
    """
    proxy = world.proxy[0]
    found = 0
    crowded = 0
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
            crowded = 1
            room = 0.0
    proxy.near_count = found
    proxy.near_room_m = room
    proxy.crowded = crowded
    for i in range(3):
        proxy.near_at_W_m[i] = tool_W[i]


@native
def _is_held_by(proxy: np.record, index: int) -> bool:
    """Whether a body is among those that hold the proxy."""
    for i in range(proxy.count):
        if proxy.body[i] == index:
            return True
    return False


@inlined
def _carry(world: "World", carried_W: Vector) -> None:
    """Let moving bodies take the proxy along: the one it rests on carries it, any other pushes it ahead."""
    proxy = world.proxy[0]
    rests_on = proxy.body[0] if proxy.count > 0 else -1
    before = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    p = carried_W
    trust(proxy, proxy.count, math.inf)
    for i in range(proxy.count):
        if world.bodies[proxy.body[i]].moved == 1:
            place_plane(world, i)
    carried = norm(sub(p, before)) > 0.0
    for k in range(proxy.near_count):
        index = world.near[k]
        body = world.bodies[index]
        if index == rests_on or body.passed != 0 or not (carried or body.moved == 1):
            continue
        if proxy.count == 4:  # a tick that did not settle may leave four
            forget_oldest(proxy)
        start = to_body_before(body, before)
        goal = to_body(body, p)
        stop = cast_body(world, index, start, goal, 2.0)
        if stop <= 1.0:
            proxy.count += 1
            found, p = nearest(proxy, carried_W, 1.0)
            if not found:
                p = to_world(body, along(start, stop, sub(goal, start)))
    for i in range(3):
        proxy.p_W_m[i] = p[i]


@inlined
def _settle(world: "World", tool_W: Vector) -> bool:
    """Move the proxy until it rests; False where it does not within the moves that a tick may take."""
    proxy = world.proxy[0]
    p = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    met, halt_m = p, math.inf
    tries = TRIES if proxy.near_count <= FEW else 0
    outcome = MOVED
    proxy.aside = 0
    for _ in range(min(PASS_MAX, CAST_MAX // max(1, proxy.near_count))):
        outcome, p, met, halt_m, tries = _advance(world, tool_W, p, met, halt_m, tries)
        if outcome != MOVED:
            break
    settled = bool(outcome == AT_REST)
    if proxy.count == 0 and proxy.aside > 0 and not settled:  # past the edge of the last face, not over the next
        copy_plane(proxy, ASIDE + (proxy.aside - 1) % (SAVED - ASIDE), 0)
        proxy.count = 1
        p = met
    for i in range(3):
        proxy.p_W_m[i] = p[i]
    return settled


@inlined
def _advance(
    world: "World", tool_W: Vector, p_W: Vector, met_W: Vector, halt_m: float, tries: int
) -> tuple[int, Vector, Vector, float, int]:
    """One move of the proxy at `p_W`, or one change of its planes.

    Args:
        world, tool_W: the scene, and the device position.
        p_W: the proxy.
        met_W: where a face stopped it last.
        halt_m: distance from the proxy to the tool at its last halt, infinite before the first.
        tries: how often the faces beyond edges may still be tried.

    Returns:
        `MOVED`, `AT_REST` or `TRAPPED`, and the new `p_W`, `met_W`, `halt_m` and `tries`.
    """
    proxy = world.proxy[0]
    found, goal = nearest(proxy, tool_W, 1.0)
    if not found:  # planes that moved apart enclose nothing: let the oldest go
        if proxy.count < 2:
            return TRAPPED, p_W, met_W, halt_m, tries
        forget_oldest(proxy)
        return MOVED, p_W, met_W, halt_m, tries
    drop_idle(proxy)
    if proxy.aside > 0 and take_back(world, p_W, goal):
        return MOVED, p_W, met_W, halt_m, tries
    where = lies_over_planes(world, goal)
    if where == PAST and tries > 0:
        outcome, place = cross_edges(world, p_W, tool_W, goal)
        if outcome == RESTS:
            return AT_REST, place, met_W, halt_m, tries
        if outcome == MET:
            return MOVED, place, place, halt_m, tries - 1
        tries = 0
    p = p_W
    way = sub(goal, p)
    if norm(way) > STILL * _skin(world):
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
    if left_m >= halt_m or not drop_unsupported(world, p):  # no nearer than at the last halt: flat, let it be
        return AT_REST, p, met_W, halt_m, tries
    return MOVED, p, met_W, left_m - STILL * proxy.skin_m[ASIDE], tries


@inlined
def _skin(world: "World") -> float:
    """Skin of what holds the proxy, 0 in the air: there every move counts."""
    proxy = world.proxy[0]
    return proxy.skin_m[0] if proxy.count > 0 else 0.0
