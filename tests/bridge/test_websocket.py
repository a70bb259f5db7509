"""`hapscene serve --ws`: a designer adds, tunes, paints, deforms and removes bodies while a game touches them over
UDP.
"""

import json
import socket
from base64 import b64encode
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import numpy as np
import pytest
import trimesh

sync = pytest.importorskip(
    "websockets.sync.client", reason="websockets is not installed: pip install 'hapscene[serve]'"
)
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus  # noqa: E402

from hapscene.bridge.packets import FRAME, HELLO, ORDER, STATE, Frame, Packet, pack, pack_json, unpack  # noqa: E402
from hapscene.bridge.websocket import CONNECTIONS_MAX, MESSAGE_MAX  # noqa: E402

from .client_packets import pack_frame, unpack_state  # noqa: E402
from .here import PATIENCE_S, Client, Here, Line  # noqa: E402

BOX = trimesh.creation.box((0.1, 0.1, 0.1))


class Designer:
    """A connection that sends orders; y is up in its coordinates, and its unit is the centimetre."""

    def __init__(self, served: Here, **hello: Any) -> None:
        self.wire = sync.connect(served.ws)
        self.number = 0
        self.welcome = self.say({"version": 1, "up": "y", "handed": "right", "metres": 0.01} | hello)

    def say(self, what: Any) -> dict[str, Any]:
        self.wire.send(what if isinstance(what, str) else json.dumps(what))
        answer: dict[str, Any] = json.loads(self.wire.recv(PATIENCE_S))
        return answer

    def order(self, order: str, **what: Any) -> dict[str, Any]:
        self.number += 1
        answer = self.say({"id": self.number, "order": order, **what})
        assert answer.pop("id") == self.number
        return answer


@pytest.fixture(scope="module")
def served() -> Iterator[Here]:
    served = Here(ws=True)
    yield served
    served.close()


@pytest.fixture
def designer(served: Here) -> Iterator[Designer]:
    made = Designer(served)
    yield made
    made.wire.close()


@pytest.fixture
def game(served: Here) -> Iterator[Client]:
    made = Client(served)
    yield made
    made.close()


def test_all_orders_while_a_game_plays(served: Here, designer: Designer, game: Client) -> None:
    """The game aims 15 mm below the top of a box of 100 mm that the designer, whose y is up, puts 1 m aside."""
    assert designer.welcome["bodies"] == ["crate"] and designer.welcome["swatches"] == ["plain", "wood"]
    box_cm = {"vertices": (100 * BOX.vertices[:, [0, 2, 1]] * (1, 1, -1)).tolist(), "faces": BOX.faces.tolist()}
    crate = {"name": "box", **box_cm, "swatch": "wood", "p": [100, 0, 0]}

    def feel(ticks: int = 16) -> dict[str, Any]:
        return game.feel(ticks, aim=(1.02, 0.01, 0.035))  # on no diagonal, where either face may be felt

    def until(true: Callable[[], Any]) -> None:
        served.servo.until(lambda: feel() and true())

    game.order("start", p=[1.02, 0.01, 0.06])
    assert designer.order("add", **crate) == {"done": "add", "body": 1}
    until(lambda: game.state["body"] == 1)
    feel(600)
    assert game.state["force"][2] > 0.1
    hard = game.state["depth"]
    assert (game.state["normal"], game.state["swatch"]) == (pytest.approx((0, 0, 1)), 1)

    assert designer.order("tune", swatch="wood", numbers={"stiffness_N_m": 100.0}) == {"done": "tune"}
    until(lambda: game.state["depth"] > 2 * hard)
    assert designer.order("paint", body="box", swatch="leather") == {"done": "paint", "faces": 12}
    until(lambda: game.state["swatch"] == 2)
    assert designer.order("paint", body="box", swatch="plain", faces=[feel()["face"]])["faces"] == 1
    until(lambda: game.state["swatch"] == 0)

    taller = b64encode((np.array(box_cm["vertices"]) * (1, 1.01, 1)).astype("<f4").tobytes()).decode()
    assert designer.order("deform", body="box", vertices=taller) == {"done": "deform"}
    until(lambda: game.state["proxy"][2] > 0.0503)

    assert designer.order("pause") == {"done": "pause"}
    tick = feel()["tick"]
    assert feel()["tick"] == tick
    assert designer.order("resume") == {"done": "resume"}
    assert feel()["tick"] > tick
    assert game.state["body"] == 1  # contact is kept
    assert not game.events  # of numbers that it cannot look up

    answer = designer.order("bodies")
    assert (answer["bodies"], answer["faces"]) == (["crate", "box"], [12, 12])
    assert answer["swatches"] == ["plain", "wood", "leather"] and game.order("bodies") == answer
    game.bodies, game.swatches = answer["bodies"], answer["swatches"]
    game.frame(bodies=[("box", (1, 0, 0), (0, 0, 0, 1))])
    assert game.poll()
    total = game.impulse("box")
    assert total[2] < -0.001
    assert designer.order("remove", body="box") == {"done": "remove"}
    until(lambda: game.state["body"] == -1 and game.events and game.events[-1][1:3] == ("ended", "box"))
    game.frame(bodies=[("box", (1, 0, 0), (0, 0, 0, 1))])  # the client does not know this body yet
    assert game.poll() and game.impulse("box")[2] <= total[2]
    assert designer.order("bodies")["bodies"] == ["crate", ""]
    assert designer.order("add", name="box", like="crate")["body"] == 2


