"""The twin: a scene, a device and a hand in one closed loop."""

import os
from collections.abc import Mapping, Sequence
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
from hapscene.handle.handle_loop import HANDLE, new_handle
from hapscene.handle.plant import Plant
from hapscene.loop.closed_loop import DELAY_MAX, Tool
from hapscene.loop.driver import CHANNEL, drive, new_loop, still_bodies
from hapscene.loop.hand_intent import Intent
from hapscene.loop.result import FELT, Feel
from hapscene.records import ROW, records
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.surface.effect import Effect

if TYPE_CHECKING:
    from hapscene.fidelity.fidelity import Fidelity
    from hapscene.scene.scene import Scene

__all__ = ["Run", "Twin"]


class Twin:
    """A hand that touches a scene with a device: the real tick, closed over a simulated arm.

    Args:
        scene: what is there.
        device: what the hand holds: a name of `hapscene.device.DEVICES`, which brings its limits along, or a simulated
            device, which has none unless they are given.
        handle: the haptography handle on it; None for a device that plays accelerations as they are.
        compensator: what drives the handle, a name of `hapscene.handle.compensator.COMPENSATORS`.
        nominal: the handle that the compensator takes it for; else the same.
        X_WD: (4, 4) where an Omni stands in W; else its workspace is centred on the first intention.
        effects, seed, tick_s, a_rate_Hz, limits, settings, fidelity: as `Renderer` has them.
        delay_ticks: how many ticks later a force goes out: 0 for a loop that writes in the tick in which it read.

    Attributes:
        renderer: the renderer in the loop; `tune` it as you like.
        safety: (1,) `hapscene.device.safety.SAFETY`, where the servo has set one.
        body: what the compiled loop acts on; None before the first `reset` or `run`.

    Raises:
        HapsceneError: a delay out of range, or what `Renderer` refuses.
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
        settings: Mapping[str, Mapping[str, Any]] | None = None,
        fidelity: "Fidelity | str | os.PathLike[str] | None" = None,
    ) -> None:
        if not 0 <= delay_ticks < DELAY_MAX or delay_ticks % 1 != 0:
            raise HapsceneError(f"delay_ticks must be a whole number from 0 to {DELAY_MAX - 1}, is {delay_ticks}")
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
            fidelity=fidelity,
        )
        self.handle, self.compensator, self.nominal = handle, compensator, nominal or handle
        self.X_WD = X_WD
        self._seed = seed
        self._delay = delay_ticks
        self.safety: Any = None
        self.body: Any = None
        self._drive: Any = None  # the compiled driver, once it has run

    def __repr__(self) -> str:
        handle = "no handle" if self.handle is None else f"a handle driven by {self.compensator!r}"
        return f"<Twin: {type(self.device).__name__} with {handle}; {self.renderer!r}>"

    def reset(self, p_WT: ArrayLike, v_WT_m_s: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Start anew, the tool at `p_WT` (3,) [m], no force on its way; a point mass with a velocity (3,).

        Raises:
            PathError: not three finite numbers.
            HapsceneError: a place out of the device's reach.
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
        self.body = Tool(
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

    def run(self, intent: Intent, poses: Mapping[str, ArrayLike] | None = None) -> Feel:
        """Run an intent, a tick for each of its rows; `poses` {body: X_WB (n, 4, 4)} moves bodies there.

        Goes on from where the last run ended; the first starts at rest at the intent's first target.

        Raises:
            SceneError: poses for an unknown body, of another length, or not rigid.
        """
        self.begin(intent)
        run = Run(self, intent, *self.renderer._poses(poses or {}, len(intent)))
        run.advance(len(intent))
        return run.result()

    def begin(self, intent: Intent) -> None:
        """At rest at the intent's first target, unless a run goes on."""
        if self.body is None:
            if self.X_WD is None and isinstance(self.device, Omni):
                self.X_WD = stand(0.5 * (intent.target_W_m.min(axis=0) + intent.target_W_m.max(axis=0)))
            self.reset(intent.target_W_m[0])
        self.renderer._apply_scene_poses()


class Run:
    """The ticks of an intent, some at a time: for what simulates between them."""

    def __init__(
        self,
        twin: Twin,
        intent: Intent,
        moving: NDArray[np.int64],
        X_WB: NDArray[np.float64],
        teleported: NDArray[np.int64],
    ) -> None:
        """`moving` (m,), their poses (n, m, 4, 4) tick by tick, or (1, m, 4, 4) as now; which jump (m,)."""
        n, renderer, self._channel = len(intent), twin.renderer, records(1, CHANNEL)[0]
        self._twin, self._intent = twin, intent
        self._rows, self._felt = records(n, ROW), records(n, FELT)
        self._a_m_s2, self._a_handle_m_s2 = np.zeros((2, n, renderer.block))
        self._channel.moving_count = len(moving)
        hand = (intent.target_W_m, intent.grip, intent.push_W_N)
        loop = new_loop(
            [renderer],
            [twin.body],
            self._channel,
            new_clock(),
            bodies=still_bodies(moving, X_WB, teleported),
            intent=tuple(np.require(part, requirements=("C", "W")) for part in hand),
            rows=self._rows.reshape(1, n),
            felt=self._felt.reshape(1, n),
            a_m_s2=self._a_m_s2[None],
            a_handle_m_s2=self._a_handle_m_s2[None],
        )
        if twin._drive is None:
            twin._drive = entry_of(drive, loop)
        self._loop = loop

    def advance(self, count: int) -> None:
        """The next ticks."""
        self._channel.until += count
        self._twin._drive(self._loop)

    def result(self) -> Feel:
        """The closed loop of all ticks."""
        twin, felt = self._twin, self._felt
        delay = 0.0 if twin.handle is None else float(twin.body.handle.delay[0])
        return Feel(
            recording=twin.renderer.recording(self._rows, self._a_m_s2),
            p_W_m=_column(felt, "p_W_m"),
            v_W_m_s=_column(felt, "v_W_m_s"),
            target_W_m=self._intent.target_W_m,
            f_motor_W_N=_column(felt, "f_motor_W_N"),
            f_hand_W_N=_column(felt, "f_hand_W_N"),
            work_J=_column(felt, "work_J"),
            a_handle_m_s2=self._a_handle_m_s2,
            latency_s=delay / twin.renderer.a_rate_Hz,
            f_coil_N=_column(felt, "f_coil_N"),
            heat=_column(felt, "heat"),
            trouble=np.ascontiguousarray(felt["trouble"]),
        )


def _quantum_m(device: PointMass | Omni | Connection) -> float:
    """Step of the encoders in which the handle's own movement is seen; 0 of a real device, which measures it all."""
    if isinstance(device, Connection):
        return 0.0
    return device.quantum_m if isinstance(device, PointMass) else device.resolution_m


def _column(rows: Any, name: str) -> NDArray[np.float64]:
    return np.ascontiguousarray(rows[name])
