"""Leader and follower in one compiled loop, many times faster than real time."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.device.sim.arm import find_tip
from hapscene.geometry import Vector
from hapscene.records import Records
from hapscene.teleoperation.datagram import SAMPLE_COUNT
from hapscene.teleoperation.endpoint import Endpoint, receive_message
from hapscene.teleoperation.leader_follower import Follower, Hand, Leader, step_follower, step_leader
from hapscene.teleoperation.link import Link, collect, post

__all__ = ["TICK_RECORD", "Line", "operate", "receive"]

TICK_RECORD: Final = np.dtype(
    [
        ("leader_W_m", "f8", (3,)),  # exact tool positions at the start of the tick
        ("follower_W_m", "f8", (3,)),
        ("f_leader_W_N", "f8", (3,)),  # motor forces
        ("f_follower_W_N", "f8", (3,)),
        ("f_contact_W_N", "f8", (3,)),  # force of the surface on the follower's tool, at the end of the tick
        ("touching", "i8"),
        ("a_follower_m_s2", "f8", (SAMPLE_COUNT,)),  # accelerometer of the follower
        ("a_tip_m_s2", "f8", (SAMPLE_COUNT,)),  # tip of the leader, moved by base motors and hand
        ("a_handle_m_s2", "f8", (SAMPLE_COUNT,)),  # handle of the leader relative to the tip, moved by the voice coil
    ],
    align=True,
)
"""The recorded quantities of a tick."""


class Line(NamedTuple):
    """The links in both directions, and storage for a received message."""

    to_follower: Link
    to_leader: Link
    message: Records  # (1,) MESSAGE


@native
def operate(leader: Leader, follower: Follower, line: Line, first: int, hand: Hand, rows: Records) -> None:
    """Run one tick for each row of `rows` (n,) TICK_RECORD, from tick `first` on, and fill the rows.

    `hand` has target, grip and push of the leader's hand, as in the reference trajectory.
    """
    for k in range(len(rows)):
        now, row = first + k, rows[k]
        receive(follower.end, line.to_follower, now, line.message)  # both receive before either sends
        receive(leader.end, line.to_leader, now, line.message)
        _set(row.leader_W_m, find_tip(leader.arm))
        _set(row.follower_W_m, find_tip(follower.arm))
        _set(row.f_follower_W_N, step_follower(follower, now))
        post(line.to_leader, now, follower.outgoing)
        _set(row.f_leader_W_N, step_leader(leader, hand, k, now))
        post(line.to_follower, now, leader.outgoing)
        row.touching = follower.row[0].touching
        for i in range(3):
            row.f_contact_W_N[i] = follower.row[0].f_W_N[i]
        for i in range(SAMPLE_COUNT):
            row.a_follower_m_s2[i] = follower.read_m_s2[i]
            row.a_tip_m_s2[i] = leader.tip_m_s2[i]
            row.a_handle_m_s2[i] = leader.handle_m_s2[i]


@native
def receive(end: Endpoint, link: Link, now: int, message: Records) -> None:
    """Pass the messages that a link has delivered by tick `now` to an end."""
    while collect(link, now, message, 0):
        receive_message(end, now, message[0])


@native
def _set(target: NDArray[np.float64], vector: Vector) -> None:
    target[0], target[1], target[2] = vector[0], vector[1], vector[2]
