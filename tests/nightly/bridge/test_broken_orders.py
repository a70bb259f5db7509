"""Invalid orders over WebSocket and UDP, against a servo in contact: the servo is not affected."""

import json
import random
import resource
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.bridge.conventions import Convention
from hapscene.bridge.orders import Orders
from hapscene.bridge.packets import BYE, HELLO, ORDER, Packet, pack, pack_json, unpack, unpack_json
from hapscene.bridge.server import BridgeServer
from hapscene.loop import Servo

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
from hapscene.bridge.websocket import WebSocketBridge

BOX = trimesh.creation.box((0.05, 0.05, 0.05))
VERTICES, FACES = BOX.vertices.tolist(), BOX.faces.tolist()

GOOD: list[dict[str, Any]] = [
    {"order": "add", "name": "more", "vertices": VERTICES, "faces": FACES, "swatch": "wood", "p": [5, 0, 0]},
    {"order": "add", "name": "like", "like": "other", "p": [5, 0, 0], "q": [0, 0, 0.6, 0.8], "two_sided": True},
    {"order": "remove", "body": "more"},
    {"order": "paint", "body": "other", "swatch": "wood", "faces": [0, 1, 2]},
    {"order": "deform", "body": "other", "vertices": VERTICES},
    {"order": "tune", "swatch": "wood", "numbers": {"stiffness_N_m": 300.0}},
    {"order": "tune_field", "effect": "magnet", "numbers": {"strength": 1.0}},
    {"order": "free", "body": "other", "mass": 0.2, "inertia": [1e-4, 1e-4, 1e-4], "com": [0, 0, 0]},
    {"order": "start", "p": ["here"], "grip": "light"},
    {"order": "bodies"},
    {"order": "counts"},
    {"order": "resume"},
]
"""None of which, as it is or with some signs of it changed, has to do with the body that is touched."""

NASTY: list[Any] = [
    *(None, True, -1, 0, 1e308, float("nan"), "", "\ud800", "x" * 1000, [], {}, [[]], [None], 10**30, "__class__"),
    *(["crate"], {"order": "add"}, [[0, 0, 0]] * 8, [1e9] * 3, "\x1b[31m"),
]


def broken(rng: random.Random) -> str:
    """An order with a member changed, or signs of its text."""
    order = json.loads(json.dumps({"id": rng.randrange(100)} | rng.choice(GOOD)))
    for _ in range(rng.randrange(3)):
        inner: Any = order
        while isinstance(inner, dict | list) and inner:
            key = rng.choice(list(inner)) if isinstance(inner, dict) else rng.randrange(len(inner))
            if rng.random() < 0.4 or not isinstance(inner[key], dict | list):
                inner[key] = deepcopy(rng.choice(NASTY))
                break
            inner = inner[key]
    text = list(json.dumps(order))
    for _ in range(rng.choice((0, 0, 1, 3))):
        at = rng.randrange(len(text))
        text[at : at + rng.randrange(2)] = rng.choice('0123456789-.eE[]{}",: \0é\U0001f600')
    return "".join(text[: rng.randrange(len(text))] if rng.random() < 0.05 else text)


@pytest.fixture(scope="module")
def touched() -> Iterator[tuple[WebSocketBridge, Servo]]:
    scene = hapscene.Scene()
    scene.add(BOX, "crate", unit="m")
    scene.add(BOX, "other", unit="m", swatch="wood", pose=np.eye(4) + np.pad([[3.0]], ((0, 3), (3, 0))))
    with Servo(scene, "omni") as servo, Orders(servo) as orders, BridgeServer(orders, "127.0.0.1", 0) as server:
        servo.start((0.0, 0.0, 0.03))
        servo.aim((0.0, 0.0, 0.01))
        while not servo.state().touching or servo.state().tick < 1000:
            pass
        with WebSocketBridge(server, "127.0.0.1", 0) as door:
            yield door, servo


def break_many(touched: tuple[WebSocketBridge, Servo], seed: int, count: int) -> None:
    door, servo = touched
    rng, to, orders = random.Random(seed), Convention.of({}), door._orders
    here = ("127.0.0.1", 1)
    welcome = door._server.answer(pack(Packet(HELLO, 0, 1, pack_json({"version": 1, "nonce": seed}))), here)
    assert isinstance(welcome, bytes)
    key, since, done, memory = unpack(welcome).key, servo.state().tick, 0, []
    for k in range(count):
        text = broken(rng)
        if k % 2:
            answer = json.loads(door._order(to, text).result(30.0))
        else:
            packet = pack(Packet(ORDER, key, k + 1, text.encode(errors="surrogatepass")))
            answer: Any = door._server.answer(packet, here)
            answer = unpack_json(unpack(answer.result(30.0)).payload)
        assert ("done" in answer) != ("error" in answer)
        assert not any(word in answer.get("error", "") for word in ("Error", "Traceback", "object at"))
        done += "done" in answer
        if k % 500 == 0 or k == count - 1:
            rows = servo.read(since).rows
            since = servo.state().tick
            assert (rows["body"] == 0).all()
            assert np.abs(np.diff(rows["f_W_N"], axis=0)).max(initial=0.0) < 0.05  # [N] from tick to tick
            memory.append(resource_kB(servo))
    door._server.answer(pack(Packet(BYE, key, count + 1, b"")), here)
    assert orders.counts["failed"] == 0 and servo.alive and count / 20 < done < count
    half, end = np.array(memory[len(memory) // 2]), np.array(memory[-1])
    print(f"{count:,} orders, {done:,} done; kB of server and servo: {half} -> {end}; {servo.timing()}")
    assert (end - half <= 20_000).all()  # [kB]: the bodies that were added stay reserved, 16 kB each


def resource_kB(servo: Servo) -> tuple[int, int]:
    statm = Path(f"/proc/{servo._process.pid}/statm")
    kB = resource.getpagesize() // 1024
    return tuple(kB * int(path.read_text().split()[1]) for path in (Path("/proc/self/statm"), statm))


def test_invalid_orders_do_not_affect_the_servo(touched: tuple[WebSocketBridge, Servo]) -> None:
    break_many(touched, 5, 1500)


@pytest.mark.soak
def test_memory_after_a_hundred_thousand_invalid_orders(touched: tuple[WebSocketBridge, Servo]) -> None:
    break_many(touched, 6, 100_000)
