"""HTTP and WebSocket server of the page: viser behind a token, with our own files and sockets on the same port.

Whoever runs a web page can make a visitor's browser talk to a server on the visitor's machine: browsers allow a
WebSocket to a foreign origin, and DNS rebinding makes even reading possible. So every request must name one of our
hosts, and a WebSocket must come from a page of the same host.

A program can send any host and origin, and all users of a computer reach its ports. So the address of the page holds a
token, drawn at each start: scene and sockets are below it, and whoever has it may do all that the page can. It is not a
cookie, which a browser would send to all other ports of the computer too. The page keeps it in the browser's storage
and removes it from the address bar. Our own files, the same for everybody, need no token.
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
from importlib import resources
from typing import Any, Final, Self

from hapscene.errors import ViewError
from hapscene.web.listener import refusal_reason

__all__ = ["SOCKET_PATH", "PageServer", "button_hints", "host_names", "own_addresses"]

SOCKET_PATH: Final = "/hapscene"
"""Path of our own WebSocket; viser has every other path."""

LOOPBACK: Final = frozenset({"localhost", "127.0.0.1", "::1"})

POLICY: Final = (
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval'; "
    "connect-src 'self' data: blob:; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
)
"""Content security policy: the page loads from this server only, and no other page shows it in a frame."""

FRAME_BYTES_MAX: Final = 1 << 20
"""Longest message that is received [bytes]; a page sends some hundred."""

DOOR: Final = b"""<!doctype html><meta charset="utf-8"><title>hapscene paint</title>
<p>This page opens at the address that the terminal printed, with all its letters: use that one.</p>
<script>
const known = localStorage.getItem("hapscene");
if (known && known !== location.pathname) location.replace(known);
</script>
"""
"""Answer to a request without the token; a browser that had the token before finds the page again."""

MIME_TYPES: Final = {"css": "text/css; charset=utf-8", "js": "application/javascript; charset=utf-8"}

SCRIPTS: Final = ("bodies", "cursor", "ear", "keys", "outline", "plot", "shelf", "sound", "upload", "viser")

HEAD: Final = b"""<link rel="stylesheet" href="/hapscene.css"><script>
const real = matchMedia.bind(window);
window.matchMedia = (query) => real(query === "(max-width: 36em)" ? "(max-width: 760px)" : query);
</script><script src="/hapscene.js" type="module"></script>
<link rel="stylesheet" href="/hapscene-shelf.css"><script src="/hapscene-shelf.js" type="module"></script>
<script src="/hapscene-upload.js" type="module"></script><script src="/hapscene-bodies.js" type="module"></script>"""
"""Inserted into viser's page. In a window too narrow for both, the panel is a sheet below the picture."""

TOKEN_BYTES: Final = 16
"""Length of the token [bytes]: 128 bits cannot be guessed."""

Answer = tuple[http.HTTPStatus, str, bytes]
"""Status, MIME type and content."""

Handler = Callable[[Any], Awaitable[None]]

_patching = threading.Lock()


def host_names(host: str) -> frozenset[str]:
    """Host names of this server, lower case; a public server is also called by its addresses."""
    if host in LOOPBACK:
        return LOOPBACK
    return LOOPBACK | {host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}


