"""The describe phase of the tick: writes the contact to one `Touch` record, which all effects read.

Kinematics in one place keep the effects consistent: penetration depth and its rate, slip relative to the body that the
proxy touches, approach speed, touched swatch, and normal force.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import inlined, native
from hapscene.constants import TINY
from hapscene.contact.triangle import corners, to_body, to_body_last, to_world, turn_to_world, weights
from hapscene.geometry import Vector, along, dot, norm, sub
from hapscene.records import Record
from hapscene.surface.blending import paint_at, take_paint

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["describe", "shade"]


@inlined
def describe(world: "World", surface: "Surface", p_WT: Vector) -> None:
    """Fill `surface.touch[0]` from the proxy and the state of the last tick."""
    touch, memory, proxy = surface.touch[0], surface.memory[0], world.proxy[0]
    was_touching, was_depth, was_body = touch.touching, touch.depth_m, touch.body
    p_WP = (proxy.p_WP_m[0], proxy.p_WP_m[1], proxy.p_WP_m[2])
    p_WC = p_WP
    if proxy.touching == 1 and proxy.radius_m > 0.0:
        p_WC = along(p_WP, -proxy.radius_m, _vector(proxy.nhat_W[proxy.dominant]))
    v = (0.0, 0.0, 0.0)
    if memory.fresh == 0:
        v = sub(p_WT, (memory.p_WT_m[0], memory.p_WT_m[1], memory.p_WT_m[2]))
        v = (v[0] / touch.tick_s, v[1] / touch.tick_s, v[2] / touch.tick_s)
        touch.tick += 1
    touch.touching = proxy.touching
    touch.crossed = memory.other_crossed = 0
    touch.began = 1 if proxy.touching == 1 and was_touching == 0 else 0
    touch.ended = 1 if proxy.touching == 0 and was_touching == 1 else 0
    _set(touch.p_WT_m, p_WT)
    _set(touch.v_WT_m_s, v)
    if proxy.touching == 1:
        n = _locate(world, surface, p_WT, p_WP, p_WC)
        slip = (0.0, 0.0, 0.0)
        if touch.began == 0 and touch.body == was_body:
            slip = _slip(world.bodies[touch.body], memory, p_WP, p_WC, n)
        drag = _body_velocity(world.bodies[touch.body], p_WC, touch.tick_s)
        _set(memory.drag_m_s, drag)
        v_rel = sub(v, drag)
        _press(touch, memory.smoothing, v_rel, was_depth)
        _slide(touch, memory, slip, v_rel, n)
    else:
        if touch.ended == 1:
            touch.leaving_m_s = max(0.0, dot(sub(v, _vector(memory.drag_m_s)), _vector(touch.nhat_W)))
            touch.left_body = -1 if memory.jumped == 1 else was_body
            body, last = world.bodies[was_body], _vector(memory.p_WP_m)
            _set(memory.left_B_m, to_body_last(body, last) if body.moved == 1 else to_body(body, last))
        p_WP = p_WC = p_WT
        _set(memory.drag_m_s, (0.0, 0.0, 0.0))
        _clear_contact(touch)
    if touch.left_body >= 0:
        _set(touch.left_W_m, to_world(world.bodies[touch.left_body], _vector(memory.left_B_m)))
    _list_punctured(world, touch)
    _set(touch.p_WP_m, p_WP)
    _set(touch.p_WC_m, p_WC)
    _set(memory.p_WT_m, p_WT)
    _set(memory.p_WP_m, p_WP)
    memory.fresh = memory.jumped = 0


@inlined
def _list_punctured(world: "World", touch: np.record) -> None:
    """List the punctured bodies and their poses."""
    proxy = world.proxy[0]
    touch.inside = proxy.puncture_count
    for k in range(proxy.puncture_count):
        body = world.bodies[proxy.punctured[k]]
        touch.inside_body[k] = proxy.punctured[k]
        for i in range(3):
            for j in range(3):
                touch.inside_X_WB[k, 3 * i + j] = body.R_WB[i, j]
            touch.inside_X_WB[k, 9 + i] = body.p_WB_m[i]


@native
def shade(world: "World", surface: "Surface") -> int:
    """Replace the normal by one interpolated over the touched face if all active planes belong to one smooth surface.

    Slip and speeds remain those along the face. Returns no flags.
    """
    touch, proxy = surface.touch[0], world.proxy[0]
    if touch.touching == 0:
        return 0
    for i in range(proxy.count):
        cosine = 0.0
        for k in range(3):
            cosine += proxy.nhat_W[i, k] * proxy.nhat_W[proxy.dominant, k]
        if cosine < proxy.crease_cos:
            return 0
    body = world.bodies[touch.body]
    row = body.face + touch.face
    x = y = z = 0.0
    for k in range(3):
        w = max(0.0, touch.bary[k])  # the proxy can be one skin past an edge
        x += w * world.corners_m[row, 4 + k, 0]
        y += w * world.corners_m[row, 4 + k, 1]
        z += w * world.corners_m[row, 4 + k, 2]
    s = turn_to_world(body, (x, y, z))
    n = touch.nhat_W
    length = norm(s)
    if length == 0.0:
        return 0
    if s[0] * n[0] + s[1] * n[1] + s[2] * n[2] < 0.0:  # back of a two-sided face
        length = -length
    n[0], n[1], n[2] = s[0] / length, s[1] / length, s[2] / length
    return 0


@inlined
def _locate(world: "World", surface: "Surface", p_WT: Vector, p_WP: Vector, p_WC: Vector) -> Vector:
    """Write what is touched: body, face, swatch, depth, normal and normal force. Returns the normal."""
    touch, proxy = surface.touch[0], world.proxy[0]
    by = proxy.dominant
    touch.body, touch.face = proxy.body[by], proxy.face[by]
    body = world.bodies[touch.body]
    for i in range(3):
        touch.x_WB[i], touch.y_WB[i] = body.R_WB[i, 0], body.R_WB[i, 1]
    _set(touch.bary, weights(corners(world, body, touch.face), to_body(body, p_WC)))
    paint = int(surface.paint[surface.paint_start[touch.body] + touch.face])
    if paint < 0:
        paint = paint_at(surface.leaf, surface.leaf_start[-1 - paint], surface.leaf_start[-paint], touch.bary)
    if paint != touch.swatch or touch.other >= 0:
        take_paint(touch, surface.memory[0], surface.states, surface.passed_on, paint)
    out = sub(p_WP, p_WT)
    depth = norm(out)
    touch.depth_m = depth
    if proxy.count == 1 or depth == 0.0:  # use the normal of the face, which is exact at any depth
        n = (proxy.nhat_W[by, 0], proxy.nhat_W[by, 1], proxy.nhat_W[by, 2])
    else:
        n = (out[0] / depth, out[1] / depth, out[2] / depth)
    _set(touch.nhat_W, n)
    touch.stiffness_N_m = surface.stiffness_N_m[touch.swatch]
    if touch.other >= 0:
        touch.stiffness_N_m += touch.weight * (surface.stiffness_N_m[touch.other] - touch.stiffness_N_m)
    touch.normal_force_N = touch.stiffness_N_m * depth
    return n


@native
def _body_velocity(body: np.record, p_WC: Vector, tick_s: float) -> Vector:
    """Return the velocity of a body at a point on it [m/s], 0 if the body is at rest."""
    if body.moved == 0:
        return 0.0, 0.0, 0.0
    d = sub(to_world(body, to_body_last(body, p_WC)), p_WC)
    return d[0] / tick_s, d[1] / tick_s, d[2] / tick_s


@native
def _slip(body: np.record, memory: np.record, p_WP: Vector, p_WC: Vector, n: Vector) -> Vector:
    """Return the tangential displacement of the proxy relative to the body in this tick [m]."""
    last = (memory.p_WP_m[0], memory.p_WP_m[1], memory.p_WP_m[2])
    if body.moved == 1:
        arm = sub(p_WC, p_WP)  # the body moves under the contact point
        last = along(to_world(body, to_body_last(body, along(last, 1.0, arm))), -1.0, arm)
    d = sub(p_WP, last)
    return along(d, -dot(d, n), n)


@native
def _press(touch: Record, smoothing: float, v_rel: Vector, was_depth: float) -> None:
    """Write the depth rate within a contact, or the approach speed if one begins, and low-pass the normal force."""
    n = touch.nhat_W
    if touch.began == 1:
        into = -(n[0] * v_rel[0] + n[1] * v_rel[1] + n[2] * v_rel[2])
        touch.approach_m_s = max(0.0, into)
        touch.depth_rate_m_s = 0.0
        touch.force_N = 0.0
    else:
        touch.depth_rate_m_s = (touch.depth_m - was_depth) / touch.tick_s
    touch.force_N += smoothing * (touch.normal_force_N - touch.force_N)
    if touch.force_N < TINY:
        touch.force_N = 0.0


@native
def _slide(touch: np.record, memory: np.record, slip: Vector, v_rel: Vector, n: Vector) -> None:
    """Write the slip of this tick and its low-passed speed, which starts with the tangential velocity of the device."""
    k = memory.smoothing
    s = (memory.slip_m_s[0], memory.slip_m_s[1], memory.slip_m_s[2])
    if touch.began == 1:
        s = v_rel
    else:
        s = along(s, k / touch.tick_s, slip)
        s = along(s, -k, (memory.slip_m_s[0], memory.slip_m_s[1], memory.slip_m_s[2]))
    s = along(s, -dot(s, n), n)
    speed = norm(s)
    if speed < TINY:
        s, speed = (0.0, 0.0, 0.0), 0.0
    _set(memory.slip_m_s, s)
    _set(touch.slip_W_m, slip)
    touch.slip_m_s = speed


@native
def _clear_contact(touch: np.record) -> None:
    """Clear body, depth, force and slip without contact. Normal and swatch remain those of the last contact."""
    touch.body, touch.face = -1, -1
    touch.depth_m = touch.depth_rate_m_s = touch.normal_force_N = touch.force_N = touch.slip_m_s = 0.0
    _set(touch.slip_W_m, (0.0, 0.0, 0.0))
    _set(touch.bary, (0.0, 0.0, 0.0))


@native
def _vector(values: NDArray[np.float64]) -> Vector:
    return values[0], values[1], values[2]


@native
def _set(target: NDArray[np.float64], v: Vector) -> None:
    target[0], target[1], target[2] = v[0], v[1], v[2]
