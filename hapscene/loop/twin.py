"""The simulated twin of a haptic device: scene, device and hand in one closed loop."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.clock import new_clock
from hapscene.compiled.entry import entry_of
from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.driver import Connection
from hapscene.device.model import DeviceLike, Limits, limits_of
from hapscene.device.safety import no_safety
from hapscene.device.sim.arm import new_arm, simulated_device
from hapscene.device.sim.omni import Omni, stand
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.geometry import numbers, positions
from hapscene.handle.handle_record import HANDLE, new_handle
from hapscene.handle.plant import Plant
from hapscene.loop.closed_loop import DELAY_MAX, Tool
from hapscene.loop.driver import CHANNEL, Loop, drive, new_loop, static_bodies
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.loop.result import LOOP_ROW, ClosedLoopResult
from hapscene.records import ROW, Records, records
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.surface.effect import Effect

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["Run", "Twin"]


class Twin:
    """A simulated hand that touches a scene with a device: the haptic tick and the device dynamics in closed loop.

    Args:
        scene: the scene.
        device: name from `hapscene.device.DEVICES`, which sets the limits of that device, or a simulated device,
            which has no limits unless `limits` is given.
        handle: haptography handle on the device; None for a device that outputs accelerations without distortion.
        compensator: compensator of the handle, a name from `hapscene.handle.compensator.COMPENSATORS`.
        nominal: model of the handle that the compensator assumes; the true handle by default.
        X_WD: (4, 4) pose of an Omni in W. By default its workspace is centred on the first reference trajectory.
        effects, seed, tick_s, a_rate_Hz, limits, settings, tip_radius_m: see `Renderer`.
        delay_ticks: delay from the tick to its force [ticks].

    Attributes:
        renderer: renderer in the loop; you may call its `tune`.
        safety: (1,) `hapscene.device.safety.SAFETY`, if a servo has set it.
        tool: state of device, hand and handle; None before the first `reset` or `run`.

    Raises:
        HapsceneError: `delay_ticks` is out of range, or `Renderer` rejects an argument.
    """

    def __init__(
        self,
        scene: "Scene",
        device: "DeviceLike | Connection",
        effects: Sequence[str | Effect] = EFFECTS,
        *,
        seed: int = 0,
        tick_s: float = TICK_S,
        a_rate_Hz: float = ACCELERATION_RATE_HZ,
        limits: Limits | None = None,
        delay_ticks: int = 0,
        handle: Plant | None = None,
        compensator: str = "adaptive",
        nominal: Plant | None = None,
        X_WD: ArrayLike | None = None,
        settings: Mapping[str, Mapping[str, object]] | None = None,
        tip_radius_m: float = 0.0,
    ) -> None:
        if not 0 <= delay_ticks < DELAY_MAX or delay_ticks % 1 != 0:
            raise HapsceneError(f"delay_ticks must be an integer from 0 to {DELAY_MAX - 1}, is {delay_ticks}")
        if handle is not None and not isinstance(handle, Plant):
            raise HapsceneError(f"handle must be a Plant, is {handle!r:.60}")
        self.device = device if isinstance(device, Connection) else simulated_device(device)
        if limits is None and not isinstance(device, PointMass | Omni | Connection):
            limits = limits_of(device, tick_s, delay_ticks)
        self.renderer = Renderer(
            scene,
            effects,
            seed=seed,
            tick_s=tick_s,
            a_rate_Hz=a_rate_Hz,
            limits=limits,
            settings=settings,
            tip_radius_m=tip_radius_m,
        )
        self.handle, self.compensator, self.nominal = handle, compensator, nominal or handle
        self.X_WD = X_WD
        self._seed = seed
        self._delay = delay_ticks
        self.safety: Any = None
        self.tool: Any = None
        self._drive: Callable[[Loop], object] | None = None  # the compiled driver, once it has run

    def __repr__(self) -> str:
        handle = "no handle" if self.handle is None else f"a handle driven by {self.compensator!r}"
        return f"<Twin: {type(self.device).__name__} with {handle}; {self.renderer!r}>"

    def reset(self, p_WT: ArrayLike, v_WT_m_s: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Restart with the tool at `p_WT` (3,) [m] and no delayed force; a point mass also has a velocity (3,).

        Raises:
            PathError: position or velocity is not three finite numbers.
            HapsceneError: the position is out of reach of the device.
        """
        p = positions(numbers(p_WT).reshape(1, -1))[0]
        v = positions(numbers(v_WT_m_s).reshape(1, -1))[0]
        arm = new_arm(self.device, p, self.X_WD)
        arm.point.v_m_s = v
        if self.handle is None:
            handle = records(1, HANDLE)
        else:
            handle = new_handle(
                self.handle, self.nominal or self.handle, self.compensator, self.renderer.a_rate_Hz, self._seed
            )
        self.tool = Tool(
            arm=arm,
            handle=handle,
            has_handle=int(self.handle is not None),
            axis_W=np.array([0.0, 0.0, 1.0]),
            shift_m=np.zeros(1),
            quantum_m=_quantum_m(self.device),
            wait_N=np.zeros((DELAY_MAX, 3)),
            ticks=np.zeros(1, np.int64),
            delay=self._delay,
            safety=no_safety() if self.safety is None else self.safety,
        )
        self.renderer.reset(p)

    def run(self, reference: ReferenceTrajectory, poses: Mapping[str, ArrayLike] | None = None) -> ClosedLoopResult:
        """Run a tick for each row of a reference trajectory.

        The first run starts at rest at the first target; later runs continue from the state of the last tick.

        Args:
            reference: reference trajectory of the hand.
            poses: poses of bodies that move, {body: X_WB (n, 4, 4)}, one for each tick.

        Raises:
            SceneError: a body is unknown, or poses have another length or are not rigid.

        Warns:
            UsageWarning: the tool starts inside a body.
        """
        self.begin(reference)
        run = Run(self, reference, *self.renderer._poses(poses or {}, len(reference)))
        run.advance(len(reference))
        return run.result()

    def begin(self, reference: ReferenceTrajectory) -> None:
        """Start at rest at the first target of a reference trajectory, unless the twin has run already."""
        if self.tool is None:
            if self.X_WD is None and isinstance(self.device, Omni):
                target = reference.target_W_m
                self.X_WD = stand(0.5 * (target.min(axis=0) + target.max(axis=0)))
            self.reset(reference.target_W_m[0])
        self.renderer._apply_scene_poses()


