"""Teleoperation in one process: a leader in a simulated hand, a simulated link, and a follower in a scene."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.model import DeviceLike
from hapscene.device.sim.arm import find_tip, simulated_device
from hapscene.dsp.noise import seeded_state, uniform
from hapscene.errors import HapsceneError
from hapscene.geometry import Vector
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import Plant
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.records import Records, records
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.scene.scene import Scene
from hapscene.surface.effect import Effect
from hapscene.teleoperation.endpoint import Coupling, Endpoint, receive_message
from hapscene.teleoperation.jitter_buffer import MESSAGE, SAMPLE_COUNT
from hapscene.teleoperation.leader_follower import (
    Array,
    Follower,
    Hand,
    Leader,
    new_follower,
    new_leader,
    step_follower,
    step_leader,
)

__all__ = ["Impairment", "Operation", "OperationResult", "operate"]


# A simulated network link with delay, jitter and loss, from a seeded random number generator.

SLOT_COUNT: Final = 1024
"""Capacity for messages in transit [count]: a second at 1 kHz. More are lost, as in a full router."""

DELAY_MAX_S: Final = 0.5
"""Longest delay and longest jitter of a link [s]; limited by the capacity."""

JITTER_MOST: Final = 4.0
"""Upper end of the jitter distribution [times its mean]; 2 % of an exponential distribution lie beyond."""

LINE: Final = np.dtype(
    [
        ("delay_ticks", "f8"),
        ("jitter_ticks", "f8"),
        ("loss", "f8"),
        ("rng", "u8", (4,)),
        ("head", "i8"),  # number of the oldest message that may still be in transit
        ("tail", "i8"),  # number of the next message; message n is in slot n % SLOT_COUNT
    ],
    align=True,
)


@dataclass(frozen=True)
class Impairment:
    """Delay, jitter and loss of a link in one direction.

    Attributes:
        delay_s: delay of every message, 0 to 0.5.
        jitter_s: mean of an additional delay, drawn for each message from an exponential distribution that ends at four
            times its mean. Messages overtake each other if it is longer than a tick.
        loss: share of messages that are lost, 0 to 1.

    Raises:
        HapsceneError: a number out of range.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0

    def __post_init__(self) -> None:
        most = {"delay_s": DELAY_MAX_S, "jitter_s": DELAY_MAX_S / JITTER_MOST, "loss": 1.0}
        for name, limit in most.items():
            if not 0.0 <= getattr(self, name) <= limit:
                raise HapsceneError(f"impairment: {name} must be from 0 to {limit:g}, is {getattr(self, name):g}")


class Link(NamedTuple):
    """A link in one direction, and the messages in transit."""

    line: Records  # (1,) LINE
    messages: Records  # (SLOT_COUNT,) MESSAGE
    arrival_tick: NDArray[np.float64]  # (SLOT_COUNT,); infinite once the message has arrived


def new_link(impairment: Impairment, tick_s: float, seed: int, name: str) -> Link:
    """Return an empty link. Links of the same seed and name lose and delay the same messages."""
    line = records(1, LINE)
    line.delay_ticks = impairment.delay_s / tick_s
    line.jitter_ticks = impairment.jitter_s / tick_s
    line.loss = impairment.loss
    line.rng[0] = seeded_state(seed, f"link.{name}")
    return Link(line, records(SLOT_COUNT, MESSAGE), np.full(SLOT_COUNT, math.inf))


@native
def post(link: Link, tick: int, message: Records) -> None:
    """Send a message (1,) over a link, in tick `tick` of the sender."""
    line = link.line[0]
    delay = line.delay_ticks
    if line.jitter_ticks > 0.0:
        delay += line.jitter_ticks * min(-math.log(1.0 - uniform(line.rng)), JITTER_MOST)
    if (line.loss > 0.0 and uniform(line.rng) < line.loss) or line.tail - line.head == SLOT_COUNT:
        return
    slot = line.tail % SLOT_COUNT
    line.tail += 1
    link.messages[slot] = message[0]
    link.arrival_tick[slot] = tick + delay


@native
def collect(link: Link, tick: int, message: Records) -> bool:
    """Move the next message that has arrived by tick `tick`, in order of arrival, to `message` (1,).

    Returns whether there was one.
    """
    line = link.line[0]
    first, slot = math.inf, -1
    for number in range(line.head, line.tail):
        candidate = number % SLOT_COUNT
        if link.arrival_tick[candidate] < first:
            first, slot = link.arrival_tick[candidate], candidate
    if first > tick:
        return False
    message[0] = link.messages[slot]
    link.arrival_tick[slot] = math.inf
    while line.head < line.tail and link.arrival_tick[line.head % SLOT_COUNT] == math.inf:
        line.head += 1
    return True


# Both devices in one process.


