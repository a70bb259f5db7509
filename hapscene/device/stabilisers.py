"""Stabilisers of the tick: a virtual coupling before the contact, a passivity controller after the effects.

Virtual coupling: the scene is touched by a tool of its own, tied to the measured one by a spring and a damper.
Colgate, Stanley & Brown 1995; Adams & Hannaford 1999. However stiff the scene, the device then meets nothing stiffer
than the coupling. The virtual tool has no mass: it is where coupling and scene balance, and what the scene does to it
is what the device is sent. Each tick makes one step of Newton's method towards that place, from the last one and the
force that the tick found there, so a wall is in balance a tick after it was met, and no coupling, however soft, needs
a smaller step.
"""

from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.constants import TINY
from hapscene.flags import Flag
from hapscene.geometry import Vector

if TYPE_CHECKING:
    from hapscene.surface.surface_arrays import Surface

__all__ = ["FORGET_S", "couple", "guard"]


@native
def couple(surface: "Surface") -> int:
    """Replace the measured tool, `memory.now_W_m`, by the virtual one: k (tool − virtual) + b (speed − its speed) = −f.

    Returns no flags.
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
    """One coordinate: moved along with the tool, then by what was out of balance in the last tick."""
    last, virtual = memory.tool_W_m[i], memory.p_WT_m[i]
    force_N = limits.coupling_N_m * (last - virtual) + memory.f_W_N[i]
    return float(virtual + (tool_m - last) + force_N / stiffness_N_m)


# The net under walls that the limits did not catch: a passivity observer, and a controller whose damping is capped.
#
# Observer: the energy that a wall gave out and never took in. A wall may give back what its spring holds, so in a tick
# in which the force f was held while the tool went Δx over the touched body (Hannaford & Ryu 2002, exact for a
# zero-order hold; the spring as reference as in Ryu, Preusche, Hirzinger & Hannaford 2005)
#
#     made ← max(0, made + f·Δx + ½ f' d' − ½ f d)
#
# with the normal part f of the force that was sent `delay_ticks` before, and the spring's force and depth f d, f' d' of
# the last and of this tick. So what a damper took is never set off against what comes later, and friction has no part
# in it: it only takes, and what it took would hide what the wall gives. What was made is kept from bounce to bounce,
# and forgotten within `FORGET_S`. Encoders of step Δ see the tool up to ½Δ from where it is: what that looks like, ½KΔ
# for each metre along the normal, is not counted; where the force is cut at its limit it changes with no step.
#
# Controller: as long as made > 0, a damper along the normal that takes it back within a tick, as far as `guard_Ns_m`
# lets it: without that cap it would ask for an endless damper wherever the tool nearly rests, and chatter. It never
# pulls, and leaves a tool in the air alone.


_DAMPED = int(Flag.ENERGY_DAMPED)

FORGET_S: Final = 0.5
"""Time in which what was made is forgotten [s]: several bounces of a light hand. Much shorter, and a bounce is over
before its energy is taken back; longer, and a wall is felt as sticky long after."""

TINY_J: Final = 1e-10
"""What is left alone [J]: rounding, and no more than moves a light device at 0.1 mm/s."""


@native
def guard(surface: "Surface", tool_W: Vector) -> int:
    """Observe the last tick, the measured tool now at `tool_W` [m]; damp this tick's sum. Returns flags."""
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
    damping = min(made * touch.tick_s / (way * way), limits.guard_Ns_m)
    over = max(push - limits.force_N, 0.0)  # is cut anyway, and would hide what is taken from it
    add = max(-damping * way / touch.tick_s - over, -max(push, 0.0))
    for i in range(3):
        f[i] += add * n[i]
    return _DAMPED


@native
def stored_energy(limits: np.record, touch: np.record, push_N: float) -> float:
    """Energy of the wall's spring at its depth, its force cut, and of the coupling [J], pushed at with `push_N`."""
    depth_m, most_N = touch.depth_m, limits.force_N
    spring_N = min(max(push_N, 0.0), touch.stiffness_N_m * depth_m)
    stored = 0.5 * spring_N * depth_m if spring_N <= most_N else most_N * depth_m * (1.0 - 0.5 * most_N / spring_N)
    if limits.coupling_N_m > 0.0:
        stored += 0.5 * push_N * push_N / limits.coupling_N_m
    return float(stored)