class Run:
    """A run of a twin in parts, for simulations that compute something between its ticks."""

    def __init__(
        self,
        twin: Twin,
        reference: ReferenceTrajectory,
        moving: NDArray[np.int64],
        X_WB: NDArray[np.float64],
        teleported: NDArray[np.int64],
    ) -> None:
        """Prepare a run.

        Args:
            twin: the twin.
            reference: reference trajectory of the hand, n ticks.
            moving: (m,) indices of bodies that move.
            X_WB: their poses, (n, m, 4, 4) for each tick, or (1, m, 4, 4) to be written between ticks.
            teleported: (m,) 1 for bodies that teleport.
        """
        n, renderer, self._channel = len(reference), twin.renderer, records(1, CHANNEL)[0]
        self._twin, self._reference = twin, reference
        self._rows, self._loop_rows = records(n, ROW), records(n, LOOP_ROW)
        self._a_m_s2, self._a_handle_m_s2 = np.zeros((2, n, renderer.block))
        self._channel.moving_count = len(moving)
        hand = (reference.target_W_m, reference.grip, reference.push_W_N)
        loop = new_loop(
            [renderer],
            [twin.tool],
            self._channel,
            new_clock(),
            bodies=static_bodies(moving, X_WB, teleported),
            reference=tuple(np.require(part, requirements=("C", "W")) for part in hand),
            rows=self._rows.reshape(1, n),
            loop_rows=self._loop_rows.reshape(1, n),
            a_m_s2=self._a_m_s2[None],
            a_handle_m_s2=self._a_handle_m_s2[None],
        )
        self._drive = twin._drive = twin._drive or entry_of(drive, loop)
        self._loop = loop

    def advance(self, count: int) -> None:
        """Run the next `count` ticks."""
        self._channel.until += count
        self._drive(self._loop)
        self._twin.renderer.warn_if_inside()

    def result(self) -> ClosedLoopResult:
        """Return the result of all ticks."""
        twin, rows = self._twin, self._loop_rows
        delay = 0.0 if twin.handle is None else float(twin.tool.handle.delay[0])
        return ClosedLoopResult(
            recording=twin.renderer.recording(self._rows, self._a_m_s2),
            p_W_m=_column(rows, "p_W_m"),
            v_W_m_s=_column(rows, "v_W_m_s"),
            target_W_m=self._reference.target_W_m,
            f_motor_W_N=_column(rows, "f_motor_W_N"),
            f_hand_W_N=_column(rows, "f_hand_W_N"),
            work_J=_column(rows, "work_J"),
            a_handle_m_s2=self._a_handle_m_s2,
            latency_s=delay / twin.renderer.a_rate_Hz,
            f_coil_N=_column(rows, "f_coil_N"),
            heat=_column(rows, "heat"),
            trouble=np.ascontiguousarray(rows["trouble"]),
        )


def _quantum_m(device: PointMass | Omni | Connection) -> float:
    """Return the encoder step for displacements of the handle; 0 for a real device, which measures the sum."""
    if isinstance(device, Connection):
        return 0.0
    return device.quantum_m if isinstance(device, PointMass) else device.resolution_m


def _column(rows: Records, name: str) -> NDArray[np.float64]:
    return np.ascontiguousarray(rows[name])
