"""Contact and free motion over a link with delay, and the rendered stiffness beside its closed form."""

from typing import Any, Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.device.sim.hand import Grip
from hapscene.device.sim.point import PointMass
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.operation import Impairment, Operation, OperationResult
from hapscene.teleoperation.plate import plate

BAD: Final = {"jitter_s": 0.005, "loss": 0.05}
"""Impairments of the bad link, in addition to its delay."""


def land(grip: str) -> ReferenceTrajectory:
    """Move down at 0.2 m/s to a target 2 cm below the surface, and stay: a hard contact."""
    t_s = np.arange(4.0 / TICK_S) * TICK_S
    z_m = np.maximum(0.03 - 0.2 * np.maximum(t_s - 0.2, 0.0), -0.02)
    return ReferenceTrajectory.along(np.column_stack((0.0 * t_s, 0.0 * t_s, z_m)), grip)


REST_MAX_M_S: Final = 0.005
"""Largest speed of a tool at rest, root mean square over the last second [m/s]."""

ENERGY_MAX_J: Final = 2e-3
"""Largest energy output of a passive run [J]: the allowances of both ends."""

WALL_N_M: Final = 500.0
"""Stiffness of the plate in the measurement [N/m]."""


def operate_landing(scheme: str, delay_s: float, bad: bool = False) -> OperationResult:
    """A landing in a light grip."""
    intent = land("light")
    line = Impairment(delay_s, **BAD) if bad else Impairment(delay_s)
    start = intent.target_W_m[0]
    operation = Operation(plate("wood"), start, coupling=Coupling(scheme), line=line, compensator="none")
    return operation.run(intent)


def predict_stiffness(delay_s: float, coupling: Coupling | None = None) -> float:
    """Stiffness rendered through waves, in closed form [N/m]. At rest the link is a spring b/d, in series with the
    spring of the follower and the wall: 1/K = 1/K_wall + 1/K_c + d/b.
    """
    tied = coupling or Coupling()
    return 1.0 / (1.0 / WALL_N_M + 1.0 / tied.stiffness_N_m + delay_s / tied.impedance_Ns_m)


def measure_stiffness(coupling: Coupling, delay_s: float) -> tuple[float, float]:
    """Stiffness rendered at the leader [N/m], and the mean delay of a wave [s]."""
    scene = plate(Swatch("wall", stiffness_N_m=WALL_N_M))
    start = (0.0, 0.0, 0.002)
    bare: dict[str, Any] = {"device": PointMass(0.045, 0.1), "compensator": "none", "effects": ("wall",)}
    operation = Operation(scene, start, coupling=coupling, line=Impairment(delay_s), **bare)
    found = []
    for push_N in (-0.5, -1.0):
        operated = operation.run(ReferenceTrajectory.hold(start, 6000, Grip(0.0, 2.0), push_W_N=(0.0, 0.0, push_N)))
        found.append((push_N, operated.leader_W_m[-1, 2]))
    queues = [end.queue[0] for end in (operation.leader.end, operation.follower.end)]
    lag_s = float(np.mean([int(queue.lag_ticks) for queue in queues])) * 1e-3
    (f0, z0), (f1, z1) = found
    return float((f1 - f0) / (z1 - z0)), lag_s


def final_speed_m_s(result: OperationResult) -> float:
    """Root mean square of the speed of the faster tool over the last second [m/s]."""
    final = result.t_s >= result.t_s[-1] - 1.0
    speeds = [np.diff(p[final], axis=0) / TICK_S for p in (result.leader_W_m, result.follower_W_m)]
    return max(float(np.sqrt((v**2).sum(axis=1).mean())) for v in speeds)


def energy_out_J(result: OperationResult) -> float:
    """Largest energy that the motors of both devices together had given out at any time [J]."""
    return max(float(result.work_J.max()), 0.0)
