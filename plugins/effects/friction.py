"""Friction that sticks and slips, and does not drift (Hayward & Armstrong 2000), damped while it sticks.

A spring of stiffness k_t ties the proxy to a point of adhesion w on the surface; its tension is z = x − w. While it
sticks, spring and damper hold the proxy, which moved by Δx over the body in this tick of T:

    z ← z + Δx
    f = −(k_t z + b_t Δx/T)

Where |f| would be over µ_s F_n, F_n = `touch.normal_force_N`, it slips: |f| is µ F_n, in the direction it had, and z
is cut to µ F_n/k_t, so that the point of adhesion is dragged along. The damper is inside the limit (as in Kikuuwe,
Takesue, Sano, Mochiyama & Fujimoto 2006), so it makes nothing harder to slide; and a slip never draws the spring
further than the hand did, so what it gives back was put in.

µ is that at the slip speed v (`touch.slip_m_s`; Stribeck, and viscous friction: Armstrong-Hélouvry, Dupont & Canudas
de Wit 1994),

    µ = µ_d + (µ_s − µ_d) exp(−(v/v_s)²) + µ_v v

by default µ_d alone. It is asked while it slips only: what sticks feels no speed, and does not creep. As z is only ever
cut, friction gives back what was put in, no more, however µ falls. Where it falls faster than device and hand damp,
the tool squeals as on the surface itself; the low-pass on v makes it hold a little longer (`docs/stability.md`).

It sticks again when |f| falls below µ_d F_n, that is, when the hand turns back or presses harder, and where friction
grows as v falls, once v is at `REST` of v_s. With v_s and µ_v of 0 and undamped, all
depends on movement alone, none on velocity or time, so noise of the velocity is not felt; below the limit the point of
adhesion stays where it is to the bit, where Dahl's model creeps under vibration. The damper is for devices with little
friction of their own: held by a bare spring, at period T they ring about the point of adhesion for ever once k_t T/2 is
over their damping. With encoders of step Δ it is felt as kicks of b_t Δ/T; so it is 0 by default.

The spring is carried along the surface: when the normal turns, the tension turns with it by the least rotation. k_t is
by default the stiffness of the default wall, since the same device must bear it.

When it breaks loose, what is set free of the force makes the surface ring, as a tap does: a decaying sinusoid of
`breakaway_1_kg` times that force.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import DAMPING_NS_M, STIFFNESS_N_M
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.resonator import RESONATOR, resonate, strike
from hapscene.surface.swatch import FRICTION_MAX

REST = 0.05
"""Slip speed at which it sticks where friction grows as it slows down, over v_s [1]: µ is within 0.3 % of its rise
there. At 0 a tool that rests would be shaken loose by what it hardly feels."""

ROUNDING = 1e-9
"""How far below its limit the tension must fall before it sticks [1]: a proxy that rests while it slips sits
on the limit, rounding aside, and must not need to break away again."""


@native
def carry(z_W_m: Any, nhat_W: Any, to_W: Any, slip_W_m: Any) -> float:
    """Turn the tension from the plane of `nhat_W` to that of `to_W`, draw it by the slip; its length [m]."""
    cosine = along = 0.0
    for i in range(3):
        cosine += nhat_W[i] * to_W[i]
        along += z_W_m[i] * to_W[i]
    turned_over = cosine < -0.999  # the other side of a sheet, in the same plane
    share = 0.0 if turned_over else along / (1.0 + cosine)
    lift = 0.0
    for i in range(3):
        z_W_m[i] += slip_W_m[i] - share * (nhat_W[i] + to_W[i])
        nhat_W[i] = to_W[i]
        lift += z_W_m[i] * to_W[i]
    length2 = 0.0
    for i in range(3):
        z_W_m[i] -= lift * to_W[i]  # round an edge, slip is a chord
        length2 += z_W_m[i] * z_W_m[i]
    return math.sqrt(length2)


@native
def coefficient(p: np.record, slip_m_s: float) -> float:
    """µ at a slip speed [1]."""
    mu = p.friction_dynamic + p.friction_viscous_s_m * slip_m_s
    if p.friction_stribeck_m_s > 0.0:
        share = math.exp(-((slip_m_s / p.friction_stribeck_m_s) ** 2))
        mu += share * max(0.0, p.friction_static - p.friction_dynamic)
    return float(mu)


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Add the force of friction [N], tangential and no more than µ F_n, and what is heard when it breaks loose."""
    resonate(touch, s, out)
    if touch.began or touch.ended:
        for i in range(3):
            s.z_W_m[i] = 0.0
            s.nhat_W[i] = touch.nhat_W[i]
        s.slipping = 0.0
        return
    if not touch.touching:
        return
    length = carry(s.z_W_m, s.nhat_W, touch.nhat_W, touch.slip_W_m)
    stiffness, damper = p.tangential_stiffness_N_m, p.tangential_damping_Ns_m / touch.tick_s
    least_N = p.friction_dynamic * touch.normal_force_N
    dynamic_N = coefficient(p, touch.slip_m_s) * touch.normal_force_N
    static_N = max(p.friction_static * touch.normal_force_N, dynamic_N)
    size2 = 0.0
    for i in range(3):
        f_N = stiffness * s.z_W_m[i] + damper * touch.slip_W_m[i]
        size2 += f_N * f_N
    size_N, kept = math.sqrt(size2), 1.0
    if size_N > (dynamic_N if s.slipping else static_N):
        if s.slipping == 0.0 and p.breakaway_decay_1_s > 0.0 and p.breakaway_Hz < 0.5 * touch.rate_Hz:
            strike(s, p.breakaway_1_kg * (size_N - dynamic_N), p.breakaway_Hz, p.breakaway_decay_1_s)
        s.slipping = 1.0
        kept = dynamic_N / size_N
    elif size_N < (1.0 - ROUNDING) * (dynamic_N if touch.slip_m_s < REST * p.friction_stribeck_m_s else least_N):
        s.slipping = 0.0
    for i in range(3):
        out.f_W_N[i] -= kept * (stiffness * s.z_W_m[i] + damper * touch.slip_W_m[i])
    if s.slipping and stiffness * length > dynamic_N:
        for i in range(3):
            s.z_W_m[i] *= dynamic_N / (stiffness * length)


EFFECT = Effect(
    "friction",
    "Stick and slip along the surface, without drift.",
    render,
    params=(
        Param("friction_static", 0.0, "1", "coefficient at which it breaks away", 0.0, FRICTION_MAX),
        Param("friction_dynamic", 0.0, "1", "coefficient while it slips", 0.0, FRICTION_MAX),
        Param("tangential_stiffness_N_m", STIFFNESS_N_M, "N/m", "stiffness while it sticks", 1.0, 1e5),
        Param("tangential_damping_Ns_m", DAMPING_NS_M, "N·s/m", "damping while it sticks", 0.0, 1e3),
        Param("friction_stribeck_m_s", 0.0, "m/s", "speed over which it falls to dynamic; 0 at once", 0.0, 10.0),
        Param("friction_viscous_s_m", 0.0, "s/m", "what the coefficient grows by with speed", 0.0, 100.0),
        Param("breakaway_1_kg", 0.0, "1/kg", "sound of breaking loose, per newton set free", 0.0, 1e4),
        Param("breakaway_Hz", 0.0, "Hz", "its frequency", 0.0, 1e4),
        Param("breakaway_decay_1_s", 0.0, "1/s", "its decay", 0.0, 1e4),
    ),
    state=(State("z_W_m", (3,)), State("nhat_W", (3,)), State("slipping"), *RESONATOR),
)
