"""Viscosity: a damper in a region, as honey in a pot.

    f = −b g u,    u̇ = 2π f_c (g v − u)

with damping b [N·s/m], the velocity v [m/s] of the tool in F (the first named body, or W), u its low-pass of cut-off
f_c [Hz], and g [1]: 1 in the region, falling to 0 over `margin_m` inside its border, so that nothing jumps there. The
region is a box (`box_m`, two opposite corners), a ball (`center_m` and `radius_m`), or, where neither is given,
everywhere.

For any g that changes with place or time, f·v = −b u² − (b/(4π f_c)) d(u²)/dt: what it stores is ½ b u²/(2π f_c), and
it gives no more (that is why g stands twice). Sampled with period T, a free mass m is stable while b < 2 m/T, whatever
f_c (the characteristic polynomial z² − (2 − κ − βκ/2) z + 1 − κ + βκ/2, β = bT/m, κ = 1 − e^(−2π f_c T), by Jury's
test): 90 N·s/m for the 45 g of an Omni at 1 kHz. Far below, the encoder's step Δ limits it: felt as a tick of b κ Δ/T.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import EffectError
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.field_frame import add_force, field_array, to_frame

JUMP_M_S: Final = 10.0
"""Speed beyond which the tool, or the body of the frame, did not move but was put elsewhere [m/s]: it is not damped."""

EVERYWHERE, BALL, BOX = 0.0, 1.0, 2.0


@native
def depth_in(table: NDArray[np.float64], x: float, y: float, z: float, radius_m: float) -> float:
    """How far inside the region's border a point of F is [m]; 0 outside, and as deep as you like in no region."""
    at = len(table) - 7
    if table[at] == EVERYWHERE:
        return math.inf
    dx, dy, dz = abs(x - table[at + 1]), abs(y - table[at + 2]), abs(z - table[at + 3])
    if table[at] == BALL:
        return max(0.0, radius_m - math.sqrt(dx * dx + dy * dy + dz * dz))
    return float(max(0.0, min(table[at + 4] - dx, table[at + 5] - dy, table[at + 6] - dz)))


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Add the drag [N]."""
    x, y, z = to_frame(table, touch.p_WT_m)
    vx, vy, vz = (x - s.p_m[0]) / touch.tick_s, (y - s.p_m[1]) / touch.tick_s, (z - s.p_m[2]) / touch.tick_s
    s.p_m[0], s.p_m[1], s.p_m[2] = x, y, z
    if s.started == 0.0 or vx * vx + vy * vy + vz * vz > JUMP_M_S * JUMP_M_S:
        vx = vy = vz = 0.0
    s.started = 1.0
    g = min(1.0, depth_in(table, x, y, z, p.radius_m) / p.margin_m)
    share = -math.expm1(-2.0 * math.pi * p.cutoff_Hz * touch.tick_s)
    s.u_m_s[0] += share * (g * vx - s.u_m_s[0])
    s.u_m_s[1] += share * (g * vy - s.u_m_s[1])
    s.u_m_s[2] += share * (g * vz - s.u_m_s[2])
    add_force(out, table, -p.damping_Ns_m * g, (s.u_m_s[0], s.u_m_s[1], s.u_m_s[2]))


def table(settings: Mapping[str, Any], rate_Hz: float) -> NDArray[np.float64]:
    """The region: its kind, centre and half sizes."""
    box, center = settings["box_m"], settings["center_m"]
    if box is not None and center is not None:
        raise EffectError("effect 'viscosity' acts in one region: give box_m or center_m, not both")
    if box is not None:
        corners = field_array("viscosity", settings, "box_m", "two opposite corners (2, 3)")
        if len(corners) != 2:
            raise EffectError(f"effect 'viscosity': box_m is two opposite corners (2, 3), not {corners.shape}")
        return np.array([BOX, *corners.mean(axis=0), *(abs(corners[1] - corners[0]) / 2.0)])
    if center is not None:
        middle = field_array("viscosity", settings, "center_m", "a ball's centre (3,)")
        if len(middle) != 1:
            raise EffectError(f"effect 'viscosity': center_m is one point (3,), not {middle.shape}")
        return np.array([BALL, *middle[0], 0.0, 0.0, 0.0])
    return np.array([EVERYWHERE, *np.zeros(6)])


EFFECT = Effect(
    "viscosity",
    "Drags at the tool in a region, as honey does.",
    render,
    params=(
        Param("damping_Ns_m", 2.0, "N·s/m", "force over speed; stable below 2 m/T", 0.0, 100.0),
        Param("radius_m", 0.05, "m", "of the ball about center_m", 0.0, 100.0),
        Param("margin_m", 0.005, "m", "inside the border, over which it rises", 1e-4, 10.0),
        Param("cutoff_Hz", 50.0, "Hz", "of the low-pass on the velocity", 1.0, 1000.0),
    ),
    state=(State("p_m", (3,)), State("u_m_s", (3,)), State("started")),
    table=table,
    scope="scene",
    arrays=("box_m", "center_m"),
)
