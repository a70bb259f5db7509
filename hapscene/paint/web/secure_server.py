"""The page's server: one port, with our own files and socket beside viser's, for those who know the page's address.

Whoever runs a web page can have a visitor's browser talk to a server on the visitor's machine: a WebSocket to a foreign
origin is allowed by browsers, and a name whose address changes (DNS rebinding) makes even reading possible. So every
request must name one of our hosts, and a WebSocket must come from a page of that same host.

A program can name any host and origin, and on a computer of several users everybody reaches the port. So the address
holds a token, drawn at each start: scene and sockets are below it. It is no cookie, since a browser would hand that to
the servers on all other ports of the computer, too. The page keeps it in the browser's storage, which is of this port
alone, and takes it out of the address bar; our own files, the same for everybody, need none.
"""

import asyncio
import contextlib
import hmac
import http
import io
import logging
import secrets
import socket
import threading
import warnings
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final, Self

from hapscene.errors import ViewError
from hapscene.paint.web.counted_log import CountedLog
from hapscene.paint.web.viser_inside import CheckedConnection, harden
from hapscene.web.listener import refusal_reason

PORT_MAX: Final = 65535

PORT_TRIES: Final = 100
"""How many ports are tried, from the one asked for on [count]."""

SOCKET_PATH: Final = "/hapscene"
"""Where our own WebSocket is; every other is viser's."""

LOOPBACK: Final = frozenset({"localhost", "127.0.0.1", "::1"})

POLICY: Final = (
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval'; "
    "connect-src 'self' data: blob:; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
)
"""What the page may load: what this server gives, and nothing from the net; no other page may show it in a frame."""

FRAME_BYTES_MAX: Final = 1 << 20
"""Longest message that is received [bytes]; a page sends some hundred."""

CONNECTIONS_MAX: Final = 200
"""How many connections there may be [count]: each takes one of the files that the process may open, 1024 or less."""

DOOR: Final = b"""<!doctype html><meta charset="utf-8"><title>hapscene paint</title>
<p>This page opens at the address that the terminal printed, with all its letters: use that one.</p>
<script>
const known = localStorage.getItem("hapscene");
if (known && known !== location.pathname) location.replace(known);
</script>
"""
"""What is answered without the token, to whomever; a browser that had it before finds it again."""

MIME_TYPES: Final = {"css": "text/css; charset=utf-8", "js": "application/javascript; charset=utf-8"}
"""Types of what is served, by suffix."""

HEAD: Final = b"""<link rel="stylesheet" href="/hapscene.css"><script>
const real = matchMedia.bind(window);
window.matchMedia = (query) => real(query === "(max-width: 36em)" ? "(max-width: 760px)" : query);
</script><script src="/hapscene.js" type="module"></script>
<link rel="stylesheet" href="/hapscene-shelf.css"><script src="/hapscene-shelf.js" type="module"></script>
<script src="/hapscene-upload.js" type="module"></script><script src="/hapscene-bodies.js" type="module"></script>"""
"""What is put into viser's page. Where a window is too narrow for both, its panel is a sheet below the picture."""

TOKEN_BYTES: Final = 16
"""Of the secret in the page's address [bytes]: 128 bits cannot be guessed."""

_building = threading.Lock()


@dataclass(frozen=True)
class StaticFile:
    """What is served: its type and content."""

    kind: str
    content: bytes


def host_names(host: str) -> frozenset[str]:
    """The host names that a browser may call this server by, lower case. Addresses of a public server come besides."""
    if host in LOOPBACK:
        return LOOPBACK
    return LOOPBACK | {host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}


