"""The proxy of a tool with a round tip: the centre of a ball that never enters a face.

The centre moves like the point proxy of a scene whose faces are thickened by the radius r of the ball. A thickened
face is convex. The point q of a face closest to the centre c gives a plane with the whole thickened face behind it and
the centre in front:

    nhat = (c − q) / |c − q|        nhat · x ≥ nhat · q + r

The same holds for the cylinders that contain many faces (`hapscene.contact.face_tree`). A *front* of cylinders and
faces that together contain all faces nearby is kept from tick to tick. In each tick the centre moves to the point x
closest to the device. The entry of the front whose plane x violates most is refined: its plane is computed anew at c,
then a cylinder is replaced by those inside it, down to a face. The plane of the face becomes a constraint, and x is
computed again, until it violates no plane. The way from c to x is then in front of all planes to a tenth of r, so the
centre passes through no face, at any speed, thin plates and loose triangles included. At x, the planes that hold the
ball are renewed, until they no longer change: then they touch the thickened faces where the ball does.

Both sides of a face are solid. No skin is needed, since the centre is never closer to a face than r.
"""

import math
from typing import TYPE_CHECKING, Final

from hapscene.compiled.native import inlined, native
from hapscene.constants import PASS_MAX
from hapscene.contact.face_tree import LEAF_MAX, way_from_cylinder
from hapscene.contact.inside import close_left_punctures
from hapscene.contact.planes import drop_idle, nearest
from hapscene.contact.proxy import carried_position, list_bodies
from hapscene.contact.triangle import beyond, closest_point, corners, edge_past, to_body, to_body_last, turn_to_world
from hapscene.contact.world import FRONT_MAX
from hapscene.flags import Flag
from hapscene.geometry import Vector, along, cross, dot, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["move_ball"]

TOLERANCE_M: Final = 2e-9
"""How far behind a plane the centre may lie [m]. `nearest` allows half of it with `SKIN_M`."""

SKIN_M: Final = 1e-6
"""Skin that `nearest` reads for its tolerance, of which it uses a thousandth [m]."""

SETTLED_M: Final = 2e-7
"""Change of the centre below which the search ends [m]."""

SLACK: Final = 0.1
"""How far behind the plane of a face the centre may start to slide onto it, as a fraction of the radius of the tip [1];
where it ends, `TOLERANCE_M` holds. Below 1, so that the centre passes through no face."""

FRONT_KEPT: Final = 128
"""Largest front that the next tick keeps [count]. A larger one takes longer to test than a new one to make."""

SEARCH_MAX: Final = 256
"""Most refinements of one projection [count]; a fast landing on a million faces needs about 50."""

NO_FACE: Final = -1
FULL: Final = -2

EDGES_MAX: Final = 4
"""Most edges that are crossed to find the face below the ball [count]."""

FAILED: Final = 0
FOUND: Final = 1
SETTLED: Final = 2

SLOW: Final = 0.1
"""Ratio of two successive moves from which the search looks ahead [1]: fine meshes converge faster, edges slower."""

SLOWEST: Final = 0.95
"""Largest such ratio that is used [1]; it bounds the look ahead."""

_UNSETTLED = int(Flag.UNSETTLED)


@native
def move_ball(world: "World", tool_W: Vector) -> int:
    """Advance the centre of the ball by one tick; the counterpart of `hapscene.contact.proxy.move_proxy`.

    Returns `Flag.UNSETTLED` if the centre did not reach equilibrium, or if the bodies leave no room for the ball.
    """
    proxy = world.proxy[0]
    before_W = (proxy.p_W_m[0], proxy.p_W_m[1], proxy.p_W_m[2])
    c = carried_position(world)
    _begin_front(world, tool_W, before_W, c)
    if proxy.placed == 1:
        c = _make_room(world, before_W)
        proxy.placed = 0
    elif world.moved[0] > 0:
        found, p = _project(world, c, before_W, True, False)
        if found:
            c = p
    settled, c = _solve(world, tool_W, c)
    held, dominant = 0, 0
    for k in range(proxy.count):
        proxy.side[k] = _side(world, k)
        if proxy.push_m[k] > 0.0:
            held = 1
        if proxy.push_m[k] > proxy.push_m[dominant]:
            dominant = k
    for i in range(3):
        proxy.p_W_m[i] = proxy.p_WP_m[i] = c[i]
    proxy.touching = held
    proxy.dominant = dominant
    if proxy.puncture_count > 0:
        close_left_punctures(world, c)
    return 0 if settled else _UNSETTLED


