"""The bridge in this process: its servo runs in virtual time, and packets are answered immediately."""

import socket
import sys
from collections import deque
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import trimesh

import hapscene
from hapscene.bridge.orders import Orders
from hapscene.bridge.server import BridgeServer
from hapscene.bridge.websocket import WebSocketBridge
from tests.virtual_servo import VirtualServo

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "engines" / "python"))

import hapscene_client as client_file  # from the folder above

PATIENCE_S = 180.0


class Here:
    """`hapscene serve` of a cube of 50 mm, but for the process. `ws` is the address of its WebSocket, where it has one.

    Each `Client` has an address of its own.
    """

    def __init__(self, ws: bool = False, tools: int = 1) -> None:
        scene = hapscene.Scene()
        scene.add(trimesh.creation.box((0.05, 0.05, 0.05)), "crate", unit="m", swatch="wood")
        self.servo, self.clients = VirtualServo(scene, ["omni"] * tools), 0
        self._open = ExitStack()
        self._open.enter_context(self.servo)
        orders = self._open.enter_context(Orders(self.servo))
        self.server = self._open.enter_context(BridgeServer(orders, "127.0.0.1", 0, self.servo.clock))
        self.door = self._open.enter_context(WebSocketBridge(self.server, "127.0.0.1", 0)) if ws else None
        self.ws = "ws://{}:{}".format(*self.door.address) if self.door else ""

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages by result."""
        return dict(self.server.orders.counts)

    def close(self) -> None:
        self._open.close()


class Line:
    """A socket to a bridge: what is sent is answered before the next is."""

    def __init__(self, here: Here) -> None:
        here.clients += 1
        self.here, self.address, self.answers = here, ("127.0.0.1", here.clients), deque[bytes]()

    def send(self, data: bytes) -> None:
        answer = self.here.server.answer(bytes(data), self.address)
        if isinstance(answer, Future):
            answer = answer.result(PATIENCE_S)
        if answer is not None:
            self.answers.append(answer)

    def recv(self, size: int) -> bytes:
        if not self.answers:
            raise TimeoutError
        return self.answers.popleft()

    def settimeout(self, timeout_s: float) -> None: ...

    def close(self) -> None: ...


class Client(client_file.Client):
    """The client of the examples, on such a line."""

    def __init__(self, here: Here, **how: Any) -> None:
        self.here = here
        super().__init__(**how)

    def _connect(self, host: str, port: int) -> socket.socket:
        return Line(self.here)  # type: ignore[return-value]

    def feel(self, ticks: int = 16, **frame: Any) -> dict[str, Any]:
        """Send a frame, let ticks go by, and send it again: and return the new state."""
        self.frame(**frame)
        self.here.servo.advance(ticks)
        self.frame(**frame)
        assert self.poll()
        assert self.state is not None
        return self.state
