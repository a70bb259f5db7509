"""One end of the line, and how both are tied: what it has sent, heard and spent, and what its motors are to give.

Of the two schemes `position` is here, the position–position controller of the haptography paper,

    f = K (x_peer − x) + B (v_peer − v)

per axis, with the newest that was heard of the peer; `wave` is in `wave.py`. Both start where the two ends are when
they first hear of each other, and let go after `timeout_s` of silence.
"""

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from hapscene.compiled.native import native
from hapscene.errors import HapsceneError, no_such
from hapscene.geometry import Vector
from hapscene.records import records
from hapscene.teleoperation.jitter_buffer import call, new_queue, store
from hapscene.teleoperation.wave import CATCH_UP_S, arrive, energy_to_tell, limit_force, repay, tie_follower, tie_leader

__all__ = ["ROLES", "SCHEMES", "Coupling", "Endpoint", "control", "hear", "new_endpoint", "place", "tell"]

SCHEMES: Final = ("position", "wave")
"""Names of the schemes: the position–position controller, and wave variables (see `wave`)."""

TIMEOUT_S: Final = 0.1
"""Silence of the peer after which the motors let go [s]. A line that loses half of its messages at random is silent as
long once in 1e30 ticks. Longer, and the position–position controller pulls for so long to where a peer has died."""

CUTOFF_HZ: Final = 50.0
"""Corner of the one-pole low-pass on positions that velocities are taken from [Hz]. An encoder step of 55 µm in 1 ms is
55 mm/s; at 50 Hz a quarter of it is left."""

ALLOWANCE_J: Final = 1e-3
"""Energy that each end may give out at the start [J]; covers the rounding of encoders."""

RESERVE_J: Final = 20e-3
"""Most energy that is kept for later [J]; the rest is thrown away, so that nothing can live on it."""