def test_packets_in_binary_messages(served: Here, designer: Designer) -> None:
    wire = designer.wire

    def ask(kind: int, key: int, sequence: int, payload: bytes) -> Packet:
        wire.send(pack(Packet(kind, key, sequence, payload)))
        return unpack(wire.recv(PATIENCE_S))

    key = ask(HELLO, 0, 1, pack_json({"version": 1, "nonce": 5})).key
    assert b"done" in ask(ORDER, key, 1, pack_json({"order": "start", "p": [0, 0, 0.1]})).payload
    frames = count(1)

    def tool() -> tuple[float, ...]:
        answer = ask(FRAME, key, next(frames), pack_frame(Frame((0.0, 0.0, 0.1), 0, ())))
        assert answer.kind == STATE
        return unpack_state(answer.payload).tool

    tool()
    served.servo.advance(16)
    assert tool() == pytest.approx((0, 0, 0.1), abs=1e-3)
    assert "done" in designer.order("counts")
    stranger = Line(served)
    stranger.send(pack(Packet(FRAME, key, 2, pack_frame(Frame(None, 0, ())))))
    assert b"no such session" in stranger.recv(100)
    wire.send(pack(Packet(7, key, 2, b"")))


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ({"order": "add", "name": "x"}, "vertices and faces"),
        ({"order": "add", "name": "x", "like": "ghost"}, "no body 'ghost'; there are: "),
        ({"order": "add", "name": "crate", "like": "crate"}, "crate"),
        ({"order": "add", "name": "x", "like": "crate", "swatch": "/etc/passwd"}, "name of a swatch"),
        ({"order": "add", "name": "x", "like": "crate", "mesh": "crate.stl"}, "expected: name, vertices, faces"),
        ({"order": "add", "name": "x", "vertices": [[0, 0, 0]]}, "vertices and faces"),
        ({"order": "add", "name": "x", "vertices": [[0, 0, 0]], "faces": [[0, 0, 0]], "like": "crate"}, "and faces"),
        ({"order": "add", "name": "x", "like": "crate", "swatch": "x.swatch"}, "name of a swatch"),
        ({"order": "add", "name": "x", "like": "crate", "swatch": 5}, "name of a swatch"),
        *(
            ({"order": "add", "name": "x", "vertices": [[0, 0, 0]], "faces": faces}, "expected integers (m, 3)")
            for faces in ([[0, 0, 0.5]], [[0, 0, 2**31]], [[0, 0, float("nan")]], [0, 0, 0])
        ),
        ({"order": "add", "name": "x", "vertices": [[0, 0, 0]] * 3, "faces": [[0, 1, 3]]}, "vert"),
        ({"order": "paint", "body": "crate", "swatch": "wood", "faces": [12]}, "12"),
        ({"order": "deform", "body": "crate", "vertices": [[0, 0, 0]]}, "vertices"),
        ({"order": "tune_field", "effect": "weight", "numbers": {}}, "no effect of the scene 'weight'"),
        ({"order": "remove"}, "expected: body"),
        ({"order": "jump"}, "unknown order 'jump'"),
        ({"order": "start"}, "missing or invalid"),
        ({"order": "tune", "swatch": "oka", "numbers": {}}, "no swatch 'oka'"),
        ({"order": "free", "body": "crate", "mass": -1, "inertia": [1, 1, 1]}, "must be above 0"),
        ("{", "a JSON object"),
        ({"id": [1]}, "id: "),
    ],
)
def test_invalid_orders_are_answered(designer: Designer, order: Any, says: str) -> None:
    answer = designer.say({"id": 1} | order if isinstance(order, dict) else order)
    assert says in answer["error"] and "Error" not in answer["error"]
    assert "bodies" in designer.order("bodies")


