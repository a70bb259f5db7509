"""The proxy of a tool with a round tip: the centre of a ball that never enters a face.

The centre moves like the point proxy of a scene whose faces are thickened by the radius of the ball. A thickened face
is convex. From the point of the face closest to the centre follows a plane that has the whole thickened face behind it
and the centre in front of it:

    nhat = (c − q) / |c − q|        nhat · x ≥ nhat · q + r

Each tick lists the faces near the centre c with their planes, and moves the centre to the point x closest to the device
that all planes allow. The way from c to x lies in front of all planes, so the ball passes through no face, thin plates
and loose triangles included, and no search along the way is needed. The planes that hold the centre are then renewed
from the closest points of their faces to x, which are at least as far away, until they no longer change: the centre is
then where its planes touch the thickened faces themselves.

Both sides of a face are solid. No skin is needed, since the centre is never closer to a face than the radius.
"""

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.compiled.native import inlined, native
from hapscene.constants import PASS_MAX
from hapscene.contact.face_tree import square_distance
from hapscene.contact.planes import drop_idle, nearest
from hapscene.contact.proxy import list_bodies
from hapscene.contact.puncture import close_left_punctures
from hapscene.contact.triangle import closest_point, corners, to_body, to_body_last, to_world, turn_to_world
from hapscene.contact.world import LISTED_MAX
from hapscene.flags import Flag
from hapscene.geometry import Vector, along, cross, dot, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["move_ball"]

TOLERANCE_M: Final = 2e-9
"""How far behind a plane the centre may lie [m]. `nearest` allows half of it with `SKIN_M`."""

SKIN_M: Final = 1e-6
"""Skin that `nearest` reads for its tolerance, of which it uses a thousandth [m]."""

SETTLED_M: Final = 2e-8
"""Change of a plane at the device position below which the search ends [m]."""

ADD_MAX: Final = 32
"""Most planes that one projection adds [count]; each brings the centre farther from the device."""

MARGIN_RATIO: Final = 2.0
"""Reach of the listed faces beyond the ball, in distances that the device moved [1]. A longer reach lists more faces,
a shorter one lists them more often."""

MARGIN_MIN: Final = 0.01
"""Shortest such reach [radii]."""

BEND_MIN: Final = 0.02
"""Turn of the planes from which the search looks ahead of the next point [1]."""

AHEAD_MIN: Final = 0.05
"""Inverse of the farthest look ahead [1]."""

FLAT2: Final = 1e-12
"""Squared sine of the angle to the normal of a face up to which a plane counts as that of the face itself [1]."""

_UNSETTLED = int(Flag.UNSETTLED)


@native
def move_ball(world: "World", tool_W: Vector) -> int:
    """Advance the centre of the ball by one tick; the counterpart of `hapscene.contact.proxy.move_proxy`.

    Returns `Flag.UNSETTLED` if the centre did not reach equilibrium, or if the bodies leave no room for the ball.
    """
    proxy, ball = world.proxy[0], world.ball[0]
    before_W = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    c = before_W
    step_m = norm(sub(tool_W, (ball.tool_W_m[0], ball.tool_W_m[1], ball.tool_W_m[2])))
    for i in range(3):
        ball.tool_W_m[i] = tool_W[i]
    if proxy.placed == 1:
        step_m = 0.0
    _list_near(world, tool_W, c, step_m)
    if proxy.placed == 1:
        proxy.placed = 0
        c = _make_room(world, c)
    elif world.moved[0] > 0:
        c = _carry(world, c)
    settled, c = _solve(world, tool_W, c, step_m)
    held, dominant = 0, 0
    for i in range(proxy.count):
        if proxy.push_m[i] > 0.0:
            held = 1
        if proxy.push_m[i] > proxy.push_m[dominant]:
            dominant = i
    for i in range(3):
        proxy.p_W_m[i] = proxy.p_WP_m[i] = c[i]
    proxy.touching = held
    proxy.dominant = dominant
    if proxy.puncture_count > 0:
        close_left_punctures(world, before_W, c)
        ball.margin_m = -1.0
    return 0 if settled else _UNSETTLED


@inlined
def _list_near(world: "World", tool_W: Vector, c: Vector, step_m: float) -> None:
    """List the bodies that the ball can meet in this tick, if those of an earlier tick no longer suffice."""
    proxy, at = world.proxy[0], world.proxy[0].near_at_W_m
    reach_m = norm(sub(tool_W, c)) + 2.0 * proxy.radius_m + 4.0 * MARGIN_RATIO * step_m
    if norm(sub(tool_W, (at[0], at[1], at[2]))) + reach_m >= proxy.near_margin_m:
        list_bodies(world, tool_W, reach_m)
        world.ball[0].margin_m = -1.0


@native
def _make_room(world: "World", c: Vector) -> Vector:
    """Return a position near `c` at which the ball enters no face."""
    radius_m = world.proxy[0].radius_m
    for _ in range(PASS_MAX):
        _list_faces(world, c, radius_m, False)
        found, x = _project(world, c)
        if not found or norm(sub(x, c)) < TOLERANCE_M:
            break
        c = x
    world.ball[0].margin_m = -1.0
    return c


