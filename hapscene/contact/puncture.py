"""Punctured bodies (`Output.release`): a body that the tool has entered no longer constrains the proxy.

A punctured body is excluded from casts until the proxy leaves it on the side by which it entered. To decide this, a ray
runs from the present proxy position back to the last one: if it meets a face of the body from the entry side, the
proxy has left.
"""

from typing import TYPE_CHECKING

from hapscene.compiled.native import native
from hapscene.constants import PASSED_MAX
from hapscene.contact.embree import first_face
from hapscene.contact.planes import copy_plane
from hapscene.contact.triangle import corners, plane, to_body, to_body_last
from hapscene.geometry import Vector, dot, norm, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = ["close_left_punctures", "close_puncture", "open_puncture"]


@native
def open_puncture(world: "World") -> None:
    """Exclude the touched body from contact, from the next tick on, and drop its planes."""
    proxy = world.proxy[0]
    if proxy.touching == 0 or proxy.puncture_count == PASSED_MAX:
        return
    index = proxy.body[proxy.dominant]
    world.bodies[index].punctured = 1 if proxy.side[proxy.dominant] > 0.0 else -1
    proxy.punctured[proxy.puncture_count] = index
    proxy.puncture_count += 1
    kept, count = 0, proxy.count
    for i in range(count):
        if proxy.body[i] != index:
            copy_plane(proxy, i, kept)
            kept += 1
    proxy.count = kept


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


@native
def close_left_punctures(world: "World", before_W: Vector, now_W: Vector) -> None:
    """Close the punctures of bodies that the proxy left in this tick on the entry side."""
    proxy = world.proxy[0]
    kept = 0
    for i in range(proxy.puncture_count):
        index = proxy.punctured[i]
        if _is_inside(world, index, before_W, now_W):
            proxy.punctured[kept] = index
            kept += 1
        else:
            world.bodies[index].punctured = 0
    proxy.puncture_count = kept


@native
def _is_inside(world: "World", index: int, before_W: Vector, now_W: Vector) -> bool:
    """Return whether the proxy is still beyond the surface by which it entered a punctured body."""
    body, ball = world.bodies[index], world.ball_W_m[index]
    if body.punctured == 0 or norm(sub(now_W, (ball[0], ball[1], ball[2]))) > ball[3]:
        return False
    now = to_body(body, now_W)
    back = sub(to_body_last(body, before_W), now)
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
    return bool(side != body.punctured)
