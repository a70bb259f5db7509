"""The bridge server with the client of the examples, on a good and on a bad line."""

import random
import warnings
from collections.abc import Iterator
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.bridge.orders import Orders
from hapscene.bridge.server import SILENT_S, BridgeServer
from hapscene.errors import HapsceneError, UsageWarning
from hapscene.flags import Flag

from .here import Client, Here, Line, client_file

AIM, FRAME, HELLO, ORDER, pack = (getattr(client_file, name) for name in ("AIM", "FRAME", "HELLO", "ORDER", "pack"))
MASS_KG = 0.2


@pytest.fixture(scope="module")
def served() -> Iterator[Here]:
    served = Here()
    yield served
    served.close()


@pytest.fixture
def client(served: Here) -> Iterator[Client]:
    made = Client(served, up="y", handed="left")
    yield made
    made.close()


def push(client: Client, seconds: float = 2.0) -> tuple[float, np.ndarray, list[float]]:
    """A crate that slides along x, pushed by the hand; its velocity, the impulse it received, forces that were seen."""
    client.order("free", body="crate", mass=MASS_KG, inertia=[1e-4] * 3)
    client.frame(bodies=[("crate", (0, 0, 0), (0, 0, 0, 1), True)])
    client.order("start", p=[-0.03, 0.0, 0.0])
    client.totals.clear()
    x = v = answer = 0.0
    forces = []
    for k in range(round(60 * seconds)):
        client.here.servo.advance(16 + (k % 3 > 0))
        client.poll()
        given = client.impulse("crate")[0]
        v, answer = v + (given - answer) / MASS_KG, given
        x += v / 60
        aim = (-0.03 + 0.05 * k / 60, 0.0, 0.0)
        client.frame(aim=aim, bodies=[("crate", (x, 0, 0), (0, 0, 0, 1), (v, 0, 0), (0, 0, 0))])
        if client.state is not None:
            forces.append(client.state["force"][0])
    client.poll()
    return v, np.array(client.impulse("crate")), forces


def test_momentum_of_a_pushed_crate(client: Client) -> None:
    assert client.bodies == ["crate"] and client.swatches == ["plain", "wood"]
    v, answer, forces = push(client)
    assert v > 0.01 and MASS_KG * v == pytest.approx(answer[0], rel=0.05)  # what came after the last frame is not in it
    assert min(forces) < -0.05 and max(np.abs(answer[1:3])) < 0.1 * answer[0]
    kinds = [event[1] for event in client.events]
    assert kinds[0] == "began" and client.events[0][2:4] == ("crate", "wood")
    assert all(a != b for a, b in pairwise(kinds))


def test_totals_and_events_are_complete_on_a_bad_line(client: Client) -> None:
    """5 % of the packets in each direction are lost, 5 % duplicated, 10 % delayed."""
    rng, held, real = random.Random(7), [], client.socket

    class Bad:
        """The socket of a bad line."""

        def __getattr__(self, name: str) -> Any:
            return getattr(real, name)

        def send(self, data: bytes) -> None:
            luck = rng.random()
            if luck < 0.05:
                return
            if luck < 0.15:
                held.append(data)
                return
            real.send(data)
            if luck < 0.2:
                real.send(data)
            while held:
                real.send(held.pop())

        def recv(self, size: int) -> bytes:
            while True:
                data = real.recv(size)
                if rng.random() >= 0.05:
                    return data

    client.socket = Bad()  # type: ignore[assignment]
    push(client)
    client.socket = real
    still = ("crate", (0.5, 0.0, 0.0), (0, 0, 0, 1), True)
    client.frame(aim=(-0.1, 0.0, 0.0), bodies=[still])
    client.feel(500, aim=(-0.1, 0.0, 0.0), bodies=[still])
    assert client.state["body"] < 0
    after = client.impulse("crate")
    counts = client.order("counts")["counts"]
    assert counts["replayed"] > 0
    for _ in range(3):
        client.feel(bodies=[still])
    assert client.impulse("crate") == after and after[0] > 0.001
    kinds = [event[1] for event in client.events]
    assert kinds.count("began") == kinds.count("ended") > 0
    assert [event[0] for event in client.events] == sorted(event[0] for event in client.events)


def test_invalid_packets_are_counted_without_effect(served: Here, client: Client) -> None:
    client.order("start", p=[0.0, 0.2, 0.0])
    client.feel(aim=(0.0, 0.2, 0.0))
    before = client.order("counts")["counts"]
    rng = random.Random(1)
    far = AIM.pack(1, 0, 0, 0, 3.0, 3.0, 3.0)
    good = pack(FRAME, client.key, client.sequence + 1000, far)
    stranger = Line(served)
    stranger.send(good)  # with the key, from elsewhere
    client.socket.send(pack(FRAME, client.key ^ 1, client.sequence + 1000, far))
    client.socket.send(pack(FRAME, client.key, client.sequence, far))
    client.socket.send(pack(ORDER, client.key, client.orders, b'{"order": "start", "p": [0, 0, 0]}'))
    client.socket.send(pack(HELLO, 0, 1, b"{" * 5000))
    for k in range(2000):
        data = bytearray(good)
        for _ in range(rng.randrange(1, 4)):
            data[rng.randrange(len(data))] ^= rng.randrange(1, 256)
        client.socket.send(data[: rng.randrange(len(data))] if k % 4 == 0 else data)
    stranger.send(pack(HELLO, 0, 1, b'{"version": 1}'))
    client.feel()
    counts = client.order("counts")["counts"]
    assert counts["forged"] >= before.get("forged", 0) + 2 and counts["replayed"] > before.get("replayed", 0)
    assert counts["bad"] > before.get("bad", 0) + 1900 and counts["busy"] >= 1
    assert client.state["tool"] == pytest.approx((0.0, 0.2, 0.0), abs=5e-3)