@inlined
def _begin_front(world: "World", tool_W: Vector, before_W: Vector, c: Vector) -> None:
    """List the bodies that the ball can meet in this tick, and start with their roots unless the last front holds."""
    proxy, ball, at = world.proxy[0], world.ball[0], world.proxy[0].near_at_W_m
    ball.now += 1
    reach_m = 2.0 * (norm(sub(tool_W, c)) + norm(sub(before_W, c)) + proxy.radius_m)
    listed = norm(sub(tool_W, (at[0], at[1], at[2]))) + reach_m < proxy.near_margin_m
    if not listed:
        list_bodies(world, tool_W, reach_m)
    if listed and 0 < ball.count <= FRONT_KEPT + proxy.near_count:
        return
    held, proxy.count, ball.count = proxy.count, 0, 0
    for k in range(held):
        if world.bodies[proxy.body[k]].punctured == 0:
            _append(world, proxy.body[k], -1 - proxy.face[k])
            _put_plane(world, ball.count - 1, before_W, before_W, True)
            _hold(world, ball.count - 1)
    for k in range(proxy.near_count):
        body = world.bodies[world.near[k]]
        if body.punctured == 0 and body.tree_count > 0:
            _append(world, world.near[k], 1)


@inlined
def _append(world: "World", index: int, node: int) -> None:
    """Add an entry to the front; its plane is computed when it is tested for the first time."""
    ball = world.ball[0]
    i = ball.count
    ball.body[i], ball.node[i], ball.stamp[i] = index, node, -1
    ball.plane[3, i] = math.inf
    ball.count = i + 1


@native
def _make_room(world: "World", c: Vector) -> Vector:
    """Return a position near `c` at which the ball enters no face."""
    for _ in range(PASS_MAX):
        found, x = _project(world, c, c, False, False)
        if not found or x == c:
            break
        c = x
        world.ball[0].now += 1
    return c


@native
def _solve(world: "World", tool_W: Vector, c: Vector) -> tuple[bool, Vector]:
    """Move the centre from `c` as close to the device as the faces allow; return whether it is in equilibrium, and
    where."""
    ball, last_m = world.ball[0], math.inf
    for k in range(PASS_MAX):
        ball.now += 1
        found, x = _project(world, tool_W, c, False, k == 0)
        if not found and k == 0:
            continue
        if found != FOUND:
            return bool(found == SETTLED), x if found == SETTLED else c
        y, way_m = x, norm(sub(x, c))
        if way_m > SETTLED_M and way_m > SLOW * last_m:
            y = _ahead(world, c, x, 1.0 / (1.0 - min(way_m / last_m, SLOWEST)))
            way_m = math.inf
        c, last_m = y, way_m
        if not _renew_planes(world, c, c) and y == x:
            return True, c
    return False, c


@native
def _project(world: "World", target_W: Vector, c: Vector, last: bool, ease: bool) -> tuple[int, Vector]:
    """Return the point closest to a target that the front allows a ball at `c`.

    Starts with the planes of the proxy, and adds the plane that the point violates most, until it violates no more.
    Each addition increases the distance from the target, so no set of planes comes twice. Returns `FAILED` if no point
    satisfies the planes, or the front is too large; `SETTLED` if the planes are those for a ball at the point.

    Args:
        world: the scene as the contact reads it.
        target_W, c: target, and position of the ball.
        last: True if the ball was at `c` in the last tick, at the last poses of the bodies.
        ease: True to renew the planes at the point before the front is tested; see also `_test_plane`.
    """
    proxy = world.proxy[0]
    allowed, x = nearest(proxy, target_W, 0.0)
    if not allowed:
        proxy.count, x = 0, target_W
    found = SETTLED if ease else FOUND
    if ease and _renew_planes(world, x, c):
        allowed, z = nearest(proxy, target_W, 0.0)
        found, x = FOUND, z if allowed else x
    drop_idle(proxy)
    for _ in range(SEARCH_MAX):
        by = _find_face(world, c, x, last, ease)
        if by == NO_FACE:
            return found, x
        if by == FULL:
            break
        _hold(world, by)
        allowed, x = nearest(proxy, target_W, 0.0)
        if not allowed:
            break
        found = FOUND
        drop_idle(proxy)
    return FAILED, x


