"""The bridge server without sockets and servo process: invalid messages, order of messages, totals."""

import socket
import warnings
from collections.abc import Iterator
from concurrent.futures import Future
from itertools import count
from threading import Event
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.bridge.conventions import Convention
from hapscene.bridge.orders import Orders
from hapscene.bridge.packets import (
    ANSWER,
    BYE,
    FRAME,
    HELLO,
    ORDER,
    REFUSED,
    SIZE_MAX,
    BodyFrame,
    Frame,
    Packet,
    PacketError,
    State,
    pack,
    pack_json,
    unpack,
    unpack_json,
)
from hapscene.bridge.server import BATCH_MAX, BridgeServer
from hapscene.device.sim.hand import grip_named
from hapscene.errors import HapsceneError, SceneError
from hapscene.flags import Flag
from hapscene.loop.servo import BODY_ROOM
from hapscene.loop.servo_state import ServoState
from hapscene.render.contact_info import ContactEvent, Impulse
from tests.virtual_clock import VirtualClock

from .client_packets import pack_frame, unpack_state

HERE = ("127.0.0.1", 1)
GIVEN = [("clipped", UserWarning), ("clipped", UserWarning), ("old", DeprecationWarning)]
NONCES = count()
TUNE = b'{"order": "tune", "swatch": "plain", "numbers": {}}'


class Still:
    """A servo without a loop, which records the calls."""

    alive, tick_s, tools, tip_radius_m, body_names = True, 1e-3, 1, 0.0, ("crate",)

    def __init__(self) -> None:
        self.total, self.applied, self.grips, self.mass_kg = np.zeros(6), np.zeros(6), ["light"], np.inf
        self.scene = hapscene.Scene()
        self.scene.add(trimesh.creation.box((0.05, 0.05, 0.05)), "crate", unit="m")

    def impulse(self, body: str) -> Impulse:
        return Impulse(self.total[:3].copy(), self.total[3:].copy())

    def start(self, p_WT: Any, grip: str, tool: int | None) -> np.ndarray:
        grip_named(grip)
        given = np.vstack((self.total, np.zeros((BODY_ROOM, 6))))
        self.total[:] = 0.0
        return given

    def aim(self, p_WT: Any, grip: str, tool: int) -> None:
        self.grips.append(grip)

    def move(self, body: str, X_WB: Any, *, applied: Impulse, **how: Any) -> None:
        self.applied = np.concatenate(applied)

    def set_mass(self, body: str, mass_kg: float, **how: Any) -> None:
        if body != "crate":
            raise SceneError("no body; there are: " + 10_000 * "crate, ")
        self.mass_kg = mass_kg

    def state(self, tool: int = 0) -> ServoState:
        zeros = np.zeros(3)
        return ServoState(0, zeros, zeros, zeros, zeros, 0.0, 0.0, False, -1, -1, -1, Flag(0))

    def events(self, since: int = 0, *, tool: int) -> tuple[list[Any], int]:
        return [], since

    button_events = events


@pytest.fixture
def server() -> Iterator[BridgeServer]:
    with Orders(Still()) as orders, BridgeServer(orders, "127.0.0.1", 0) as server:  # type: ignore[arg-type]
        yield server


class Talk:
    """A connected client."""

    def __init__(self, server: BridgeServer, **hello: Any) -> None:
        self.server, self.key, self.sequence = server, 0, 0
        server._sessions.clear()  # any earlier client is disconnected
        welcome = self.say(HELLO, pack_json({"version": 1, "nonce": next(NONCES), **hello}))
        self.key, self.kind, self.answer = welcome.key, welcome.kind, unpack_json(welcome.payload)

    def say(self, kind: int, payload: bytes) -> Packet:
        self.sequence += 1
        answer = self.server._answer(Packet(kind, self.key, self.sequence, payload), HERE)
        if isinstance(answer, Future):
            answer = answer.result()
        assert answer is not None
        return unpack(answer)

    def order(self, payload: bytes) -> dict[str, Any]:
        answer = self.say(ORDER, payload)
        assert answer.kind == ANSWER
        return unpack_json(answer.payload)

    def frame(self, seen: tuple[float, ...] = (0.0,) * 6) -> State:
        body = BodyFrame(0, False, (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), None, None, seen)
        return unpack_state(self.say(FRAME, pack_frame(Frame((0.0,) * 3, 0, (body,)))).payload)


