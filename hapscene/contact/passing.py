"""Bodies that let the tool in (`Output.release`): while it is in one, that one holds it no more, what is in it does.

A body that was passed is not cast against until the proxy has left it again by the side on which it came in: seen from
where the proxy is now, the last face it crossed is met from that side.
"""

from typing import TYPE_CHECKING

from hapscene.compiled.native import native
from hapscene.constants import PASSED_MAX
from hapscene.contact.embree import first_face
from hapscene.contact.planes import copy_plane
from hapscene.contact.triangle import corners, plane, to_body, to_body_before
from hapscene.geometry import Vector, dot, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["hold_again", "leave", "let_in"]


@native
def let_in(world: "World") -> None:
    """Pass the body that is touched, from the next tick on."""
    proxy = world.proxy[0]
    if proxy.held == 0 or proxy.passed_count == PASSED_MAX:
        return
    index = proxy.body[proxy.by]
    world.bodies[index].passed = 1 if proxy.side[proxy.by] > 0.0 else -1
    proxy.passed[proxy.passed_count] = index
    proxy.passed_count += 1
    kept, count = 0, proxy.count
    for i in range(count):
        if proxy.body[i] != index:
            copy_plane(proxy, i, kept)
            kept += 1
    proxy.count = kept


@native
def hold_again(world: "World", index: int) -> None:
    """Have a passed body hold."""
    proxy = world.proxy[0]
    kept = 0
    for i in range(proxy.passed_count):
        if proxy.passed[i] != index:
            proxy.passed[kept] = proxy.passed[i]
            kept += 1
    proxy.passed_count = kept
    world.bodies[index].passed = 0


@native
def leave(world: "World", before_W: Vector, now_W: Vector) -> None:
    """Have the passed bodies hold again that the proxy has left on its way in this tick."""
    proxy = world.proxy[0]
    kept = 0
    for i in range(proxy.passed_count):
        index = proxy.passed[i]
        if _is_inside(world, index, before_W, now_W):
            proxy.passed[kept] = index
            kept += 1
        else:
            world.bodies[index].passed = 0
    proxy.passed_count = kept


@native
def _is_inside(world: "World", index: int, before_W: Vector, now_W: Vector) -> bool:
    """Whether the proxy is still on the far side of the surface by which it came into a body."""
    body, ball = world.bodies[index], world.ball_W_m[index]
    if body.passed == 0 or norm(sub(now_W, (ball[0], ball[1], ball[2]))) > ball[3]:
        return False
    now = to_body(body, now_W)
    back = sub(to_body_before(body, before_W), now)
    length = norm(back)
    if length == 0.0:
        return True
    c = body.center_B_m
    direction = (back[0] / length, back[1] / length, back[2] / length)
    face = first_face(body.search, world.ray, sub(now, (c[0], c[1], c[2])), direction, length, 0)
    if face < 0:
        return True
    n, _ = plane(*corners(world, body, face))
    side = 1 if dot(n, direction) < 0.0 else -1
    return bool(side != body.passed)
