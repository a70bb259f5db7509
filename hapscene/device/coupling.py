"""Virtual coupling: the scene is touched by a tool of its own, tied to the measured one by a spring and a damper.

Colgate, Stanley & Brown 1995; Adams & Hannaford 1999. However stiff the scene, the device then meets nothing stiffer
than the coupling. The virtual tool has no mass: it is where coupling and scene balance, and what the scene does to it
is what the device is sent. Each tick makes one step of Newton's method towards that place, from the last one and the
force that the tick found there, so a wall is in balance a tick after it was met, and no coupling, however soft, needs
a smaller step.
"""

from typing import Any

from hapscene.contact.geometry import Vector
from hapscene.native import native


@native
def couple(surface: Any, tool_W: Vector) -> Vector:
    """The virtual tool for one measured at `tool_W` [m]: k (tool − virtual) + b (speed − its speed) + f = 0."""
    limits, touch, memory = surface.limits[0], surface.touch[0], surface.memory[0]
    if memory.fresh == 1:
        return tool_W
    stiffness = limits.coupling_N_m + limits.coupling_Ns_m / touch.tick_s
    if touch.touching == 1:
        stiffness += touch.stiffness_N_m
    return (
        _balanced(limits, memory, tool_W[0], 0, stiffness),
        _balanced(limits, memory, tool_W[1], 1, stiffness),
        _balanced(limits, memory, tool_W[2], 2, stiffness),
    )


@native
def _balanced(limits: Any, memory: Any, tool_m: float, i: int, stiffness_N_m: float) -> float:
    """One coordinate: moved along with the tool, then by what was out of balance in the last tick."""
    last, virtual = memory.tool_W_m[i], memory.p_WT_m[i]
    force_N = limits.coupling_N_m * (last - virtual) + memory.f_W_N[i]
    return float(virtual + (tool_m - last) + force_N / stiffness_N_m)