@native
def _find_face(world: "World", c: Vector, x: Vector, last: bool, ease: bool) -> int:
    """Refine the front until no cylinder is violated more than a face.

    Returns the entry of the face whose plane `x` violates most, `NO_FACE`, or `FULL`.
    """
    ball = world.ball[0]
    planes, height, violated, count = ball.plane, ball.height_m, ball.violated, ball.count
    for i in range(count):  # a loop that the compiler makes of vector instructions
        height[i] = planes[0, i] * x[0] + planes[1, i] * x[1] + planes[2, i] * x[2] - planes[3, i]
    violations = 0
    for i in range(count):  # without a branch, which the processor would often predict wrongly
        violated[violations] = i
        violations += height[i] < -TOLERANCE_M
    for k in range(violations):
        if ball.stamp[violated[k]] != ball.now:
            _test_plane(world, violated[k], c, x, last, ease)
    while True:
        worst, by = -TOLERANCE_M, NO_FACE
        for k in range(violations):
            if height[violated[k]] < worst:
                worst, by = height[violated[k]], violated[k]
        if by == NO_FACE:
            return NO_FACE
        count = ball.count
        by = _refine(world, by, c, x, last, ease)
        if by != NO_FACE:
            return int(by)
        for i in range(count, ball.count):
            violated[violations] = i
            violations += 1


