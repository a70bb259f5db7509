"""A follower that is a body of a simulation, for example the tip of a robot that touches simulated objects.

The simulation has the methods of `hapscene.bridge.Simulation`. The motors of the follower exert a force at the
origin of the body, held over a tick; for a robot, Jᵀ f are the joint torques. The accelerometer reads the
acceleration of the body along the handle in each step, so that a simulation with shorter steps resolves taps better.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hapscene.compiled.native import native
from hapscene.constants import TICK_S
from hapscene.errors import SceneError, no_such
from hapscene.geometry import Vector
from hapscene.records import Records, records
from hapscene.teleoperation.datagram import MESSAGE, SAMPLE_COUNT
from hapscene.teleoperation.endpoint import Coupling, control, fill_message, new_endpoint, set_start
from hapscene.teleoperation.leader_follower import Array, high_pass, new_tool, tip_acceleration

if TYPE_CHECKING:
    from hapscene.bridge.simulation import Simulation

__all__ = ["BodyFollower", "read_accelerometer"]


class BodyFollower:
    """A follower that is a body of a simulation; used instead of a `Follower`.

    Args:
        simulation: the simulation; a tick must be a multiple of its step.
        body: name of the body; None if the simulation has only one.
        coupling, axis_W: as in `leader_follower.new_follower`.

    Attributes:
        p_W_m: (3,) present position of the body's origin.
        end, outgoing, read_m_s2: as in `Follower`.

    Raises:
        SceneError: unknown body; steps that do not divide a tick; later, a position that is not finite.
    """

    def __init__(self, simulation: "Simulation", body: str | None, coupling: Coupling, axis_W: Sequence[float]) -> None:
        names = tuple(simulation.names)
        if body is None and len(names) != 1:
            raise SceneError(
                f"the simulation has {len(names)} bodies; choose the tool of the follower by body=…, one of: "
                f"{', '.join(names)}"
            )
        if body is not None and body not in names:
            raise SceneError(no_such("moving body", body, names))
        self._simulation, self._index = simulation, 0 if body is None else names.index(body)
        count = round(TICK_S / simulation.step_s) if simulation.step_s > 0.0 else 0
        if count < 1 or abs(count * simulation.step_s / TICK_S - 1.0) > 1e-9:
            raise SceneError(
                f"the simulation step is {1e3 * simulation.step_s:g} ms, which does not divide the tick of a follower, "
                f"{1e3 * TICK_S:g} ms; choose {1e3 * TICK_S:g} ms, or a half, a fifth or a tenth of that"
            )
        self._X_WB, self._wrench = np.tile(np.eye(4), (len(names), 1, 1)), np.zeros((len(names), 6))
        self.p_W_m = self._read()
        self.end, self.outgoing = new_endpoint(coupling, "follower", TICK_S), records(1, MESSAGE)
        set_start(self.end, *self.p_W_m)
        self._tool, self._positions_m = new_tool(self.p_W_m, axis_W), np.tile(self.p_W_m, (count, 1))
        self.read_m_s2 = np.zeros(SAMPLE_COUNT)

    def step(self, now: int) -> Vector:
        """Run tick `now`, as `leader_follower.step_follower` does; return the motor force [N]."""
        force: Vector = control(self.end, now, *self.p_W_m.tolist())
        fill_message(self.end, now, self.outgoing)
        self.outgoing.a_m_s2[0] = self.read_m_s2
        self._wrench[self._index, :3] = force
        for position_m in self._positions_m:
            self._simulation.advance(self._wrench)
            position_m[:] = self.p_W_m = self._read()
        read_accelerometer(self._tool, self._positions_m, self._simulation.step_s, self.read_m_s2)
        return force

    def contact(self) -> Array:
        """(3,) contact force on the body [N]; NaN if the simulation has no method `contact`."""
        contact = getattr(self._simulation, "contact", None)
        return np.full(3, np.nan) if contact is None else np.asarray(contact(self._index), np.float64)

    def _read(self) -> Array:
        self._simulation.read(self._X_WB)
        p_W_m = self._X_WB[self._index, :3, 3].copy()
        if not np.isfinite(p_W_m).all():
            raise SceneError(
                "the position of the follower is not finite: the simulation has diverged; shorten its step"
            )
        return p_W_m


@native
def read_accelerometer(tool: Records, positions_m: Array, step_s: float, read_m_s2: Array) -> None:
    """Compute the accelerometer samples of a tick (SAMPLE_COUNT,) from tool positions (k, 3), one per step."""
    count, sample = len(positions_m), 0
    for i in range(count):
        a_m_s2 = tip_acceleration(tool[0], (positions_m[i, 0], positions_m[i, 1], positions_m[i, 2]), step_s)
        filtered_m_s2 = high_pass(tool[0], a_m_s2, step_s)
        while sample < SAMPLE_COUNT and sample * count < (i + 1) * SAMPLE_COUNT:
            read_m_s2[sample] = filtered_m_s2
            sample += 1
