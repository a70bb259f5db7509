"""`hapscene serve` as a process, over real sockets."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bridge.here import client_file
from tests.bridge.served import Served


def test_serve_answers_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    served = Served(tmp_path)
    client = client_file.Client(port=served.port)
    assert client.order("start", p=[0.0, 0.0, 0.1]) == {"done": "start"}
    client.frame(aim=(0.0, 0.0, 0.1))
    assert client.poll(60.0)
    text = served.end()
    assert served.process.returncode == 0 and "ended; " in text and "frames " in text and "Traceback" not in text
    with pytest.raises((TimeoutError, ConnectionError)):
        client_file.Client(port=served.port, patience_s=0.3)


def test_served_tip_keeps_its_radius_above_the_surface(tmp_path: Path) -> None:
    served = Served(tmp_path, "--tip-radius", "0.004")
    client = client_file.Client(port=served.port)
    client.order("start", p=[0.0, 0.0, 0.031])
    for _ in range(600):
        client.frame(aim=(0.0, 0.0, 0.01))
        if client.poll(0.1) and client.state["depth"] > 0.0:
            break
    served.end()
    assert client.state is not None and client.state["depth"] > 0.0
    assert client.state["proxy"][2] == pytest.approx(0.029, abs=3e-6)


class WebLine:
    """A WebSocket in place of the UDP socket of a client."""

    def __init__(self, url: str) -> None:
        sync = pytest.importorskip("websockets.sync.client")
        self._wire, self._timeout_s = sync.connect(url), 0.1

    def send(self, data: bytes) -> None:
        self._wire.send(data)

    def recv(self, size: int) -> bytes:
        data = self._wire.recv(self._timeout_s)
        assert isinstance(data, bytes)
        return data

    def settimeout(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s

    def close(self) -> None:
        self._wire.close()


class WebClient(client_file.Client):
    def __init__(self, url: str, **how: Any) -> None:
        self._url = url
        super().__init__(**how)

    def _connect(self, host: str, port: int) -> Any:
        return WebLine(self._url)


def test_two_clients_press_one_crate(tmp_path: Path) -> None:
    """One client simulates the crate over UDP; the other has a hand over WebSocket."""
    served = Served(tmp_path, "--tools", "2", "--ws", "0")
    one, other = client_file.Client(port=served.port), WebClient(served.ws, tool=1)
    mass_kg, x, v, received = 0.2, 0.0, 0.0, 0.0
    one.order("free", body="crate", mass=mass_kg, inertia=[1e-4] * 3)
    one.frame(bodies=[("crate", (0, 0, 0), (0, 0, 0, 1), True)])
    one.order("start", p=[-0.03, 0.0, 0.0])
    other.order("start", p=[0.03, 0.0, 0.0])
    forces_N, start_s = [], time.monotonic()
    for k in range(180):
        time.sleep(max(start_s + k / 60 - time.monotonic(), 0.0))
        for client in (one, other):
            client.poll()
        total = one.impulse("crate")[0]
        v, received = v + (total - received) / mass_kg, total
        x += v / 60
        deep = 0.02 * min(k / 60, 1.0)
        one.frame(aim=(-0.03 + deep, 0, 0), bodies=[("crate", (x, 0, 0), (0, 0, 0, 1), (v, 0, 0), (0, 0, 0))])
        other.frame(aim=(0.03 - deep, 0, 0))
        if k > 90 and one.state and other.state:
            forces_N.append((one.state["force"][0], other.state["force"][0]))
    other.close()
    one.close()
    served.end()
    left_N, right_N = np.median(forces_N, axis=0)
    assert left_N < -0.1 and right_N > 0.1
    assert mass_kg * v == pytest.approx(received, abs=1e-9)
