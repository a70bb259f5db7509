"""A client of the bridge as a device: its aim is the tool, the STATE is the force."""

import importlib.util
import json
import math
import random
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.bridge.packets import BYE, FRAME, HELLO, REFUSED, STATE, WELCOME, Frame, Packet, pack, unpack
from hapscene.errors import DeviceError
from hapscene_plugins.devices.network import DRIVER, FORCE_N, GONE_S, SILENT, WAITING
from tests.virtual_clock import VirtualClock

_FILE = Path(__file__).parents[2] / "bridge" / "client_packets.py"
_SPEC = importlib.util.spec_from_file_location("client_packets", _FILE)
assert _SPEC is not None and _SPEC.loader is not None
client_packets = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(client_packets)

UNITY = {"version": 1, "nonce": 5, "up": "y", "handed": "left", "metres": 0.1}


class Client:
    def __init__(self, device: Any) -> None:
        self.device, self.key, self.sequence = device, 0, 0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(device.address)
        self.socket.settimeout(1.0)

    def say(self, kind: int, payload: bytes = b"") -> None:
        self.sequence += 1
        self.socket.send(pack(Packet(kind, self.key, self.sequence, payload)))

    def receive(self) -> Packet:
        return unpack(self.socket.recv(65536))

    def hello(self, **words: Any) -> Packet:
        self.say(HELLO, json.dumps(UNITY | words).encode())
        turn(self.device)
        answer = self.receive()
        self.key = answer.key
        return answer

    def frame(self, *aim: float) -> None:
        self.say(FRAME, client_packets.pack_frame(Frame(aim, 0, ())))

    def close(self) -> None:
        self.socket.close()


def turn(device: Any, f_D_N: Any = (0.0, 0.0, 0.0)) -> None:
    device.read()
    device.state.f_D_N = f_D_N
    device.write()


@pytest.fixture
def clock() -> VirtualClock:
    """Who is slow here is not silent."""
    return VirtualClock()


@pytest.fixture
def device(clock: VirtualClock) -> Iterator[Any]:
    with DRIVER.open(**DRIVER.read_options({"port": "0"}), clock=clock) as device:
        yield device


@pytest.fixture
def client(device: Any) -> Iterator[Client]:
    client = Client(device)
    yield client
    client.close()


def test_aim_is_the_tool_and_the_state_the_force_in_the_client_s_frame(device: Any, client: Client) -> None:
    turn(device)
    assert device.state.ready[0] == 0 and "no client" in device.reason(int(device.state.trouble[0]))
    assert client.hello().kind == WELCOME
    client.frame(1.0, 2.0, 3.0)
    turn(device, (1.0, 2.0, -1.0))
    answer = client.receive()
    state = client_packets.unpack_state(answer.payload)
    assert (answer.kind, answer.sequence, state.tick) == (STATE, client.sequence, 3)
    np.testing.assert_allclose(device.state.p_DT_m[0], (0.1, 0.3, 0.2))  # Unity: y up, z away
    np.testing.assert_allclose(state.force, (1.0, -1.0, 2.0))
    np.testing.assert_allclose(state.tool, (1.0, 2.0, 3.0))
    assert device.state.ready[0] == 1 and device.state.count[0] == 1


def test_force_is_within_the_limit_and_none_that_is_none(device: Any, client: Client) -> None:
    client.hello()
    for f_D_N, size in (((300.0, 0.0, 400.0), FORCE_N), ((math.nan, 0.0, 0.0), 0.0), ((math.inf, 0.0, 0.0), 0.0)):
        client.frame(0.0, 0.0, 0.0)
        turn(device, f_D_N)
        assert np.linalg.norm(client_packets.unpack_state(client.receive().payload).force) == pytest.approx(size)
    client.frame(0.0, 0.0, 0.0)
    turn(device, (1.0, 0.0, 0.0))
    turn(device, (2.0, 0.0, 0.0))  # a change waits for the next FRAME
    turn(device)  # but not the end of the force
    turn(device)
    forces = [np.linalg.norm(client_packets.unpack_state(client.receive().payload).force) for _ in range(2)]
    assert forces == [1.0, 0.0]
    client.socket.setblocking(False)
    with pytest.raises(BlockingIOError):
        client.receive()


