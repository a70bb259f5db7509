"""The Inverse3 driver: messages as published, in both versions; states, grips and faults of the service."""

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from hapscene.errors import DeviceError
from hapscene_plugins.devices import inverse3
from hapscene_plugins.devices.inverse3 import DRIVER, Inverse3Connection
from hapscene_plugins.devices.inverse3_link import Link
from hapscene_plugins.devices.inverse3_messages import force_message, numbers, parse
from tests.virtual_clock import VirtualClock

ORIENTATION = {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
HALF_TURN = np.diag((-1.0, -1.0, 1.0))


def xyz(*values: float) -> dict[str, float]:
    return dict(zip("xyz", values, strict=True))


class Service:
    """Haply's service without a network: a state at the start, and one for each message while it `answers`."""

    def __init__(self) -> None:
        self.state: dict[str, Any] = {"cursor_position": xyz(0.06, -0.13, 0.16), "cursor_velocity": xyz(0.1, 0.2, 0.3)}
        self.status: dict[str, Any] = {"calibrated": True, "ready": True}
        self.more: dict[str, Any] = {}
        self.sent: list[tuple[float, ...]] = []
        self.field = "vector"
        self.answers, self.closed, self.messages = True, False, [b"[]", b"{"]  # neither is a state
        self.answer()

    def answer(self) -> None:
        other = {"device_id": "other", "state": {"cursor_position": xyz(0.5, 0.5, 0.5)}}
        entries = [{"device_id": "05DA", "state": self.state, "status": self.status}, other]
        self.messages.append(json.dumps({"inverse3": entries, **self.more}).encode())

    def receive(self, wait_s: float) -> bytes | None:
        return self.messages.pop(0) if self.messages else None

    def send(self, text: bytes) -> None:
        (entry,) = json.loads(text)["inverse3"]
        assert entry["device_id"] == "05DA"
        self.sent.append(tuple(entry["commands"]["set_cursor_force"][self.field].values()))
        if self.answers:
            self.answer()

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Service:
    made = Service()
    monkeypatch.setattr("hapscene_plugins.devices.inverse3.Link", lambda uri, wait_s: made)
    return made


def tick(device: Inverse3Connection, *force_N: float) -> None:
    device.read()
    device.state.f_D_N = force_N or (0.0, 0.0, 0.0)
    device.write()


@pytest.mark.parametrize("field", ["vector", "values"])
def test_message_as_published(field: str) -> None:
    assert json.loads(force_message("05DA", field, (1.0, 0.0, -2.0))) == {
        "inverse3": [{"device_id": "05DA", "commands": {"set_cursor_force": {field: {"x": 1.0, "y": 0.0, "z": -2.0}}}}]
    }


def test_a_missing_service_is_an_error() -> None:
    with pytest.raises(DeviceError, match=r"inverse3: ws://127.0.0.1:9: no answer"):
        DRIVER.open(uri="ws://127.0.0.1:9")
    (found,) = DRIVER.find(uri="ws://127.0.0.1:9")
    assert "no answer" in found.trouble and "start Haply's" in found.remedy


def test_states_and_limited_forces(service: Service) -> None:
    device = Inverse3Connection(clock=VirtualClock())
    tick(device, 3.0, 0.0, 4.0)
    state = device.state[0]
    np.testing.assert_allclose(state.p_DT_m, (0.01, 0.02, -0.01), atol=1e-12)
    assert state.v_DT_m_s.tolist() == [0.1, 0.2, 0.3]
    assert (state.count, state.ready, state.trouble) == (2, 1, 0)  # the one at the start, and an answer
    assert service.sent == [(0.0, 0.0, 0.0), pytest.approx((1.2, 0.0, 1.6))]  # 2 N
    service.messages.insert(0, b'{"category": "safety"}')  # an event answers nothing
    tick(device, 0.1, 0.2, 0.3)
    assert state.count == 3 and service.sent[-1] == (0.1, 0.2, 0.3)
    for bad in (xyz(0.0, 1.5, 0.0), {"x": 0.0, "y": 0.0}, xyz(0.0, "1", 0.0), xyz(True, 0.0, 0.0)):
        service.state = {"cursor_position": bad}
        tick(device)
        tick(device)
        assert state.p_DT_m[0] == pytest.approx(0.01)
    assert state.count == 4  # the answer to the last good one
    service.state = {"cursor_position": xyz(0.06, -0.13, 0.16)}
    tick(device)
    tick(device, 0.1, 0.2, 0.3)
    assert np.isnan(state.v_DT_m_s).all()
    service.messages += [b"{}", b"{}"]  # answers to no message of the driver
    device.close()
    assert service.closed and service.sent[-2:] == [(0.1, 0.2, 0.3), (0.0, 0.0, 0.0)] and len(service.messages) == 2


def test_release_sends_zero_and_closes(service: Service) -> None:
    DRIVER.release()
    assert service.closed and service.sent == [(0.0, 0.0, 0.0)] * 2


@pytest.mark.parametrize(
    ("status", "transform", "trouble"),
    [
        ({"calibrated": False, "ready": True}, {}, inverse3.CALIBRATE),
        ({"calibrated": True, "ready": False}, {}, inverse3.POWER),
        ({"calibrated": True, "ready": True}, {"scale": xyz(2.0, 2.0, 2.0)}, inverse3.TRANSFORMED),
        ({"calibrated": True, "ready": True}, {"rotation": ORIENTATION | {"z": 0.0, "w": 1.0}}, 0),
    ],
)
def test_no_force_unless_the_device_is_ready(service: Service, status: Any, transform: Any, trouble: int) -> None:
    service.status, service.state["transform"] = status, transform
    service.messages.clear()
    service.answer()
    device = Inverse3Connection(clock=VirtualClock())
    for _ in range(3):
        tick(device, 1.0, 0.0, 0.0)
    assert (device.state.trouble[0], device.state.ready[0]) == (trouble, int(trouble == 0))
    assert service.sent[-1] == ((0.0, 0.0, 0.0) if trouble else (1.0, 0.0, 0.0))
    assert bool(device.reason(trouble)) == bool(trouble)


def test_ignored_forces_are_reported(service: Service) -> None:
    service.state["current_cursor_force"] = xyz(0.0, 0.0, 0.0)
    device = Inverse3Connection(clock=(clock := VirtualClock()))
    for force_N, ticks, trouble in (
        (0.09, inverse3.IGNORED_COUNT + 5, 0),
        (0.2, inverse3.IGNORED_COUNT + 1, 0),
        (0.2, 1, inverse3.IGNORED),
    ):
        for _ in range(ticks):
            tick(device, force_N, 0.0, 0.0)
            clock.sleep_s(0.01)  # while it answers, no time is too long
        assert (device.state.trouble[0], device.state.ready[0]) == (trouble, 1)
    service.state["current_cursor_force"] = xyz(0.2, 0.0, 0.0)
    tick(device, 0.2, 0.0, 0.0)
    tick(device, 0.2, 0.0, 0.0)
    assert device.state.trouble[0] == 0


def test_grips(service: Service) -> None:
    device = Inverse3Connection(clock=VirtualClock())
    wired = {"verse_grip": [{"state": {"button": True, "orientation": ORIENTATION}}]}
    wireless = {"wireless_verse_grip": [{"state": {"buttons": {"a": True, "c": True}, "orientation": ORIENTATION}}]}
    for service.more, buttons, R_DT in ((wired, 1, HALF_TURN), (wireless, 5, HALF_TURN), ({}, 0, np.eye(3))):
        tick(device)  # takes the last answer
        device.state.R_DT = np.eye(3)
        tick(device)
        assert device.state.buttons[0] == buttons
        np.testing.assert_allclose(device.state.R_DT[0], R_DT, atol=1e-12)


def test_a_service_without_answers_gets_few_messages_and_is_an_error(service: Service) -> None:
    clock = VirtualClock()
    service.field = "values"
    device = Inverse3Connection(field="values", clock=clock)
    tick(device, 1.0, 0.0, 0.0)
    service.answers = False
    with pytest.raises(DeviceError, match=r"inverse3.*no valid data.*restart"):
        for _ in range(1000):
            tick(device, 1.0, 0.0, 0.0)
            clock.sleep_s(1e-3)
    assert len(service.sent) == 3 + inverse3.PENDING_MAX and device.state.ready[0] == 0
    device.write()  # the force is 0 from then on
    assert service.sent[-1] == (0.0, 0.0, 0.0)


def test_a_service_without_a_device_is_an_error(service: Service) -> None:
    clock = VirtualClock()
    service.receive = lambda wait_s: clock.sleep_s(wait_s)  # type: ignore[func-returns-value]
    with pytest.raises(DeviceError, match="lists no Inverse3"):
        Inverse3Connection(clock=clock)
    assert service.closed and clock.now_s() == pytest.approx(1002.0)


def test_values_of_messages() -> None:
    assert parse(b"[1]") is None and parse("{") is None and parse('{"a": 1}') == {"a": 1}
    assert numbers({"p": xyz(1, 2.5, -3)}, "p") == (1.0, 2.5, -3.0)
    assert numbers({"p": xyz(1, 2.5, 1e7)}, "p") is None and numbers({}, "p") is None


def test_a_service_that_does_not_complete_the_connection_is_left() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        with pytest.raises(DeviceError, match="no answer"):
            Link(f"ws://127.0.0.1:{server.getsockname()[1]}", 0.01)
        request = server.accept()[0].makefile("rb").read()  # to the end of the connection
        assert request.startswith(b"GET ")


ENDED = threading.Event()
"""The service's ping was answered, and the connection ended with the protocol's closing message."""


@pytest.fixture
def uri() -> Iterator[str]:
    """The address of a service that sends a message in parts, and returns what it receives."""

    def talk(wire: Any) -> None:
        with suppress(ConnectionClosed):
            wire.send(iter(['{"inve', 'rse3":', " 5}"]))
            answered = wire.ping().wait(20.0)
            for message in wire:  # raises where the connection ends without a last message
                wire.send(message)
            if answered:
                ENDED.set()

    ENDED.clear()
    with serve(talk, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()


def test_another_service_on_the_port_is_not_an_inverse3(uri: str) -> None:
    assert DRIVER.find(uri=uri) == []


def test_messages_over_a_network(uri: str) -> None:
    with Link(uri, 20.0) as link:
        complete = (message for message in iter(lambda: link.receive(20.0), 0) if message is not None)
        assert next(complete) == b'{"inverse3": 5}'
        assert link.receive(1e-3) is None
        assert link._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        texts = ("", "force", 70_000 * "f", "last")  # the third takes more than one read
        for text in texts:
            link.send(text.encode())
        assert [next(complete) for _ in texts] == [text.encode() for text in texts]
    assert ENDED.wait(20.0)
    with pytest.raises(OSError):
        link.send(b"after the end")
    link.close()
    assert link._socket.fileno() == -1