@contextlib.contextmanager
def guarded(
    host: str,
    token: str,
    files: Mapping[str, StaticFile],
    index: Callable[[bytes], bytes],
    handlers: Mapping[str, Callable[[Any], Awaitable[None]]],
    log: logging.Logger,
    admitted: Callable[[], Awaitable[object]] | None = None,
) -> Iterator[None]:
    """While this lasts, a viser server that is made listens behind the gate, and says nothing on the terminal.

    viser has no check of hosts or origins and no way to add one, so its call of `websockets.serve` is led through here.

    Args:
        host: what the server is bound to.
        token: what a path begins with, or gets nothing but `files`.
        files: what is served besides viser's client, by path.
        index: changes viser's page.
        handlers: have the connections that are not viser's, by path.
        log: is told what goes wrong.
        admitted: what a connection waits for before it is handled; files are served meanwhile.
    """
    import viser
    import websockets.asyncio.server as asyncio_server
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    names, public = host_names(host), host not in LOOPBACK
    real = asyncio_server.serve

    def answer(status: http.HTTPStatus, kind: str, content: bytes) -> Response:
        headers = Headers({"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": "no-store"})
        headers["Content-Security-Policy"] = POLICY
        headers["X-Content-Type-Options"] = "nosniff"
        headers["Referrer-Policy"] = "no-referrer"
        return Response(int(status), status.phrase, headers, content)

    class Connection(asyncio_server.ServerConnection):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            if len(self.server.handlers) > CONNECTIONS_MAX:
                log.warning("connection refused: too many are open")
                transport.abort()

    def serve(viser_handler: Any, *place: Any, process_request: Any, **options: Any) -> Any:
        def check(connection: Any, request: Any) -> Any:
            upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
            try:
                why = refusal_reason(request.headers, names, public, upgrade)
            except (LookupError, ValueError):  # a header twice, or none that can be read
                why = "this request is not understood"
            if why is not None:
                return answer(http.HTTPStatus.FORBIDDEN, "text/plain; charset=utf-8", why.encode())
            path = request.path.partition("?")[0]
            if path in files and not upgrade:
                return answer(http.HTTPStatus.OK, files[path].kind, files[path].content)
            given, _, rest = path[1:].partition("/")
            if not hmac.compare_digest(given.encode(errors="replace"), token.encode()):
                return answer(http.HTTPStatus.FORBIDDEN, "text/html; charset=utf-8", DOOR)
            request.path = path = f"/{rest}"
            if upgrade:
                return None
            if path in ("/", "/index.html"):
                request.headers.pop("Accept-Encoding", None)
                page = process_request(connection, request)
                return answer(http.HTTPStatus.OK, "text/html; charset=utf-8", index(page.body))
            try:
                return process_request(connection, request)
            except OSError:  # of the system, such as a name that is too long
                return answer(http.HTTPStatus.NOT_FOUND, "text/plain; charset=utf-8", b"there is no such file")

        async def route(connection: Any) -> None:
            if admitted is not None:
                await admitted()
            handler = handlers.get(connection.request.path)
            if handler is not None:
                await handler(connection)
            elif connection.subprotocol == f"viser-v{viser.__version__}":
                await viser_handler(CheckedConnection(connection, log))
            else:  # viser would print what the other one calls itself
                await connection.close(1002, f"this is viser {viser.__version__}; load the page anew")

        options |= {"logger": log, "max_size": FRAME_BYTES_MAX, "create_connection": Connection}
        return real(route, *place, process_request=check, **options)

    with _building, contextlib.redirect_stdout(io.StringIO()):
        asyncio_server.serve = serve  # type: ignore[misc, assignment]
        try:
            yield
        finally:
            asyncio_server.serve = real  # type: ignore[misc]


def free_port(host: str, port: int) -> int:
    """The first port from `port` on that can be served at; 0, which stands for any, for 0.

    viser tries ports on its own, but waits for ever where none can be had.

    Raises:
        ViewError: the host is not this computer, or no such port is free.
    """
    try:
        _bind(host, 0)
    except (OSError, ValueError) as error:
        raise ViewError(
            f"the page cannot be served at {host[:60]!r}: {getattr(error, 'strerror', None) or error}; give an address "
            "of this computer: --host 127.0.0.1 for it alone, 0.0.0.0 for the network"
        ) from None
    if port == 0:
        return 0
    last = min(port + PORT_TRIES - 1, PORT_MAX)
    for candidate in range(port, last + 1):
        with contextlib.suppress(OSError):
            _bind(host, candidate)
            return candidate
    raise ViewError(f"no port from {port} to {last} is free at {host!r}; give another, or --port 0 for any")


def _bind(host: str, port: int) -> None:
    """Listen for a moment at every address of a host, as viser's server will."""
    places = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    for family, *_, address in places:
        socket.create_server(address, family=family).close()


