"""Leader, line and follower in one closed loop, compiled: many times faster than real time."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.device.arm import find_tip
from hapscene.geometry import Vector
from hapscene.native import native
from hapscene.teleoperation.datagram import SAMPLE_COUNT
from hapscene.teleoperation.endpoint import hear
from hapscene.teleoperation.leader_follower import follow, intend, lead
from hapscene.teleoperation.link import collect, post

HAPPENED: Final = np.dtype(
    [
        ("leader_W_m", "f8", (3,)),  # tools, true, at the tick's start
        ("follower_W_m", "f8", (3,)),
        ("f_leader_W_N", "f8", (3,)),  # motors
        ("f_follower_W_N", "f8", (3,)),
        ("f_contact_W_N", "f8", (3,)),  # of the surface on the follower's tool, at the tick's end
        ("touching", "i8"),
    ],
    align=True,
)
"""What is noted of a tick."""


class Line(NamedTuple):
    """The line both ways, and the message that has just come out of it."""

    forth: Any  # Link to the follower
    back: Any  # Link to the leader
    message: Any  # (1,) MESSAGE


@native
def operate(
    leader: Any,
    follower: Any,
    line: Any,
    first: int,
    target_W_m: NDArray[np.float64],
    grip: NDArray[np.float64],
    push_W_N: NDArray[np.float64],
    happened: Any,
    a_follower_m_s2: NDArray[np.float64],
    a_tip_m_s2: NDArray[np.float64],
    a_handle_m_s2: NDArray[np.float64],
) -> None:
    """n ticks from number `first` on of what the leader's hand means to do (see `twin.intent.Intent`).

    Fills `happened` (n,) and, (n, SAMPLE_COUNT) each: what the follower's accelerometer read; the acceleration of the
    leader's tip by its base motors and the hand; that of its handle by the voice coil.
    """
    for k in range(len(target_W_m)):
        now, row = first + k, happened[k]
        begin_tick(leader, follower.end, line, now, target_W_m, grip, push_W_N, k)
        _note(row.leader_W_m, find_tip(leader.arm))
        _note(row.follower_W_m, find_tip(follower.arm))
        _note(row.f_follower_W_N, follow(follower, now))
        _note(row.f_leader_W_N, end_tick(leader, follower.told, line, now))
        row.touching = follower.row[0].touching
        for i in range(3):
            row.f_contact_W_N[i] = follower.row[0].f_W_N[i]
        for i in range(SAMPLE_COUNT):
            a_follower_m_s2[k, i] = follower.read_m_s2[i]
            a_tip_m_s2[k, i] = leader.tip_m_s2[i]
            a_handle_m_s2[k, i] = leader.handle_m_s2[i]


@native
def begin_tick(
    leader: Any, follower_end: Any, line: Any, now: int, target_W_m: Any, grip: Any, push_W_N: Any, k: int
) -> None:
    """Both ends hear what has arrived by tick `now`, and the hand means row `k` of an intention."""
    while collect(line.forth, now, line.message, 0):
        hear(follower_end, now, line.message[0])
    while collect(line.back, now, line.message, 0):
        hear(leader.end, now, line.message[0])
    intend(leader, target_W_m, grip, push_W_N, k)


@native
def end_tick(leader: Any, follower_told: Any, line: Any, now: int) -> Vector:
    """The leader's own tick, after the follower's; both messages leave. The force of the leader's motors [N]."""
    force = lead(leader, now)
    post(line.forth, now, leader.told)
    post(line.back, now, follower_told)
    return force


@native
def step_leader(leader: Any, intent: Any, row: int, link: Any, now: int, arrived: Any, count: int, leaving: Any) -> int:
    """Tick `now` of a leader alone, for a process of its own: row `row` of the hand's intention (target, grip, push).

    Hears `arrived[:count]`, and fills `leaving` with what the line lets out; returns how many.
    """
    for i in range(count):
        hear(leader.end, now, arrived[i])
    intend(leader, intent[0], intent[1], intent[2], row)
    lead(leader, now)
    return _let_out(link, now, leader.told, leaving)


@native
def step_follower(follower: Any, link: Any, now: int, arrived: Any, count: int, leaving: Any) -> int:
    """Tick `now` of a follower alone, likewise."""
    for i in range(count):
        hear(follower.end, now, arrived[i])
    follow(follower, now)
    return _let_out(link, now, follower.told, leaving)


@native
def _let_out(link: Any, now: int, told: Any, leaving: Any) -> int:
    post(link, now, told)
    count = 0
    while count < len(leaving) and collect(link, now, leaving, count):
        count += 1
    return count


@native
def _note(place: Any, vector: Vector) -> None:
    place[0], place[1], place[2] = vector[0], vector[1], vector[2]