@dataclass(frozen=True)
class Coupling:
    """How leader and follower are coupled; both ends must have the same.

    Attributes:
        scheme: one of `SCHEMES`.
        stiffness_N_m, damping_Ns_m: of the spring and damper between the two, K and B.
        impedance_Ns_m: b of the waves. Higher is a stiffer line (b over the delay) and a heavier one (b times it).
        force_limit_N: of the motors.
        timeout_s: silence after which the motors let go.

    Raises:
        HapsceneError: an unknown scheme, or a number out of range.
    """

    scheme: str = "wave"
    stiffness_N_m: float = 500.0
    damping_Ns_m: float = 3.0
    impedance_Ns_m: float = 3.0
    force_limit_N: float = 3.3
    timeout_s: float = TIMEOUT_S

    def __post_init__(self) -> None:
        if self.scheme not in SCHEMES:
            raise HapsceneError(no_such("scheme", self.scheme, SCHEMES))
        for name in ("stiffness_N_m", "impedance_Ns_m", "force_limit_N", "timeout_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise HapsceneError(f"coupling: {name} must be above 0 and finite, is {getattr(self, name):g}")
        if not 0.0 <= self.damping_Ns_m < math.inf:
            raise HapsceneError(f"coupling: damping_Ns_m must be at least 0 and finite, is {self.damping_Ns_m:g}")


ROLES: Final = ("leader", "follower")

PORT: Final = np.dtype(
    [
        ("wave", "i8"),  # 1 for the scheme `wave`, 0 for `position`
        ("follower", "i8"),  # 1 for the follower, 0 for the leader
        ("tick_s", "f8"),
        ("stiffness_N_m", "f8"),
        ("damping_Ns_m", "f8"),
        ("impedance_Ns_m", "f8"),
        ("catch_up", "f8"),  # share of what position is behind that is caught up in a tick
        ("smoothing", "f8"),  # weight of the newest position in the low-passed one
        ("force_limit_N", "f8"),
        ("allowance_J", "f8"),
        ("reserve_J", "f8"),
        ("timeout_ticks", "i8"),
        # the device
        ("x_m", "f8", (3,)),  # where it was in the last tick
        ("smooth_m", "f8", (3,)),  # low-passed
        ("v_m_s", "f8", (3,)),  # difference of the low-passed positions
        ("f_N", "f8", (3,)),  # force held over the last tick
        ("work_J", "f8"),  # done by the motors on the device since the start
        ("work_most_J", "f8"),  # the most it ever was
        # the peer
        ("engaged", "i8"),  # 1 while the peer is heard
        ("heard_tick", "i8"),  # of the newest message, −1 before any
        ("silent_ticks", "i8"),  # since it arrived
        ("overtaken", "i8"),  # messages that came after a newer one, or twice
        ("peer_m", "f8", (3,)),
        ("peer_m_s", "f8", (3,)),
        ("offset_m", "f8", (3,)),  # from the own position to the peer's when they engaged
        # waves
        ("x_d_m", "f8", (3,)),  # where the follower is wanted
        ("sent", "f8", (3,)),  # integral of the waves sent [√(J·s)]
        ("sent_J", "f8"),
        ("observed_J", "f8"),
        ("path", "f8", (3,)),  # integral of the waves that were to be played
        ("spent", "f8", (3,)),  # of those that were
        ("spent_J", "f8"),
        ("short", "i8"),  # ticks in which the energy that had arrived was short
    ],
    align=True,
)


class Endpoint(NamedTuple):
    """An end of the line."""

    port: Any  # (1,) PORT
    queue: Any  # (1,) QUEUE of what it hears


def new_endpoint(coupling: Coupling, role: str, tick_s: float) -> Endpoint:
    """An end of the line that has heard nothing yet. `role` is one of `ROLES`."""
    port = records(1, PORT)
    port.wave = SCHEMES.index(coupling.scheme)
    port.follower = ROLES.index(role)
    port.tick_s = tick_s
    for name in ("stiffness_N_m", "damping_Ns_m", "impedance_Ns_m", "force_limit_N"):
        port[name] = getattr(coupling, name)
    port.allowance_J, port.reserve_J = ALLOWANCE_J, RESERVE_J
    port.smoothing = 1.0 - math.exp(-2.0 * math.pi * CUTOFF_HZ * tick_s)
    port.timeout_ticks = round(coupling.timeout_s / tick_s)
    port.catch_up = 1.0 - math.exp(-tick_s / CATCH_UP_S)
    port.heard_tick = -1
    return Endpoint(port, new_queue())


@native
def place(end: Any, x: float, y: float, z: float) -> None:
    """Say where the device is before the first tick."""
    port = end.port[0]
    position = (x, y, z)
    for i in range(3):
        port.x_m[i] = port.smooth_m[i] = port.x_d_m[i] = position[i]


@native
def hear(end: Any, now: int, heard: Any) -> None:
    """Take in a message of the peer, one `MESSAGE`, in tick `now`.

    The first new one after silence engages: from there both ends move together, wherever they were.
    """
    port = end.port[0]
    overtaken = heard.tick <= port.heard_tick
    port.overtaken += overtaken
    if port.engaged == 0:
        if overtaken:
            return
        _engage(end, heard)
    store(end.queue[0], now, heard)
    if overtaken:
        return
    port.silent_ticks = 0
    port.heard_tick = heard.tick
    for i in range(3):
        port.peer_m[i] = heard.p_WT_m[i]
        port.peer_m_s[i] = heard.v_WT_m_s[i]


@native
def _engage(end: Any, heard: Any) -> None:
    """Start from here: no force, and no wave from before counts."""
    port = end.port[0]
    port.engaged = 1
    end.queue[0].started = 0
    for i in range(3):
        port.offset_m[i] = heard.p_WT_m[i] - port.x_m[i]
        port.x_d_m[i] = port.x_m[i]
        port.path[i] = port.spent[i] = heard.wave_sqrtJs[i]
    port.spent_J = heard.wave_J


@native
def tell(end: Any, now: int, message: Any) -> None:
    """Fill a message (1,) for the peer; its acceleration samples are the caller's."""
    port, told = end.port[0], message[0]
    told.tick = now
    told.echo = port.heard_tick
    for i in range(3):
        told.p_WT_m[i] = port.x_m[i]
        told.v_WT_m_s[i] = port.v_m_s[i]
        told.wave_sqrtJs[i] = port.sent[i]
    told.wave_J = energy_to_tell(port)


@native
def control(end: Any, now: int, x: float, y: float, z: float) -> Vector:
    """Tick `now` with the device at (x, y, z) [m]: the force of its motors [N], zero unless the peer is heard."""
    port = end.port[0]
    _observe(port, (x, y, z))
    port.silent_ticks += 1
    if port.silent_ticks > port.timeout_ticks:
        port.engaged = 0
    call(end.queue[0], now)
    for i in range(3):
        port.f_N[i] = 0.0
    if port.engaged == 1:
        if port.wave == 0:
            _tie_positions(port)
        else:
            wave = arrive(port, end.queue[0])
            if port.follower == 1:
                tie_follower(port, wave)
            else:
                tie_leader(port, wave)
            repay(port)
    return port.f_N[0], port.f_N[1], port.f_N[2]


@native
def _observe(port: Any, position: Vector) -> None:
    """Velocity, and the work that the held force has done meanwhile."""
    work = 0.0
    for i in range(3):
        work += port.f_N[i] * (position[i] - port.x_m[i])
        port.x_m[i] = position[i]
        moved = port.smoothing * (position[i] - port.smooth_m[i])
        port.smooth_m[i] += moved
        port.v_m_s[i] = moved / port.tick_s
    port.work_J += work
    port.work_most_J = max(port.work_most_J, port.work_J)
    port.observed_J = min(port.observed_J - work, port.sent_J + port.reserve_J)


@native
def _tie_positions(port: Any) -> None:
    """The position–position controller."""
    for i in range(3):
        stretch = port.peer_m[i] - port.offset_m[i] - port.x_m[i]
        port.f_N[i] = port.stiffness_N_m * stretch + port.damping_Ns_m * (port.peer_m_s[i] - port.v_m_s[i])
    limit_force(port)
