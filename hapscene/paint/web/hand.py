"""The simulated hand of the page: its device, grip and handle, and the servo that renders its touch."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import DEFAULT_GRIP, TICK_S
from hapscene.device.model import DEVICES, limits_of
from hapscene.device.sim.hand import GRIPS
from hapscene.device.sim.omni import Omni, stand
from hapscene.device.sim.omni_kinematics import reachable
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError, no_such
from hapscene.handle import Plant
from hapscene.loop import Servo, ServoState
from hapscene.scene.body import Body
from hapscene.scene.scene import Scene

__all__ = [
    "COMPENSATOR_HINTS",
    "GRIP_NAMES",
    "HAND_DEVICES",
    "HOVER_M",
    "IDLE_S",
    "LIFT_M",
    "NO_HANDLE",
    "HandConfig",
    "TouchHand",
    "aim_point",
    "make_servo",
]

Vector = NDArray[np.float64]
Result = TypeVar("Result")


class HandDevice(NamedTuple):
    """A device that the hand can hold: the name in `DEVICES` of its limits, and its dynamic model."""

    limits: str
    model: PointMass | Omni


HAND_DEVICES: Final[Mapping[str, HandDevice]] = {
    "omni": HandDevice("omni", Omni()),
    **{
        "omni-point" if name == "omni" else name: HandDevice(name, device.point)
        for name, device in DEVICES.items()
        if device.point is not None
    },
}
"""Devices by name: the full model of the Omni, and every device as a point mass with friction and encoders."""

GRIP_NAMES: Final = tuple(name for name in GRIPS if name != "none")

NO_HANDLE: Final = "no-handle"

COMPENSATOR_HINTS: Final[Mapping[str, str]] = {
    "adaptive": "the acceleration of the handle, whose compensator adapts to its accelerometer",
    "flat": "the acceleration of the handle, compensated by its inverse model to be flat from 20 Hz on",
    "inverse": "the acceleration of the handle, compensated by its inverse model, attenuated at low frequency",
    "naive": "the acceleration of the handle, driven by its mass alone, without its spring and the grip",
    NO_HANDLE: "the acceleration commanded by the swatches, as of an ideal handle",
}
"""Content of sound and plots for each compensator. `none` of `hapscene touch` is omitted, since it is silent."""


@dataclass(frozen=True)
class HandConfig:
    """Configuration of the simulated hand.

    Attributes:
        device: a name of `HAND_DEVICES`.
        grip: firmness of the grip, a name of `GRIP_NAMES`.
        compensator: compensator of the handle, a name of `COMPENSATOR_HINTS`.
        tip_radius_m: radius of the tip of the tool; 0 for a point.

    Raises:
        HapsceneError: a name is unknown.
    """

    device: str = "omni"
    grip: str = DEFAULT_GRIP
    compensator: str = "adaptive"
    tip_radius_m: float = 0.0

    def __post_init__(self) -> None:
        if self.device == "ideal":
            raise HapsceneError(
                f"the device 'ideal' cannot be simulated, since it has no mass: choose one of {', '.join(HAND_DEVICES)}"
            )
        for kind, known in (("device", HAND_DEVICES), ("grip", GRIP_NAMES), ("compensator", COMPENSATOR_HINTS)):
            name = getattr(self, kind)
            if name not in tuple(known):  # in a tuple, since a page may send an unhashable value
                raise HapsceneError(no_such(kind, name, known))

    @property
    def limits(self) -> str:
        """Name in `DEVICES` of the device whose limits apply."""
        return HAND_DEVICES[self.device].limits

    def __str__(self) -> str:
        handle = "no handle" if self.compensator == NO_HANDLE else f"{self.compensator} handle"
        return f"{self.device}, {self.grip} grip, {handle}"

    def reaches(self, from_W_m: Vector, p_W_m: Vector) -> bool:
        """Whether the tool, which started at `from_W_m` (3,), can reach `p_W_m` (3,) [m]; always for a point mass."""
        if not isinstance(HAND_DEVICES[self.device].model, Omni):
            return True
        X_WD = stand(from_W_m)  # the pose that the servo gives the device
        return bool(reachable(X_WD[:3, :3].T @ (p_W_m - X_WD[:3, 3])))


def make_servo(scene: Scene, config: HandConfig, progress: Callable[[str], None], servo: type[Servo] = Servo) -> Servo:
    """A servo with a simulated hand; the device is placed for each touch so that it starts mid-workspace."""
    model, limits = HAND_DEVICES[config.device].model, limits_of(config.limits, TICK_S)
    make = partial(servo, scene, model, limits=limits, tip_radius_m=config.tip_radius_m, progress=progress)
    return make() if config.compensator == NO_HANDLE else make(handle=Plant(), compensator=config.compensator)


HOVER_M: Final = 0.002
"""Height above the surface at which a touch starts [m]: from higher up, the hand would land with too much force."""

LIFT_M: Final = 0.006
"""Target height above the surface after a touch [m]: enough for a light grip to overcome the friction of the Omni."""

IDLE_S: Final = 1.5
"""Time for which the servo runs on after a touch [s], so that vibrations decay and are shown."""

REACTION_S: Final = 0.15
"""Delay of the force control after contact begins or ends [s]: the reaction time of touch."""

NOTICED_SHARE: Final = 0.05
"""Relative error of the force that is not corrected [1]: below the JND (7 %, Pang, Tan & Durlach 1991)."""

ADDED_N: Final = 0.5
"""Limit of the force correction in the air and for smaller forces [N]: above the friction of the Omni, 0.26 N. On the
surface, the correction is at most the force itself."""

CORRECTION_1_S: Final = 8.0
"""Rate at which a force error is corrected [1/s]: mostly within 0.2 s, which is slow against the 17 ms of the hand."""

ARM_ENDS: Final = (
    "End of the Omni's workspace, which extends 80 mm along x, 35 mm along y and 60 mm along z from where you pressed. "
    "Release and press again to continue here, or choose omni-point in the tab Haptics for an unlimited workspace."
)


class Contact(NamedTuple):
    """Target of a touch: position of the tool, outward normal, force, and stiffness of the surface."""

    p_W_m: Vector
    nhat_W: Vector
    force_N: float
    stiffness_N_m: float


class TouchHand:
    """A simulated hand that touches the scene through a servo in a separate process.

    Calls that wait for the servo run in one thread, in order; pending updates are merged. The methods must be called in
    the event loop of the server.

    Args:
        say: shows a message to the user; the second argument is "error" or "".
        config: initial configuration.
        servo: makes the servo for a scene and a configuration.

    Attributes:
        status: "starting", "ready", "failed" or "closed".
        problem: why the hand failed; else "".
        stage: what the start of the hand does at present.
        touching: whether the pointer button is held.
        config: configuration. A change of the grip takes effect at once, other changes with the next `open`.
    """

    def __init__(
        self,
        say: Callable[[str, str], None],
        config: HandConfig,
        servo: Callable[[Scene, HandConfig, Callable[[str], None]], Servo] = make_servo,
    ) -> None:
        self._say = say
        self._make = servo
        self._executor = ThreadPoolExecutor(1, "hapscene hand")
        self._servo: Servo | None = None
        self._servo_made: Servo | None = None
        self.status, self.problem, self.stage = "closed", "", "preparing"
        self.touching = False
        self.config = config
        self._contact: Contact | None = None  # target; used once the servo has started
        self._from_W_m = np.zeros(3)  # start of the touch
        self._limit_reported = False
        self._deeper_m = 0.0  # additional depth from the force control
        self._on_surface, self._surface_tick = False, 0  # whether in contact, and the tick of the last change
        self._starting = False
        self._since = 0
        self._last_s = -np.inf
        self._running = False
        self._parameters: dict[str, dict[str, float]] = {}  # pending, by swatch
        self._scene: Scene | None = None
        self._sending = False
        self._servo_bodies: dict[str, Body] = {}  # bodies as the servo knows them
        self._wanted: tuple[Scene, HandConfig] | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, scene: Scene) -> None:
        """Start the servo, replacing a running one, and show failures. Of several calls, the last counts."""
        self.status, self.problem, self.stage = "starting", "", "preparing"
        self._servo, self._running, self.touching = None, False, False
        opening = self._wanted is not None
        self._wanted = (scene, self.config)
        while not opening and self._wanted is not None:
            wanted = self._wanted
            try:
                servo = await self._in_thread(partial(self._start, *wanted))
                self.status, self._since = "ready", 0
            except (HapsceneError, OSError) as error:
                servo = None
                self._fail(f"The simulated hand failed to start: {error}")
            if self._wanted is wanted:
                self._wanted, self._servo = None, servo
                self._send()  # changes since the call

    def _start(self, scene: Scene, config: HandConfig) -> Servo:
        if self._servo_made is not None:
            self._servo_made.close()
        self._servo_made = self._make(scene, config, self._note_stage)  # stored at once, so that `close` can end it
        self._servo_bodies = {body.name: body for body in scene.bodies}
        if self.status == "closed":
            raise HapsceneError("the page is closed")
        return self._servo_made.__enter__()

    def _note_stage(self, text: str) -> None:
        """Store a stage of the start, or the time that it has taken so far. Called in the thread."""
        text = text.removesuffix(" … ")
        self.stage = f"{self.stage.partition(' (')[0]} ({text})" if text[0].isdigit() else text

    def close(self) -> None:
        """Stop the servo. May be called from any thread, after the last call of other methods."""
        starting, self.status = self.status == "starting", "closed"
        if starting and self._servo_made is not None:
            self._servo_made.cancel()
        self._executor.shutdown(wait=True, cancel_futures=True)
        if self._servo_made is not None:
            self._servo_made.close()
        self._servo = self._servo_made = None

    @property
    def servo(self) -> Servo | None:
        """The servo; None until it is ready."""
        return self._servo

    # --- the hand ---

    def press(self, p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float) -> bool:
        """Start a touch at a point of the surface; returns whether the hand is available."""
        if self._servo is None or not self._alive():
            return False
        self.touching, self._limit_reported, self._deeper_m = True, False, 0.0
        if not self._starting:
            self._starting, self._from_W_m = True, p_W_m + (self.config.tip_radius_m + HOVER_M) * nhat_W
            self._start_task(self._come_down(self._servo, self._from_W_m))
        self.move(p_W_m, nhat_W, force_N, stiffness_N_m)
        return True

    async def _come_down(self, servo: Servo, p_W_m: Vector) -> None:
        try:
            await self._in_thread(partial(servo.start, p_W_m, self.config.grip))
        finally:
            self._starting = False
        if servo is self._servo:
            self._running, self._since = True, int(servo.state().tick) + 1
            self._on_surface, self._surface_tick = False, self._since
            self._aim()

    def move(self, p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float) -> None:
        """Move the touch to a point of the surface; shows a message if it is outside the workspace."""
        if not self.touching:
            return
        center_W_m = p_W_m + self.config.tip_radius_m * nhat_W
        if self.config.reaches(self._from_W_m, center_W_m):
            self._contact = Contact(center_W_m, nhat_W, force_N, stiffness_N_m)
            self._aim()
        elif not self._limit_reported:
            self._limit_reported = True
            self._say(ARM_ENDS, "error")

    def _aim(self) -> None:
        if self.touching and self._contact is not None and self._servo is not None and not self._starting:
            aim = aim_point(*self._contact, self.config.grip) - self._deeper_m * self._contact.nhat_W
            self._call(partial(self._servo.aim, aim, self.config.grip))

    def lift(self, now_s: float) -> None:
        """End the touch and lift the tool off the surface."""
        if not self.touching:
            return
        self.touching, self._last_s = False, now_s
        if self._servo is not None and not self._starting and self._running:
            self._call(partial(self._lift_off, self._servo))

    def _lift_off(self, servo: Servo) -> None:
        state = servo.state()
        servo.aim(state.p_WP_m + LIFT_M * state.nhat_W, self.config.grip)

    def read(self, now_s: float) -> tuple[ServoState, Vector, Vector] | None:
        """State of the last tick, and force (n,) [N] and acceleration (n, block) [m/s²] since the last call.

        The acceleration is that of the handle, or the commanded one without a handle. Returns None while the hand is
        idle.
        """
        if self._servo is None or not self._running or not self._alive():
            return None
        try:
            log, state = self._servo.read(self._since), self._servo.state()
        except HapsceneError:
            if self._alive():
                raise
            return None
        self._since = log.first + len(log.rows)
        if state.touching != self._on_surface:
            self._on_surface, self._surface_tick = state.touching, state.tick
            if not state.touching and self._deeper_m < 0.0:  # after a bounce, the tool could stay off the surface
                self._deeper_m = 0.0
                self._aim()
        reacted = state.tick - self._surface_tick > REACTION_S / TICK_S
        if self.touching and not self._starting and reacted and len(log.rows):
            normal_N = float((log.rows["f_W_N"] * log.rows["nhat_W"]).sum(axis=1).mean())
            self._correct_force(normal_N, len(log.rows) * TICK_S)
        if not self.touching and not self._starting and now_s - self._last_s > IDLE_S:
            self._running = False
            self._start_task(self._in_thread(self._servo.pause))
        return state, np.linalg.norm(log.rows["f_W_N"], axis=1), log.a_handle_m_s2

    def _correct_force(self, normal_N: float, over_s: float) -> None:
        """Adjust the target depth so that the normal force reaches its target despite friction and compliance.

        In the air the force is 0, so that a light press increases until it overcomes the friction of the device.
        """
        assert self._contact is not None
        force_N = self._contact.force_N
        missing_N = force_N - normal_N
        if abs(missing_N) > NOTICED_SHARE * force_N:
            compliance = compliance_m_N(self._contact.stiffness_N_m, self.config.grip)
            deeper_m = self._deeper_m + min(CORRECTION_1_S * over_s, 0.5) * missing_N * compliance
            most_N = max(force_N, ADDED_N) if self._on_surface else ADDED_N
            self._deeper_m = min(max(deeper_m, -force_N * compliance), most_N * compliance)
            self._aim()

    # --- updates of the scene ---

    def tune(self, swatch: str, numbers: Mapping[str, float]) -> None:
        """Change parameters of a swatch in the servo."""
        self._parameters.setdefault(swatch, {}).update(numbers)
        self._send()

    def repaint(self, scene: Scene) -> None:
        """Update painting, bodies, poses and swatches in the servo from a scene."""
        self._scene = scene
        self._parameters.clear()
        self._send()

    def _send(self) -> None:
        if self._servo is not None and not self._sending:
            self._sending = True
            self._start_task(self._send_all())

    async def _send_all(self) -> None:
        """Send pending updates, the scene first; errors of the servo are shown and do not stop later updates."""
        try:
            while self._servo is not None and (self._scene is not None or self._parameters):
                servo, scene, self._scene = self._servo, self._scene, None
                if scene is not None:
                    update = partial(self._update_scene, servo, scene)
                else:
                    swatch = next(iter(self._parameters))
                    update = partial(servo.tune, swatch, **self._parameters.pop(swatch))
                try:
                    await self._in_thread(update)
                except HapsceneError as error:
                    if scene is not None and any(body.name not in self._servo_bodies for body in scene.bodies):
                        await self.open(scene)  # too large to be added to the running servo
                    else:
                        self._report(error)
        finally:
            self._sending = False

    def _update_scene(self, servo: Servo, scene: Scene) -> None:
        """Remove, add and move bodies of the servo, then update the painting. Called in the thread.

        A body whose mesh was scaled is removed and added again.
        """
        bodies = {body.name: body for body in scene.bodies}
        for name, known in list(self._servo_bodies.items()):
            if name not in bodies or bodies[name].mesh is not known.mesh:
                servo.remove(name)
                del self._servo_bodies[name]
        for name, body in bodies.items():
            if name not in self._servo_bodies:
                servo.add(body.mesh, name, pose=body.X_WB, two_sided=body.two_sided)
            elif not np.array_equal(self._servo_bodies[name].X_WB, body.X_WB):
                servo.move(name, body.X_WB, teleport=True)
            self._servo_bodies[name] = body
        servo.repaint(scene)

    def _start_task(self, work: Awaitable[object]) -> None:
        """Start work without waiting for it; errors are shown to the user."""

        async def run() -> None:
            try:
                await work
            except HapsceneError as error:
                self._report(error)

        task = asyncio.get_running_loop().create_task(run())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _report(self, error: HapsceneError) -> None:
        if self.status == "ready":
            self._say(f"Simulated hand: {error}", "error")

    def _alive(self) -> bool:
        if self._servo is not None and self._servo.alive:
            return True
        if self.status == "ready":
            self._fail("The process of the simulated hand has ended. To restart it, choose another device.")
        return False

    def _fail(self, problem: str) -> None:
        self.status, self.problem, self._running, self.touching = "failed", problem, False, False
        self._say(problem, "error")

    def _call(self, order: Callable[[], object]) -> None:
        """Call the servo, unless its process has ended, which is reported once."""
        if self._alive():
            try:
                order()
            except HapsceneError:
                if self._alive():
                    raise

    async def _in_thread(self, work: Callable[[], Result]) -> Result:
        return await asyncio.get_running_loop().run_in_executor(self._executor, work)


def aim_point(p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float, grip: str) -> Vector:
    """Target position of the hand (3,) at which a wall at `p_W_m` reacts with `force_N` [m].

    The depth follows from the springs of grip and wall in series.
    """
    return np.asarray(p_W_m - force_N * compliance_m_N(stiffness_N_m, grip) * nhat_W)


def compliance_m_N(stiffness_N_m: float, grip: str) -> float:
    """Compliance of grip and wall in series [m/N]."""
    return 1.0 / GRIPS[grip].k_N_m + 1.0 / max(stiffness_N_m, 1.0)
