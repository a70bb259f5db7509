"""The web server of a page: who is let in, what limits a page, and that sending never blocks."""

import contextlib
import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from importlib import resources
from queue import Queue
from threading import Event, Thread
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as connect_socket
from websockets.sync.server import ServerConnection

from hapscene.errors import HapsceneError
from hapscene.web import server as web_server
from hapscene.web.server import WebListener, WebServer
from tests.virtual_clock import VirtualClock

PATIENCE_S = 60.0

Opened = tuple[WebServer, "Queue[Any]"]


def content(name: str) -> tuple[bytes, str] | None:
    if name == "broken.png":
        raise HapsceneError("no picture")
    return (b"a picture", "image/png") if name == "picture.png" else None


@pytest.fixture
def opened() -> Iterator[Opened]:
    """A server that greets each page, and records the received messages and closed pages."""
    taken: Queue[Any] = Queue()
    with WebServer(
        resources.files("hapscene.play"),
        "page",
        take=lambda page, message: taken.put(message),
        joined=lambda page: page.send({"hello": 1}),
        left=lambda page: taken.put("left"),
        content=content,
        clock=VirtualClock(),
    ) as server:
        yield server, taken


def connect(server: WebServer, token: str | None = None, origin: str | None = "") -> ClientConnection:
    root = server.url if token is None else f"http://127.0.0.1:{server.address[1]}/{token}/"
    origin = "/".join(server.url.split("/")[:3]) if origin == "" else origin
    return connect_socket(f"ws{root[4:]}socket", origin=origin)  # type: ignore[arg-type]


def status(url: str, **headers: str) -> int:
    """Status of a request; 0 where the connection is closed without an answer."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code
    except OSError:
        return 0


def receive(tab: ClientConnection) -> Any:
    return json.loads(tab.recv(PATIENCE_S))


def test_serves_its_files_with_the_token(opened: Opened) -> None:
    server, _ = opened
    for name in ("", "page.html", "page.js", "page.css", "picture.png"):
        assert status(server.url + name) == 200, name
    for name in ("page_server.py", "broken.png"):
        assert status(server.url + name) == 404, name


def test_refuses_requests_without_token_of_other_hosts_and_origins(
    opened: Opened, capfd: pytest.CaptureFixture[str]
) -> None:
    server, _ = opened
    root = f"http://127.0.0.1:{server.address[1]}/"
    assert status(root) == status(root + "page.js") == status(root + "x" * 22 + "/") == 403
    assert status(server.url, Host="[::1") == 403
    assert status(server.url, Host="evil.example") == 403  # a name that was made to resolve to this machine
    for token, origin in (("x" * 22, ""), ("", ""), (None, "http://evil.example"), (None, None), (None, "null")):
        with pytest.raises(InvalidStatus, match="403"):
            connect(server, token, origin)
    assert capfd.readouterr().err == ""


def test_the_address_for_other_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    class Probe(contextlib.ExitStack):
        asked: tuple[object, ...] = ()

        def __init__(self, *kind: object) -> None:
            super().__init__()

        def connect(self, address: tuple[str, int]) -> None:
            Probe.asked = address

        def getsockname(self) -> tuple[str, int]:
            return ("10.1.2.3" if Probe.asked else "0.0.0.0", 5)

    monkeypatch.setattr(web_server.socket, "socket", Probe)
    assert [web_server.url_host(host) for host in ("0.0.0.0", "::", "::1", "here")] == [
        *("10.1.2.3", "10.1.2.3", "[::1]", "here")
    ]
    assert [web_server.is_address(name) for name in ("1.2.3.4", "::1", "here")] == [True, True, False]


def test_messages_reach_the_program_and_every_page(opened: Opened) -> None:
    server, taken = opened
    with connect(server) as one, connect(server) as other:
        assert receive(one) == receive(other) == {"hello": 1}
        for text in ("{", "[" * 3000, b"\xff\xfe", '{"a": [1]}'):
            one.send(text)
        assert taken.get(timeout=PATIENCE_S) == {"a": [1]}  # invalid JSON is ignored
        server.send({"b": 2})
        assert receive(one) == receive(other) == {"b": 2}
    assert [taken.get(timeout=PATIENCE_S) for _ in range(2)] == ["left", "left"] and server.pages == []


def test_too_long_and_too_many_messages_end_the_connection(opened: Opened) -> None:
    server, _ = opened
    for messages, code in ((["x" * 4097], "1009"), (["{}"] * (int(web_server.MESSAGES_MAX_HZ) + 1), "1008")):
        tab = connect(server)
        with pytest.raises(ConnectionClosed, match=code):
            for message in messages:
                tab.send(message)
            while True:
                tab.recv(PATIENCE_S)


def test_connections_are_limited(opened: Opened) -> None:
    server, _ = opened
    tabs = [connect(server) for _ in range(web_server.CONNECTIONS_MAX)]
    assert status(server.url) == 0
    threads = list(server._listener._threads.values())
    for tab in tabs:
        tab.close()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert status(server.url) == 200


def test_a_page_that_does_not_read_is_disconnected(opened: Opened) -> None:
    """Sending to it does not block."""
    server, taken = opened
    tab = connect(server)
    assert receive(tab)
    (page,) = server.pages
    for _ in range(2 * web_server.WAITING_MAX):
        page.send_text("x" * 1_000_000)
    assert taken.get(timeout=PATIENCE_S) == "left"
    with pytest.raises(ConnectionClosed):
        while True:
            tab.recv(PATIENCE_S)


def test_messages_before_the_end_arrive() -> None:
    joined = Event()
    files = resources.files("hapscene.play")
    server = WebServer(files, "page", take=lambda page, message: None, joined=lambda page: joined.set())
    server.open()
    with connect(server) as tab:
        assert joined.wait(PATIENCE_S)  # a ping is answered before the page is registered
        for number in range(10):
            server.send(number)
        threads = [server._listener._thread, *server._listener._threads.values()]
        server.close()
        assert len(threads) > 1 and not any(thread.is_alive() for thread in threads)
        assert [receive(tab) for _ in range(10)] == list(range(10))


def test_a_port_in_use_is_an_error(opened: Opened) -> None:
    with pytest.raises(HapsceneError, match="--page-port"):
        WebServer(
            resources.files("hapscene.play"),
            "page",
            take=lambda page, message: None,
            port=opened[0].address[1],
            option="--page-port",
        )


def talk(connection: ServerConnection) -> None:
    with contextlib.suppress(ConnectionClosed):
        connection.recv()


def test_connection_during_shutdown_is_closed() -> None:
    """It is let in, and all is closed before it is served."""
    closers: list[Thread] = []

    def close(let_in: bool) -> None:
        closers.append(Thread(target=listener.close))
        closers[0].start()
        closers[0].join(0.5)  # as far as it comes

    listener = WebListener(talk, "127.0.0.1", 0, connections_max=1, what="it", option="--port", on_connection=close)
    listener.open()
    address = "ws://{}:{}".format(*listener.address)
    refused = (ConnectionClosed, InvalidMessage, ConnectionError)  # and not that it waits in vain
    with pytest.raises(refused), connect_socket(address, open_timeout=60) as page:
        page.recv(timeout=60)
    closers[0].join(60)
    assert not closers[0].is_alive()
