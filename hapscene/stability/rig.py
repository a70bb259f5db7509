"""The setup of all stability trials: a flat sheet, a device, and a hand that guides it.

It is the closed loop of `hapscene.loop` with the real haptic tick and the shipped wall effect, whose stiffness and
damping can be changed while it runs.
"""

import warnings
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.model import DeviceWarning, Limits
from hapscene.device.sim.hand import Grip
from hapscene.device.sim.omni import Omni, stand
from hapscene.device.sim.point import PointMass
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.loop.result import ClosedLoopResult
from hapscene.loop.twin import Twin
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.effect import Effect, load_effect
from hapscene.surface.swatch import Swatch

__all__ = ["AT_M", "Rig", "sheet"]

SHEET_M: Final = 0.2
"""Side of the sheet [m]. Its top is z = 0; it has no underside, so that penetration is not limited."""

AT_M: Final = (0.031, -0.017)
"""Contact point, x and y [m]: inside one of the two faces."""


def sheet(swatch: Swatch, side_m: float = SHEET_M) -> Scene:
    """A scene of one flat sheet at z = 0, touched from above, with a swatch."""
    h = side_m / 2.0
    corners = np.array([(-h, -h, 0.0), (h, -h, 0.0), (h, h, 0.0), (-h, h, 0.0)])
    scene = Scene()
    scene.add(Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], np.int32)), name="sheet", swatch=swatch)
    return scene


class Rig:
    """A device above the sheet.

    Args:
        device: the device; an Omni is placed so that it touches the sheet in its nominal posture.
        tick_s: period of the haptic tick.
        delay_ticks: delay of the force.
        limits: limits of the device; None disables them.
        stiffness_N_m, damping_Ns_m: of the wall, until `tune` changes them.
    """

    def __init__(
        self,
        device: PointMass | Omni,
        tick_s: float,
        delay_ticks: int = 0,
        limits: Limits | None = None,
        stiffness_N_m: float = 1.0,
        damping_Ns_m: float = 0.0,
    ) -> None:
        self.tick_s = tick_s
        wall = Swatch("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=damping_Ns_m)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeviceWarning)  # here it is intended that limits restrict the wall
            self.twin = Twin(
                sheet(wall),
                device,
                effects=(_wall(),),
                tick_s=tick_s,
                a_rate_Hz=1.0 / tick_s,
                limits=limits,
                delay_ticks=delay_ticks,
                X_WD=stand((*AT_M, 0.0)) if isinstance(device, Omni) else None,
            )

    def tune(self, stiffness_N_m: float, damping_Ns_m: float = 0.0) -> None:
        """Set stiffness and damping of the wall."""
        self.twin.renderer.tune("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=damping_Ns_m)

    def follow(self, depth_m: NDArray[np.float64], grip: Grip) -> ClosedLoopResult:
        """Guide the tool along depths (n,), from rest at the first one; negative depths are above the sheet."""
        path = np.column_stack((np.full((len(depth_m), 2), AT_M), -depth_m))
        self.twin.reset(path[0])
        return self.twin.run(ReferenceTrajectory.along(path, grip))

    def stay(self, depth_m: float, count: int, grip: Grip) -> ClosedLoopResult:
        """Continue to hold the target at a depth for `count` ticks."""
        return self.twin.run(ReferenceTrajectory.hold((*AT_M, -depth_m), count, grip))


@cache
def _wall() -> Effect:
    """The shipped wall effect; cached, since loading it takes longer than most trials."""
    return load_effect("wall")
