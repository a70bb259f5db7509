"""Computes what the tool does to the bodies: the reaction to the contact force on the hand.

The reaction acts at the contact point. If the active planes belong to several bodies, each of the others receives the
share of the normal force with which its planes push, and the touched body receives the rest with the whole tangential
force, so that the sum is exact. Forces that an effect assigns to a punctured body (`f_inside_W_N`) act on that body.
Impulses are accumulated as running totals, so that a program that reads them rarely loses nothing.
"""

from typing import TYPE_CHECKING

import numpy as np

from hapscene.compiled.native import inlined, native
from hapscene.geometry import Vector, along, cross, dot, sub

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["react"]


@inlined
def react(world: "World", surface: "Surface") -> None:
    """Write the force on the touched body and add the impulse of this tick on all bodies.

    Runs before the effects of the scene, so `surface.total` holds the contact force alone.
    """
    touch, proxy, memory = surface.touch[0], world.proxy[0], surface.memory[0]
    f = surface.total[0].f_W_N
    force = (-f[0], -f[1], -f[2])
    at = (touch.p_WC_m[0], touch.p_WC_m[1], touch.p_WC_m[2])
    index = touch.body
    for k in range(touch.inside):
        g = surface.total[0].f_inside_W_N[k]
        force = (force[0] + g[0], force[1] + g[1], force[2] + g[2])
        _give(world, proxy.punctured[k], touch, at, (-g[0], -g[1], -g[2]))
    if touch.touching == 0:
        index = proxy.punctured[proxy.puncture_count - 1] if proxy.puncture_count > 0 else -1
        if index < 0 and dot(force, force) > 0.0:  # pulls of adhesion after the contact act on the body that was left
            index = touch.left_body
    elif touch.depth_m > 0.0:
        normal_N = dot(force, (touch.nhat_W[0], touch.nhat_W[1], touch.nhat_W[2]))
        # the device presses along the normal with depth = Σ push; each plane carries push/depth of the normal force
        for i in range(proxy.count):
            if proxy.body[i] != index:
                share_N = normal_N * proxy.push_m[i] / touch.depth_m
                n = (proxy.nhat_W[i, 0], proxy.nhat_W[i, 1], proxy.nhat_W[i, 2])
                force = along(force, -share_N, n)
                at = along((touch.p_WP_m[0], touch.p_WP_m[1], touch.p_WP_m[2]), -proxy.radius_m, n)
                _give(world, proxy.body[i], touch, at, (share_N * n[0], share_N * n[1], share_N * n[2]))
    if index < 0:
        force = (0.0, 0.0, 0.0)
    else:
        _give(world, index, touch, at, force)
    for i in range(3):
        memory.f_body_W_N[i] = force[i]


@native
def _give(world: "World", index: int, touch: np.record, at: Vector, force: Vector) -> None:
    """Add the linear and angular impulse of a force at a point over this tick."""
    o, lead, impulse = world.bodies[index].p_WB_m, world.bodies[index].shift_W_m, world.impulse[index]
    arm = sub(at, (o[0] - lead[0], o[1] - lead[1], o[2] - lead[2]))
    torque = cross(arm, force)
    for i in range(3):
        impulse[i] += force[i] * touch.tick_s
        impulse[3 + i] += torque[i] * touch.tick_s
