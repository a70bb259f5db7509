"""Teleoperation in one process: a leader in a hand, a line, a follower on a scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.model import DeviceLike
from hapscene.device.sim.arm import find_tip, simulated_device
from hapscene.handle.handle_loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.records import records
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.scene.scene import Scene
from hapscene.surface.effect import Effect
from hapscene.teleoperation.bilateral_loop import HAPPENED, Line, operate, receive, step_leader
from hapscene.teleoperation.body_follower import BodyFollower
from hapscene.teleoperation.datagram import MESSAGE
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.leader_follower import Follower, Leader, new_follower, new_leader
from hapscene.teleoperation.link import Impairment, new_link, post

if TYPE_CHECKING:
    from hapscene.bridge.simulation import Simulation

__all__ = ["UP", "Operated", "Operation", "world_of"]

Array = NDArray[np.float64]

UP: Final = (0.0, 0.0, 1.0)
"""Default direction of the handle in W: upright on a horizontal surface."""

REST_S: Final = 1.0
"""End of an operation, in which all should be at rest [s]."""


@dataclass(frozen=True, eq=False)
class Operated:
    """What happened, n ticks: SI units, vectors in W.

    Attributes:
        t_s: (n,) start of each tick.
        leader_W_m, follower_W_m: (n, 3) the tools, true.
        f_leader_W_N, f_follower_W_N: (n, 3) forces of the motors, held over the tick.
        f_contact_W_N: (n, 3) of the surface on the follower's tool, at the tick's end; NaN where a simulation is
            followed that does not say it.
        touching: (n,) whether the follower touches.
        a_follower_m_s2: (n, SAMPLE_COUNT) what the follower's accelerometer read, along the handle.
        a_tip_m_s2: (n, SAMPLE_COUNT) acceleration of the leader's tip, by base motors and hand.
        a_handle_m_s2: (n, SAMPLE_COUNT) of the handle on it, by the voice coil.
        latency_s: from a sample at the follower to the same at the leader's handle.
        work_J: (n,) of both devices' motors since the start. What rises above 0 was generated.
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

    def __repr__(self) -> str:
        touching = int(self.touching.sum())
        return f"<Operated: {len(self.t_s):,} ticks, {touching:,} touching; {1e3 * self.latency_s:.3g} ms late>"

    @property
    def rest_m_s(self) -> float:
        """Root mean square of the faster tool's speed at the end [m/s]."""
        late = self.t_s >= self.t_s[-1] - REST_S
        speeds = [np.diff(p[late], axis=0) / TICK_S for p in (self.leader_W_m, self.follower_W_m)]
        return max(float(np.sqrt((v**2).sum(axis=1).mean())) for v in speeds)

    @property
    def energy_out_J(self) -> float:
        """The most energy that both devices' motors together had given out at any time [J]."""
        return max(float(self.work_J.max()), 0.0)