@dataclass(frozen=True, eq=False)
class OperationResult:
    """The recorded quantities of n ticks, in SI units and world coordinates W.

    Attributes:
        t_s: (n,) start of each tick.
        leader_W_m, follower_W_m: (n, 3) exact tool positions.
        f_leader_W_N, f_follower_W_N: (n, 3) motor forces, held over the tick.
        f_contact_W_N: (n, 3) force of the surface on the follower's tool, at the end of the tick.
        touching: (n,) whether the follower is in contact.
        a_follower_m_s2: (n, SAMPLE_COUNT) accelerometer of the follower, along the handle.
        a_tip_m_s2: (n, SAMPLE_COUNT) acceleration of the leader's tip, by base motors and hand.
        a_handle_m_s2: (n, SAMPLE_COUNT) acceleration of the handle relative to the tip, by the voice coil.
        latency_s: latency from the follower's accelerometer to the leader's handle.
        work_J: (n,) work of the motors of both devices since the start; positive if they generate energy.
    """

    t_s: Array
    leader_W_m: Array
    follower_W_m: Array
    f_leader_W_N: Array
    f_follower_W_N: Array
    f_contact_W_N: Array
    touching: NDArray[np.bool_]
    a_follower_m_s2: Array
    a_tip_m_s2: Array
    a_handle_m_s2: Array
    latency_s: float
    work_J: Array


class Operation:
    """A simulated hand that touches a scene through a leader, a link and a follower.

    Args:
        scene: scene that the follower touches.
        p_WT: (3,) start position of both tools.
        coupling: coupling of the ends.
        line: impairment of the link in each direction.
        device: device of both ends.
        compensator: compensator of the leader's handle, a name of `hapscene.handle.compensator.COMPENSATORS`; "none"
            renders with the base motors alone.
        effects, seed: as in `Renderer`.

    Raises:
        HapsceneError: a start position out of reach of the device, an unknown compensator, or an argument that
            `Renderer` refuses.
    """

    def __init__(
        self,
        scene: Scene,
        p_WT: Sequence[float],
        *,
        coupling: Coupling | None = None,
        line: Impairment | None = None,
        device: "DeviceLike | None" = None,
        compensator: str = "adaptive",
        effects: Sequence[str | Effect] = EFFECTS,
        seed: int = 0,
    ) -> None:
        coupling, line, device = coupling or Coupling(), line or Impairment(), simulated_device(device or "omni")
        self.renderer = follower_renderer(scene, effects, seed)
        self.follower: Follower = new_follower(self.renderer, device, coupling, p_WT)
        handle = new_handle(Plant(), Plant(), compensator, ACCELERATION_RATE_HZ, seed)
        self.leader: Leader = new_leader(device, handle, coupling, p_WT)
        # "forth" and "back" seed the random streams of the links: other names give other results
        to_follower, to_leader = (new_link(line, TICK_S, seed, name) for name in ("forth", "back"))
        self.line = Line(to_follower, to_leader, records(1, MESSAGE))
        self._ticks = 0

    def run(self, intent: ReferenceTrajectory) -> OperationResult:
        """Simulate a reference trajectory of the leader's hand, one tick per row, from the present state."""
        n = len(intent)
        rows = records(n, TICK_RECORD)
        hand = (intent.target_W_m, intent.grip, intent.push_W_N)
        operate(self.leader, self.follower, self.line, self._ticks, hand, rows)
        t_s = np.asarray((self._ticks + np.arange(n)) * TICK_S, np.float64)
        self._ticks += n
        column = {name: np.ascontiguousarray(rows[name]) for name in TICK_RECORD.names or ()}
        column["touching"] = column["touching"].astype(bool)
        leader_J = _work(column["leader_W_m"], column["f_leader_W_N"])
        follower_J = _work(column["follower_W_m"], column["f_follower_W_N"])
        return OperationResult(
            t_s=t_s,
            **column,
            latency_s=self.latency_s,
            work_J=leader_J + follower_J,
        )

    @property
    def latency_s(self) -> float:
        """Present latency from the follower's accelerometer to the handle: one tick to send, the jitter buffer, and the
        look-ahead of the handle."""
        queue = self.leader.end.queue[0]
        ticks = 1 + int(queue.lag_ticks) + int(queue.a_extra_ticks)
        return ticks * TICK_S + int(self.leader.handle[0].delay) / ACCELERATION_RATE_HZ


def follower_renderer(scene: Scene, effects: Sequence[str | Effect] = EFFECTS, seed: int = 0) -> Renderer:
    """Return a renderer whose tick lasts one sample of the follower's accelerometer."""
    return Renderer(scene, effects, seed=seed, tick_s=1.0 / ACCELERATION_RATE_HZ, a_rate_Hz=ACCELERATION_RATE_HZ)


def _work(p_W_m: Array, f_W_N: Array) -> Array:
    """(n,) work of a held force on a tool since the start. The work of the last tick is not included."""
    done = np.einsum("ij,ij->i", f_W_N[:-1], np.diff(p_W_m, axis=0))
    return np.append(0.0, np.cumsum(done))


# Both devices in one compiled loop, many times faster than real time.


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
    while collect(link, now, message):
        receive_message(end, now, message[0])


@native
def _set(target: Array, vector: Vector) -> None:
    target[0], target[1], target[2] = vector[0], vector[1], vector[2]
