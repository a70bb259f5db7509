"""Client of hapscene's bridge in one file; needs only Python's standard library. See docs/reference/bridge-protocol.md.

client = Client(up="y", handed="right")
client.order("free", body="crate", mass=0.2, inertia=[1e-4] * 3)
client.order("start", p=[0.0, 0.1, 0.0])
while running:
    client.poll()
    total = client.impulse("crate")  # apply its increase since the last frame: v += ΔJ / 0.2, …
    client.frame(aim=mouse, bodies=[("crate", p, q, v, w)])  # the pose after that
"""

import contextlib
import json
import random
import socket
import struct
import time
import zlib
from collections.abc import Sequence
from typing import Any

HELLO, WELCOME, FRAME, STATE, ORDER, ANSWER, BYE, REFUSED = range(1, 9)
HEAD, CHECK = struct.Struct("<4sBBHQI"), struct.Struct("<I")
AIM, BODY = struct.Struct("<BBHI3d"), struct.Struct("<HHI3d4d3d3d6d")
STATES, IMPULSE, EVENT = struct.Struct("<Qd3d3d3d3dddiiiIIHH"), struct.Struct("<HHI6d"), struct.Struct("<QBBHHHd")
KINDS = {1: "began", 2: "crossed", 3: "ended", 4: "pressed", 5: "released"}
BUSY, LOST = "another client is here", b"no such session"


def pack(kind: int, key: int, sequence: int, payload: bytes) -> bytes:
    head = HEAD.pack(b"HSB1", kind, 0, HEAD.size + CHECK.size + len(payload), key, sequence)
    return head + CHECK.pack(zlib.crc32(head + payload)) + payload


def unpack(data: bytes) -> tuple[int, int, int, bytes] | None:
    """Return kind, key, sequence and payload; None if the data is not a valid packet."""
    start = HEAD.size + CHECK.size
    if len(data) < start:
        return None
    magic, kind, _, size, key, sequence = HEAD.unpack_from(data)
    whole = magic == b"HSB1" and size == len(data)
    if not whole or zlib.crc32(data[: HEAD.size] + data[start:]) != CHECK.unpack_from(data, HEAD.size)[0]:
        return None
    return kind, key, sequence, data[start:]


