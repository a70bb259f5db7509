"""`hapscene serve` as a process, over real sockets."""

from pathlib import Path

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
