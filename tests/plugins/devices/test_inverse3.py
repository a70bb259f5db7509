"""The Inverse3 driver: messages as published, in both versions; a missing service; WebSocket frames."""

import json
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.inverse3 import DRIVER
from hapscene_plugins.devices.inverse3_link import Link
from hapscene_plugins.devices.inverse3_messages import force_message


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


@pytest.fixture
def echo_uri() -> Iterator[str]:
    """URI of a server of another implementation, which answers each message in fragments and whole."""
    serve = pytest.importorskip("websockets.sync.server", reason="no websockets: extra `serve`").serve

    def answer(socket: Any) -> None:
        socket.send("x" * 70_000)
        for message in socket:
            socket.ping()  # answered by the link
            socket.send([message, "", "…"])  # in fragments
            socket.send(message.encode())

    with serve(answer, "127.0.0.1", 0, compression=None) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()


def test_frames_are_those_of_the_standard(echo_uri: str) -> None:
    with Link(echo_uri, 5.0) as link:

        def message() -> bytes | None:
            return next(filter(None, (link.receive(1.0) for _ in range(10))), None)

        assert message() == b"x" * 70_000
        for text in ("a", "b" * 125, "c" * 126, "d" * 1_000):
            link.send(text.encode())
            assert message() == (text + "…").encode()
            assert message() == text.encode()
        assert link.receive(0.0) is None


def test_the_end_of_the_service_is_an_error(echo_uri: str) -> None:
    with Link(echo_uri, 5.0) as link:
        link.send(b"", 8)  # the server closes after it has received the closing frame
        with pytest.raises(OSError):
            for _ in range(10):
                link.receive(1.0)
