"""A scheme of its own: wave variables, made to hold on a real line (Niemeyer & Slotine 1991, 1998).

Per axis, u = (b ẋ + F)/√(2b) goes to the follower and v = (b ẋ − F)/√(2b) comes back; û and v̂ are what arrives:

    leader     F = b v − √(2b) v̂,  its motors give −F,               u = √(2b) v − v̂
    follower   b ẋ_d + F = √(2b) û,  F = K (x_d − x) + B (ẋ_d − v),  v = û − √(2/b) F

A wave carries the energy u²/2 per second, so a line that only delays is passive whatever the delay. What makes it so
with jitter, loss, reordering, encoder steps and a force that is held over a tick:

- Waves are sent as totals, their integral and their energy, and wait for their turn (`jitter_buffer`). The receiver
  goes from total to total, over messages that are missing on a straight line, which never asks for more energy than
  they had (Cauchy–Schwarz); and never spends more than has arrived. Where energy was short, position is caught up as
  soon as some is left.
- The energy told is never more than was observed at the motors: all that arrived, less the work f·Δx that was done on
  the device, exact for a force held over a tick (Stramigioli et al. 2005). While that falls short of the waves' own, a
  damper makes up for it. So the energy that arrives has been there, whatever the device did.
"""

import math
from typing import Any, Final

from hapscene.compiled.native import native
from hapscene.geometry import Vector
from hapscene.teleoperation.jitter_buffer import next_wave

__all__ = [
    "CATCH_UP_S",
    "GIFT_J",
    "REPAY_NS_M",
    "arrive",
    "energy_to_tell",
    "limit_force",
    "repay",
    "tie_follower",
    "tie_leader",
]

CATCH_UP_S: Final = 0.03
"""Time constant with which a position that fell behind for want of energy is caught up [s]. Faster asks for more energy
at once, slower is felt to drag."""

GIFT_J: Final = 2e-3
"""Energy beyond that of its waves that an end tells its peer of, once it has taken as much out of its device [J]: what
a position is caught up with: b x²/(2 CATCH_UP_S), which is 1.3 mJ for 5 mm at 3 N·s/m."""

REPAY_NS_M: Final = 1.0
"""Damping of an end while its device has given less energy than was told [N·s/m]: a capped passivity controller
(Hannaford & Ryu 2002). A third of the waves' impedance: seldom on, and hardly felt."""


@native
def tie_leader(port: Any, back: Vector) -> None:
    """Waves at the leader: an impedance b, and what comes back."""
    b = port.impedance_Ns_m
    root = math.sqrt(2.0 * b)
    for i in range(3):
        port.f_N[i] = root * back[i] - b * port.v_m_s[i]
    limit_force(port)
    v = port.v_m_s
    _send(port, root * v[0] - back[0], root * v[1] - back[1], root * v[2] - back[2])


@native
def tie_follower(port: Any, wave: Vector) -> None:
    """Waves at the follower: they move x_d, which draws the device along by spring and damper."""
    b, K, B, T = port.impedance_Ns_m, port.stiffness_N_m, port.damping_Ns_m, port.tick_s
    root = math.sqrt(2.0 * b)
    for i in range(3):  # b v_d + K (x_d + T v_d − x) + B (v_d − v) = √(2b) û, solved for v_d
        stretch = port.x_d_m[i] - port.x_m[i]
        v_d = (root * wave[i] + B * port.v_m_s[i] - K * stretch) / (b + B + K * T)
        port.f_N[i] = root * wave[i] - b * v_d
    limit_force(port)
    f = port.f_N
    for i in range(3):
        port.x_d_m[i] += T * (root * wave[i] - f[i]) / b
    _send(port, wave[0] - 2.0 / root * f[0], wave[1] - 2.0 / root * f[1], wave[2] - 2.0 / root * f[2])


@native
def arrive(port: Any, queue: Any) -> Vector:
    """The wave to play in this tick, within the energy that has arrived [√W]."""
    T = port.tick_s
    ticks, total, total_J = next_wave(queue)
    if ticks == 0:
        return 0.0, 0.0, 0.0
    port.spent_J = max(port.spent_J, total_J - port.reserve_J)
    x = (total[0] - port.path[0]) / ticks
    y = (total[1] - port.path[1]) / ticks
    z = (total[2] - port.path[2]) / ticks
    behind = port.catch_up
    to_x = x + behind * (port.path[0] - port.spent[0])
    to_y = y + behind * (port.path[1] - port.spent[1])
    to_z = z + behind * (port.path[2] - port.spent[2])
    port.path[0] += x
    port.path[1] += y
    port.path[2] += z
    wanted_J = 0.5 / T * (to_x * to_x + to_y * to_y + to_z * to_z)
    budget_J = max(total_J - port.spent_J, 0.0)
    if wanted_J > budget_J:
        ratio = math.sqrt(budget_J / wanted_J)
        to_x, to_y, to_z, wanted_J = ratio * to_x, ratio * to_y, ratio * to_z, budget_J
        port.short += ratio < 0.9
    port.spent[0] += to_x
    port.spent[1] += to_y
    port.spent[2] += to_z
    port.spent_J += wanted_J
    port.observed_J += wanted_J
    return to_x / T, to_y / T, to_z / T


@native
def energy_to_tell(port: Any) -> float:
    """The energy total that goes with the waves sent so far [J]."""
    return float(min(port.sent_J + GIFT_J, port.observed_J + port.allowance_J))


@native
def repay(port: Any) -> None:
    """Damp the device while it has given less than the waves took, and the gift."""
    if port.observed_J + port.allowance_J < port.sent_J + GIFT_J:
        for i in range(3):
            port.f_N[i] -= REPAY_NS_M * port.v_m_s[i]
        limit_force(port)


@native
def _send(port: Any, x: float, y: float, z: float) -> None:
    """Add a wave [√W] to what was sent."""
    port.sent[0] += port.tick_s * x
    port.sent[1] += port.tick_s * y
    port.sent[2] += port.tick_s * z
    port.sent_J += 0.5 * port.tick_s * (x * x + y * y + z * z)


@native
def limit_force(port: Any) -> None:
    """Keep the force inside the motors' limit; its direction stays."""
    f = port.f_N
    magnitude = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    if magnitude > port.force_limit_N:
        for i in range(3):
            f[i] *= port.force_limit_N / magnitude