def test_packets_without_a_session(server: BridgeServer) -> None:
    talk = Talk(server)
    for kind, payload in ((FRAME, pack_frame(Frame(None, 0, ()))), (ORDER, b"{}")):
        asked = Packet(kind, talk.key ^ 1, 7, payload)
        answer = server.answer(pack(asked), HERE)
        assert isinstance(answer, bytes) and len(answer) <= 3 * len(pack(asked))
        assert unpack(answer) == (REFUSED, 0, 7, b'{"error":"no such session"}')
        assert server.answer(pack(asked)[:-1] + b"?", HERE) is None
    assert server.answer(pack(Packet(BYE, talk.key ^ 1, 7, b"")), HERE) is None
    assert (server.counts["forged"], server.counts["bad"]) == (3, 2)


def test_a_slow_order_does_not_delay_frames(server: BridgeServer) -> None:
    servo: Any = server.servo
    begun, going = Event(), Event()
    servo.tune = lambda swatch, **numbers: (begun.set(), going.wait(120.0))
    talk = Talk(server)
    first = server._answer(Packet(ORDER, talk.key, 2, b'{"order": "tune", "swatch": "plain", "numbers": {}}'), HERE)
    second = server._answer(Packet(ORDER, talk.key, 3, b'{"order": "counts"}'), HERE)
    assert isinstance(first, Future) and isinstance(second, Future) and begun.wait(120.0)
    talk.frame()
    assert not first.done() and not second.done()
    assert server._answer(Packet(ORDER, talk.key, 2, b"{}"), HERE) is None  # it is being done
    going.set()
    assert unpack_json(unpack(second.result()).payload)["done"] == "counts" and first.done()


@pytest.mark.parametrize(
    "order",
    [
        b"[]",
        b'{"order": "tune", "swatch": "plain", "numbers": [1]}',
        b'{"order": "free", "body": "crate", "mass": 1%s, "inertia": [1, 1, 1]}' % (400 * b"0"),
        b'{"order": "start", "p": {"x": 1}}',
        b'{"order": "free", "body": "ghost", "mass": 1, "inertia": [1, 1, 1]}',  # of a scene of many names
    ],
)
def test_invalid_orders_are_answered(server: BridgeServer, order: bytes) -> None:
    assert "error" in Talk(server).order(order)


def test_faces_that_clients_add_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.bridge.orders.FACE_MAX", 3)
    servo: Any = Still()
    servo.add = lambda mesh, name, **how: servo.scene.add(mesh, name)
    plate = {"order": "add", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "faces": [[0, 1, 2], [1, 3, 2]]}
    ours = Convention.of({})
    with Orders(servo) as orders:
        assert orders.carry_out(ours, plate | {"name": "one"})["body"] == 1
        assert orders.carry_out(ours, {"order": "add", "name": "two", "like": "one"})["body"] == 2
        assert "1 are left" in orders.carry_out(ours, plate | {"name": "three"})["error"]
    with pytest.raises(RuntimeError):
        orders.submit(ours, dict, str)  # it is closed


def test_warnings_of_an_order_are_in_its_answer() -> None:
    servo: Any = Still()
    servo.tune = lambda swatch: [warnings.warn(text, kind, stacklevel=1) for text, kind in GIVEN]
    with Orders(servo) as orders, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        answer = orders.carry_out(Convention.of({}), {"order": "tune", "swatch": "plain", "numbers": {}})
    assert answer == {"done": "tune", "notes": ["clipped", "clipped"]}
    for number in (True, -1, 1, 0.0, "0", None):
        with pytest.raises(PacketError, match="from 0 to 0"):
            orders.tool(number)
    assert orders.tool(0) == 0


