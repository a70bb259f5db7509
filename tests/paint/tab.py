"""A browser's tab without the browser: speaks viser's protocol and the page's own."""

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

SIZE = (800, 600)
TRIPS_MAX = 50_000


class Tab:
    """What a browser would know: the controls, the state, and what was said."""

    def __init__(self, page: Page) -> None:
        url = page.url.removeprefix("http://").rstrip("/")
        origin: Any = f"http://{url.partition('/')[0]}"
        protocol: Any = f"viser-v{viser.__version__}"
        self.page = page
        self.controls: dict[str, dict[str, Any]] = {}
        self.nodes: dict[str, dict[str, Any]] = {}
        self.state: dict[str, Any] = {}
        self.said: list[str] = []
        self.traces: list[np.ndarray] = []
        self.sounds: list[np.ndarray] = []
        self.client = -1
        self._marks = 0
        self._told = threading.Condition()
        self.viser = connect(f"ws://{url}/", origin=origin, subprotocols=[protocol], max_size=None)
        self.ours = connect(f"ws://{url}{SOCKET_PATH}", origin=origin, max_size=None)
        for read in (self._read_viser, self._read_ours):
            threading.Thread(target=read, daemon=True).start()
        self.look()
        with self._told:
            self._told.wait_for(lambda: self.client >= 0 and self.state)

    def close(self) -> None:
        self.viser.close()
        self.ours.close()

    def look(self, wxyz: Any = None, position: Any = None) -> None:
        """Send a camera: from above on the middle of the scene, unless told otherwise."""
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
        """Send one of viser's messages."""
        self.viser.send(msgspec.msgpack.encode({"type": kind, **content}))

    def send(self, do: str, **content: Any) -> None:
        """Send one of the page's own."""
        self.ours.send(json.dumps({"do": do, **content}))

    def point(self, do: str, p_W_m: Any) -> None:
        """The pointer over a place of the scene, seen by `look()`'s camera."""
        x, y, z = self.page.context.view.to_view(p_W_m)
        across = 2 * (6.0 - z) * np.tan(0.4)
        self.send(
            do, x=0.5 + x / across * SIZE[1] / SIZE[0], y=0.5 - y / across, w=SIZE[0], h=SIZE[1], client=self.client
        )

    def control(self, label: str) -> dict[str, Any]:
        """The control of that label, when it is there."""
        return self.wait(lambda: [c for c in list(self.controls.values()) if c["props"].get("label") == label])[-1]

    def set(self, label: str, value: Any) -> None:
        """Give a control a value, as the user would."""
        self.post("GuiUpdateMessage", uuid=self.control(label)["uuid"], updates={"value": value})

    def choose(self, name: str) -> None:
        """Take a swatch to paint with: press its card on the shelf."""
        self.send("library", act="use", name=name)
        self.settle()

    def wait(self, true: Callable[[], Any]) -> Any:
        """The value of a condition once it is true, asked after each of at most `TRIPS_MAX` round trips to the page."""
        for _ in range(TRIPS_MAX):
            if found := true():
                return found
            self._go_there_and_back()
        raise AssertionError("the condition did not become true")

    def settle(self) -> None:
        """Until the page has done all that was sent on both sockets so far, and all that it told of that has come."""
        count = self.page.context.socket.refused
        self.ours.send("no message of ours: it is counted")
        self.wait(lambda: self.page.context.socket.refused > count)
        self._marks += 1
        height, client = 6.0 + 1e-9 * self._marks, self.page.server.get_clients()[self.client]
        self.look(position=[0.0, 0.0, height])
        self.wait(lambda: client.camera.position[2] == height)
        self._go_there_and_back()
        shown = self.page.server.gui.add_html(mark := f"shown {self._marks}")
        with self._told:
            self._told.wait_for(lambda: any(c["props"].get("content") == mark for c in self.controls.values()))
        shown.remove()

    def _go_there_and_back(self) -> None:
        self._marks += 1
        mark = f"mark {self._marks}"
        self.page.server.get_event_loop().call_soon_threadsafe(self.page.context.socket.say, mark)
        with self._told:
            self._told.wait_for(lambda: mark in self.said)
        self.said.remove(mark)

    def _read_viser(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        with contextlib.suppress(ConnectionClosed):
            for raw in self.viser:
                assert isinstance(raw, bytes)
                size, packed = (int.from_bytes(raw[i : i + 8], "little") for i in (0, 8))
                batch = msgspec.msgpack.decode(unpack.decompress(raw[16 : 16 + packed], max_output_size=size))
                with self._told:
                    for message in batch["messages"]:
                        self._take(message)
                    self._told.notify_all()

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
                with self._told:
                    self._hear(raw)
                    self._told.notify_all()

    def _hear(self, raw: str | bytes) -> None:
        if isinstance(raw, str):
            message = json.loads(raw)
            self.state = message.get("state", self.state)
            if "say" in message:
                self.said.append(message["say"])
        else:
            numbers = np.frombuffer(raw, "<f4")
            (self.traces if numbers[0] == 1.0 else self.sounds).append(numbers)