@native
def _carry(world: "World", c: Vector) -> Vector:
    """Let moving bodies take the ball along: the body it touches carries it, other bodies push it."""
    proxy = world.proxy[0]
    p, most_m, moved = c, 0.0, False
    for k in range(proxy.near_count):
        body = world.bodies[world.near[k]]
        if body.moved == 1 and body.punctured == 0:
            moved = True
            now = to_world(body, to_body_last(body, c))
            most_m = max(most_m, norm(sub(now, c)))
            if proxy.count > 0 and proxy.body[0] == world.near[k]:
                p = now
    if moved:
        # In the frame of a body, the ball starts where it was relative to the last pose. The planes of that position,
        # turned with the body, keep the ball on its side of all faces.
        if _list_faces(world, c, 2.0 * most_m, True):
            found, x = _project(world, p)
            if found:
                p = x
        world.ball[0].margin_m = -1.0
    return p


@native
def _solve(world: "World", tool_W: Vector, c: Vector, step_m: float) -> tuple[bool, Vector]:
    """Move the centre as close to the device as the faces allow; return whether it is in equilibrium, and where."""
    proxy, ball = world.proxy[0], world.ball[0]
    margin_m = max(MARGIN_RATIO * step_m, MARGIN_MIN * proxy.radius_m)
    for _ in range(PASS_MAX):
        at = (ball.at_W_m[0], ball.at_W_m[1], ball.at_W_m[2])
        if norm(sub(c, at)) > ball.margin_m:
            while not _list_faces(world, c, margin_m, False):
                margin_m *= 0.5
                if margin_m < SETTLED_M:
                    return False, c
            at = c
        found, x = _project(world, tool_W)
        if not found:
            return False, c
        if norm(sub(x, at)) > ball.margin_m:  # beyond the listed faces
            way = sub(x, c)
            if c == at:
                c = along(c, 0.99 * ball.margin_m / norm(way), way)
                margin_m *= 2.0
            ball.margin_m = -1.0
            continue
        bend = _bend(world, x)
        if bend > BEND_MIN and norm(sub(x, c)) > SETTLED_M:
            c = _ahead(world, c, x, 1.0 / max(1.0 - bend, AHEAD_MIN))
        else:
            c = x
        if not _renew_planes(world, c) and c == x:
            return True, c
    return False, c


@native
def _bend(world: "World", x: Vector) -> float:
    """Return how much the planes turn, of one radius of motion: the pushes of edges and corners over the radius [1]."""
    proxy = world.proxy[0]
    bend = 0.0
    for k in range(proxy.count):
        body = world.bodies[proxy.body[k]]
        a, b, c = corners(world, body, proxy.face[k])
        n = cross(sub(b, a), sub(c, a))
        m = cross(turn_to_world(body, n), (proxy.nhat_W[k, 0], proxy.nhat_W[k, 1], proxy.nhat_W[k, 2]))
        if dot(m, m) > FLAT2 * dot(n, n):
            bend += proxy.push_m[k] / proxy.radius_m
    return bend


@native
def _ahead(world: "World", c: Vector, x: Vector, ratio: float) -> Vector:
    """Return the point on the way from `c` past `x`, up to `ratio` times as far, that all planes of the list allow.

    The solution on a cylinder or ball of radius r, pushed by s, is not x, where the plane at `c` is closest to the
    device, but at the angle of the point 1 / (1 − s/r) times as far along that plane.
    """
    ball = world.ball[0]
    plane, way = ball.plane, sub(x, c)
    for i in range(ball.count):
        sinks = -(plane[0, i] * way[0] + plane[1, i] * way[1] + plane[2, i] * way[2])
        if sinks > 0.0:
            above = plane[0, i] * c[0] + plane[1, i] * c[1] + plane[2, i] * c[2] - plane[3, i]
            ratio = min(ratio, max(above / sinks, 1.0))
    arm = sub(c, (ball.at_W_m[0], ball.at_W_m[1], ball.at_W_m[2]))
    room_m = ball.margin_m - norm(arm)
    return along(c, min(ratio, max(room_m / norm(way), 1.0)), way)


@native
def _project(world: "World", target_W: Vector) -> tuple[bool, Vector]:
    """Return the point closest to a target that the planes of all listed faces allow, and make the active ones those
    of the proxy.

    Adds the plane that the point violates most until there is none; each addition increases the distance from the
    target, so no set of planes comes twice. Returns False if no point satisfies the planes.
    """
    proxy, ball = world.proxy[0], world.ball[0]
    plane = ball.plane
    proxy.count = 0
    x = target_W
    for _ in range(ADD_MAX):
        worst, by = -TOLERANCE_M, -1
        for i in range(ball.count):
            above = plane[0, i] * x[0] + plane[1, i] * x[1] + plane[2, i] * x[2] - plane[3, i]
            if above < worst:
                worst, by = above, i
        if by < 0:
            return True, x
        _hold(world, by)
        found, x = nearest(proxy, target_W, 0.0)
        if not found:
            return False, x
        drop_idle(proxy)
    return False, x


