"""A phase of the tick of its own: what the tool does to the bodies, the reverse of what the surface does to the hand.

It acts at the proxy. Where the planes that hold the proxy are of several bodies, the others take the share of the
normal force with which their planes push, and the touched one the rest, with all that is tangential: the sum is exact.
What an effect says that a body gives within which the tool is (`f_inside_W_N`) is that one's. Running totals are kept,
so that whoever looks at them seldom, or misses a look, loses nothing.
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
    """Note the force on the touched body, and add what all got in this tick; `surface.total` is of contact alone."""
    touch, proxy, memory = surface.touch[0], world.proxy[0], surface.memory[0]
    f = surface.total[0].f_W_N
    force = (-f[0], -f[1], -f[2])
    index = touch.body
    for k in range(touch.inside):
        g = surface.total[0].f_inside_W_N[k]
        force = (force[0] + g[0], force[1] + g[1], force[2] + g[2])
        _give(world, proxy.passed[k], touch, (-g[0], -g[1], -g[2]))
    if touch.touching == 0:
        index = proxy.passed[proxy.passed_count - 1] if proxy.passed_count > 0 else -1
        if index < 0 and dot(force, force) > 0.0:  # what pulls after a contact
            index = touch.left_body
    elif touch.depth_m > 0.0:
        normal_N = dot(force, (touch.nhat_W[0], touch.nhat_W[1], touch.nhat_W[2]))
        for i in range(proxy.count):
            if proxy.body[i] != index:
                share_N = normal_N * proxy.push_m[i] / touch.depth_m
                n = (proxy.nhat_W[i, 0], proxy.nhat_W[i, 1], proxy.nhat_W[i, 2])
                force = along(force, -share_N, n)
                _give(world, proxy.body[i], touch, (share_N * n[0], share_N * n[1], share_N * n[2]))
    if index < 0:
        force = (0.0, 0.0, 0.0)
    else:
        _give(world, index, touch, force)
    for i in range(3):
        memory.f_body_W_N[i] = force[i]


@native
def _give(world: "World", index: int, touch: np.record, force: Vector) -> None:
    """Add the impulse of a force at the proxy over this tick."""
    p, o, lead, impulse = touch.p_WP_m, world.bodies[index].p_WB_m, world.bodies[index].lead_W_m, world.impulse[index]
    arm = sub((p[0], p[1], p[2]), (o[0] - lead[0], o[1] - lead[1], o[2] - lead[2]))
    torque = cross(arm, force)
    for i in range(3):
        impulse[i] += force[i] * touch.tick_s
        impulse[3 + i] += torque[i] * touch.tick_s
