"""The setup of all stability trials: a flat sheet, a device, and a hand that guides it and releases it.

It is the closed loop of `hapscene.loop` with the real haptic tick and the shipped wall effect, whose stiffness and
damping can be changed while it runs.
"""

import warnings
from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.model import DeviceWarning, Limits
from hapscene.device.sim.hand import GRIPS, Grip
from hapscene.device.sim.omni import Omni, stand
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.loop.result import ClosedLoopResult
from hapscene.loop.twin import Twin
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.effect import Effect
from hapscene.surface.effect_registry import load_effect
from hapscene.surface.swatch import Swatch

__all__ = ["AT_M", "Rig", "sheet"]

SHEET_M: Final = 0.2
"""Side of the sheet [m]. Its top is z = 0; it has no underside, so that penetration is not limited."""

AT_M: Final = (0.031, -0.017)
"""Contact point, x and y [m]: inside one of the two faces."""

HOLD: Final = 100.0
"""Stiffness of the guiding hand relative to that of mass, wall and dampers over a tick [1]. The tool then follows
within a tick; at 10, a wall at its stability limit would still move it."""

SETTLE: Final = 16
"""Ticks for which the hand holds the tool before it releases it, in addition to the delay, until transients have
decayed to rounding."""


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
        self.device, self.tick_s, self.delay_ticks = device, tick_s, delay_ticks
        self._stiffness_N_m, self._damping_Ns_m = stiffness_N_m, damping_Ns_m
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeviceWarning)  # here it is intended that limits restrict the wall
            self.twin = self._twin(limits)

    def _twin(self, limits: Limits | None) -> Twin:
        device, tick_s = self.device, self.tick_s
        wall = Swatch("wall", stiffness_N_m=self._stiffness_N_m, damping_Ns_m=self._damping_Ns_m)
        return Twin(
            sheet(wall),
            device,
            effects=(_wall(),),
            tick_s=tick_s,
            a_rate_Hz=1.0 / tick_s,
            limits=limits,
            delay_ticks=self.delay_ticks,
            X_WD=stand((*AT_M, 0.0)) if isinstance(device, Omni) else None,
        )

    def tune(self, stiffness_N_m: float, damping_Ns_m: float = 0.0) -> None:
        """Set stiffness and damping of the wall."""
        self._stiffness_N_m, self._damping_Ns_m = stiffness_N_m, damping_Ns_m
        self.twin.renderer.tune("wall", stiffness_N_m=stiffness_N_m, damping_Ns_m=damping_Ns_m)

    def release(self, depth_m: float, speed_m_s: float, push_N: float, count: int) -> ClosedLoopResult:
        """Guide a point mass into the sheet, release it at a depth with a speed, and then only push.

        Args:
            depth_m: depth of the release, above 0.
            speed_m_s: speed into the sheet at the release.
            push_N: pushing force, before and after the release.
            count: ticks after the release.

        Returns:
            the closed-loop result of the `count` ticks after the release.
        """
        settle = SETTLE + self.delay_ticks
        before = depth_m - speed_m_s * self.tick_s * np.arange(settle, -1.0, -1.0)
        lead_in = before[0] * np.linspace(-0.01, 1.0, 4)[:3]  # start above the sheet
        target = _at(np.concatenate((lead_in, before)))
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
        self.twin.reset(_at(-height_m), (0.0, 0.0, -speed_m_s))
        return self.push_on(0.0, count)

    def follow(self, depth_m: NDArray[np.float64], grip: Grip) -> ClosedLoopResult:
        """Guide the tool along depths (n,), from rest at the first one; negative depths are above the sheet."""
        path = _at(depth_m)
        self.twin.reset(path[0])
        return self.twin.run(ReferenceTrajectory.along(path, grip))

    def stay(self, depth_m: float, count: int, grip: Grip) -> ClosedLoopResult:
        """Continue to hold the target at a depth for `count` ticks."""
        return self.twin.run(ReferenceTrajectory.hold((*AT_M, -depth_m), count, grip))

    @property
    def point(self) -> PointMass:
        """The device as a point mass."""
        if not isinstance(self.device, PointMass):
            raise HapsceneError("rig: small motion requires a point mass; the device is an Omni")
        return self.device

    def _lead(self) -> Grip:
        """The guiding hand, which the tool follows within a tick."""
        device, wall_Ns_m = self.point, self._damping_Ns_m
        k = HOLD * max(device.mass_kg / self.tick_s**2, self._stiffness_N_m, (wall_Ns_m + device.b_Ns_m) / self.tick_s)
        return Grip(k, 2.0 * np.sqrt(k * device.mass_kg))


@cache
def _wall() -> Effect:
    """The shipped wall effect; cached, since loading it takes longer than most trials."""
    return load_effect("wall")


def _at(depth_m: float | Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (n, 3) in W at depths (n,)."""
    depth = np.asarray(depth_m, np.float64)
    return np.stack([np.full(depth.shape, AT_M[0]), np.full(depth.shape, AT_M[1]), -depth], axis=-1)