@inlined
def _hold(world: "World", listed: int) -> None:
    """Add the plane of a listed face to those of the proxy; `met` stores its number in the list."""
    proxy, ball = world.proxy[0], world.ball[0]
    k = proxy.count
    for i in range(3):
        proxy.nhat_W[k, i] = ball.plane[i, listed]
    proxy.offset_m[k] = ball.plane[3, listed]
    proxy.skin_m[k] = SKIN_M
    proxy.body[k], proxy.face[k] = ball.body[listed], ball.face[listed]
    proxy.met[k] = listed
    proxy.count = k + 1


@native
def _renew_planes(world: "World", c: Vector) -> bool:
    """Renew the planes that hold the proxy from the points of their faces closest to `c`; return whether any changed."""
    proxy, ball = world.proxy[0], world.ball[0]
    changed = False
    for k in range(proxy.count):
        i = proxy.met[k]
        body = world.bodies[ball.body[i]]
        _put_plane(world, i, body, ball.body[i], ball.face[i], to_body(body, c), math.inf)
        turn2, above = 0.0, -ball.plane[3, i]
        for j in range(3):
            turn2 += (ball.plane[j, i] - proxy.nhat_W[k, j]) ** 2
            above += ball.plane[j, i] * c[j]
        changed |= above + math.sqrt(turn2) * proxy.push_m[k] > SETTLED_M
        a, b, d = corners(world, body, ball.face[i])
        n = turn_to_world(body, cross(sub(b, a), sub(d, a)))
        side = n[0] * ball.plane[0, i] + n[1] * ball.plane[1, i] + n[2] * ball.plane[2, i]
        proxy.side[k] = 1.0 if side >= 0.0 else -1.0
    return bool(changed)


@native
def _list_faces(world: "World", c: Vector, margin_m: float, last: bool) -> bool:
    """List the faces that the ball can meet while its centre moves by at most `margin_m` from `c`, with their planes.

    With `last`, the planes are those of a centre that was at `c` in the last tick, moved to the present poses of the
    bodies. Returns False if there are too many faces.
    """
    proxy, ball = world.proxy[0], world.ball[0]
    for i in range(3):
        ball.at_W_m[i] = c[i]
    ball.margin_m = margin_m
    ball.count = 0
    for k in range(proxy.near_count):
        index = world.near[k]
        body = world.bodies[index]
        if body.punctured != 0:
            continue
        c_B, reach_m = to_body(body, c), proxy.radius_m + margin_m
        if last and body.moved == 1:
            c_B = to_body_last(body, c)
            reach_m += norm(sub(to_world(body, c_B), c))
        if not _list_body(world, index, c_B, reach_m):
            ball.margin_m = -1.0
            return False
    return True


@native
def _list_body(world: "World", index: int, c_B: Vector, reach_m: float) -> bool:
    """Add the faces of a body within `reach_m` of a point to the list; return False if there are too many."""
    ball, body = world.ball[0], world.bodies[index]
    leaves, reach2 = body.leaf_count, reach_m * reach_m
    ball.stack[0] = 1
    top = 1
    while top > 0:
        top -= 1
        node = ball.stack[top]
        if square_distance(world.tree[body.tree + node], c_B) > reach2:
            continue
        if node < leaves:
            ball.stack[top] = 2 * node
            ball.stack[top + 1] = 2 * node + 1
            top += 2
            continue
        leaf = node - leaves
        for i in range(leaf * body.tree_count // leaves, (leaf + 1) * body.tree_count // leaves):
            if ball.count == LISTED_MAX:
                return False
            face = world.tree_face[body.tree_face + i]
            if _put_plane(world, ball.count, body, index, face, c_B, reach2):
                ball.count += 1
    return True


@inlined
def _put_plane(
    world: "World", i: int, body: np.record, index: int, face: int, c_B: Vector, reach2: float
) -> bool:
    """Write the plane of a face for a centre at `c_B` to place `i` of the list.

    Returns False if the squared distance of the face exceeds `reach2`.
    """
    ball = world.ball[0]
    a, b, c = corners(world, body, face)
    q = closest_point(a, b, c, c_B)
    n = sub(c_B, q)
    d2 = dot(n, n)
    if not d2 <= reach2:
        return False
    if d2 == 0.0:
        n = cross(sub(b, a), sub(c, a))
    length = norm(n)
    n = (n[0] / length, n[1] / length, n[2] / length)
    offset = dot(n, q) + world.proxy[0].radius_m
    n, o = turn_to_world(body, n), body.p_WB_m
    for j in range(3):
        ball.plane[j, i] = n[j]
    ball.plane[3, i] = offset + n[0] * o[0] + n[1] * o[1] + n[2] * o[2]
    ball.body[i], ball.face[i] = index, face
    return True