@native
def _refine(world: "World", i: int, c: Vector, x: Vector, last: bool, ease: bool) -> int:
    """Replace entry `i` of the front by what it contains, and go on with the part whose plane `x` violates most.

    Returns the entry of a face that `x` violates, `NO_FACE`, or `FULL`.
    """
    ball, index = world.ball[0], world.ball[0].body[i]
    body = world.bodies[index]
    leaves = body.leaf_count
    while ball.node[i] >= 0:
        node, appended = ball.node[i], ball.count
        if appended + LEAF_MAX > FRONT_MAX:
            return FULL
        if node < leaves:
            ball.node[i] = 2 * node
            _append(world, index, 2 * node + 1)
        else:
            first = (node - leaves) * body.tree_count // leaves
            ball.node[i] = -1 - world.tree_face[body.tree_face + first]
            for k in range(first + 1, (node - leaves + 1) * body.tree_count // leaves):
                _append(world, index, -1 - world.tree_face[body.tree_face + k])
        worst, by = _test_plane(world, i, c, x, last, ease), i
        for k in range(appended, ball.count):
            above = _test_plane(world, k, c, x, last, ease)
            if above < worst:
                worst, by = above, k
        if worst >= -TOLERANCE_M:
            return NO_FACE
        i = by
    return int(i)


@inlined
def _test_plane(world: "World", i: int, c: Vector, x: Vector, last: bool, ease: bool) -> float:
    """Compute the plane of entry `i` of the front for a ball at `c`; return the height of `x` above it [m].

    With `ease`, the plane for a ball at `x` is taken if the ball at `c` is in front of it, to `SLACK`: it restricts
    `x` least. Planes for `c` would stop a ball that slides over a fine mesh at every edge.
    """
    ball = world.ball[0]
    if ease:
        above, above_c = _put_plane(world, i, x, c, False)
    if not ease or above_c < -SLACK * world.proxy[0].radius_m:
        _, above = _put_plane(world, i, c, x, last)
    ball.height_m[i] = above
    return float(above)


@native
def _put_plane(world: "World", i: int, c_W: Vector, x_W: Vector, last: bool) -> tuple[float, float]:
    """Compute the plane of entry `i` of the front for a ball at `c_W`; see `_project` for `last`.

    Returns the heights of `c_W` and of `x_W` above it [m].
    """
    ball, body = world.ball[0], world.bodies[world.ball[0].body[i]]
    node = ball.node[i]
    c = to_body_last(body, c_W) if last and body.moved == 1 else to_body(body, c_W)
    ball.stamp[i] = ball.now
    if node >= 0:
        length, n = way_from_cylinder(world.tree[body.tree + node], c)
        if length == 0.0:  # inside
            ball.plane[3, i] = math.inf
            return -math.inf, -math.inf
        above_c = length - world.proxy[0].radius_m
    else:
        u, v, w = corners(world, body, -1 - node)
        n = sub(c, closest_point(u, v, w, c))
        length = norm(n)
        above_c = length - world.proxy[0].radius_m
        if length == 0.0:
            n = cross(sub(v, u), sub(w, u))
            length = norm(n)
    scale = 1.0 / length  # one division: they are slow
    n = (scale * n[0], scale * n[1], scale * n[2])
    offset = dot(n, c) - above_c
    n, o = turn_to_world(body, n), body.p_WB_m
    offset += n[0] * o[0] + n[1] * o[1] + n[2] * o[2]
    for j in range(3):
        ball.plane[j, i] = n[j]
    ball.plane[3, i] = offset
    return above_c, dot(n, x_W) - offset


@inlined
def _hold(world: "World", i: int) -> None:
    """Add the plane of entry `i` of the front to those of the proxy; `met` stores its number."""
    proxy, ball = world.proxy[0], world.ball[0]
    k = proxy.count
    for j in range(3):
        proxy.nhat_W[k, j] = ball.plane[j, i]
    proxy.offset_m[k] = ball.plane[3, i]
    proxy.skin_m[k] = SKIN_M
    proxy.body[k], proxy.face[k] = ball.body[i], -1 - ball.node[i]
    proxy.met[k] = i
    proxy.count = k + 1


@native
def _ahead(world: "World", c: Vector, x: Vector, ratio: float) -> Vector:
    """Return the point on the way from `c` past `x`, up to `ratio` times as far, that the front allows.

    On a cylinder or ball of radius r, pushed by s, each move is s/r times as long as the last one. The solution is at
    the angle of the point 1 / (1 − s/r) times as far along the plane at `c`.
    """
    ball = world.ball[0]
    planes, way = ball.plane, sub(x, c)
    for i in range(ball.count):
        sinks = -(planes[0, i] * way[0] + planes[1, i] * way[1] + planes[2, i] * way[2])
        if sinks > 0.0:
            above = planes[0, i] * c[0] + planes[1, i] * c[1] + planes[2, i] * c[2] - planes[3, i]
            ratio = min(ratio, max(above / sinks, 1.0))
    return along(c, ratio, way)


@native
def _renew_planes(world: "World", c: Vector, start_W: Vector) -> bool:
    """Renew the planes that hold the ball for a centre at `c`, unless the ball at `start_W` is behind the new plane.

    Returns whether the solution can change by more than `SETTLED_M`.
    """
    proxy, ball = world.proxy[0], world.ball[0]
    change_m = 0.0
    for k in range(proxy.count):
        # an edge does not hold a tool that is deeper than the radius below it: the next face does
        i = _entry_below(world, proxy.met[k], c) if proxy.push_m[k] > proxy.radius_m else proxy.met[k]
        above, above_start = _put_plane(world, i, c, start_W, False)
        behind_m = -SLACK * proxy.radius_m
        if i != proxy.met[k] and (above < 0.0 or above_start < behind_m):  # a concave edge holds with both faces
            ball.stamp[i], i = -1, proxy.met[k]
            above, above_start = _put_plane(world, i, c, start_W, False)
        if above_start < min(above, 0.0) + behind_m:
            ball.stamp[i] = -1
            continue
        proxy.met[k], proxy.face[k] = i, -1 - ball.node[i]
        turn2 = 0.0
        for j in range(3):
            turn2 += (ball.plane[j, i] - proxy.nhat_W[k, j]) ** 2
            proxy.nhat_W[k, j] = ball.plane[j, i]
        proxy.offset_m[k] = ball.plane[3, i]
        change_m = max(change_m, above + math.sqrt(turn2) * proxy.push_m[k])
    return bool(change_m > SETTLED_M)


@native
def _entry_below(world: "World", i: int, c_W: Vector) -> int:
    """Return the entry of the face below `c_W`, found from the face of entry `i` across convex edges; `i` if none is.

    Where the centre is past an edge, the plane of the edge is tilted by the distance to the edge over the radius, which
    is more than the next face. A small ball that is pushed deep would go far beyond that face, and come back.
    """
    ball, body = world.ball[0], world.bodies[world.ball[0].body[i]]
    first = -1 - ball.node[i]
    face, c = first, to_body(body, c_W)
    for _ in range(EDGES_MAX):
        u, v, w = corners(world, body, face)
        edge = edge_past(u, v, w, c, 0.0)
        if edge < 0:
            break
        face = beyond(world, body, face, edge)
        if face < 0:
            return i
    else:
        return i
    if face == first:
        return i
    for k in range(ball.count):
        if ball.node[k] == -1 - face and ball.body[k] == ball.body[i]:
            return k
    if ball.count == FRONT_MAX:
        return i
    _append(world, ball.body[i], -1 - face)
    return int(ball.count - 1)


@native
def _side(world: "World", k: int) -> float:
    """Return 1 if the ball is in front of the face of plane `k`, −1 if it is behind."""
    proxy = world.proxy[0]
    body = world.bodies[proxy.body[k]]
    a, b, c = corners(world, body, proxy.face[k])
    n = proxy.nhat_W[k]
    return 1.0 if dot(turn_to_world(body, cross(sub(b, a), sub(c, a))), (n[0], n[1], n[2])) >= 0.0 else -1.0