def test_a_refused_start_keeps_the_grip(server: BridgeServer) -> None:
    talk = Talk(server)
    assert "error" in talk.order(b'{"order": "start", "p": [0, 0, 0], "grip": "iron"}')
    talk.frame()
    assert server.servo.grips[-1] == "light"  # type: ignore[attr-defined]


def test_a_client_can_request_the_orientation_of_its_tool(server: BridgeServer) -> None:
    """A handle that points to the user's right, away and up at 2 : 3 : 6, in the frame of Unity."""
    servo: Any = server.servo
    X_WT = np.eye(4)
    X_WT[:3, 0], X_WT[:3, 2] = np.array([6.0, 2.0, -3.0]) / 7.0, np.array([2.0, 3.0, 6.0]) / 7.0
    servo.tool_pose = lambda tool: X_WT
    talk = Talk(server, up="y", handed="left", orientation=True)
    assert 7.0 * np.array(talk.frame().axes) == pytest.approx([6.0, -3.0, 2.0, 2.0, 6.0, 3.0])
    assert Talk(server).frame().axes == ()


def test_totals_continue_over_a_start_and_restart_with_a_client(server: BridgeServer) -> None:
    servo: Any = server.servo
    talk = Talk(server)
    servo.total[:] = 1.0
    first = talk.frame().impulses[0][1]
    assert first == (1.0,) * 6
    talk.order(b'{"order": "start", "p": [0, 0, 0]}')
    assert talk.frame(first).impulses[0][1] == first
    assert not servo.applied.any()  # all of it, none since the start
    servo.total[:] = 0.5
    assert talk.frame(first).impulses[0][1] == (1.5,) * 6
    other = Talk(server, up="y", handed="left")
    assert other.key != talk.key
    assert other.frame().impulses[0][1] == (0.0,) * 6
    np.testing.assert_array_equal(servo.applied, 0.5)


def test_bodies_are_fixed_for_a_new_client(server: BridgeServer) -> None:
    servo: Any = server.servo
    Talk(server).order(b'{"order": "free", "body": "crate", "mass": 0.2, "inertia": [1, 1, 1]}')
    assert servo.mass_kg == 0.2 and server.orders.freed == {"crate"}
    Talk(server)
    assert servo.mass_kg == np.inf and not server.orders.freed
    Talk(server).order(b'{"order": "free", "body": "crate", "mass": 0.2, "inertia": [1, 1, 1]}')
    servo.remove = lambda body: None
    assert server.orders.carry_out(Convention.of({}), {"order": "remove", "body": "crate"}) == {"done": "remove"}
    assert not server.orders.freed


def test_the_server_ends_during_a_flood(server: BridgeServer) -> None:
    class Flood:
        def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
            assert server.counts["bad"] < 10 * BATCH_MAX, "for ever"
            return b"", HERE

    server._socket, real = Flood(), server._socket  # type: ignore[assignment]
    server.answer_all()
    server._socket = real


def test_packets_over_udp(server: BridgeServer, monkeypatch: pytest.MonkeyPatch) -> None:
    servo: Any = server.servo
    rounds = iter((False, True))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.settimeout(120.0)
        ours.sendto(pack(Packet(HELLO, 0, 1, b'{"version": 1}')), server.address)
        server.serve(lambda: next(rounds))
        welcome = unpack(ours.recv(SIZE_MAX))
        assert unpack_json(welcome.payload)["bodies"] == ["crate"]
        ours.sendto(pack(Packet(ORDER, welcome.key, 1, b'{"order": "counts"}')), server.address)
        server.answer_all()
        assert unpack_json(unpack(ours.recv(SIZE_MAX)).payload)["counts"] == {"hello": 1, "orders": 1}
    server._send(("127.0.0.1", 0), b"")
    (never := Future[bytes]()).cancel()
    server._send_done(server.address, never)
    assert server.counts["unsent"] == 1
    monkeypatch.setattr("hapscene.bridge.server.POLL_S", 0.0)
    monkeypatch.setattr(servo, "state", lambda: next(rounds))
    with pytest.raises(StopIteration):  # of the servo, which has ended
        server.serve(lambda: False)
    made = list[socket.socket]()
    monkeypatch.setattr(socket, "socket", lambda *a, real=socket.socket: made.append(real(*a)) or made[-1])
    with pytest.raises(HapsceneError, match=rf"127.0.0.1:{server.address[1]}: cannot listen"):
        BridgeServer(server.orders, *server.address)
    server.__exit__()
    assert [made[0].fileno(), server._socket.fileno()] == [-1, -1]


