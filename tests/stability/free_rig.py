"""A rig whose hand releases the tool, or throws it: its small motion has closed forms."""

from typing import Final

import numpy as np

from hapscene.device.sim.hand import GRIPS, Grip
from hapscene.device.sim.point import PointMass
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.loop.result import ClosedLoopResult
from hapscene.stability.rig import AT_M, Rig

HOLD: Final = 100.0
"""Stiffness of the guiding hand relative to that of mass, wall and dampers over a tick [1]. The tool then follows
within a tick; at 10, a wall at its stability limit would still move it."""

SETTLE: Final = 16
"""Ticks for which the hand holds the tool before it releases it, in addition to the delay, until transients have
decayed to rounding."""


class FreeRig(Rig):
    """A point mass above the sheet."""

    def __init__(self, device: PointMass, tick_s: float, delay_ticks: int = 0, stiffness_N_m: float = 1.0) -> None:
        super().__init__(device, tick_s, delay_ticks, None, stiffness_N_m)
        self.device, self.delay_ticks = device, delay_ticks
        self.stiffness_N_m, self.damping_Ns_m = stiffness_N_m, 0.0

    def tune(self, stiffness_N_m: float, damping_Ns_m: float = 0.0) -> None:
        self.stiffness_N_m, self.damping_Ns_m = stiffness_N_m, damping_Ns_m
        super().tune(stiffness_N_m, damping_Ns_m)

    def release(self, depth_m: float, speed_m_s: float, push_N: float, count: int) -> ClosedLoopResult:
        """Guide the tool into the sheet, release it at a depth with a speed, then push; returns the push."""
        settle = SETTLE + self.delay_ticks
        before = depth_m - speed_m_s * self.tick_s * np.arange(settle, -1.0, -1.0)
        lead_in = before[0] * np.linspace(-0.01, 1.0, 4)[:3]  # start above the sheet
        depth = np.concatenate((lead_in, before))
        target = np.column_stack((np.full((len(depth), 2), AT_M), -depth))
        grip = np.broadcast_to(self._lead().row(), target.shape).copy()
        grip[-1] = 0.0  # release
        push = np.array((0.0, 0.0, -push_N))
        self.twin.reset(target[0])
        self.twin.run(ReferenceTrajectory(target, grip, np.broadcast_to(push, grip.shape)))
        return self.push_on(push_N, count)

    def push_on(self, push_N: float, count: int) -> ClosedLoopResult:
        """Continue to push into the sheet for `count` ticks."""
        return self.twin.run(ReferenceTrajectory.hold((*AT_M, 0.0), count, GRIPS["none"], push_W_N=(0.0, 0.0, -push_N)))

    def throw(self, height_m: float, speed_m_s: float, count: int) -> ClosedLoopResult:
        """Throw a free point mass at the sheet from above, and simulate `count` ticks."""
        self.twin.reset((*AT_M, height_m), (0.0, 0.0, -speed_m_s))
        return self.push_on(0.0, count)

    def _lead(self) -> Grip:
        """The guiding hand, which the tool follows within a tick."""
        mass_kg, damping_Ns_m = self.device.mass_kg, self.damping_Ns_m + self.device.b_Ns_m
        k = HOLD * max(mass_kg / self.tick_s**2, self.stiffness_N_m, damping_Ns_m / self.tick_s)
        return Grip(k, 2.0 * np.sqrt(k * mass_kg))
