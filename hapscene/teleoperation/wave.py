"""Coupling by wave variables, extended for a link with jitter and loss (Niemeyer & Slotine 1991, 1998).

Per axis, u = (b ẋ + F)/√(2b) is sent to the follower and v = (b ẋ − F)/√(2b) to the leader; û and v̂ are the received
waves:

    leader     F = b v − √(2b) v̂,  motor force −F,                   u = √(2b) v − v̂
    follower   b ẋ_d + F = √(2b) û,  F = K (x_d − x) + B (ẋ_d − v),  v = û − √(2/b) F

A wave transports the power u²/2, so that a link with a constant delay is passive. Two measures keep it passive with
jitter, loss, reordering, encoder steps and a force that is held over a tick:

- Waves are sent as totals, their integral and their energy, through a jitter buffer. The receiver interpolates linearly
  over missing messages, which never needs more energy than they had (Cauchy–Schwarz), and never applies more energy
  than has arrived. When energy was short, the missing position is made up as soon as there is energy again.
- The transmitted energy is never more than the energy observed at the motors: all received energy, less the work
  f·Δx on the device, which is exact for a force held over a tick (Stramigioli et al. 2005). While it is less than
  the energy of the waves, a damper compensates the debt. Energy that arrives was therefore available, whatever the
  device did.
"""

import math
from typing import Final

from hapscene.compiled.native import native
from hapscene.geometry import Vector
from hapscene.records import Record
from hapscene.teleoperation.jitter_buffer import next_wave

__all__ = [
    "CATCH_UP_S",
    "couple_follower",
    "couple_leader",
    "damp_debt",
    "energy_to_send",
    "limit_force",
    "receive_wave",
]

CATCH_UP_S: Final = 0.03
"""Time constant with which a position error caused by lack of energy is made up [s]. A shorter one needs more energy at
once; a longer one is perceived as drag."""

CREDIT_J: Final = 2e-3
"""Energy beyond that of its waves that an end transmits after its device has supplied it [J]. It serves to make up
position errors: b x²/(2 CATCH_UP_S), which is 1.3 mJ for 5 mm at 3 N·s/m."""

DEBT_DAMPING_NS_M: Final = 1.0
"""Damping of an end while its device has supplied less energy than was transmitted [N·s/m]: a passivity controller with
a limit (Hannaford & Ryu 2002). A third of the wave impedance: rarely active, and hardly perceptible."""


@native
def couple_leader(state: Record, back: Vector) -> None:
    """Compute force and outgoing wave of the leader from the received wave."""
    b = state.impedance_Ns_m
    root = math.sqrt(2.0 * b)
    for i in range(3):
        state.f_N[i] = root * back[i] - b * state.v_m_s[i]
    limit_force(state)
    v = state.v_m_s
    _send(state, root * v[0] - back[0], root * v[1] - back[1], root * v[2] - back[2])


@native
def couple_follower(state: Record, wave: Vector) -> None:
    """Compute force and outgoing wave of the follower, whose desired position x_d is moved by the received wave."""
    b, K, B, T = state.impedance_Ns_m, state.stiffness_N_m, state.damping_Ns_m, state.tick_s
    root = math.sqrt(2.0 * b)
    for i in range(3):  # solve b v_d + K (x_d + T v_d − x) + B (v_d − v) = √(2b) û for v_d
        stretch = state.x_d_m[i] - state.x_m[i]
        v_d = (root * wave[i] + B * state.v_m_s[i] - K * stretch) / (b + B + K * T)
        state.f_N[i] = root * wave[i] - b * v_d
    limit_force(state)
    f = state.f_N
    for i in range(3):
        state.x_d_m[i] += T * (root * wave[i] - f[i]) / b
    _send(state, wave[0] - 2.0 / root * f[0], wave[1] - 2.0 / root * f[1], wave[2] - 2.0 / root * f[2])


@native
def receive_wave(state: Record, queue: Record) -> Vector:
    """Return the wave to apply in this tick, limited by the energy that has arrived [√W]."""
    T = state.tick_s
    ticks, total, total_J = next_wave(queue)
    if ticks == 0:
        return 0.0, 0.0, 0.0
    state.spent_J = max(state.spent_J, total_J - state.reserve_J)
    x = (total[0] - state.path[0]) / ticks
    y = (total[1] - state.path[1]) / ticks
    z = (total[2] - state.path[2]) / ticks
    behind = state.catch_up
    to_x = x + behind * (state.path[0] - state.spent[0])
    to_y = y + behind * (state.path[1] - state.spent[1])
    to_z = z + behind * (state.path[2] - state.spent[2])
    state.path[0] += x
    state.path[1] += y
    state.path[2] += z
    wanted_J = 0.5 / T * (to_x * to_x + to_y * to_y + to_z * to_z)
    budget_J = max(total_J - state.spent_J, 0.0)
    if wanted_J > budget_J:
        ratio = math.sqrt(budget_J / wanted_J)
        to_x, to_y, to_z, wanted_J = ratio * to_x, ratio * to_y, ratio * to_z, budget_J
    state.spent[0] += to_x
    state.spent[1] += to_y
    state.spent[2] += to_z
    state.spent_J += wanted_J
    state.observed_J += wanted_J
    return to_x / T, to_y / T, to_z / T


@native
def energy_to_send(state: Record) -> float:
    """The total energy that is transmitted with the waves sent so far [J]."""
    return float(min(state.sent_J + CREDIT_J, state.observed_J + state.allowance_J))


@native
def damp_debt(state: Record) -> None:
    """Damp the device while it has supplied less energy than its waves and the credit contain."""
    if state.observed_J + state.allowance_J < state.sent_J + CREDIT_J:
        for i in range(3):
            state.f_N[i] -= DEBT_DAMPING_NS_M * state.v_m_s[i]
        limit_force(state)


@native
def _send(state: Record, x: float, y: float, z: float) -> None:
    """Add a wave [√W] to the totals to send."""
    state.sent[0] += state.tick_s * x
    state.sent[1] += state.tick_s * y
    state.sent[2] += state.tick_s * z
    state.sent_J += 0.5 * state.tick_s * (x * x + y * y + z * z)


@native
def limit_force(state: Record) -> None:
    """Limit the magnitude of the force to that of the motors, without changing its direction."""
    f = state.f_N
    magnitude = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    if magnitude > state.force_limit_N:
        for i in range(3):
            f[i] *= state.force_limit_N / magnitude
