"""Access control of the server, tested alone and in front of a real server."""

import http.client
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from hapscene.errors import ViewError
from hapscene.paint.web.server import LOOPBACK, SOCKET_PATH, PageServer, host_names
from hapscene.web import server as web_server
from hapscene.web.server import refusal_reason


@pytest.mark.parametrize("host", ["localhost:80", "127.0.0.1:8080", "[::1]:1", "LOCALHOST:80", "localhost"])
def test_our_own_names_are_served(host: str) -> None:
    assert refusal_reason({"Host": host}, LOOPBACK, False, upgrade=False) is None
    assert refusal_reason({"Host": host, "Origin": f"http://{host}"}, LOOPBACK, False, upgrade=True) is None


@pytest.mark.parametrize("host", ["", "evil.example", "localhost.evil.example", "127.0.0.1.nip.io", "10.0.0.7:80"])
def test_other_names_are_not(host: str) -> None:
    assert refusal_reason({"Host": host}, LOOPBACK, False, upgrade=False)


@pytest.mark.parametrize(
    "origin", ["", "null", "http://evil.example", "http://localhost:81", "http://127.0.0.1:80", "file://localhost:80"]
)
def test_a_page_of_another_origin_gets_no_socket(origin: str) -> None:
    assert refusal_reason({"Host": "localhost:80", "Origin": origin}, LOOPBACK, False, upgrade=True)


def test_public_server_accepts_its_address_and_host_name_only() -> None:
    names = host_names("192.168.1.5")
    assert refusal_reason({"Host": "192.168.1.5:80"}, names, True, upgrade=False) is None
    assert refusal_reason({"Host": f"{socket.gethostname()}:80"}, names, True, upgrade=False) is None
    assert refusal_reason({"Host": "rebound.example:80"}, names, True, upgrade=False)


@pytest.mark.parametrize("host", ["203.0.113.9", "no-such-host.invalid", "a..b", "x" * 300])
def test_address_of_another_machine_is_refused_at_once(host: str) -> None:
    """viser would try a thousand ports, and then wait for ever."""
    with ThreadPoolExecutor(1) as pool, pytest.raises(ViewError, match=r"cannot be served.*--host 127\.0\.0\.1"):
        pool.submit(PageServer, host, 0).result(timeout=60)


@pytest.fixture(scope="module")
def opened() -> Iterator[PageServer]:
    async def echo(connection: Any) -> None:
        async for message in connection:
            await connection.send(message)

    with PageServer("127.0.0.1", 0) as made:
        made.handlers[SOCKET_PATH] = echo
        made.admit()
        yield made


@pytest.fixture
def server(opened: PageServer) -> Any:
    return opened.viser


@pytest.fixture
def token(opened: PageServer) -> str:
    return opened.url.rstrip("/").rpartition("/")[2]


def ask(server: Any, path: str, host: str | None = None) -> tuple[int, bytes, Any]:
    port = server.get_port()
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", path, headers={"Host": host or f"127.0.0.1:{port}"})
    answer = connection.getresponse()
    return answer.status, answer.read(), answer.headers


def test_addresses_for_this_and_for_other_computers(
    opened: PageServer, token: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    port, lan = opened.viser.get_port(), "192.168.1.5"
    for host, url, network_url in (("127.0.0.1", "127.0.0.1", None), ("0.0.0.0", "localhost", lan), (lan, lan, lan)):
        monkeypatch.setattr(opened.viser, "get_host", lambda host=host: host)
        monkeypatch.setattr(web_server.socket.socket, "getsockname", lambda probe: (lan, 0))
        assert opened.url == f"http://{url}:{port}/{token}/"
        assert opened.network_url == (network_url and f"http://{network_url}:{port}/{token}/")
    assert web_server.url_host("fe80::1") == "[fe80::1]"


def test_page_of_viser_includes_the_scripts_of_the_painter(server: Any, token: str) -> None:
    status, content, headers = ask(server, f"/{token}/")
    assert status == 200 and b"/hapscene.js" in content and len(content) > 500_000
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    status, content, headers = ask(server, "/hapscene.css?v=1")
    assert status == 200 and b"#hs" in content and headers["Content-Type"].startswith("text/css")
    assert ask(server, f"/{token}/nothing")[0] == 404
    assert ask(server, f"/{token}/", "[::1")[0] == 403
    assert ask(server, f"/{token}/../../etc/passwd")[0] == 404


@pytest.mark.parametrize("path", ["/", "/none/", "/hapscene", "/index.html"])
def test_without_the_token_there_is_no_page(server: Any, path: str) -> None:
    status, content, _ = ask(server, path)
    assert status == 403 and len(content) < 500 and b"/hapscene.js" not in content


@pytest.mark.parametrize("path", ["/{}", "/{}" + SOCKET_PATH])
@pytest.mark.parametrize("origin", [None, "http://evil.example"])
def test_another_origin_gets_no_socket(server: Any, token: str, path: str, origin: str | None) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{server.get_port()}{path.format(token)}", origin=origin)  # type: ignore[arg-type]


def test_our_own_page_gets_both_sockets(server: Any, token: str) -> None:
    url = f"127.0.0.1:{server.get_port()}"
    with connect(f"ws://{url}/{token}{SOCKET_PATH}", origin=f"http://{url}") as ours:  # type: ignore[arg-type]
        ours.send("hello")
        assert ours.recv(timeout=20) == "hello"
    import viser

    protocol: Any = f"viser-v{viser.__version__}"
    with connect(f"ws://{url}/{token}", origin=f"http://{url}", subprotocols=[protocol]) as theirs:  # type: ignore[arg-type]
        assert isinstance(theirs.recv(timeout=20), bytes)


def test_server_is_bound_to_loopback_only(server: Any) -> None:
    with pytest.raises(OSError):  # this computer too, but another address: one bound to all of them would answer
        socket.create_connection(("127.0.0.2", server.get_port()), timeout=2.0)
    socket.create_connection(("127.0.0.1", server.get_port()), timeout=2.0).close()


def test_no_tunnel_is_opened_on_demand(server: Any) -> None:
    from viser import _messages

    handlers = server._websock_server._incoming_handlers
    assert _messages.ShareUrlRequest not in handlers and _messages.ShareUrlDisconnect not in handlers


def test_early_client_gets_the_page_and_waits() -> None:
    async def greet(connection: Any) -> None:
        await connection.send("hello")

    with PageServer("127.0.0.1", 0) as made:
        place = made.url.removeprefix("http://").rstrip("/")
        assert ask(made.viser, f"/{place.partition('/')[2]}/")[0] == 200
        host = place.partition("/")[0]
        with connect(f"ws://{place}{SOCKET_PATH}", origin=f"http://{host}") as early:  # type: ignore[arg-type]
            made.handlers[SOCKET_PATH] = greet  # what was not there when it came
            made.admit()
            assert early.recv(timeout=120) == "hello"
    made.close()  # once more is nothing