def test_inward_faces_are_noted(designer: Designer) -> None:
    box = {"vertices": (100 * BOX.vertices).tolist(), "faces": BOX.faces[:, ::-1].tolist(), "p": [0, -500, 0]}
    assert "wound inward" in designer.order("add", name="inward", **box)["notes"][0]
    assert "notes" not in designer.order("add", name="turned", clockwise=True, **box)


def test_foreign_origins_are_rejected(served: Here) -> None:
    for origin in ("https://example.com", "null", "http://localhost.example.com", "http://127.0.0.1.example.com:80"):
        with pytest.raises(InvalidStatus, match="403"):
            sync.connect(served.ws, origin=origin)
    sync.connect(served.ws, origin="http://localhost:8000").close()


def test_an_invalid_convention_can_be_corrected(served: Here) -> None:
    designer = Designer(served, up="x")
    assert "up 'x'" in designer.welcome["error"]
    assert "version 1" in designer.say({"order": "counts"})["error"]
    assert designer.say({"version": 1})["version"] == 1
    designer.wire.close()


def test_limits_are_enforced_and_counted() -> None:
    served = Here(ws=True)
    designer, long = Designer(served), Designer(served)
    talks = list(served.door._listener._threads.values())
    with pytest.raises(ConnectionClosed):
        long.wire.send(" " * (MESSAGE_MAX + 1))
        long.wire.recv(PATIENCE_S)
    talks[1].join(PATIENCE_S)
    assert designer.order("counts")["counts"]["web bad"] == 1
    more = [sync.connect(served.ws) for _ in range(CONNECTIONS_MAX - 1)]
    talks = [*served.door._listener._threads.values()][1:]
    with pytest.raises((OSError, EOFError, InvalidMessage, ConnectionClosed)):
        sync.connect(served.ws)
    for wire in more:
        wire.close()
    for talk in talks:
        talk.join(PATIENCE_S)
    counts = designer.order("counts")["counts"]
    assert counts["web full"] == counts["web bad"] == 1
    served.close()


def test_close_with_open_connections() -> None:
    served = Here(ws=True)
    designer = Designer(served)
    place = ("127.0.0.1", int(served.ws.rpartition(":")[2]))
    with socket.create_connection(place) as garbled, socket.create_connection(place):  # which says nothing
        garbled.sendall(bytes(range(256)))
        assert garbled.recv(100) == b""
        assert designer.order("counts")["counts"]["web let in"] <= designer.order("counts")["counts"]["web"] - 1
        served.close()
        with pytest.raises(ConnectionClosed):
            designer.wire.recv(PATIENCE_S)