class PageServer:
    """viser's server behind the gate, with our page and sockets, below a token: see `guarded`.

    It is there before what the page shows: a browser fetches and compiles viser's page while a scene is loaded.

    Args:
        host: the address to serve at.
        port: the port; a free one near it where it is taken, any for 0.

    Attributes:
        viser: the server.
        log: is told what goes wrong.
        handlers: have the connections that are not viser's, by path; whoever shows something puts them in.

    Raises:
        ViewError: viser is missing, or the host or port cannot be had.
    """

    def __init__(self, host: str, port: int) -> None:
        self.log = CountedLog()
        self.handlers: dict[str, Callable[[Any], Awaitable[None]]] = {}
        self._token, self._admitted, self._closed = secrets.token_urlsafe(TOKEN_BYTES), asyncio.Event(), False
        try:
            self.viser = _serve(host, port, self._token, self.handlers, self.log, self._admitted.wait)
        except BaseException:
            self.log.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def admit(self) -> None:
        """Handle connections from now on; those that came before have waited."""
        self.viser.get_event_loop().call_soon_threadsafe(self._admitted.set)

    def close(self) -> None:
        """Have it end, and say nothing on the terminal; nothing where it has."""
        if self._closed:
            return
        self._closed = True
        self.admit()  # whoever waits still, to go
        with contextlib.redirect_stdout(io.StringIO()):
            warnings.filterwarnings("ignore", "Queued a .* on a closed connection")  # what a drawer had for the page
            self.viser.stop()
        self.log.close()

    @property
    def url(self) -> str:
        """Where a browser finds it: the only key to it. Whoever has this address may do all that the page can."""
        host = self.viser.get_host()
        return self._below({"0.0.0.0": "localhost", "::": "localhost"}.get(host, host))

    def addresses(self) -> list[str]:
        """What opens it from other computers."""
        host = self.viser.get_host()
        return [self._below(name) for name in (own_addresses() if host in ("0.0.0.0", "::") else [host]) if self.public]

    @property
    def public(self) -> bool:
        """Whether other computers may reach it."""
        return self.viser.get_host() not in LOOPBACK

    def _below(self, name: str) -> str:
        return f"http://{f'[{name}]' if ':' in name else name}:{self.viser.get_port()}/{self._token}/"


def _serve(
    host: str,
    port: int,
    token: str,
    handlers: Mapping[str, Callable[[Any], Awaitable[None]]],
    log: CountedLog,
    admitted: Callable[[], Awaitable[object]],
) -> Any:
    """viser's server, made and listening."""
    try:
        import viser
    except ImportError:
        raise ViewError("the painter needs viser, which is missing: pip install 'hapscene[paint]'") from None
    folder = resources.files("hapscene.paint.web")
    names = {"/hapscene.css": "page.css", "/hapscene.js": "page.js"}
    beside = ("bodies", "cursor", "ear", "keys", "number", "outline", "plot", "shelf", "sound", "upload", "viser")
    names |= {f"/hapscene-{name}.js": f"{name}.js" for name in beside}
    names["/hapscene-shelf.css"] = "shelf.css"
    files = {
        place: StaticFile(MIME_TYPES[name.split(".")[1]], (folder / name).read_bytes()) for place, name in names.items()
    }
    port = free_port(host, port)
    with guarded(
        host, token, files, lambda page: page.replace(b"<head>", b"<head>" + HEAD, 1), handlers, log.logger, admitted
    ):
        server = viser.ViserServer(host=host, port=port, label="hapscene paint", verbose=False)
    server.get_event_loop().set_exception_handler(log.note_loop)
    harden(server, log.logger)
    return server


def own_addresses() -> list[str]:
    """The addresses that other computers may find this one by, the likeliest first; IPv4."""
    found = []
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        way.connect(("192.0.2.1", 9))  # nothing is sent: it says which of our addresses looks outward
        found.append(way.getsockname()[0])
    with contextlib.suppress(OSError):
        found += [place[4][0] for place in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)]
    return [name for name in dict.fromkeys(found) if name not in LOOPBACK and not name.startswith("127.")]
