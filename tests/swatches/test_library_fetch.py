"""Swatches fetched from a real server on this machine that cuts off, lies and bombs."""

import gzip
import hashlib
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene import cli
from hapscene.dsp.ar_filter import ar_from_reflection
from hapscene.errors import SwatchError
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import swatch_to_json
from hapscene.surface.texture import Texture
from hapscene.swatches import library
from hapscene.swatches.library import get, load_swatch, own_entries, read_index


def oak() -> Swatch:
    rng = np.random.default_rng(0)
    a = ar_from_reflection(rng.uniform(-0.5, 0.5, (30, 60)))
    texture = Texture.from_models(
        1e4, rng.uniform(1, 2, 30), rng.uniform(0.1, 0.2, 30), a=a, variance_m2_s4=rng.uniform(0, 1, 30)
    )
    return Swatch("oak", texture=texture, licence="MIT")


class Server:
    """A web server whose answers a test can bend; `files` by name, `bend` by name."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.bend: dict[str, Callable[[Any, bytes], None]] = {}
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                name = self.path.lstrip("/")
                data = outer.files.get(name)
                if data is None:
                    self.send_error(404)
                elif name in outer.bend:
                    outer.bend[name](self, data)
                else:
                    send(self, data)

            def log_message(self, *arguments: object) -> None:
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.http.server_address[1]}/"

    def publish(self, name: str, data: bytes, **changes: object) -> None:
        """Puts a file up and an index that names it."""
        file = f"{name}.swatch"
        self.files[file] = data
        row = {"name": name, "file": file, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)} | changes
        content = {"format": "hapscene library", "version": 1, "swatches": [row]}
        self.files["index.json"] = json.dumps(content).encode()


def send(handler: Any, data: bytes, code: int = 200, length: int | None = None, **headers: str) -> None:
    handler.send_response(code)
    handler.send_header("Content-Length", str(len(data) if length is None else length))
    for key, value in headers.items():
        handler.send_header(key.replace("_", "-"), value)
    handler.end_headers()
    handler.wfile.write(data)


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    thread = threading.Thread(target=server.http.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server
    server.http.shutdown()
    thread.join()
    server.http.server_close()


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "home"))
    return tmp_path / "home"


def fetched(server: Server, name: str = "oak") -> Swatch:
    address, entries = read_index(server.url + "index.html")  # as it stands in a browser
    get(name, address, entries)
    return load_swatch(name)


DATA = swatch_to_json(oak()).encode()


def test_download(server: Server, home: Path) -> None:
    server.publish("oak", DATA)
    assert fetched(server) == oak()
    assert sorted(f.name for f in home.iterdir() if f.name != library.LOCK) == ["index.json", "oak.swatch"]
    assert (home / "oak.swatch").read_bytes() == DATA


def refused(server: Server, home: Path, name: str = "oak") -> str:
    """Fetching raises an error, whose text is returned, and leaves the library as it was."""
    with pytest.raises(SwatchError) as caught:
        fetched(server, name)
    assert own_entries() == []
    assert not home.exists() or not [f for f in home.iterdir() if f.name != library.LOCK]
    return str(caught.value)


@pytest.mark.parametrize("data", [DATA[:-100], DATA.replace(b"MIT", b"BSD")], ids=["truncated", "changed"])
def test_content_must_match_the_index(server: Server, home: Path, data: bytes) -> None:
    server.publish("oak", DATA)
    server.files["oak.swatch"] = data
    refused(server, home)
    server.files["oak.swatch"] = DATA  # the refused file does not stay in the way
    assert fetched(server) == oak()


def test_longer_file_raises(server: Server, home: Path) -> None:
    server.publish("oak", DATA)

    def endless(handler: Any, data: bytes) -> None:
        handler.send_response(200)
        handler.end_headers()
        with suppress(OSError):
            for _ in range(1000):
                handler.wfile.write(b" " * 100_000)

    server.bend["oak.swatch"] = endless
    refused(server, home)


def test_compressed_content_raises(server: Server, home: Path) -> None:
    bomb = gzip.compress(b" " * (64 << 20))
    server.publish("oak", DATA)
    server.bend["oak.swatch"] = lambda handler, data: send(handler, bomb, Content_Encoding="gzip")
    refused(server, home)
    server.publish("oak", bomb)  # not a swatch as a separate file
    del server.bend["oak.swatch"]
    refused(server, home)
    server.bend["index.json"] = lambda handler, data: send(handler, bomb, Content_Encoding="gzip")
    refused(server, home)


def test_file_name_with_path_raises(server: Server, home: Path, tmp_path: Path) -> None:
    server.publish("oak", DATA, file="../oak.swatch")
    refused(server, home)
    assert not list(tmp_path.rglob("*.swatch"))


def test_invalid_answers(server: Server, home: Path) -> None:
    with pytest.raises(SwatchError):
        read_index(server.url)
    server.files["index.json"] = b"<html>"
    with pytest.raises(SwatchError):
        read_index(server.url + "index.json")
    server.publish("oak", DATA)
    refused(server, home, "elm")
    del server.files["oak.swatch"]
    refused(server, home)
    for url in ("file:///etc/passwd", "ftp://x/y", "oak", "http://"):
        with pytest.raises(SwatchError):
            read_index(url)
    server.http.shutdown()
    server.http.server_close()
    with pytest.raises(SwatchError):
        read_index(server.url)


def to(place: str) -> Callable[[Any, bytes], None]:
    """Sends elsewhere."""
    return lambda handler, data: send(handler, b"", 302, Location=place)


def test_redirections(server: Server, home: Path) -> None:
    server.publish("oak", DATA)
    server.bend["oak.swatch"] = to("/oak.swatch")
    refused(server, home)
    for place in ("file:///etc/passwd", "ftp://127.0.0.1/x", "gopher:x\x9b"):
        server.bend["oak.swatch"] = to(place)
        refused(server, home)
    server.bend["oak.swatch"] = to("http://[")
    refused(server, home)
    with pytest.raises(SwatchError):
        library._redirected("https://example.org/a", "http://example.org/a")
    server.bend["oak.swatch"] = to("/moved")
    server.files["moved"] = DATA
    assert fetched(server) == oak()


def test_text_of_the_server_is_escaped(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    server.files["index.json"] = b""
    server.bend["index.json"] = lambda handler, data: handler.wfile.write(
        b"HTTP/1.1 500 \x1b]0;title\x07\x9b" + b"x" * 5000 + b"\r\n\r\n"
    )
    assert cli.main(["swatch", "get", "--from", server.url]) == 2
    said = capsys.readouterr().err
    assert r"the server returns 500 \x1b]0;title\x07\u009bxxx" in said and len(said) < 300 and said[:-1].isprintable()


def test_command(server: Server, home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    server.publish("oak", DATA)
    assert cli.main(["swatch", "get", "--from", server.url]) == 0
    assert "oak" in capsys.readouterr().out and not home.exists()
    assert cli.main(["swatch", "get", "oak", "elm", "--from", server.url]) == 2
    said = capsys.readouterr()
    assert "oak.swatch" in said.out and "no swatch 'elm'" in said.err and load_swatch("oak") == oak()
    assert cli.main(["swatch", "get", "--all", "--from", server.url]) == 2
    assert "already in the library" in capsys.readouterr().err
    assert cli.main(["swatch", "get", "--all", "--replace", "--from", server.url]) == 0
