"""The page's server, apart since it alone knows viser's inside: one port, with our own files and socket, for our own
page alone.

Whoever runs a web page can have a visitor's browser talk to a server on the visitor's machine: a WebSocket to a foreign
origin is allowed by browsers, and a name whose address changes (DNS rebinding) makes even reading possible. So every
request must name one of our hosts, and a WebSocket must come from a page of that same host.
"""

import contextlib
import http
import io
import ipaddress
import math
import socket
import threading
from collections.abc import Awaitable, Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final
from urllib.parse import urlsplit

from hapscene.errors import ViewError

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

TEXT_MAX: Final = 4096
"""Longest text that a field takes [characters]: a path."""

NUMBER_MAX: Final = 1e15
"""Largest number of a field without bounds [1]: what is larger cannot be sent to the other pages."""

MIME_TYPES: Final = {"css": "text/css; charset=utf-8", "js": "application/javascript; charset=utf-8"}
"""Types of what is served, by suffix."""

HEAD: Final = b'<link rel="stylesheet" href="/hapscene.css"><script src="/hapscene.js" type="module"></script>'
"""What is put into viser's page."""

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


def refusal_reason(headers: Mapping[str, str], names: Collection[str], public: bool, upgrade: bool) -> str | None:
    """Why a request gets nothing; None if it is ours.

    Args:
        headers: of the request.
        names: host names that are ours.
        public: whether any address is ours too: an address cannot be rebound, as a name can.
        upgrade: whether it asks for a WebSocket.
    """
    host = headers.get("Host", "")
    name = _name(f"//{host}")
    if name is None or not (name in names or (public and _is_address(name))):
        return "this host name is not served"
    if not upgrade:
        return None
    origin = headers.get("Origin", "")
    if urlsplit(origin).scheme not in ("http", "https") or urlsplit(origin).netloc.lower() != host.lower():
        return "another origin is not served"
    return None


@contextlib.contextmanager
def guarded(
    host: str,
    files: Mapping[str, StaticFile],
    index: Callable[[bytes], bytes],
    handler: Callable[[Any], Awaitable[None]],
) -> Iterator[None]:
    """While this lasts, a viser server that is made listens behind the gate, and says nothing on the terminal.

    viser has no check of hosts or origins and no way to add one, so its call of `websockets.serve` is led through here.

    Args:
        host: what the server is bound to.
        files: what is served besides viser's client, by path.
        index: changes viser's page.
        handler: has the connections to `SOCKET_PATH`.
    """
    import websockets.asyncio.server as asyncio_server
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    names, public = host_names(host), host not in LOOPBACK
    real = asyncio_server.serve

    def answer(status: http.HTTPStatus, kind: str, content: bytes) -> Response:
        headers = Headers({"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": "no-store"})
        headers["Content-Security-Policy"] = POLICY
        headers["X-Content-Type-Options"] = "nosniff"
        return Response(int(status), status.phrase, headers, content)

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
            if upgrade:
                return None
            if path in files:
                return answer(http.HTTPStatus.OK, files[path].kind, files[path].content)
            if path in ("/", "/index.html"):
                request.headers.pop("Accept-Encoding", None)
                page = process_request(connection, request)
                return answer(http.HTTPStatus.OK, "text/html; charset=utf-8", index(page.body))
            return process_request(connection, request)

        async def route(connection: Any) -> None:
            ours = connection.request.path.partition("?")[0] == SOCKET_PATH
            await (handler if ours else viser_handler)(connection)

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


def serve(host: str, port: int, handler: Callable[[Any], Awaitable[None]]) -> Any:
    """viser's server behind the gate, with our page and socket.

    Raises:
        ViewError: viser is missing, or the host or port cannot be had.
    """
    try:
        import viser
    except ImportError:
        raise ViewError("the painter needs viser, which is missing: pip install 'hapscene[paint]'") from None
    folder = resources.files("hapscene.paint.web")
    names = {"/hapscene.css": "page.css", "/hapscene.js": "page.js"}
    names |= {f"/hapscene-{name}": name for name in ("number.js", "plot.js", "sound.js")}
    files = {
        place: StaticFile(MIME_TYPES[name.split(".")[1]], (folder / name).read_bytes()) for place, name in names.items()
    }
    port = free_port(host, port)
    with guarded(host, files, lambda page: page.replace(b"<head>", b"<head>" + HEAD, 1), handler):
        server = viser.ViserServer(host=host, port=port, label="hapscene paint", verbose=False)
    harden(server)
    return server


def stop(server: Any) -> None:
    """Have it end, and say nothing on the terminal."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


async def set_slider(server: Any, client: int, name: str, value: float) -> str | None:
    """Give a slider a number, as its user would; what else was made of it, in a sentence, or None.

    Args:
        server: viser's.
        client: who does.
        name: viser's name of the slider; any other control is left alone.
        value: the nearest that it can have counts.
    """
    from viser import GuiSliderHandle
    from viser._messages import GuiUpdateMessage

    slider = server.gui._gui_input_handle_from_uuid.get(name)
    if not isinstance(slider, GuiSliderHandle):
        return None
    bounded = min(max(value, slider.min), slider.max)
    await server.gui._handle_gui_updates(client, GuiUpdateMessage(name, {"value": bounded}))
    if not slider._impl.removed:
        told = GuiUpdateMessage(name, {"value": slider.value})
        server.gui._websock_interface.queue_message(told)  # to all: viser spares the one who typed
    if bounded == value:
        return None
    return f"{slider.label}: from {slider.min:g} to {slider.max:g}; {value:g} became {bounded:g}."


def harden(server: Any) -> None:
    """Take from a viser server what a page of ours needs not, and a page of others might use.

    Its share button would open a tunnel to the net. Its updates of controls may name any attribute of them: only
    values come through, of the type that the control has.
    """
    from viser import _messages

    base = server._websock_server
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        base.unregister_handler(message)

    def filtered(gui: Any) -> Callable[[Any, Any], Awaitable[None]]:
        async def update(client_id: Any, message: Any) -> None:
            handle = gui._gui_input_handle_from_uuid.get(message.uuid)
            if handle is not None and _is_value(message.updates, handle):
                await gui._handle_gui_updates(client_id, message)

        return update

    base.unregister_handler(_messages.GuiUpdateMessage)
    base.register_handler(_messages.GuiUpdateMessage, filtered(server.gui))


def _is_value(updates: Any, handle: Any) -> bool:
    """Whether an update is a value that a control may have."""
    if not isinstance(updates, dict) or set(updates) != {"value"}:
        return False
    value, known = updates["value"], handle._impl.value
    if isinstance(known, bool) or isinstance(value, bool):
        return isinstance(value, bool) and isinstance(known, bool)
    if isinstance(known, int | float):
        if not isinstance(value, int | float) or not math.isfinite(value):
            return False
        low, high = getattr(handle, "min", None), getattr(handle, "max", None)
        return (-NUMBER_MAX if low is None else low) <= value <= (NUMBER_MAX if high is None else high)
    if isinstance(known, tuple):  # a colour
        return isinstance(value, list | tuple) and len(value) == len(known) and all(_is_byte(part) for part in value)
    if isinstance(known, str):
        return isinstance(value, str) and len(value) <= TEXT_MAX
    return False


def _is_byte(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 255


def _name(url: str) -> str | None:
    """Host name of a URL, lower case; None where there is none."""
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
