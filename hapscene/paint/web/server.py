"""HTTP and WebSocket server of the page: viser, protected by a token, with additional files and sockets on its port.

Any web page can make a visitor's browser connect to a server on the visitor's computer: browsers allow WebSockets to
other origins, and DNS rebinding even allows reading. Therefore every request must name an accepted host, and a
WebSocket must come from a page of the same host.

A program can send any host and origin, and all users of a computer can reach its ports. Therefore the address of the
page contains a token, drawn at each start, which gives full access. It is not a cookie, since browsers send cookies to
all ports of a host. The page stores the token in the browser and removes it from the address bar. The static files of
this package need no token.
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
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

from hapscene.errors import ViewError
from hapscene.web.server import refusal_reason, url_host

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

__all__ = ["SOCKET_PATH", "PageServer", "button_hints", "host_names"]

SOCKET_PATH: Final = "/hapscene"
"""Path of the WebSocket for `PageSocket`; all other paths belong to viser."""

LOOPBACK: Final = frozenset({"localhost", "127.0.0.1", "::1"})

POLICY: Final = (
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval'; "
    "connect-src 'self' data: blob:; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
)
"""Content security policy: the page loads from this server only and cannot be shown in a frame."""

FRAME_BYTES_MAX: Final = 1 << 20
"""Longest message that is received [bytes]; pages send some hundred."""

NO_TOKEN_PAGE: Final = b"""<!doctype html><meta charset="utf-8"><title>hapscene paint</title>
<p>The token is missing or invalid. Open the complete address that the terminal printed.</p>
<script>
const known = localStorage.getItem("hapscene");
if (known && known !== location.pathname) location.replace(known);
</script>
"""
"""Answer to a request without a valid token; it redirects a browser that has stored the token."""

MIME_TYPES: Final = {"css": "text/css; charset=utf-8", "js": "application/javascript; charset=utf-8"}

HEAD: Final = b"""<link rel="stylesheet" href="/hapscene.css"><script>
const real = matchMedia.bind(window), load = fetch.bind(window);
window.matchMedia = (query) => real(query === "(max-width: 36em)" ? "(max-width: 760px)" : query);
const unused = (what) => String(what.url ?? what).startsWith("data:image/jpeg");
window.fetch = (what, options) => unused(what) ? new Promise(() => {}) : load(what, options);
</script><script src="/hapscene.js" type="module"></script>
<link rel="stylesheet" href="/hapscene-swatch_library.css">
<script src="/hapscene-swatch_library.js" type="module"></script>
<script src="/hapscene-upload.js" type="module"></script><script src="/hapscene-body_tree.js" type="module"></script>"""
"""Inserted into viser's page. The script widens the window size up to which viser shows the panel below the view, and
keeps viser from decoding its default environment map, which the scene does not use."""

TOKEN_BYTES: Final = 16
"""Length of the token [bytes]."""

Answer = tuple[http.HTTPStatus, str, bytes]
"""Status, MIME type and content."""

Handler: TypeAlias = "Callable[[ServerConnection], Awaitable[None]]"

_patching = threading.Lock()


def host_names(host: str) -> frozenset[str]:
    """Accepted host names, in lower case. A public server also accepts IP addresses."""
    if host in LOOPBACK:
        return LOOPBACK
    return LOOPBACK | {host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}


def _check_host(host: str) -> None:
    """Raise ViewError if a host is not an address of this computer: viser would try one port after the other."""
    try:
        places = socket.getaddrinfo(host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, *_, address in places:
            socket.create_server(address, family=family).close()
    except (OSError, ValueError) as error:
        raise ViewError(
            f"the page cannot be served at {host[:60]!r}: {getattr(error, 'strerror', None) or error}; expected an "
            "address of this computer: use --host 127.0.0.1 (this computer only) or 0.0.0.0 (network)"
        ) from None


class PageServer:
    """A viser server protected by a token, with additional files and sockets.

    It can be started before the scene is loaded, so that the browser loads viser's page meanwhile; connections wait
    until `admit`.

    Args:
        host: address to listen at.
        port: port; if it is in use, a free one near it; 0 for any.

    Attributes:
        viser: the viser server.
        handlers: handlers of additional WebSockets, by path.

    Raises:
        ViewError: viser is missing, or the host or port cannot be used.
    """

    def __init__(self, host: str, port: int) -> None:
        try:
            import viser
        except ImportError:
            raise ViewError(
                "the painter needs the package viser, which is not installed: pip install 'hapscene[paint]'"
            ) from None
        self.handlers: dict[str, Handler] = {}
        self._names, self._token, self._files = host_names(host), secrets.token_urlsafe(TOKEN_BYTES), _static_files()
        self._admitted, self._closed = asyncio.Event(), False
        # the page shows changes to all browsers
        warnings.filterwarnings("ignore", "Queued a .* on a closed connection")
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
        """Start to handle connections, including those that wait."""
        self.viser.get_event_loop().call_soon_threadsafe(self._admitted.set)

    def close(self) -> None:
        """Stop the server, without output on the terminal. A second call has no effect."""
        if self._closed:
            return
        self._closed = True
        self.admit()  # so that waiting connections can end
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()

    @property
    def url(self) -> str:
        """Address of the page with its token, which gives full access."""
        host = self.viser.get_host()
        return self._address("localhost" if host in ("0.0.0.0", "::") else host)

    @property
    def network_url(self) -> str | None:
        """Address of the page for other computers, with its token; None if they cannot reach the page."""
        host = self.viser.get_host()
        return None if host in LOOPBACK else self._address(host)

    def _address(self, host: str) -> str:
        return f"http://{url_host(host)}:{self.viser.get_port()}/{self._token}/"

    @contextlib.contextmanager
    def _guarding(self, public: bool) -> Iterator[None]:
        """Make viser servers that are created meanwhile check host, origin and token, and print nothing.

        viser has no such checks and no hook for them, so its call of `websockets.serve` is replaced.
        """
        import websockets.asyncio.server as asyncio_server
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        real = asyncio_server.serve
        log = logging.Logger("hapscene.paint")  # errors in requests are not printed
        log.addHandler(logging.NullHandler())

        def serve(viser_handler: Handler, *place: Any, process_request: Any, **options: Any) -> Any:
            def respond(connection: "ServerConnection", request: "Request") -> "Response | None":
                found = self._answer(request, public, lambda: process_request(connection, request))
                if not isinstance(found, tuple):
                    return found
                status, kind, content = found
                headers = {"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": "no-store"}
                headers |= {"Content-Security-Policy": POLICY, "X-Content-Type-Options": "nosniff"}
                headers |= {"Referrer-Policy": "no-referrer"}
                return Response(int(status), status.phrase, Headers(headers), content)

            async def route(connection: "ServerConnection") -> None:
                await self._admitted.wait()
                await self.handlers.get(connection.request.path if connection.request else "", viser_handler)(
                    connection
                )

            options |= {"logger": log, "max_size": FRAME_BYTES_MAX}
            return real(route, *place, process_request=respond, **options)

        with _patching, contextlib.redirect_stdout(io.StringIO()):
            asyncio_server.serve = serve  # type: ignore[misc, assignment]
            try:
                yield
            finally:
                asyncio_server.serve = real  # type: ignore[misc]

    def _answer(self, request: "Request", public: bool, relay: "Callable[[], Response]") -> "Answer | Response | None":
        """An `Answer`, a response of viser, or None for a WebSocket that is accepted."""
        upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
        try:
            reason = refusal_reason(request.headers, self._names, public, upgrade)
        except (LookupError, ValueError):  # a header that occurs twice or cannot be parsed
            reason = "invalid request"
        if reason is not None:
            return http.HTTPStatus.FORBIDDEN, "text/plain; charset=utf-8", reason.encode()
        path = request.path.partition("?")[0]
        if path in self._files and not upgrade:
            return self._files[path]
        given, _, rest = path[1:].partition("/")
        if not hmac.compare_digest(given.encode(errors="replace"), self._token.encode()):
            return http.HTTPStatus.FORBIDDEN, "text/html; charset=utf-8", NO_TOKEN_PAGE
        request.path = path = f"/{rest}"
        if upgrade:
            return None
        if path in ("/", "/index.html"):
            request.headers.pop("Accept-Encoding", None)
            page = bytes(relay().body).replace(b"<head>", b"<head>" + HEAD, 1)
            return http.HTTPStatus.OK, "text/html; charset=utf-8", page
        try:
            return relay()
        except OSError:  # for example, the file name is too long
            return http.HTTPStatus.NOT_FOUND, "text/plain; charset=utf-8", b"no such file"


def _static_files() -> Mapping[str, Answer]:
    """Static files of this package, by URL path."""
    found = {}
    for file in resources.files("hapscene.paint.web").iterdir():
        name, _, suffix = file.name.partition(".")
        if suffix in MIME_TYPES:
            path = "/hapscene" + ("" if name == "page" else f"-{name}")
            found[f"{path}.{suffix}"] = http.HTTPStatus.OK, MIME_TYPES[suffix], file.read_bytes()
    return found


def button_hints(*guis: Any) -> dict[str, str]:
    """Hints of viser's buttons by element id: viser itself does not show them."""
    from viser import GuiButtonHandle

    handles = [handle for gui in guis for handle in gui._gui_input_handle_from_uuid.items()]
    return {name: button.hint for name, button in handles if isinstance(button, GuiButtonHandle) and button.hint}