class Client:
    """A session. `state` is the newest state, `events` are the events since the list was last emptied.

    A contact event is (tick, kind, body, swatch, speed); a button event is (tick, kind, number as text, "", 0.0).

    `poll` and `order` raise ConnectionError if the server was restarted or has another client: create a new client.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 47700,
        up: str = "z",
        handed: str = "right",
        metres: float = 1.0,
        tool: int = 0,
        patience_s: float = 10.0,
    ) -> None:
        self.patience_s = patience_s
        self.socket = self._connect(host, port)
        self.key = self.sequence = self.orders = self.event_count = 0
        self.state: dict[str, Any] | None = None
        self.events: list[tuple[int, str, str, str, float]] = []
        self.totals: dict[str, tuple[float, ...]] = {}
        hello = {
            "version": 1,
            "nonce": random.getrandbits(53),
            "up": up,
            "handed": handed,
            "metres": metres,
            "tool": tool,
            "buttons": True,
        }
        kind, self.key, answer = self._ask(HELLO, 1, hello, (WELCOME, REFUSED))
        if kind == REFUSED:
            raise ConnectionError(answer["error"])
        self.bodies, self.swatches, self.tick_s = answer["bodies"], answer["swatches"], answer["tick_s"]

    def order(self, order: str, **what: Any) -> dict[str, Any]:
        """Send an order, executed once, and return its answer; raise ValueError if the server refuses it."""
        self.orders += 1
        _, _, answer = self._ask(ORDER, self.orders, {"order": order, **what}, (ANSWER,))
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    def frame(self, aim: Sequence[float] | None = None, bodies: Sequence[Any] = ()) -> None:
        """Send the target of the hand and the poses of bodies, without waiting for the answer.

        A body is (name, p, q) or (name, p, q, v, w), q as x y z w; a last member True teleports it.
        """
        parts = [AIM.pack(aim is not None, len(bodies), 0, self.event_count, *(aim if aim is not None else (0, 0, 0)))]
        for body in bodies:
            body, jumps = (body[:-1], body[-1]) if isinstance(body[-1], bool) else (body, False)
            name, p, q, *moving = body
            v, w = moving or ((0, 0, 0), (0, 0, 0))
            seen = self.totals.get(name, (0.0,) * 6)
            parts.append(BODY.pack(self.bodies.index(name), jumps | 2 * bool(moving), 0, *p, *q, *v, *w, *seen))
        self.sequence += 1
        self._send(pack(FRAME, self.key, self.sequence, b"".join(parts)))

    def poll(self, wait_s: float = 0.0) -> bool:
        """Read the packets that have arrived; return whether a new state is among them."""
        came, end_s = False, time.monotonic() + wait_s
        while True:
            self.socket.settimeout(max(end_s - time.monotonic(), 0.0) if not came else 0.0)
            try:
                data = self.socket.recv(65536)
            except (BlockingIOError, TimeoutError):
                return came
            except ConnectionError:
                continue
            packet = self._unpack(data)
            if packet and packet[:2] == (STATE, self.key):
                came = self._take(packet[2], packet[3]) or came

    def impulse(self, name: str) -> tuple[float, ...]:
        """Return the total impulse of the tool on a body: six numbers, in N·s and N·m·s."""
        return self.totals.get(name, (0.0,) * 6)

    def close(self) -> None:
        self._send(pack(BYE, self.key, 0, b""))
        self.socket.close()

    def _connect(self, host: str, port: int) -> socket.socket:
        line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        line.connect((host, port))
        line.settimeout(0.05)
        return line

    def _take(self, sequence: int, payload: bytes) -> bool:
        if self.state is not None and sequence <= self.state["sequence"]:
            return False  # overtaken
        tick, age_s, *n = STATES.unpack_from(payload)
        names = ("tool", "proxy", "normal", "force")
        state: dict[str, Any] = {name: tuple(n[3 * i : 3 * i + 3]) for i, name in enumerate(names)}
        rest = ("depth", "slip", "body", "face", "swatch", "flags", "first_event", "events", "bodies")
        state |= dict(zip(rest, n[12:], strict=True)) | {"tick": tick, "age_s": age_s, "sequence": sequence}
        at = STATES.size
        for _ in range(state["bodies"]):
            body, _, _, *total = IMPULSE.unpack_from(payload, at)
            self.totals[self.bodies[body]] = tuple(total)
            at += IMPULSE.size
        for number in range(state["first_event"], state["first_event"] + state["events"]):
            tick, kind, _, body, swatch, _, speed = EVENT.unpack_from(payload, at)
            at += EVENT.size
            if number >= self.event_count and kind > 3:
                self.events.append((tick, KINDS[kind], str(body), "", speed))
            elif number >= self.event_count:
                self.events.append((tick, KINDS[kind], self.bodies[body], self.swatches[swatch], speed))
        self.event_count = max(self.event_count, state["first_event"] + state["events"])
        self.state = state
        return True

    def _ask(
        self, kind: int, sequence: int, what: dict[str, Any], answers: tuple[int, ...]
    ) -> tuple[int, int, dict[str, Any]]:
        packet, end_s = pack(kind, self.key, sequence, json.dumps(what).encode()), time.monotonic() + self.patience_s
        self.socket.settimeout(0.1)
        why: OSError = TimeoutError("no answer: is `hapscene serve` running?")
        while time.monotonic() < end_s:
            self._send(packet)
            try:
                data = self.socket.recv(65536)
            except (TimeoutError, ConnectionError):
                continue
            packet_in = self._unpack(data)
            if packet_in and packet_in[0] in answers and packet_in[2] == sequence:
                answer = json.loads(packet_in[3])
                if answer.get("error") != BUSY:
                    return packet_in[0], packet_in[1], answer
                why = ConnectionError(BUSY)
                time.sleep(0.1)
            elif packet_in and packet_in[:2] == (STATE, self.key):
                self._take(packet_in[2], packet_in[3])
        raise why

    def _unpack(self, data: bytes) -> tuple[int, int, int, bytes] | None:
        packet = unpack(data)
        sent = max(self.sequence, self.orders)
        if packet and packet[0] == REFUSED and packet[2] <= sent and LOST in packet[3]:
            raise ConnectionError("the session is lost: the server was restarted or has another client; make a new one")
        return packet

    def _send(self, packet: bytes) -> None:
        with contextlib.suppress(ConnectionError):  # an earlier packet was refused by the port
            self.socket.send(packet)
