"""The simulated hand behind the page: its device, grip and handle, and the servo that renders its touch."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import DEFAULT_GRIP
from hapscene.device.model import DEVICES, limits_of
from hapscene.device.sim.hand import GRIPS
from hapscene.device.sim.omni import Omni, stand
from hapscene.device.sim.omni_kinematics import reachable
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError, no_such
from hapscene.handle import Plant
from hapscene.loop import Servo, ServoState
from hapscene.loop.servo_state import TickLog
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


class HandDevice(NamedTuple):
    """A device that the hand can hold: whose limits it has, a name of `DEVICES`; and how it moves."""

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
"""By name: the whole Omni, as `hapscene touch` has it, and every device as a mass with friction and encoders."""

GRIP_NAMES: Final = tuple(name for name in GRIPS if name != "none")

NO_HANDLE: Final = "no-handle"

COMPENSATOR_HINTS: Final[Mapping[str, str]] = {
    "adaptive": "what the handle gives whose drive learns from its own accelerometer",
    "flat": "what the handle gives, driven by the inverse of its model: even from 20 Hz on",
    "inverse": "what the handle gives, driven by the inverse of its model: weaker the slower it shakes",
    "naive": "what the handle gives, driven by its mass times what is asked for: its spring and the grip are forgotten",
    NO_HANDLE: "what the swatches ask for, as if a perfect handle gave it",
}
"""What is heard and plotted, by compensator. `none` of `hapscene touch` is left out: the handle would stay silent."""


@dataclass(frozen=True)
class HandConfig:
    """What the hand holds.

    Attributes:
        device: a name of `HAND_DEVICES`.
        grip: how firmly, one of `GRIP_NAMES`.
        compensator: what drives the handle, a name of `COMPENSATOR_HINTS`.

    Raises:
        HapsceneError: no such name.
    """

    device: str = "omni"
    grip: str = DEFAULT_GRIP
    compensator: str = "adaptive"

    def __post_init__(self) -> None:
        if self.device == "ideal":
            raise HapsceneError(f"an ideal device has no mass to move; choose one of {', '.join(HAND_DEVICES)}")
        for kind, known in (("device", HAND_DEVICES), ("grip", GRIP_NAMES), ("compensator", COMPENSATOR_HINTS)):
            name = getattr(self, kind)
            if name not in tuple(known):  # a page may send anything
                raise HapsceneError(no_such(kind, name, known))

    @property
    def limits(self) -> str:
        """Whose limits apply, a name of `DEVICES`."""
        return HAND_DEVICES[self.device].limits

    def __str__(self) -> str:
        handle = "no handle" if self.compensator == NO_HANDLE else f"{self.compensator} handle"
        return f"{self.device}, {self.grip} grip, {handle}"

    def reaches(self, from_W_m: Any, p_W_m: Any) -> bool:
        """Whether an arm whose tool began at `from_W_m` (3,) gets it to `p_W_m` (3,) [m]; a point mass always does."""
        if not isinstance(HAND_DEVICES[self.device].model, Omni):
            return True
        X_WD = stand(from_W_m)  # as the servo's twin places it
        return bool(reachable(X_WD[:3, :3].T @ (p_W_m - X_WD[:3, 3])))


def make_servo(scene: Scene, config: HandConfig, tick_s: float, servo: type[Servo] = Servo) -> Servo:
    """A servo with a hand that holds this; an arm is placed anew for each touch, so that it begins in the middle."""
    handle: dict[str, Any] = {}
    if config.compensator != NO_HANDLE:
        handle = {"handle": Plant(), "compensator": config.compensator}
    model = HAND_DEVICES[config.device].model
    return servo(scene, model, tick_s=tick_s, limits=limits_of(config.limits, tick_s), **handle)


HOVER_M: Final = 0.002
"""How far over the surface the hand waits before a touch [m]: from higher up it lands with more than it means to."""

LIFT_M: Final = 0.006
"""How far it means to go off the surface after a touch [m]: even a light grip takes the Omni off against its friction.
"""

IDLE_S: Final = 1.5
"""How long after a touch the ticks go on [s], so that what rings dies away and is seen to."""

REACTION_S: Final = 0.15
"""How long after it meets or leaves the surface the hand begins to mind its force [s]: what touch takes to react."""

NOTICED_SHARE: Final = 0.05
"""Error of force that the hand leaves as it is [1]: no more than is noticed (7 %, Pang, Tan & Durlach 1991)."""

ADDED_N: Final = 0.5
"""Most that the hand adds in the air, and to a lighter force than this [N]: what the Omni's friction, 0.26 N, takes,
and some more. On the surface it adds no more than the force itself."""

CORRECTION_1_S: Final = 8.0
"""How fast an error of force is made up for [1/s]: most of it in 0.2 s, slowly against the hand's own 17 ms."""

