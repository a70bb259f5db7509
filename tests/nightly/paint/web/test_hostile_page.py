"""Hostile clients: the painter keeps running, and logs one line for each kind of error without their content."""

import contextlib
import http.client
import os
import re
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import trimesh

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from hapscene.paint.web.server import FRAME_BYTES_MAX
from tests.until import until

ESCAPE = "\x1b]0;owned\x07\x1b[31m"
GET = b"GET / HTTP/1.1\r\n"
PATIENCE_S = 120.0


class Painter(NamedTuple):
    """A painter in a process: where it is, and its key."""

    process: "subprocess.Popen[str]"
    host: str
    token: str
    folder: Path
    slow: socket.socket

    def ask(self, path: str, **headers: str) -> tuple[int, str]:
        """Status and text of a request."""
        wire = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        wire.request("GET", path, headers=headers)
        answer = wire.getresponse()
        return answer.status, answer.read().decode()

    def raw(self, content: bytes) -> bytes:
        """What comes back until the connection is closed."""
        name, port = self.host.split(":")
        back = b""
        with contextlib.suppress(ConnectionError), socket.create_connection((name, int(port)), PATIENCE_S) as wire:
            wire.sendall(content)
            while got := wire.recv(1 << 16):
                back += got
        return back

    def open(self, path: str = "/hapscene", protocol: str | None = None, **options: Any) -> ClientConnection:
        """A socket, as the page has it."""
        options = {"origin": f"http://{self.host}", "max_size": None, "ping_interval": None, **options}
        protocols: Any = [protocol] if protocol else None
        return connect(f"ws://{self.host}/{self.token}{path}", subprotocols=protocols, **options)

    def open_viser(self) -> ClientConnection:
        return self.open("", protocol=f"viser-v{viser.__version__}")

    def memory_B(self) -> int:
        """Memory that it holds."""
        pages = Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]
        return int(pages) * os.sysconf("SC_PAGE_SIZE")

    def ended_by(self, wire: ClientConnection, content: bytes) -> int:
        """The code that a socket is closed with after these bytes."""
        with contextlib.suppress(ConnectionError):
            wire.socket.sendall(content)
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                wire.recv(timeout=PATIENCE_S)
        return closed.value.rcvd.code if closed.value.rcvd else 1006


@pytest.fixture(scope="module")
def painter(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Painter]:
    folder = tmp_path_factory.mktemp("hostile")
    trimesh.creation.box((0.02, 0.02, 0.02)).export(folder / "cube.ply")
    command = [sys.executable, "-m", "hapscene", "paint", "cube.ply", "--unit", "m", "--port", "0", "--no-hand"]
    with (folder / "said").open("w") as said, (folder / "complained").open("w") as complained:
        process = subprocess.Popen([*command, "--no-browser"], cwd=folder, stdout=said, stderr=complained, text=True)
    try:
        found = until(lambda: re.search(r"http://([^/]+)/([^/]+)/", (folder / "said").read_text()))
        name, port = found[1].split(":")
        with socket.create_connection((name, int(port)), PATIENCE_S) as slow:
            slow.sendall(GET)  # the rest never comes
            yield Painter(process, found[1], found[2], folder, slow)
    finally:
        process.kill()
        process.wait()


def frame(opcode: int, content: bytes, final: bool = True, rsv: int = 0, length: int | None = None) -> bytes:
    """Return a WebSocket frame with a zero mask; `length` is the length stated in its header."""
    size = len(content) if length is None else length
    head = bytes([final << 7 | rsv << 4 | opcode])
    if size < 126:
        return head + bytes([0x80 | size]) + bytes(4) + content
    return head + b"\xff" + struct.pack(">Q", size) + bytes(4) + content


# --- without the token ---


@pytest.mark.parametrize("change", ["", "x", "{}x", "{}%00", "?token={}", "{:.21}", "hapscene.js/{}", "../{}/.."])
def test_without_the_token_nothing_is_given_but_where_to_find_it(painter: Painter, change: str) -> None:
    path = "/" + change.format(painter.token)
    status, text = painter.ask(path, Cookie=f"token={painter.token}")
    assert status == 403 and "token is missing or invalid" in text and painter.token not in text
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://{painter.host}{path}", origin=f"http://{painter.host}")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "path", ["%2e%2e/%2e%2e/etc/passwd", "..%5c..%5cetc", "//etc/passwd", "%00", "%2fetc%2fpasswd", "." * 3000]
)
def test_path_traversal_is_refused(painter: Painter, path: str) -> None:
    assert painter.ask(f"/{painter.token}/{path}")[0] == 404


# --- the wire ---


@pytest.mark.parametrize(
    "content",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc" + bytes(500) + b"\n",  # TLS
        ESCAPE.encode() + b"\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 999999999\r\n\r\n",
        GET + b"X: " + b"x" * 3_000_000,
        b"GET /" + b"x" * 3_000_000,
        GET + b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: =\r\nSec-WebSocket-Version: 99\r\n\r\n",
    ],
)
def test_invalid_request_gets_no_response(painter: Painter, content: bytes) -> None:
    assert b" 200 " not in painter.raw(content) and painter.ask("/")[0] == 403


@pytest.mark.parametrize("opened", [Painter.open, Painter.open_viser])
@pytest.mark.parametrize(
    ("content", "code"),
    [
        (frame(1, b"x" * (FRAME_BYTES_MAX + 1)), 1009),
        (frame(2, b"", final=False) + frame(0, b"x" * 1000, final=False) * 1100, 1009),
        (frame(1, b"\xff\xfe"), 1007),
        (b"\x81\x01x", 1002),  # without a mask
    ],
)
def test_invalid_frame_closes_only_its_connection(painter: Painter, opened: Any, content: bytes, code: int) -> None:
    with opened(painter) as other, opened(painter) as wire:
        assert "permessage-deflate" not in (wire.response and wire.response.headers.get("Sec-WebSocket-Extensions", ""))
        assert painter.ended_by(wire, content) == code
        other.recv(timeout=PATIENCE_S)


def test_after_all_that_it_serves_its_page_and_has_said_little(painter: Painter) -> None:
    assert painter.slow.recv(1) == b""  # it waited long enough
    assert painter.ask(f"/{painter.token}/")[0] == 200
    painter.process.terminate()
    assert painter.process.wait(PATIENCE_S) == 0
    complained = (painter.folder / "complained").read_text()
    assert "Traceback" not in complained and ESCAPE not in complained
    assert ESCAPE not in (painter.folder / "said").read_text()
