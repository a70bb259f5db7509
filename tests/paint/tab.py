"""Client of the painter's page without a browser: implements the protocols of viser and of the page."""

import contextlib
import json
import threading
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from hapscene.paint.web.page import Page
from hapscene.paint.web.server import SOCKET_PATH
from hapscene.paint.web.tools import Tools

SIZE = (800, 600)
ROUNDS_MAX = 50_000


class Tab:
    """Connection to a page: holds the controls, the scene nodes, the state and the messages received so far."""

    def __init__(self, page: Page) -> None:
        url = page.url.removeprefix("http://").rstrip("/")
        origin: Any = f"http://{url.partition('/')[0]}"
        protocol: Any = f"viser-v{viser.__version__}"
        self.page = page
        self.controls: dict[str, dict[str, Any]] = {}
        self.nodes: dict[str, dict[str, Any]] = {}
        self.state: dict[str, Any] = {}
        self.said: list[str] = []
        self.done: list[float] = []
        self.traces: list[np.ndarray] = []
        self.sounds: list[np.ndarray] = []
        self.client = -1
        self._marks = 0
        self._changed = threading.Condition()
        self.viser = connect(f"ws://{url}/", origin=origin, subprotocols=[protocol], max_size=None)
        self.ours = connect(f"ws://{url}{SOCKET_PATH}", origin=origin, max_size=None)
        for read in (self._read_viser, self._read_ours):
            threading.Thread(target=read, daemon=True).start()
        self.look()
        with self._changed:
            self._changed.wait_for(lambda: self.client >= 0)
        self.send("theme", dark=False)
        with self._changed:
            self._changed.wait_for(lambda: self.state)
        self.send("shown")

    @property
    def tools(self) -> Tools:
        """The tools of this tab."""
        return self.page.clients[self.client].context.tools

    def close(self) -> None:
        self.viser.close()
        self.ours.close()

    def look(self, wxyz: Any = None, position: Any = None) -> None:
        """Send a camera; by default above the centre of the scene, looking down."""
        self.post(
            "ViewerCameraMessage",
            wxyz=[0.0, 1.0, 0.0, 0.0] if wxyz is None else wxyz,
            position=[0.0, 0.0, 6.0] if position is None else position,
            fov=0.8,
            near=0.01,
            far=1000.0,
            image_width=SIZE[0],
            image_height=SIZE[1],
            look_at=[0.0, 0.0, 0.0],
            up_direction=[0.0, 1.0, 0.0],
        )

    def post(self, kind: str, **content: Any) -> None:
        """Send a message of viser's protocol."""
        self.viser.send(msgspec.msgpack.encode({"type": kind, **content}))

    def send(self, do: str, **content: Any) -> None:
        """Send a message of the page's protocol."""
        self.ours.send(json.dumps({"client": self.client, "do": do, **content}))

    def point(self, do: str, p_W_m: Any) -> None:
        """Send a pointer event at a point of the scene, as the camera of `look()` shows it."""
        x, y, z = self.page.context.view.to_view(p_W_m)
        across = 2 * (6.0 - z) * np.tan(0.4)
        self.send(do, x=0.5 + x / across * SIZE[1] / SIZE[0], y=0.5 - y / across, w=SIZE[0], h=SIZE[1])

    def control(self, label: str) -> dict[str, Any]:
        """Wait for a control with this label; return it."""
        return self.wait(lambda: [c for c in list(self.controls.values()) if c["props"].get("label") == label])[-1]

    def set(self, label: str, value: Any) -> None:
        """Set the value of a control, as the user would."""
        self.post("GuiUpdateMessage", uuid=self.control(label)["uuid"], updates={"value": value})

    def choose(self, name: str) -> None:
        """Select a swatch to paint with, as a click on its card does."""
        self.send("library", act="use", name=name)
        self.settle()

    def wait(self, true: Callable[[], Any]) -> Any:
        """Wait until a condition holds, checked after each round trip to the page; return its value."""
        for _ in range(ROUNDS_MAX):
            if found := true():
                return found
            self._round_trip()
        raise AssertionError("the condition did not become true")

    def settle(self) -> None:
        """Wait until the page has handled all messages sent so far and its answers have arrived."""
        self._marks += 1
        handled = self._marks
        self.send("hello", n=handled)
        self.wait(lambda: handled in self.done)
        self.done.remove(handled)
        height, client = 6.0 + 1e-9 * self._marks, self.page.server.get_clients()[self.client]
        self.look(position=[0.0, 0.0, height])
        self.wait(lambda: client.camera.position[2] == height)
        self._round_trip()
        shown = self.page.server.gui.add_html(mark := f"shown {self._marks}")
        with self._changed:
            self._changed.wait_for(lambda: any(c["props"].get("content") == mark for c in self.controls.values()))
        shown.remove()

    def _round_trip(self) -> None:
        self._marks += 1
        mark = f"mark {self._marks}"
        self.page.server.get_event_loop().call_soon_threadsafe(self.page.context.socket.say, mark)
        with self._changed:
            self._changed.wait_for(lambda: mark in self.said)
        self.said.remove(mark)

    def _read_viser(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        with contextlib.suppress(ConnectionClosed):
            for raw in self.viser:
                assert isinstance(raw, bytes)
                size, packed = (int.from_bytes(raw[i : i + 8], "little") for i in (0, 8))
                batch = msgspec.msgpack.decode(unpack.decompress(raw[16 : 16 + packed], max_output_size=size))
                with self._changed:
                    for message in batch["messages"]:
                        self._take(message)
                    self._changed.notify_all()

    def _take(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "GuiUpdateMessage" and message["uuid"] in self.controls:
            control = self.controls[message["uuid"]]
            for key, value in message["updates"].items():
                (control if key == "value" else control["props"])[key] = value
        elif kind == "GuiRemoveMessage":
            self.controls.pop(message["uuid"], None)
        elif kind.startswith("Gui") and "props" in message and "uuid" in message:
            self.controls[message["uuid"]] = message
            content = message["props"].get("content", "")
            if "hs-client" in content:
                self.client = int(content.split('data-id="')[1].split('"')[0])
        elif kind == "RemoveSceneNodeMessage":
            self.nodes.pop(message["name"], None)
        elif "props" in message and "name" in message:
            self.nodes[message["name"]] = message

    def _read_ours(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for raw in self.ours:
                with self._changed:
                    self._receive(raw)
                    self._changed.notify_all()

    def _receive(self, raw: str | bytes) -> None:
        if isinstance(raw, str):
            message = json.loads(raw)
            self.state = message.get("state", self.state)
            if "done" in message:
                self.done.append(message["done"])
            if "say" in message:
                self.said.append(message["say"])
        else:
            numbers = np.frombuffer(raw, "<f4")
            (self.traces if numbers[0] == 1.0 else self.sounds).append(numbers)