def _check_host(host: str) -> None:
    """Raise ViewError if a host is not this computer: viser, which tries the next port, would try for ever."""
    try:
        places = socket.getaddrinfo(host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, *_, address in places:
            socket.create_server(address, family=family).close()
    except (OSError, ValueError) as error:
        raise ViewError(
            f"the page cannot be served at {host[:60]!r}: {getattr(error, 'strerror', None) or error}; give an address "
            "of this computer: --host 127.0.0.1 for it alone, 0.0.0.0 for the network"
        ) from None


class PageServer:
    """viser's server behind the token, with our page and sockets.

    It starts before the scene is loaded: a browser fetches and compiles viser's page meanwhile. Connections wait until
    `admit`.

    Args:
        host: the address to serve at.
        port: the port; a free one near it where it is taken, any for 0.

    Attributes:
        viser: the server.
        handlers: handle the connections that are not viser's, by path; whoever shows something adds them.

    Raises:
        ViewError: viser is missing, or the host or port cannot be used.
    """

    def __init__(self, host: str, port: int) -> None:
        try:
            import viser
        except ImportError:
            raise ViewError("the painter needs viser, which is missing: pip install 'hapscene[paint]'") from None
        self.handlers: dict[str, Handler] = {}
        self._names, self._token, self._files = host_names(host), secrets.token_urlsafe(TOKEN_BYTES), _static_files()
        self._admitted, self._closed = asyncio.Event(), False
        _check_host(host)
        with self._guarding(host not in LOOPBACK):
            self.viser = viser.ViserServer(host=host, port=port, label="hapscene paint", verbose=False)
        for name in ("ShareUrlRequest", "ShareUrlDisconnect"):  # would open a tunnel to the internet
            self.viser._websock_server.unregister_handler(getattr(viser._messages, name))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def admit(self) -> None:
        """Handle connections from now on, those that wait too."""
        self.viser.get_event_loop().call_soon_threadsafe(self._admitted.set)

    def close(self) -> None:
        """Stop the server, without messages on the terminal; does nothing the second time."""
        if self._closed:
            return
        self._closed = True
        self.admit()  # those that still wait can end
        with contextlib.redirect_stdout(io.StringIO()):
            warnings.filterwarnings("ignore", "Queued a .* on a closed connection")  # a drawing thread may still send
            self.viser.stop()

    @property
    def url(self) -> str:
        """Address of the page, with its token: whoever has it may do all that the page can."""
        host = self.viser.get_host()
        return self._below({"0.0.0.0": "localhost", "::": "localhost"}.get(host, host))

    def addresses(self) -> list[str]:
        """Addresses that open the page from other computers; none where it is served to this one alone."""
        host = self.viser.get_host()
        return [self._below(name) for name in (own_addresses() if host in ("0.0.0.0", "::") else [host]) if self.public]

    @property
    def public(self) -> bool:
        """Whether other computers may reach it."""
        return self.viser.get_host() not in LOOPBACK

    def _below(self, name: str) -> str:
        return f"http://{f'[{name}]' if ':' in name else name}:{self.viser.get_port()}/{self._token}/"

    @contextlib.contextmanager
    def _guarding(self, public: bool) -> Iterator[None]:
        """Have a viser server that is made meanwhile check host, origin and token, and print nothing.

        viser has no check of hosts or origins and no way to add one, so its call of `websockets.serve` is replaced.
        """
        import websockets.asyncio.server as asyncio_server
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        real = asyncio_server.serve
        log = logging.Logger("hapscene.paint")  # errors of strangers are answered to them alone
        log.addHandler(logging.NullHandler())

        def serve(viser_handler: Handler, *place: Any, process_request: Any, **options: Any) -> Any:
            def respond(connection: Any, request: Any) -> Any:
                found = self._answer(request, public, lambda: process_request(connection, request))
                if not isinstance(found, tuple):
                    return found
                status, kind, content = found
                headers = {"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": "no-store"}
                headers |= {"Content-Security-Policy": POLICY, "X-Content-Type-Options": "nosniff"}
                headers |= {"Referrer-Policy": "no-referrer"}
                return Response(int(status), status.phrase, Headers(headers), content)

            async def route(connection: Any) -> None:
                await self._admitted.wait()
                await self.handlers.get(connection.request.path, viser_handler)(connection)

            options |= {"logger": log, "max_size": FRAME_BYTES_MAX}
            return real(route, *place, process_request=respond, **options)

        with _patching, contextlib.redirect_stdout(io.StringIO()):
            asyncio_server.serve = serve  # type: ignore[misc, assignment]
            try:
                yield
            finally:
                asyncio_server.serve = real  # type: ignore[misc]

    def _answer(self, request: Any, public: bool, of_viser: Callable[[], Any]) -> Any:
        """An `Answer` of ours, one of viser's, or None for a WebSocket that is let in."""
        upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
        try:
            why = refusal_reason(request.headers, self._names, public, upgrade)
        except (LookupError, ValueError):  # a header that occurs twice or cannot be read
            why = "this request is not understood"
        if why is not None:
            return http.HTTPStatus.FORBIDDEN, "text/plain; charset=utf-8", why.encode()
        path = request.path.partition("?")[0]
        if path in self._files and not upgrade:
            return self._files[path]
        given, _, rest = path[1:].partition("/")
        if not hmac.compare_digest(given.encode(errors="replace"), self._token.encode()):
            return http.HTTPStatus.FORBIDDEN, "text/html; charset=utf-8", DOOR
        request.path = path = f"/{rest}"
        if upgrade:
            return None
        if path in ("/", "/index.html"):
            request.headers.pop("Accept-Encoding", None)
            page = of_viser().body.replace(b"<head>", b"<head>" + HEAD, 1)
            return http.HTTPStatus.OK, "text/html; charset=utf-8", page
        try:
            return of_viser()
        except OSError:  # of the system, such as a name that is too long
            return http.HTTPStatus.NOT_FOUND, "text/plain; charset=utf-8", b"there is no such file"


def _static_files() -> Mapping[str, Answer]:
    """Our own files by their paths."""
    folder = resources.files("hapscene.paint.web")
    names = {"/hapscene.css": "page.css", "/hapscene.js": "page.js", "/hapscene-shelf.css": "shelf.css"}
    names |= {f"/hapscene-{name}.js": f"{name}.js" for name in SCRIPTS}
    return {
        path: (http.HTTPStatus.OK, MIME_TYPES[name.split(".")[1]], (folder / name).read_bytes())
        for path, name in names.items()
    }


def own_addresses() -> list[str]:
    """IPv4 addresses that other computers may find this one by, the likeliest first."""
    found = []
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # sends nothing: it selects the address that looks outward
        found.append(probe.getsockname()[0])
    with contextlib.suppress(OSError):
        found += [place[4][0] for place in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)]
    return [name for name in dict.fromkeys(found) if name not in LOOPBACK and not name.startswith("127.")]


def button_hints(server: Any) -> dict[str, str]:
    """Hints of viser's buttons by their ids in the page: viser itself does not show them."""
    from viser import GuiButtonHandle

    handles = server.gui._gui_input_handle_from_uuid.items()
    return {name: button.hint for name, button in handles if isinstance(button, GuiButtonHandle) and button.hint}