ARM_ENDS: Final = (
    "The Omni's arm ends here: from where you pressed it reaches 80 mm along x, 35 mm along y, 60 mm along z. "
    "Press anew to go on from here; or choose omni-point in the tab Feel, which reaches everywhere."
)

Vector = NDArray[np.float64]


class Contact(NamedTuple):
    """Where the hand means to touch, the outward normal there, how hard, and how stiff it is."""

    p_W_m: Vector
    nhat_W: Vector
    force_N: float
    stiffness_N_m: float


class TouchHand:
    """A simulated hand with what it holds, in a process of its own.

    Orders that wait for an answer go through a thread, one after the other; those of a kind that wait while one is
    under way become one. Methods are called in the server's event loop.

    Args:
        say: shows a line to the user, with its kind.
        config: what it holds at first.
        servo: makes the servo of a scene and what is held; another one for another kind of hand.

    Attributes:
        status: "starting", "ready", "failed" or "closed".
        problem: why it failed, in a sentence; else nothing.
        touching: whether the button is held.
        on_felt: is given what was felt, whenever some was.
        config: what it holds: another grip at once, all else from the next `open` on.
    """

    def __init__(
        self,
        say: Callable[[str, str], None],
        config: HandConfig,
        servo: Callable[[Scene, HandConfig, float], Any] = make_servo,
    ) -> None:
        self._say = say
        self._make = servo
        self._executor = ThreadPoolExecutor(1, "hapscene hand")
        self._servo: Any = None
        self._servo_made: Any = None
        self.status, self.problem = "closed", ""
        self.touching = False
        self.on_felt: Callable[[TickLog], None] = lambda felt: None
        self.config = config
        self._contact: Contact | None = None  # waits until the start is through
        self._from_W_m = np.zeros(3)  # where the touch began
        self._end_said = False
        self._deeper_m = 0.0
        self._on_surface, self._surface_tick = False, 0  # whether it is on the surface, and from which tick on
        self._starting = False
        self._since = 0
        self._last_s = -np.inf
        self._running = False
        self._numbers: dict[str, dict[str, float]] = {}
        self._scene: Scene | None = None
        self._sending = False
        self._felt: dict[str, Body] = {}  # as the servo has them
        self._wanted: tuple[Scene, HandConfig, float] | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, scene: Scene, tick_s: float) -> None:
        """Start the process, in place of one that is there; says so if it cannot. The last of several orders counts."""
        self.status, self.problem = "starting", ""
        self._servo, self._running, self.touching = None, False, False
        opening = self._wanted is not None
        self._wanted = (scene, self.config, tick_s)
        while not opening and self._wanted is not None:
            wanted = self._wanted
            try:
                servo = await self._in_thread(partial(self._start, *wanted))
                self.status, self._since = "ready", 0
            except (HapsceneError, OSError) as error:
                servo = None
                self._fail(f"The hand cannot touch: {error}")
            if self._wanted is wanted:
                self._wanted, self._servo = None, servo
                self._send()  # what changed meanwhile

    def _start(self, scene: Scene, config: HandConfig, tick_s: float) -> Any:
        if self._servo_made is not None:
            self._servo_made.close()
        self._servo_made = self._make(scene, config, tick_s)  # known to `close`, whoever still waits for it
        self._felt = {body.name: body for body in scene.bodies}
        if self.status == "closed":
            raise HapsceneError("the page is closed")
        return self._servo_made.__enter__()

    def close(self) -> None:
        """End the process. Called from any thread, once nothing else calls."""
        starting, self.status = self.status == "starting", "closed"
        if starting and self._servo_made is not None:
            self._servo_made.cancel()
        self._executor.shutdown(wait=True, cancel_futures=True)
        if self._servo_made is not None:
            self._servo_made.close()
        self._servo = self._servo_made = None

    @property
    def servo(self) -> Any:
        """The servo of the hand; None until it is ready."""
        return self._servo

    @property
    def tick_s(self) -> float:
        return float(self._servo.tick_s)

    # --- the hand ---

    def press(self, p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float) -> bool:
        """Come down on a place of the surface, as soon as the hand is there; whether there is one."""
        if self._servo is None or not self._alive():
            return False
        self.touching, self._end_said, self._deeper_m = True, False, 0.0
        if not self._starting:
            self._starting, self._from_W_m = True, p_W_m + HOVER_M * nhat_W
            self._start_task(self._come_down(self._servo, self._from_W_m))
        self.move(p_W_m, nhat_W, force_N, stiffness_N_m)
        return True

    async def _come_down(self, servo: Any, p_W_m: Vector) -> None:
        try:
            await self._in_thread(partial(servo.start, p_W_m, self.config.grip))
        finally:
            self._starting = False
        if servo is self._servo:
            self._running, self._since = True, int(servo.state().tick) + 1
            self._on_surface, self._surface_tick = False, self._since
            self._aim()

    def move(self, p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float) -> None:
        """Stroke on to a place of the surface; says so where the arm does not reach it."""
        if not self.touching:
            return
        if self.config.reaches(self._from_W_m, p_W_m):
            self._contact = Contact(p_W_m, nhat_W, force_N, stiffness_N_m)
            self._aim()
        elif not self._end_said:
            self._end_said = True
            self._say(ARM_ENDS, "error")

    def _aim(self) -> None:
        if self.touching and self._contact is not None and self._servo is not None and not self._starting:
            aim = aim_point(*self._contact, self.config.grip) - self._deeper_m * self._contact.nhat_W
            self._order(partial(self._servo.aim, aim, self.config.grip))

    def lift(self, now_s: float) -> None:
        """Off the surface."""
        if not self.touching:
            return
        self.touching, self._last_s = False, now_s
        if self._servo is not None and not self._starting and self._running:
            self._order(partial(self._go_off, self._servo))

    def _go_off(self, servo: Any) -> None:
        state = servo.state()
        servo.aim(state.p_WP_m + LIFT_M * state.nhat_W, self.config.grip)

    def read(self, now_s: float) -> tuple[ServoState, NDArray[Any], NDArray[Any]] | None:
        """The newest tick, force (n,) [N] and acceleration (n, block) [m/s²] since the last look; None at rest.

        The acceleration is the handle's, or that asked for where there is no handle.
        """
        if self._servo is None or not self._running or not self._alive():
            return None
        try:
            felt, state = self._servo.read(self._since), self._servo.state()
        except HapsceneError:
            if self._alive():
                raise
            return None
        self._since = felt.first + len(felt.rows)
        self.on_felt(felt)
        if state.touching != self._on_surface:
            self._on_surface, self._surface_tick = state.touching, state.tick
            if not state.touching and self._deeper_m < 0.0:  # it bounced: so it might stay off the surface
                self._deeper_m = 0.0
                self._aim()
        long_so = state.tick - self._surface_tick > REACTION_S / self.tick_s
        if self.touching and not self._starting and long_so and len(felt.rows):
            felt_N = float((felt.rows["f_W_N"] * felt.rows["nhat_W"]).sum(axis=1).mean())
            self._correct_force(felt_N, len(felt.rows) * self.tick_s)
        if not self.touching and not self._starting and now_s - self._last_s > IDLE_S:
            self._running = False
            self._start_task(self._in_thread(self._servo.pause))
        return state, np.linalg.norm(felt.rows["f_W_N"], axis=1), felt.a_handle_m_s2

    def _correct_force(self, felt_N: float, over_s: float) -> None:
        """Press deeper, or less deep, than the springs ask for: friction and an arm that bends take their part.

        In the air nothing is felt: a light press goes on until it is through the arm's friction.
        """
        assert self._contact is not None
        force_N = self._contact.force_N
        missing_N = force_N - felt_N
        if abs(missing_N) > NOTICED_SHARE * force_N:
            compliance = compliance_m_N(self._contact.stiffness_N_m, self.config.grip)
            deeper_m = self._deeper_m + min(CORRECTION_1_S * over_s, 0.5) * missing_N * compliance
            most_N = max(force_N, ADDED_N) if self._on_surface else ADDED_N
            self._deeper_m = min(max(deeper_m, -force_N * compliance), most_N * compliance)
            self._aim()

    # --- what is felt ---

    def tune(self, swatch: str, numbers: Mapping[str, float]) -> None:
        """Have numbers of a swatch changed, at once."""
        self._numbers.setdefault(swatch, {}).update(numbers)
        self._send()

    def repaint(self, scene: Scene) -> None:
        """Have another painting felt, and other bodies, or elsewhere; with it all numbers are as the scene has them."""
        self._scene = scene
        self._numbers.clear()
        self._send()

    def _send(self) -> None:
        if self._servo is not None and not self._sending:
            self._sending = True
            self._start_task(self._send_all())

    async def _send_all(self) -> None:
        """Send what waits, the painting first; what the servo refuses is told, and holds up nothing."""
        try:
            while self._servo is not None and (self._scene is not None or self._numbers):
                servo, scene, self._scene = self._servo, self._scene, None
                if scene is not None:
                    order = partial(self._take_scene, servo, scene)
                else:
                    swatch = next(iter(self._numbers))
                    order = partial(servo.tune, swatch, **self._numbers.pop(swatch))
                try:
                    await self._in_thread(order)
                except HapsceneError as error:
                    if scene is not None and any(body.name not in self._felt for body in scene.bodies):
                        await self.open(scene, servo.tick_s)  # far larger than what was there: with it from the start
                    else:
                        self._refused(error)
        finally:
            self._sending = False

    def _take_scene(self, servo: Any, scene: Scene) -> None:
        """Have the servo feel a scene: bodies that are gone, new or elsewhere, then the painting. Called in the thread.

        A mesh of another size is another body to it.
        """
        bodies = {body.name: body for body in scene.bodies}
        for name, known in list(self._felt.items()):
            if name not in bodies or bodies[name].mesh is not known.mesh:
                servo.remove(name)
                del self._felt[name]
        for name, body in bodies.items():
            if name not in self._felt:
                servo.add(body.mesh, name, pose=body.X_WB, two_sided=body.two_sided)
            elif not np.array_equal(self._felt[name].X_WB, body.X_WB):
                servo.move(name, body.X_WB, teleport=True)
            self._felt[name] = body
        servo.repaint(scene)

    def _start_task(self, order: Awaitable[Any]) -> None:
        """Have an order done without waiting for it; the user is told what it refuses."""

        async def told() -> None:
            try:
                await order
            except HapsceneError as error:
                self._refused(error)

        task = asyncio.get_running_loop().create_task(told())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _refused(self, error: HapsceneError) -> None:
        if self.status == "ready":
            self._say(f"The hand: {error}", "error")

    def _alive(self) -> bool:
        if self._servo.alive:
            return True
        if self.status == "ready":
            self._fail("The hand's process has ended; to start a new one choose another device, then this one.")
        return False

    def _fail(self, problem: str) -> None:
        self.status, self.problem, self._running, self.touching = "failed", problem, False, False
        self._say(problem, "error")

    def _order(self, order: Callable[[], Any]) -> None:
        """Have the hand do something; nothing where its process has ended, which is told once."""
        if self._alive():
            try:
                order()
            except HapsceneError:
                if self._alive():
                    raise

    async def _in_thread(self, work: Callable[[], Any]) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._executor, work)


def aim_point(p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float, grip: str) -> Vector:
    """Where the hand must mean the tool to be for a wall at `p_W_m` to push back with `force_N`.

    The depth that the springs of grip and wall, in line, give the force at.
    """
    return np.asarray(p_W_m - force_N * compliance_m_N(stiffness_N_m, grip) * nhat_W)


def compliance_m_N(stiffness_N_m: float, grip: str) -> float:
    """How far grip and wall give together [m/N]."""
    return 1.0 / GRIPS[grip].k_N_m + 1.0 / max(stiffness_N_m, 1.0)
