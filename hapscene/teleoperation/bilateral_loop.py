"""One tick of each end, and both ends in one compiled loop: many times faster than real time.

The simulation and the network session (`udp_session`) run the same steps: `receive` hands messages to an end,
`step_leader` and `step_follower` tick it and post its message to the link from there. In the simulation the peer
receives from that link; over the network a socket carries what leaves it.
"""

from typing import Any, Final, NamedTuple

import numpy as np

from hapscene.compiled.native import native
from hapscene.device.sim.arm import find_tip
from hapscene.geometry import Vector
from hapscene.teleoperation.datagram import SAMPLE_COUNT
from hapscene.teleoperation.endpoint import hear
from hapscene.teleoperation.leader_follower import follow, intend, lead
from hapscene.teleoperation.link import collect, post

__all__ = ["HAPPENED", "Line", "operate", "receive", "step_follower", "step_leader"]

HAPPENED: Final = np.dtype(
    [
        ("leader_W_m", "f8", (3,)),  # tools, true, at the tick's start
        ("follower_W_m", "f8", (3,)),
        ("f_leader_W_N", "f8", (3,)),  # motors
        ("f_follower_W_N", "f8", (3,)),
        ("f_contact_W_N", "f8", (3,)),  # of the surface on the follower's tool, at the tick's end
        ("touching", "i8"),
        ("a_follower_m_s2", "f8", (SAMPLE_COUNT,)),  # what the follower's accelerometer read
        ("a_tip_m_s2", "f8", (SAMPLE_COUNT,)),  # of the leader's tip, by its base motors and the hand
        ("a_handle_m_s2", "f8", (SAMPLE_COUNT,)),  # of its handle, by the voice coil
    ],
    align=True,
)
"""The recorded quantities of a tick."""


class Line(NamedTuple):
    """The line both ways, and the message that has just come out of it."""

    forth: Any  # Link to the follower
    back: Any  # Link to the leader
    message: Any  # (1,) MESSAGE


@native
def operate(leader: Any, follower: Any, line: Any, first: int, hand: Any, happened: Any) -> None:
    """Ticks from number `first` on, one for each row of `happened` (n,), which it fills.

    `hand`: target, grip and push of the leader's hand (see `twin.intent.ReferenceTrajectory`).
    """
    for k in range(len(happened)):
        now, row = first + k, happened[k]
        receive(follower.end, line.forth, now, line.message)  # both, before either sends
        receive(leader.end, line.back, now, line.message)
        _note(row.leader_W_m, find_tip(leader.arm))
        _note(row.follower_W_m, find_tip(follower.arm))
        _note(row.f_follower_W_N, step_follower(follower, line.back, now))
        _note(row.f_leader_W_N, step_leader(leader, hand, k, line.forth, now))
        row.touching = follower.row[0].touching
        for i in range(3):
            row.f_contact_W_N[i] = follower.row[0].f_W_N[i]
        for i in range(SAMPLE_COUNT):
            row.a_follower_m_s2[i] = follower.read_m_s2[i]
            row.a_tip_m_s2[i] = leader.tip_m_s2[i]
            row.a_handle_m_s2[i] = leader.handle_m_s2[i]


@native
def receive(end: Any, link: Any, now: int, message: Any) -> None:
    """Hand an end the messages that its incoming link has delivered by tick `now`."""
    while collect(link, now, message, 0):
        hear(end, now, message[0])


@native
def step_leader(leader: Any, hand: Any, row: int, link: Any, now: int) -> Vector:
    """Tick `now` of a leader whose hand does row `row` of its intention; the force of its motors [N]."""
    intend(leader, hand[0], hand[1], hand[2], row)
    force = lead(leader, now)
    post(link, now, leader.told)
    return force


@native
def step_follower(follower: Any, link: Any, now: int) -> Vector:
    """Tick `now` of a follower; the force of its motors [N]."""
    force = follow(follower, now)
    post(link, now, follower.told)
    return force


@native
def _note(place: Any, vector: Vector) -> None:
    place[0], place[1], place[2] = vector[0], vector[1], vector[2]
