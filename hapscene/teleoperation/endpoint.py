"""One end of a teleoperation: what it has sent and received, and the force of its motors.

Two schemes couple the ends. `position` is the position–position controller of the haptography paper, per axis

    f = K (x_peer − x) + B (v_peer − v)

with the newest received position and velocity of the peer. `wave` uses wave variables (module `wave`). Both start from
the positions at which the ends first receive a message.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from hapscene.compiled.native import native
from hapscene.errors import HapsceneError, no_such
from hapscene.geometry import Vector
from hapscene.records import Record, Records, records
from hapscene.teleoperation.jitter_buffer import advance_queue, new_queue, store
from hapscene.teleoperation.wave import (
    CATCH_UP_S,
    couple_follower,
    couple_leader,
    damp_debt,
    energy_to_send,
    limit_force,
    receive_wave,
)

__all__ = ["Coupling", "Endpoint", "control", "fill_message", "new_endpoint", "receive_message", "set_start"]

SCHEMES: Final = ("position", "wave")
"""Names of the coupling schemes: position–position controller, and wave variables (module `wave`)."""

CUTOFF_HZ: Final = 50.0
"""Corner of the one-pole low-pass on positions before differentiation [Hz]. An encoder step of 55 µm in 1 ms is
55 mm/s; at 50 Hz a quarter of it is left."""

ALLOWANCE_J: Final = 1e-3
"""Energy that each end may give out at the start [J]; covers the quantisation of encoders."""

RESERVE_J: Final = 20e-3
"""Most received energy that is kept for later [J]. The excess is discarded, so that it cannot feed an instability."""


@dataclass(frozen=True)
class Coupling:
    """Coupling of leader and follower; both ends must use the same.

    Attributes:
        scheme: one of `SCHEMES`.
        stiffness_N_m, damping_Ns_m: K and B of the spring and damper between the two.
        impedance_Ns_m: wave impedance b. A higher one makes the link stiffer (b / delay) and heavier (b · delay).
        force_limit_N: limit of the motor force.

    Raises:
        HapsceneError: unknown scheme, or a number out of range.
    """

    scheme: str = "wave"
    stiffness_N_m: float = 500.0
    damping_Ns_m: float = 3.0
    impedance_Ns_m: float = 3.0
    force_limit_N: float = 3.3

    def __post_init__(self) -> None:
        if self.scheme not in SCHEMES:
            raise HapsceneError(no_such("coupling scheme", self.scheme, SCHEMES))
        for name in ("stiffness_N_m", "impedance_Ns_m", "force_limit_N"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise HapsceneError(f"coupling: {name} must be finite and above 0, is {getattr(self, name):g}")
        if not 0.0 <= self.damping_Ns_m < math.inf:
            raise HapsceneError(f"coupling: damping_Ns_m must be finite and at least 0, is {self.damping_Ns_m:g}")


ROLES: Final = ("leader", "follower")

STATE: Final = np.dtype(
    [
        ("wave", "i8"),  # 1 for the scheme `wave`, 0 for `position`
        ("follower", "i8"),  # 1 for the follower, 0 for the leader
        ("tick_s", "f8"),
        ("stiffness_N_m", "f8"),
        ("damping_Ns_m", "f8"),
        ("impedance_Ns_m", "f8"),
        ("catch_up", "f8"),  # share of the missing position that is made up in a tick
        ("smoothing", "f8"),  # weight of the newest position in the low-pass
        ("force_limit_N", "f8"),
        ("allowance_J", "f8"),
        ("reserve_J", "f8"),
        # the device
        ("x_m", "f8", (3,)),  # position in the last tick
        ("smooth_m", "f8", (3,)),  # low-passed position
        ("v_m_s", "f8", (3,)),  # difference of the low-passed positions
        ("f_N", "f8", (3,)),  # force held over the last tick
        ("work_J", "f8"),  # work of the motors on the device since the start
        # the peer
        ("engaged", "i8"),  # 1 after the first message
        ("received_tick", "i8"),  # tick of the newest message, −1 before the first
        ("peer_m", "f8", (3,)),
        ("peer_m_s", "f8", (3,)),
        ("offset_m", "f8", (3,)),  # from the own position to that of the peer when they engaged
        # waves
        ("x_d_m", "f8", (3,)),  # desired position of the follower
        ("sent", "f8", (3,)),  # integral of the sent waves [√(J·s)]
        ("sent_J", "f8"),
        ("observed_J", "f8"),  # energy received, less the work done on the device
        ("path", "f8", (3,)),  # integral of the received waves
        ("spent", "f8", (3,)),  # integral of the applied waves
        ("spent_J", "f8"),
    ],
    align=True,
)


class Endpoint(NamedTuple):
    """One end of a teleoperation."""

    state: Records  # (1,) STATE
    queue: Records  # (1,) QUEUE of received messages


def new_endpoint(coupling: Coupling, role: str, tick_s: float) -> Endpoint:
    """Return an end that has not received a message yet. `role` is one of `ROLES`."""
    state = records(1, STATE)
    state.wave = SCHEMES.index(coupling.scheme)
    state.follower = ROLES.index(role)
    state.tick_s = tick_s
    for name in ("stiffness_N_m", "damping_Ns_m", "impedance_Ns_m", "force_limit_N"):
        state[name] = getattr(coupling, name)
    state.allowance_J, state.reserve_J = ALLOWANCE_J, RESERVE_J
    state.smoothing = 1.0 - math.exp(-2.0 * math.pi * CUTOFF_HZ * tick_s)
    state.catch_up = 1.0 - math.exp(-tick_s / CATCH_UP_S)
    state.received_tick = -1
    return Endpoint(state, new_queue())


@native
def set_start(end: Endpoint, x: float, y: float, z: float) -> None:
    """Set the position of the device before the first tick [m]."""
    state = end.state[0]
    position = (x, y, z)
    for i in range(3):
        state.x_m[i] = state.smooth_m[i] = state.x_d_m[i] = position[i]


@native
def receive_message(end: Endpoint, now: int, message: Record) -> None:
    """Take in a message of the peer, one MESSAGE, in tick `now`.

    The first message engages the coupling: both ends move together from their present positions.
    """
    state = end.state[0]
    if state.engaged == 0:
        _engage(state, message)
    store(end.queue[0], now, message)
    if message.tick <= state.received_tick:  # overtaken by a newer one
        return
    state.received_tick = message.tick
    for i in range(3):
        state.peer_m[i] = message.p_WT_m[i]
        state.peer_m_s[i] = message.v_WT_m_s[i]


@native
def _engage(state: Record, message: Record) -> None:
    """Start the coupling without force; earlier waves do not count."""
    state.engaged = 1
    for i in range(3):
        state.offset_m[i] = message.p_WT_m[i] - state.x_m[i]
        state.x_d_m[i] = state.x_m[i]
        state.path[i] = state.spent[i] = message.wave_sqrtJs[i]
    state.spent_J = message.wave_J


@native
def fill_message(end: Endpoint, now: int, outgoing: Records) -> None:
    """Fill a message (1,) for the peer; the caller fills in its acceleration samples."""
    state, message = end.state[0], outgoing[0]
    message.tick = now
    for i in range(3):
        message.p_WT_m[i] = state.x_m[i]
        message.v_WT_m_s[i] = state.v_m_s[i]
        message.wave_sqrtJs[i] = state.sent[i]
    message.wave_J = energy_to_send(state)


@native
def control(end: Endpoint, now: int, x: float, y: float, z: float) -> Vector:
    """Compute the motor force [N] of tick `now` for a device at (x, y, z) [m]; 0 before the first message."""
    state = end.state[0]
    _observe(state, (x, y, z))
    advance_queue(end.queue[0], now)
    for i in range(3):
        state.f_N[i] = 0.0
    if state.engaged == 1:
        if state.wave == 0:
            _couple_positions(state)
        else:
            wave = receive_wave(state, end.queue[0])
            if state.follower == 1:
                couple_follower(state, wave)
            else:
                couple_leader(state, wave)
            damp_debt(state)
    return state.f_N[0], state.f_N[1], state.f_N[2]


@native
def _observe(state: Record, position: Vector) -> None:
    """Update the velocity, and the work that the held force has done since the last tick."""
    work = 0.0
    for i in range(3):
        work += state.f_N[i] * (position[i] - state.x_m[i])
        state.x_m[i] = position[i]
        moved = state.smoothing * (position[i] - state.smooth_m[i])
        state.smooth_m[i] += moved
        state.v_m_s[i] = moved / state.tick_s
    state.work_J += work
    state.observed_J = min(state.observed_J - work, state.sent_J + state.reserve_J)


@native
def _couple_positions(state: Record) -> None:
    """The position–position controller."""
    for i in range(3):
        stretch = state.peer_m[i] - state.offset_m[i] - state.x_m[i]
        state.f_N[i] = state.stiffness_N_m * stretch + state.damping_Ns_m * (state.peer_m_s[i] - state.v_m_s[i])
    limit_force(state)
