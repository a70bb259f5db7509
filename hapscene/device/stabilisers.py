"""Stabilisers of the haptic tick: virtual coupling before the contact, passivity controller after the effects.

Virtual coupling (Colgate, Stanley & Brown 1995; Adams & Hannaford 1999): a virtual tool touches the scene, and a spring
and a damper connect it to the measured tool. The device then never meets a stiffness above that of the coupling. The
virtual tool has no mass: it is in equilibrium between coupling and scene, and the force of the scene on it is sent to
the device. Each tick makes one step of Newton's method towards the equilibrium, from the last position and its force. A
wall is therefore in equilibrium one tick after contact, and a soft coupling needs no smaller step.
"""

from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.constants import TINY
from hapscene.flags import Flag
from hapscene.geometry import Vector

if TYPE_CHECKING:
    from hapscene.surface.surface_arrays import Surface

__all__ = ["FORGET_S", "control_passivity", "couple"]


@native
def couple(surface: "Surface") -> int:
    """Replace the measured tool position `memory.now_W_m` by that of the virtual tool. Returns 0 (no flags).

    The virtual tool satisfies k (tool − virtual) + b (tool velocity − virtual velocity) = −f.
    """
    limits, touch, memory = surface.limits[0], surface.touch[0], surface.memory[0]
    if memory.fresh == 1:
        return 0
    stiffness = limits.coupling_N_m + limits.coupling_Ns_m / touch.tick_s
    if touch.touching == 1:
        stiffness += touch.stiffness_N_m
    for i in range(3):
        memory.now_W_m[i] = _balanced(limits, memory, memory.now_W_m[i], i, stiffness)
    return 0


@native
def _balanced(limits: np.record, memory: np.record, tool_m: float, i: int, stiffness_N_m: float) -> float:
    """One coordinate: follow the tool, then correct the imbalance of the last tick."""
    last, virtual = memory.tool_W_m[i], memory.p_WT_m[i]
    force_N = limits.coupling_N_m * (last - virtual) + memory.f_W_N[i]
    return float(virtual + (tool_m - last) + force_N / stiffness_N_m)


# Passivity observer and passivity controller with limited damping, for walls beyond the limits of the device.
#
# Observer: the energy that a wall has generated. A wall may return the energy stored in its spring. Therefore, for a
# tick in which the force f was held while the tool moved by Δx relative to the touched body (Hannaford & Ryu 2002,
# exact for a zero-order hold; the spring as reference as in Ryu, Preusche, Hirzinger & Hannaford 2005)
#
#     made ← max(0, made + f·Δx + ½ f' d' − ½ f d)
#
# with the normal component f of the force that was sent `delay_ticks` before, and force and depth of the spring, f d
# and f' d', in the last and in this tick. Energy that a damper dissipated is not credited against energy generated
# later. Friction is left out: it only dissipates, and would hide the energy that the wall generates. The generated
# energy is kept from bounce to bounce, and forgotten within `FORGET_S`. Encoders of resolution Δ measure the tool with
# an error of up to ½Δ. The apparent energy of that error, ½KΔ per metre along the normal, is subtracted, except where
# the force is saturated and does not depend on the position.
#
# Controller: while made > 0, a damper along the normal dissipates this energy within a tick, up to the damping
# `passivity_Ns_m`. Without this limit the damping would become infinite where the tool is nearly at rest, and chatter.
# The damper never pulls the tool into the surface, and does not act in free space.


_DAMPED = int(Flag.ENERGY_DAMPED)

FORGET_S: Final = 0.5
"""Time constant at which generated energy is forgotten [s]: several bounces of a light hand. If it is much shorter, a
bounce ends before its energy is dissipated; if longer, a wall feels sticky for a long time."""

TINY_J: Final = 1e-10
"""Energy that is neglected [J]: rounding errors, or the kinetic energy of a light device at 0.1 mm/s."""


@native
def control_passivity(surface: "Surface", tool_W: Vector) -> int:
    """Observe the energy of the last tick and damp the force of this tick. Returns flags.

    `tool_W` is the measured tool position [m].
    """
    limits, touch, total, memory = surface.limits[0], surface.touch[0], surface.total[0], surface.memory[0]
    f, n, sent, was = total.f_W_N, touch.nhat_W, memory.f_W_N, memory.nhat_W
    size = len(memory.held_N)
    last = (touch.tick - 1) % size
    held = (touch.tick - 1 - limits.delay_ticks) % size
    pushed = sent[0] * was[0] + sent[1] * was[1] + sent[2] * was[2]
    work = way = push = 0.0
    for i in range(3):
        step = tool_W[i] - memory.tool_W_m[i] - memory.drag_m_s[i] * touch.tick_s
        memory.held_N[last, i] = pushed * was[i]
        work += memory.held_N[held, i] * step
        way += n[i] * step
        push += n[i] * f[i]
        was[i] = n[i]
    stored = stored_energy(limits, touch, push)
    doubt = 0.5 * touch.stiffness_N_m * limits.quantum_m * abs(way) if push < limits.force_N else 0.0
    made = memory.made_J * (1.0 - touch.tick_s / FORGET_S) + work + stored - memory.stored_J - doubt
    memory.made_J = made if made > TINY else 0.0
    memory.stored_J = stored
    if touch.touching == 0 or made <= TINY_J or way == 0.0:
        return 0
    damping = min(made * touch.tick_s / (way * way), limits.passivity_Ns_m)
    over = max(push - limits.force_N, 0.0)  # saturation removes this part anyway, which would hide the damping
    add = max(-damping * way / touch.tick_s - over, -max(push, 0.0))
    for i in range(3):
        f[i] += add * n[i]
    return _DAMPED


@native
def stored_energy(limits: np.record, touch: np.record, push_N: float) -> float:
    """Energy stored in the spring of the wall, with saturation of its force, and in the coupling [J]."""
    depth_m, most_N = touch.depth_m, limits.force_N
    spring_N = min(max(push_N, 0.0), touch.stiffness_N_m * depth_m)
    stored = 0.5 * spring_N * depth_m if spring_N <= most_N else most_N * depth_m * (1.0 - 0.5 * most_N / spring_N)
    if limits.coupling_N_m > 0.0:
        stored += 0.5 * push_N * push_N / limits.coupling_N_m
    return float(stored)
