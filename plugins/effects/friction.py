"""Stick–slip friction without drift (Hayward & Armstrong 2000), with optional damping while sticking.

A spring of stiffness k_t connects the proxy x to an attachment point w on the surface; its extension is z = x − w.
While the proxy sticks, spring and damper hold it. With the displacement Δx over the body in a tick of period T:

    z ← z + Δx
    f = −(k_t z + b_t Δx/T)

The proxy slips if |f| exceeds µ_s F_n with F_n = `touch.normal_force_N`. Then |f| is limited to µ F_n without a change
of direction, and z to µ F_n/k_t, which drags the attachment point along. The damping force counts towards the limit (as
in Kikuuwe, Takesue, Sano, Mochiyama & Fujimoto 2006), so it does not increase the friction. A slip only shortens the
spring, so friction never adds energy.

The coefficient at the slip speed v (`touch.slip_m_s`) includes the Stribeck effect and viscous friction
(Armstrong-Hélouvry, Dupont & Canudas de Wit 1994),

    µ = µ_d + (µ_s − µ_d) exp(−(v/v_s)²) + µ_v v

and is µ_d by default. It applies only while the proxy slips, so a sticking proxy does not creep. If friction falls with
speed faster than device and hand damp, the tool oscillates (stick–slip), as on the real surface; the low-pass on v
delays this slightly (`docs/results/stability.md`).

The proxy sticks again when |f| falls below µ_d F_n: when the hand reverses or presses harder or, with a Stribeck curve,
when v falls below `REST` times v_s. If v_s, µ_v and the damping are 0, the force depends only on displacement, so
velocity noise has no effect. Below the limit, the attachment point does not move at all, while Dahl's model creeps
under vibration. The damping is meant for devices with little friction, which otherwise oscillate about the attachment
point if k_t T/2 exceeds their damping. With encoders of resolution Δ, it causes force steps of b_t Δ/T; the default is
0.

The spring follows the surface: when the normal rotates, the extension rotates with it. k_t defaults to the default
contact stiffness, because the same device must render it stably.

At each transition from stick to slip, the released force excites a decaying sinusoid with an amplitude of
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
"""Slip speed below which the proxy sticks again, as a fraction of v_s [1]. There, µ is within 0.3 % of its value
at rest. With 0, imperceptible motion of a resting tool would prevent sticking."""

ROUNDING = 1e-9
"""Relative margin below the limit at which the proxy sticks [1]. A proxy that stops while slipping is at the limit
except for rounding, and must not have to overcome static friction again."""


@native
def carry(z_W_m: Any, nhat_W: Any, to_W: Any, slip_W_m: Any) -> float:
    """Rotate the extension from the plane with normal `nhat_W` to `to_W`, add the slip, and return its length [m]."""
    cosine = along = 0.0
    for i in range(3):
        cosine += nhat_W[i] * to_W[i]
        along += z_W_m[i] * to_W[i]
    turned_over = cosine < -0.999  # opposite side of a thin sheet, same plane
    share = 0.0 if turned_over else along / (1.0 + cosine)
    lift = 0.0
    for i in range(3):
        z_W_m[i] += slip_W_m[i] - share * (nhat_W[i] + to_W[i])
        nhat_W[i] = to_W[i]
        lift += z_W_m[i] * to_W[i]
    length2 = 0.0
    for i in range(3):
        z_W_m[i] -= lift * to_W[i]  # at an edge, the slip has a normal component
        length2 += z_W_m[i] * z_W_m[i]
    return math.sqrt(length2)


@native
def coefficient(p: np.record, slip_m_s: float) -> float:
    """Friction coefficient µ at a slip speed [1]."""
    mu = p.friction_dynamic + p.friction_viscous_s_m * slip_m_s
    if p.friction_stribeck_m_s > 0.0:
        share = math.exp(-((slip_m_s / p.friction_stribeck_m_s) ** 2))
        mu += share * max(0.0, p.friction_static - p.friction_dynamic)
    return float(mu)


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Adds the friction force [N], tangential and at most µ F_n, and the vibration of a breakaway [m/s²]."""
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
    "Stick–slip friction along the surface, without drift.",
    render,
    params=(
        Param("friction_static", 0.0, "1", "coefficient of static friction", 0.0, FRICTION_MAX),
        Param("friction_dynamic", 0.0, "1", "coefficient of dynamic friction", 0.0, FRICTION_MAX),
        Param("tangential_stiffness_N_m", STIFFNESS_N_M, "N/m", "stiffness while sticking", 1.0, 1e5),
        Param("tangential_damping_Ns_m", DAMPING_NS_M, "N·s/m", "damping while sticking", 0.0, 1e3),
        Param("friction_stribeck_m_s", 0.0, "m/s", "Stribeck speed; 0: no dependence on speed", 0.0, 10.0),
        Param("friction_viscous_s_m", 0.0, "s/m", "viscous friction: coefficient per speed", 0.0, 100.0),
        Param("breakaway_1_kg", 0.0, "1/kg", "breakaway vibration per newton of released force", 0.0, 1e4),
        Param("breakaway_Hz", 0.0, "Hz", "frequency of the breakaway vibration", 0.0, 1e4),
        Param("breakaway_decay_1_s", 0.0, "1/s", "decay of the breakaway vibration", 0.0, 1e4),
    ),
    state=(State("z_W_m", (3,)), State("nhat_W", (3,)), State("slipping"), *RESONATOR),
)