class Operation:
    """A hand that feels a scene through a leader, a line and a follower.

    Args:
        scene: what the follower touches; or a simulation of which a body is the follower, a robot of
            `hapscene.bridge.MuJoCo` say: its motors are a force at the body's origin, and what it touches is the
            simulation's.
        p_WT: (3,) where both tools are at the start; a body follows from where it is.
        coupling: how the ends are tied together.
        line: how bad the line is, each way.
        device: of both ends; of the leader, where a body follows.
        compensator: of the leader's handle, a name of `hapscene.handle.compensator.COMPENSATORS`; "none" leaves it to
            the base motors.
        plant: the handle; the compensator believes in `Plant()`.
        effects, seed: as `Renderer` has them.
        axis_W: (3,) along the handle.
        body: of a simulation, the one that follows; may be left out where it has but one.

    Raises:
        HapsceneError: a start out of the device's reach, an unknown compensator, or what `Renderer` refuses; an
            unknown body, or a simulation whose steps do not fit into a tick.
    """

    def __init__(
        self,
        scene: "Scene | Simulation",
        p_WT: Sequence[float],
        *,
        coupling: Coupling | None = None,
        line: Impairment | None = None,
        device: "DeviceLike | None" = None,
        compensator: str = "adaptive",
        plant: Plant | None = None,
        effects: Sequence[str | Effect] = EFFECTS,
        seed: int = 0,
        axis_W: Sequence[float] = UP,
        body: str | None = None,
    ) -> None:
        coupling, line, device = coupling or Coupling(), line or Impairment(), simulated_device(device or "omni")
        self.follower: Follower | BodyFollower
        if isinstance(scene, Scene):
            self.renderer = world_of(scene, effects, seed)
            self.follower = new_follower(self.renderer, device, coupling, p_WT, axis_W)
        else:
            self.follower = BodyFollower(scene, body, coupling, axis_W)
        handle = new_handle(plant or Plant(), Plant(), compensator, ACCELERATION_RATE_HZ, seed)
        self.leader: Leader = new_leader(device, handle, coupling, p_WT, axis_W)
        forth, back = (new_link(line, TICK_S, seed, name) for name in ("forth", "back"))
        self.line = Line(forth, back, records(1, MESSAGE))
        self._ticks = 0

    def __repr__(self) -> str:
        return f"<Operation: {self.follower if isinstance(self.follower, BodyFollower) else self.renderer!r}>"

    def run(self, intent: ReferenceTrajectory) -> Operated:
        """Simulate a reference trajectory of the leader's hand, a tick for each of its rows, from the present state."""
        n = len(intent)
        happened = records(n, HAPPENED)
        hand = (intent.target_W_m, intent.grip, intent.push_W_N)
        if isinstance(self.follower, BodyFollower):
            self._operate(self.follower, hand, happened)
        else:
            operate(self.leader, self.follower, self.line, self._ticks, hand, happened)
        t_s = np.asarray((self._ticks + np.arange(n)) * TICK_S, np.float64)
        self._ticks += n
        column: dict[str, Any] = {name: np.ascontiguousarray(happened[name]) for name in HAPPENED.names or ()}
        column["touching"] = column["touching"].astype(bool)
        leader_J = _work(column["leader_W_m"], column["f_leader_W_N"])
        follower_J = _work(column["follower_W_m"], column["f_follower_W_N"])
        return Operated(
            t_s=t_s,
            **column,
            latency_s=self.latency_s,
            work_J=leader_J + follower_J,
        )

    def _operate(self, follower: BodyFollower, hand: tuple[Array, Array, Array], happened: Any) -> None:
        """`bilateral_loop.operate` with a follower that is not compiled."""
        leader, line = self.leader, self.line
        for k, row in enumerate(happened):
            now = self._ticks + k
            receive(follower.end, line.forth, now, line.message)
            receive(leader.end, line.back, now, line.message)
            row.leader_W_m, row.follower_W_m = find_tip(leader.arm), follower.p_W_m
            row.f_follower_W_N = follower.follow(now)
            post(line.back, now, follower.told)
            row.f_leader_W_N = step_leader(leader, hand, k, line.forth, now)
            row.f_contact_W_N = follower.contact()
            row.touching = np.abs(row.f_contact_W_N).max() > 0.0
            row.a_follower_m_s2, row.a_tip_m_s2 = follower.read_m_s2, leader.tip_m_s2
            row.a_handle_m_s2 = leader.handle_m_s2

    @property
    def latency_s(self) -> float:
        """Present latency from the follower's accelerometer to the handle: a tick until a sample is sent, the jitter
        buffer, and the handle's look-ahead."""
        queue: Any = self.leader.end.queue[0]
        ticks = 1 + int(queue.lag_ticks) + int(queue.a_extra_ticks)
        return ticks * TICK_S + int(self.leader.handle[0].delay) / ACCELERATION_RATE_HZ


def world_of(scene: Scene, effects: Sequence[str | Effect] = EFFECTS, seed: int = 0) -> Renderer:
    """The scene as a world that a follower's tool meets: a tick for each sample of the accelerometer."""
    return Renderer(scene, effects, seed=seed, tick_s=1.0 / ACCELERATION_RATE_HZ, a_rate_Hz=ACCELERATION_RATE_HZ)


def _work(p_W_m: Array, f_W_N: Array) -> Array:
    """(n,) work of a held force on a tool since the start; that of the last tick is not known yet."""
    done = np.einsum("ij,ij->i", f_W_N[:-1], np.diff(p_W_m, axis=0))
    return np.append(0.0, np.cumsum(done))
