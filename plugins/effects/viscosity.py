"""Viscosity: a damper in a region of space.

    f = −b g u,    u̇ = 2π f_c (g v − u)

b [N·s/m] is the damping, v [m/s] the velocity of the tool in the frame F (the first named body, or W), and u the
velocity after a low-pass with cut-off f_c [Hz]. g [1] is 1 in the region and falls to 0 over `margin_m` inside its
border, so that the force is continuous. The region is a box (`box_m`, two opposite corners), a ball (`center_m` and
`radius_m`), or all of space if neither is given.

For any g that varies with place or time, f·v = −b u² − (b/(4π f_c)) d(u²)/dt. The stored energy is ½ b u²/(2π f_c), and
no energy is added, because g appears twice. With sampling period T, a free mass m is stable if b < 2 m/T for any f_c
(characteristic polynomial z² − (2 − κ − βκ/2) z + 1 − κ + βκ/2, β = bT/m, κ = 1 − e^(−2π f_c T), by Jury's test): up to
90 N·s/m for the 45 g of an Omni at 1 kHz. In practice the encoder resolution Δ limits b, which causes force steps of
b κ Δ/T.
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
"""Speed above which a displacement counts as teleportation of the tool or the frame and is not damped [m/s]."""

EVERYWHERE, BALL, BOX = 0.0, 1.0, 2.0


@native
def depth_in(table: NDArray[np.float64], x: float, y: float, z: float, radius_m: float) -> float:
    """Distance of a point in F from the border of the region [m]; 0 outside, infinite if the region is all of space."""
    at = len(table) - 7
    if table[at] == EVERYWHERE:
        return math.inf
    dx, dy, dz = abs(x - table[at + 1]), abs(y - table[at + 2]), abs(z - table[at + 3])
    if table[at] == BALL:
        return max(0.0, radius_m - math.sqrt(dx * dx + dy * dy + dz * dz))
    return float(max(0.0, min(table[at + 4] - dx, table[at + 5] - dy, table[at + 6] - dz)))


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Adds the damping force [N]."""
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
    """Table of the region: kind, centre and half sizes."""
    box, center = settings["box_m"], settings["center_m"]
    if box is not None and center is not None:
        raise EffectError("effect 'viscosity': both box_m and center_m are given; expected one of them")
    if box is not None:
        corners = field_array("viscosity", settings, "box_m", "two opposite corners (2, 3)")
        if len(corners) != 2:
            raise EffectError(f"effect 'viscosity': box_m has shape {corners.shape}; expected two corners (2, 3)")
        return np.array([BOX, *corners.mean(axis=0), *(abs(corners[1] - corners[0]) / 2.0)])
    if center is not None:
        middle = field_array("viscosity", settings, "center_m", "a ball's centre (3,)")
        if len(middle) != 1:
            raise EffectError(f"effect 'viscosity': center_m has shape {middle.shape}; expected one point (3,)")
        return np.array([BALL, *middle[0], 0.0, 0.0, 0.0])
    return np.array([EVERYWHERE, *np.zeros(6)])


EFFECT = Effect(
    "viscosity",
    "Damps the motion of the tool in a region.",
    render,
    params=(
        Param("damping_Ns_m", 2.0, "N·s/m", "damping; stable below 2 m/T", 0.0, 100.0),
        Param("radius_m", 0.05, "m", "radius of the ball about center_m", 0.0, 100.0),
        Param("margin_m", 0.005, "m", "distance inside the border over which the damping rises", 1e-4, 10.0),
        Param("cutoff_Hz", 50.0, "Hz", "cut-off of the low-pass on the velocity", 1.0, 1000.0),
    ),
    state=(State("p_m", (3,)), State("u_m_s", (3,)), State("started")),
    table=table,
    scope="scene",
    arrays=("box_m", "center_m"),
)
