"""A servo whose loop runs in the test process on a virtual clock and ticks only when the test calls `advance`."""

from collections import deque
from collections.abc import Callable
from multiprocessing.reduction import ForkingPickler
from threading import Lock
from typing import Any

import numpy as np

from hapscene.device.driver import Connection, new_state
from hapscene.errors import HapsceneError
from hapscene.loop import Servo
from hapscene.loop.servo_process import OrderHandler, open_twins
from hapscene.loop.session_log import settings_of
from hapscene.loop.shared_memory import Channel
from tests.virtual_clock import VirtualClock

TICKS_MAX = 20_000
"""Most ticks that `until` runs [count]."""


class VirtualServo(Servo):
    """A `Servo` without processes. `advance` increments the heartbeat of the application."""

    def __init__(self, *arguments: Any, clock: VirtualClock | None = None, **made: Any) -> None:
        super().__init__(*arguments, **made)
        self.clock = clock or VirtualClock()
        self._now_ns = self.clock.now_ns
        self.alone = False  # the application's heartbeat has stopped

    def _begin(self, shared: Channel) -> None:
        try:
            self._process = self._wire = _LocalProcess(self._arguments, shared, self.clock)
        except HapsceneError:
            self._process = None
            raise
        self._renderer_arguments = self._wire.handler.made
        self._asked = np.zeros(1, np.int64)
        self._heartbeat_count = shared.channel["heartbeat"].view(np.ndarray)

    @property
    def handler(self) -> OrderHandler:
        """Handler of the orders that the application sends."""
        handler: OrderHandler = self._wire.handler
        return handler

    def advance(self, ticks: int) -> None:
        """Run a number of ticks."""
        with self._wire.lock:
            for _ in range(ticks):
                if not self.alone:
                    self._heartbeat_count[0] += 1
                self.handler.advance(1)

    def until(self, true: Callable[[], Any], ticks: int = TICKS_MAX) -> Any:
        """Tick until the condition holds; return its value."""
        for _ in range(ticks):
            if found := true():
                return found
            self.advance(1)
        raise AssertionError(f"the condition did not hold within {ticks} ticks")


class _LocalProcess:
    """Replaces the process of the servo and the pipe to it; answers each order at once."""

    exitcode: int | None = None

    def __init__(self, made: dict[str, Any], shared: Channel, clock: VirtualClock) -> None:
        made = ForkingPickler.loads(ForkingPickler.dumps(made))
        self._opened: list[Connection] = []
        del made["bodies"]
        folder = made.pop("log_folder")
        try:
            twins = open_twins(made, self._opened)
            settings = settings_of([twin.renderer for twin in twins], made.get("settings"))
            self.handler = OrderHandler(made["scene"], twins, shared, folder, settings, clock.buffer)
        except BaseException:
            self._close()
            raise
        self._answers: deque[Any] = deque()
        self.lock = Lock()  # an order is handled between two ticks, as in the process

    def send_bytes(self, pickled: Any) -> None:
        order, arguments = ForkingPickler.loads(pickled)
        with self.lock:
            self._answers.append(ForkingPickler.dumps(self.handler.answer(order, arguments)))

    def poll(self, timeout_s: float) -> bool:
        return bool(self._answers)

    def recv(self) -> Any:
        return ForkingPickler.loads(self._answers.popleft())

    def send(self, word: Any) -> None:
        self.handler.end()
        self._close()
        self.exitcode = 0

    def _close(self) -> None:
        for connection in self.handler.connections if hasattr(self, "handler") else self._opened:
            connection.close()
            connection.state = new_state()

    def close(self) -> None: ...

    def join(self, timeout_s: float | None = None) -> None: ...

    def kill(self) -> None:
        self.exitcode = -9

    def is_alive(self) -> bool:
        return self.exitcode is None
