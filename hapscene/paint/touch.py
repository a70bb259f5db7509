"""The hand behind the page: a servo, ordered from the browser's events, and how it is read.

Only what `hapscene.servo.Servo` offers is used, so that another process, with a real device, can stand behind it.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.hand import GRIPS
from hapscene.device.model import DEVICES, device_named, limits_of
from hapscene.errors import HapsceneError
from hapscene.scene.scene import Scene
from hapscene.servo import Servo, State

HOVER_M: Final = 0.006
"""How far over the surface the hand waits before and after a touch [m]: clear of it, and there within 0.1 s."""

IDLE_S: Final = 1.5
"""How long after a touch the ticks go on [s], so that what rings dies away and is seen to."""

HELD_DEVICES: Final = tuple(name for name, device in DEVICES.items() if device.point is not None)
"""Devices that a simulated hand can hold."""

Vector = NDArray[np.float64]


class Touch:
    """A simulated hand with a device, in a process of its own.

    Orders that wait for an answer go through a thread, one after the other; those of a kind that wait while one is
    under way become one. Methods are called in the server's event loop.

    Args:
        say: shows a line to the user, with its kind.
        servo: makes the servo of a scene and a device; another one for another kind of hand.

    Attributes:
        status: "starting", "ready", "failed" or "closed".
        touching: whether the button is held.
    """

    def __init__(
        self, say: Callable[[str, str], None], servo: Callable[[Scene, str, float], Any] | None = None
    ) -> None:
        self._say = say
        self._make = servo or make_servo
        self._lane = ThreadPoolExecutor(1, "hapscene hand")
        self._servo: Any = None
        self._opened: Any = None
        self.status = "closed"
        self.touching = False
        self.grip = "medium"
        self._aim: Vector | None = None  # waits until the start is through
        self._starting = False
        self._since = 0
        self._last_s = -np.inf
        self._running = False
        self._numbers: dict[str, dict[str, float]] = {}
        self._scene: Scene | None = None
        self._sending = False
        self._wanted: tuple[Scene, str, float] | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, scene: Scene, device: str, tick_s: float) -> None:
        """Start the process, in place of one that is there; says so if it cannot. The last of several orders counts."""
        self.status = "starting"
        self._servo, self._running, self.touching = None, False, False
        opening = self._wanted is not None
        self._wanted = (scene, device, tick_s)
        while not opening and self._wanted is not None:
            wanted = self._wanted
            try:
                servo = await self._in_lane(partial(self._start, *wanted))
                self.status, self._since = "ready", 0
            except HapsceneError as error:
                servo, self.status = None, "failed"
                self._say(f"The hand cannot touch: {error}", "error")
            if self._wanted is wanted:
                self._wanted, self._servo = None, servo
                self._send()  # what changed meanwhile

    def _start(self, scene: Scene, device: str, tick_s: float) -> Any:
        if self._opened is not None:
            self._opened.close()
        self._opened = self._make(scene, device, tick_s)  # known to `close`, whoever still waits for it
        return self._opened.__enter__()

    def close(self) -> None:
        """End the process. Called from any thread, once nothing else calls."""
        self.status = "closed"
        self._lane.shutdown(wait=True, cancel_futures=True)
        if self._opened is not None:
            self._opened.close()
        self._servo = self._opened = None

    @property
    def tick_s(self) -> float:
        return float(self._servo.tick_s)

    # --- the hand ---

    def press(self, p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float) -> bool:
        """Come down on a place of the surface, as soon as the hand is there; whether there is one."""
        if self._servo is None or not self._alive():
            return False
        self.touching = True
        self._aim = aim_of(p_W_m, nhat_W, force_N, stiffness_N_m, self.grip)
        if not self._starting:
            self._starting = True
            self._do(self._come(self._servo, p_W_m + HOVER_M * nhat_W))
        return True

    async def _come(self, servo: Any, p_W_m: Vector) -> None:
        try:
            await self._in_lane(partial(servo.start, p_W_m, self.grip))
            self._running, self._since = True, max(int(servo.state().tick) + 1, 0)
            if self.touching and self._aim is not None:
                servo.aim(self._aim, self.grip)
        finally:
            self._starting = False

    def move(self, p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float) -> None:
        """Stroke on to a place of the surface."""
        self._aim = aim_of(p_W_m, nhat_W, force_N, stiffness_N_m, self.grip)
        if self.touching and self._servo is not None and not self._starting:
            self._servo.aim(self._aim, self.grip)

    def lift(self, now_s: float) -> None:
        """Off the surface."""
        if not self.touching:
            return
        self.touching, self._last_s = False, now_s
        if self._servo is not None and not self._starting and self._running:
            state = self._servo.state()
            self._servo.aim(state.p_WP_m + HOVER_M * state.nhat_W, self.grip)

    def read(self, now_s: float) -> tuple[State, NDArray[Any], NDArray[Any]] | None:
        """The newest tick, force (n,) [N] and acceleration (n, block) [m/s²] since the last look; None at rest."""
        if self._servo is None or not self._running or not self._alive():
            return None
        felt = self._servo.read(self._since)
        self._since = felt.first + len(felt.rows)
        state = self._servo.state()
        if not self.touching and not self._starting and now_s - self._last_s > IDLE_S:
            self._running = False
            self._do(self._in_lane(self._servo.rest))
        return state, np.linalg.norm(felt.rows["f_W_N"], axis=1), felt.a_m_s2

    # --- what is felt ---

    def tune(self, swatch: str, numbers: Mapping[str, float]) -> None:
        """Have numbers of a swatch changed, at once."""
        self._numbers.setdefault(swatch, {}).update(numbers)
        self._send()

    def repaint(self, scene: Scene) -> None:
        """Have another painting felt; with it all numbers are as the scene has them."""
        self._scene = scene
        self._numbers.clear()
        self._send()

    def _send(self) -> None:
        if self._servo is not None and not self._sending:
            self._sending = True
            self._do(self._send_all())

    async def _send_all(self) -> None:
        try:
            while self._servo is not None and (self._scene is not None or self._numbers):
                servo, scene, self._scene = self._servo, self._scene, None
                if scene is not None:
                    await self._in_lane(partial(servo.repaint, scene))
                    continue
                swatch = next(iter(self._numbers))
                numbers = self._numbers.pop(swatch)
                await self._in_lane(partial(servo.tune, swatch, **numbers))
        finally:
            self._sending = False

    def _do(self, order: Awaitable[Any]) -> None:
        """Have an order done without waiting for it; the user is told what it refuses."""

        async def told() -> None:
            try:
                await order
            except HapsceneError as error:
                if self.status == "ready":
                    self._say(f"The hand: {error}", "error")

        task = asyncio.get_running_loop().create_task(told())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _alive(self) -> bool:
        if self._servo.alive:
            return True
        if self.status == "ready":
            self.status, self._running, self.touching = "failed", False, False
            self._say("The hand's process has ended; choose the device again to start another.", "error")
        return False

    async def _in_lane(self, work: Callable[[], Any]) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._lane, work)


def make_servo(scene: Scene, device: str, tick_s: float) -> Servo:
    """A servo with a hand that holds a device of `HELD_DEVICES`, anywhere in the scene."""
    return Servo(scene, device_named(device).point, tick_s=tick_s, limits=limits_of(device, tick_s))


def aim_of(p_W_m: Vector, nhat_W: Vector, force_N: float, stiffness_N_m: float, grip: str) -> Vector:
    """Where the hand must mean the tool to be for a wall at `p_W_m` to push back with `force_N`.

    The grip's spring and the wall's are in line: the depth that both together give the force at.
    """
    return np.asarray(p_W_m - force_N * (1.0 / GRIPS[grip].k_N_m + 1.0 / max(stiffness_N_m, 1.0)) * nhat_W)