def test_a_silent_client_loses_its_tool_and_its_bodies() -> None:
    servo: Any = Still()
    servo.tools, servo.withdrawn = 2, []
    servo.withdraw = lambda tool: servo.withdrawn.append(tool)
    servo.button_events = lambda since=0, *, tool: ([SimpleNamespace(tick=5, pressed=True, button=3)], since + 1)
    clock, frame, ours = VirtualClock(), pack_frame(Frame(None, 0, ())), Convention.of({})

    def say(kind: int, key: int, sequence: int, payload: bytes, port: int = 1) -> Packet:
        answer = server.answer(pack(Packet(kind, key, sequence, payload)), ("127.0.0.1", port))
        assert isinstance(answer, bytes)
        return unpack(answer)

    with Orders(servo) as orders, BridgeServer(orders, "127.0.0.1", 0, clock) as server:
        first = say(HELLO, 0, 1, b'{"version": 1, "buttons": true}').key
        orders.carry_out(ours, {"order": "free", "body": "crate", "mass": 1, "inertia": [1, 1, 1]})
        assert unpack_state(say(FRAME, first, 1, frame).payload).events == ((5, 4, 3, 0xFFFF, 0.0),)
        clock.sleep_s(1.5)
        second = say(HELLO, 0, 1, b'{"version": 1, "tool": 1}', 2).key
        assert orders.freed == {"crate"} and not unpack_state(say(FRAME, second, 1, frame, 2).payload).events
        clock.sleep_s(1.0)
        say(FRAME, second, 2, frame, 2)
        assert say(FRAME, first, 2, frame).payload == b'{"error":"no such session"}' and orders.freed == {"crate"}
        clock.sleep_s(2.5)
        say(HELLO, 0, 1, b'{"version": 1}', 3)
        assert not orders.freed and servo.mass_kg == np.inf
        orders.submit(ours, dict, str).result()
    assert servo.withdrawn == [0, 1]


def test_answers_and_events_are_kept_in_limited_number(server: BridgeServer, monkeypatch: pytest.MonkeyPatch) -> None:
    servo: Any = server.servo
    monkeypatch.setattr("hapscene.bridge.server.ANSWER_COUNT", 3)
    monkeypatch.setattr("hapscene.bridge.server.EVENT_COUNT", 3)
    talk, asked = Talk(server), b'{"order": "counts"}'
    for _ in range(5):
        talk.order(asked)

    def again(sequence: int) -> Any:
        return server._answer(Packet(ORDER, talk.key, sequence, asked), HERE)

    assert [again(k) and unpack(again(k)).sequence for k in (2, 3, 4, 5, 6)] == [None, None, 4, 5, 6]
    assert server.counts["replayed"] == 2
    going = Event()
    servo.tune = lambda swatch: going.wait(120.0)
    waiting = [server._answer(Packet(ORDER, talk.key, k, TUNE), HERE) for k in range(7, 11)]
    assert waiting[3] is None and going.set() is None
    assert [unpack(one.result()).sequence for one in waiting[:3] if isinstance(one, Future)] == [7, 8, 9]
    found = [ContactEvent(tick, "began", "crate", "plain", 0.1 * tick) for tick in range(5)]
    servo.events = lambda since, *, tool: (found, 5)
    state = unpack_state(talk.say(FRAME, pack_frame(Frame(None, 0, ()))).payload)
    assert state.first_event == 2 and [event.tick for event in state.events] == [2, 3, 4]
    servo.events = lambda since, *, tool: ([], since)
    state = unpack_state(talk.say(FRAME, pack_frame(Frame(None, 4, ()))).payload)
    assert state.first_event == 4 and state.events == ((4, 1, 0, 0, 0.4),)