def test_there_is_one_client_at_a_time(served: Here, client: Client) -> None:
    with pytest.raises(ConnectionError, match="another client is here"):
        Client(served, patience_s=0.3)
    served.servo.clock.sleep_s(SILENT_S)
    Client(served).close()  # the first says nothing any more
    client.__init__(served)  # type: ignore[misc]
    client.close()
    other = Client(served)
    other.close()
    with pytest.raises(ConnectionError, match="up 'x'"):
        Client(served, up="x")
    client.__init__(served)  # type: ignore[misc]  # for the fixture to close


def test_two_clients_press_one_crate() -> None:
    """The first one pushes and simulates it. The second one has only a hand, and joins and leaves meanwhile."""
    here = Here(tools=2)
    servo, one, other = here.servo, Client(here), Client(here, tool=1)
    one.order("free", body="crate", mass=MASS_KG, inertia=[1e-4] * 3)
    one.frame(bodies=[("crate", (0, 0, 0), (0, 0, 0, 1), True)])
    one.order("start", p=[-0.03, 0.0, 0.0])
    x = v = received = 0.0
    hands_N_s, steps_N = np.zeros(2), np.zeros(150)
    for k in range(150):
        since = servo.state().tick + 1
        servo.advance(16 + (k % 3 > 0))
        pushes_N = [servo.read(since, tool=tool).rows["f_body_W_N"][:, 0] for tool in (0, 1)]
        felt_N = [servo.read(since - 1, tool=tool).rows["f_W_N"] for tool in (0, 1)]
        steps_N[k] = max(float(np.abs(np.diff(f_N, axis=0)).max()) for f_N in felt_N)
        hands_N_s += [push.sum() * servo.tick_s for push in pushes_N]
        one.poll()
        total = one.impulse("crate")[0]
        v, received = v + (total - received) / MASS_KG, total
        x += v / 60
        crate = ("crate", (x, 0, 0), (0, 0, 0, 1), (v, 0, 0), (0, 0, 0))
        one.frame(aim=(-0.03 + 0.05 * k / 60 if k < 20 else x - 0.02, 0, 0), bodies=[crate])
        if k == 20:
            assert hands_N_s[0] > 1e-3 and hands_N_s[1] == 0.0  # it is not started, and touches nothing
            other.order("start", p=[x + 0.03, 0.0, 0.0])
        if k < 100:
            other.frame(aim=(x + max(0.02, 0.03 - 0.0004 * (k - 20)), 0, 0))
        if k == 100:
            assert other.poll() and other.state["force"][0] > 0.05  # type: ignore[index]
            other.close()
            one.order("counts")  # is executed after the tool is withdrawn
            left_N_s = hands_N_s[1]
    assert min(abs(hands_N_s)) > 0.1 and hands_N_s[1] == left_N_s
    # with frames of 1 ms, a hand that meets wood at 0.12 m/s feels the same 0.1 N; then the crate comes to rest
    assert steps_N[:101].max() < 0.1 and steps_N[60:101].max() < 0.01
    assert received == pytest.approx(hands_N_s.sum(), abs=1e-9) and MASS_KG * v == pytest.approx(received, abs=1e-9)
    with pytest.raises(ConnectionError, match="tool 2: expected an integer from 0 to 1"):
        Client(here, tool=2)
    here.close()


def test_invalid_poses_and_bodies(client: Client) -> None:
    client.order("start", p=[0.0, 0.2, 0.0])
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        for number in (np.nan, np.inf, 1e308, -1e200):  # one warning, none of NumPy
            three = (number, 0.0, -number)
            client.totals["crate"] = (number,) * 6
            client.feel(1, aim=three, bodies=[("crate", three, (number,) * 4, three, three)])
    assert [note.category for note in given] == [UsageWarning] and "'crate'" in str(given[0].message)
    client.totals.clear()
    bad = client.order("counts")["counts"].get("bad", 0)
    client.bodies.append("ghost")
    client.frame(bodies=[("ghost", (0, 0, 0), (0, 0, 0, 1))])
    assert client.order("counts")["counts"]["bad"] == bad + 1
    assert client.feel(1, bodies=[("crate", (0, 0, 0), (0, 0, 0, 0))])["flags"] & Flag.POSE_REFUSED
    assert not client.feel(1, bodies=[("crate", (0, 0, 0), (0, 0, 0, 1))])["flags"] & Flag.POSE_REFUSED


def test_too_many_names_are_an_error() -> None:
    scene = SimpleNamespace(bodies=[SimpleNamespace(name=f"{k:040}") for k in range(1000)], swatches=[])
    with pytest.raises(HapsceneError, match=r"names of 1,000 bodies .* shorter names"):
        BridgeServer(Orders(SimpleNamespace(tick_s=1e-3, scene=scene, tools=1, tip_radius_m=0.0)), "127.0.0.1", 0)  # type: ignore[arg-type]


def test_button_events_reach_the_client_once(served: Here, client: Client) -> None:
    state = served.servo._channel.states[0]
    client.feel()
    for number, buttons in enumerate((0b10, 0b11, 0b01), int(state.button_count)):
        state.button_log[number % len(state.button_log)] = served.servo.state().tick, 0, buttons
        state.button_count = number + 1
        client.feel()
    tick = served.servo.state().tick
    pressed = [event[1:] for event in client.events if event[0] <= tick and event[1] in ("pressed", "released")]
    assert pressed == [("pressed", "1", "", 0.0), ("pressed", "0", "", 0.0), ("released", "1", "", 0.0)]
    state.button_count = 0