def test_silent_client_gets_no_force_until_it_resumes(device: Any, client: Client, clock: VirtualClock) -> None:
    client.hello()
    client.frame(0.0, 0.0, 0.0)
    turn(device)
    assert device.state.ready[0] == 1
    clock.sleep_s(0.016)
    turn(device)
    assert device.state.ready[0] == 0 and device.state.trouble[0] == SILENT and "FRAME" in device.reason(SILENT)
    client.frame(0.0, 0.0, 0.0)
    turn(device)
    assert device.state.ready[0] == 1
    client.say(BYE)
    turn(device)
    assert device.state.ready[0] == 0 and device.state.trouble[0] == WAITING


def test_places_that_are_none_and_packets_that_come_late_change_nothing(device: Any, client: Client) -> None:
    client.hello()
    client.frame(0.1, 0.0, 0.0)
    turn(device)
    for aim in ((math.nan, 0.0, 0.0), (1e9, 0.0, 0.0)):
        client.frame(*aim)
        turn(device)
    client.sequence = 0
    client.frame(0.2, 0.0, 0.0)
    turn(device)
    np.testing.assert_allclose(device.state.p_DT_m[0], (0.01, 0.0, 0.0))
    assert device.state.count[0] == 1


def test_one_client_at_a_time(device: Any, client: Client, clock: VirtualClock) -> None:
    refused = client.hello(version=2)
    assert refused.kind == REFUSED and b"version" in refused.payload and refused.key == 0
    key = client.hello().key
    assert client.hello().key == key != 0  # its answer was lost
    other = Client(device)
    refused = other.hello(nonce=6)
    assert refused.kind == REFUSED and b"another client is here" in refused.payload
    other.key = client.key
    other.frame(0.0, 0.0, 0.0)
    turn(device)
    assert other.receive().kind == REFUSED and device.state.ready[0] == 0
    clock.sleep_s(GONE_S - 1e-6)
    assert other.hello(nonce=6).kind == REFUSED
    clock.sleep_s(1e-6)
    assert other.hello(nonce=6).kind == WELCOME and other.key not in (0, key)
    other.close()


def test_closing_sends_zero_force_and_bye(client: Client) -> None:
    client.hello()
    client.frame(0.0, 0.0, 0.0)
    turn(client.device, (1.0, 0.0, 0.0))
    assert np.any(client_packets.unpack_state(client.receive().payload).force)
    client.device.close()
    client.device.close()
    assert client.device._socket.fileno() == -1
    assert not np.any(client_packets.unpack_state(client.receive().payload).force)
    assert client.receive().kind == BYE


@pytest.mark.parametrize("count", [2_000, pytest.param(100_000, marks=pytest.mark.soak)])
def test_mangled_packets_give_no_force(device: Any, client: Client, count: int) -> None:
    """One bit or more of a good FRAME is wrong: the checksum fails, and no state is accepted."""
    client.hello()
    rng = random.Random(3)
    for i in range(count):
        good = pack(Packet(FRAME, client.key, i + 2, client_packets.pack_frame(Frame((0.0,) * 3, 0, ()))))
        data = bytearray(good)
        for at in rng.sample(range(len(data)), rng.randrange(1, 4)):
            data[at] ^= rng.randrange(1, 256)
        client.socket.send(bytes(data[: rng.choice((None, rng.randrange(len(data))))]))
        turn(device, (1.0, 1.0, 1.0))
        assert device.state.ready[0] == 0 and device.state.count[0] == 0
        np.testing.assert_array_equal(device.state.p_DT_m[0], 0.0)


def test_a_port_in_use_is_an_error(device: Any) -> None:
    with pytest.raises(DeviceError, match=r"network: cannot listen at 127.0.0.1:\d+: .*port="):
        DRIVER.open(port=device.address[1])
