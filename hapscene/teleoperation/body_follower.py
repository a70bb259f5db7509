"""A follower that is a body of a simulation: the tip of a robot, say, which touches what is simulated with it.

The simulation may be of any kind: it has the three methods of `hapscene.bridge.Simulation`. What the motors of the
follower give is a force at the body's origin, held over a tick (a robot's have Jᵀ f at its joints). The accelerometer
is the body's own acceleration along the handle, step by step, so a simulation of short steps tells more of a tap.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import TICK_S
from hapscene.errors import SceneError, no_such
from hapscene.geometry import Vector
from hapscene.records import records
from hapscene.teleoperation.datagram import MESSAGE, SAMPLE_COUNT
from hapscene.teleoperation.endpoint import Coupling, control, new_endpoint, place, tell
from hapscene.teleoperation.leader_follower import accelerate, couple, new_tool

if TYPE_CHECKING:
    from hapscene.bridge.simulation import Simulation

__all__ = ["BodyFollower", "sense"]


class BodyFollower:
    """A follower at rest, in place of a `Follower`.

    Args:
        simulation: whose steps are a tick, or fit into one.
        body: of the simulation; None where there is but one.
        coupling, axis_W: as of a `Follower`.

    Attributes:
        p_W_m: (3,) the body's origin, now.
        end, told, read_m_s2: as of a `Follower`.

    Raises:
        SceneError: no such body; steps that do not fit into a tick; later, a place that is not finite.
    """

    def __init__(self, simulation: "Simulation", body: str | None, coupling: Coupling, axis_W: Any) -> None:
        names = tuple(simulation.names)
        if body is None and len(names) != 1:
            raise SceneError(f"which body is the follower's tool? say body=…, one of: {', '.join(names) or 'none'}")
        if body is not None and body not in names:
            raise SceneError(no_such("moving body", body, names))
        self._simulation, self._index = simulation, 0 if body is None else names.index(body)
        count = round(TICK_S / simulation.step_s) if simulation.step_s > 0.0 else 0
        if count < 1 or abs(count * simulation.step_s / TICK_S - 1.0) > 1e-9:
            raise SceneError(
                f"a follower is moved every {1e3 * TICK_S:g} ms, in which steps of {1e3 * simulation.step_s:g} ms do "
                f"not fit: choose {1e3 * TICK_S:g} ms, or a half, a fifth or a tenth of it"
            )
        self._X_WB, self._wrench = np.tile(np.eye(4), (len(names), 1, 1)), np.zeros((len(names), 6))
        self.p_W_m = self._read()
        self.end, self.told = new_endpoint(coupling, "follower", TICK_S), records(1, MESSAGE)
        place(self.end, *self.p_W_m)
        self._tool, self._places_m = new_tool(self.p_W_m, axis_W), np.tile(self.p_W_m, (count, 1))
        self.read_m_s2 = np.zeros(SAMPLE_COUNT)

    def follow(self, now: int) -> Vector:
        """Tick `now`, as `leader_follower.follow`: the force of the motors [N]."""
        force: Vector = control(self.end, now, *self.p_W_m.tolist())
        tell(self.end, now, self.told)
        self.told.a_m_s2[0] = self.read_m_s2
        self._wrench[self._index, :3] = force
        for place_m in self._places_m:
            self._simulation.advance(self._wrench)
            place_m[:] = self.p_W_m = self._read()
        sense(self._tool, self._places_m, self._simulation.step_s, self.read_m_s2)
        return force

    def contact(self) -> NDArray[np.float64]:
        """(3,) the force of what the body touches [N]: NaN where the simulation has no `contact` to say it."""
        ask = getattr(self._simulation, "contact", None)
        return np.full(3, np.nan) if ask is None else np.asarray(ask(self._index), np.float64)

    def _read(self) -> NDArray[np.float64]:
        self._simulation.read(self._X_WB)
        p_W_m = self._X_WB[self._index, :3, 3].copy()
        if not np.isfinite(p_W_m).all():
            raise SceneError("the follower's place is not finite: its simulation has burst; shorten its steps")
        return p_W_m


@native
def sense(tool: Any, places_m: NDArray[np.float64], step_s: float, read_m_s2: NDArray[np.float64]) -> None:
    """What the accelerometer read in a tick (SAMPLE_COUNT,), of the tool's places (k, 3) at the ends of its steps."""
    count, sample = len(places_m), 0
    for i in range(count):
        a_m_s2 = accelerate(tool[0], (places_m[i, 0], places_m[i, 1], places_m[i, 2]), step_s)
        heard_m_s2 = couple(tool[0], a_m_s2, step_s)
        while sample < SAMPLE_COUNT and sample * count < (i + 1) * SAMPLE_COUNT:
            read_m_s2[sample] = heard_m_s2
            sample += 1
