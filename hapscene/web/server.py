"""A server for WebSockets, and one for a web page: its files, and a WebSocket on which it exchanges JSON.

Every request must contain the token that is drawn at the start and name an accepted host; a WebSocket must come from a
page of the same host. Messages of pages are not trusted: they are limited in size and rate.
"""

import contextlib
import hmac
import http
import importlib.util
import ipaddress
import json
import logging
import secrets
import socket
import time
from collections.abc import Callable, Collection, Mapping
from importlib.resources.abc import Traversable
from queue import SimpleQueue
from threading import BoundedSemaphore, Event, Lock, Thread, current_thread
from typing import TYPE_CHECKING, Any, Final, Self
from urllib.parse import urlsplit

from hapscene.errors import HapsceneError
from hapscene.io.files import Json
from hapscene.wall_clock import CLOCK, Clock

if TYPE_CHECKING:
    from websockets.http11 import Request, Response
    from websockets.sync.server import ServerConnection

__all__ = ["PageConnection", "WebListener", "WebServer", "refusal_reason", "url_host"]

CONNECTIONS_MAX: Final = 32
"""Largest number of open connections [count]: a page opens some for its files and keeps one."""

MESSAGES_MAX_HZ: Final = 600.0
"""Largest rate of messages of a page [1/s]; pages send up to 250."""

WAITING_MAX: Final = 256
"""Largest number of unsent messages [count]; a page that reads too slowly is disconnected, and connects again."""

CLOSE_S: Final = 1.0
"""Longest wait, when the server closes, until a page has received what was sent [s]."""

THREADS_S: Final = 5.0
"""Longest wait for the connections' threads to end [s]."""

POLICY: Final = "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"

CONTENT_TYPES: Final = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
}


class WebListener:
    """Listens for WebSocket connections and handles each in a thread. The port is bound at once, served after `open`.

    Args:
        talk: called with each connection; the connection is closed when it returns.
        host, port: address to listen at; port 0 for any free one.
        connections_max: open connections [count]; further ones are closed at once.
        what, option: name of what is served and of the option that sets its port, for errors.
        on_connection: called with each connection attempt: True if it is accepted, False if the limit is reached.
        options: of `websockets.sync.server.serve`.

    Attributes:
        address: host and port.

    Raises:
        HapsceneError: websockets is not installed, the port is in use or the host is not an address of this machine.
    """

    def __init__(
        self,
        talk: "Callable[[ServerConnection], None]",
        host: str,
        port: int,
        *,
        connections_max: int,
        what: str,
        option: str,
        on_connection: Callable[[bool], None] = lambda accepted: None,
        **options: Any,
    ) -> None:
        if importlib.util.find_spec("websockets") is None:
            raise HapsceneError(f"{what} needs one more package: pip install 'hapscene[serve]'")
        from websockets.sync.server import serve

        log = logging.getLogger(__name__)  # errors in requests are answered, not printed
        log.addHandler(logging.NullHandler())
        log.propagate = False
        try:
            self._listener = serve(talk, host, port, compression=None, logger=log, **options)
        except OSError as error:
            reason = f"{what} cannot be served at {host}:{port}: {error.strerror}; choose another {option} or --host"
            raise HapsceneError(reason) from None
        self.address: tuple[str, int] = self._listener.socket.getsockname()[:2]
        self._free, self._closed = BoundedSemaphore(connections_max), Event()
        self._on_connection = on_connection
        self._threads: dict[socket.socket, Thread] = {}
        self._serve, self._listener.handler = self._listener.handler, self._serve_if_free
        self._thread = Thread(target=self._listener.serve_forever)

    def open(self) -> None:
        """Start to answer."""
        self._thread.start()

    def close(self) -> None:
        """Close the port and every connection; wait for their threads, up to `THREADS_S`."""
        self._closed.set()
        self._listener.shutdown()
        if self._thread.ident is not None:
            self._thread.join()
        threads = list(self._threads.items())
        for connection, _ in threads:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        end_s = time.monotonic() + THREADS_S
        for _, thread in threads:
            if thread is not current_thread():
                thread.join(max(0.0, end_s - time.monotonic()))

    def _serve_if_free(self, connection: socket.socket, address: object) -> None:
        # Registered before the check: either `close` finds the connection, or the check finds the server closed.
        self._threads[connection] = current_thread()
        accepted = not self._closed.is_set() and self._free.acquire(blocking=False)
        try:
            self._on_connection(accepted)
            if accepted:
                self._serve(connection, address)
            else:
                connection.close()
        finally:
            del self._threads[connection]
            if accepted:
                self._free.release()


class PageConnection:
    """The WebSocket of one open page. Sending never blocks: a thread sends the queued messages."""

    def __init__(self, connection: "ServerConnection") -> None:
        self._connection = connection
        self._waiting: SimpleQueue[str | None] = SimpleQueue()
        self._sender = Thread(target=self._send_waiting)
        self._sender.start()

    def send(self, message: object) -> None:
        """Send a message as JSON; disconnect a page that does not read."""
        self.send_text(json.dumps(message))

    def send_text(self, text: str) -> None:
        """Send a text; disconnect a page that does not read."""
        self._waiting.put(text)
        if self._waiting.qsize() > WAITING_MAX:
            with contextlib.suppress(OSError):
                self._connection.socket.shutdown(socket.SHUT_RDWR)

    def close(self, timeout_s: float | None = None) -> None:
        """Close the connection after the queued messages are sent; wait for that, up to a time limit [s]."""
        self._waiting.put(None)
        self._sender.join(timeout_s)

    def _send_waiting(self) -> None:
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            while (text := self._waiting.get()) is not None:
                self._connection.send(text)
        self._connection.close()


def _ignore(page: PageConnection) -> None:
    """No effect."""


class WebServer:
    """Serves a page while it is open.

    Callbacks run in the thread of the connection; those of several pages run at the same time.

    Args:
        folder, name: where NAME.html, NAME.css and NAME.js are, such as `importlib.resources.files("hapscene.play")`.
        take: called with each message of a page, parsed from JSON; invalid JSON is ignored.
        joined, left: called when a page opens and closes its WebSocket.
        host, port: address to listen at; port 0 for any free one.
        message_max: longest message [bytes].
        content: returns content and content type of a name in the URL that is not a file of the page, or None; may
            raise HapsceneError.
        option: name of the option that sets the port, for errors.
        clock: measures the rate of messages.

    Attributes:
        url: address of the page with its token, which gives access.
        address: host and port.
        public: whether other machines can reach it.

    Raises:
        HapsceneError: websockets is not installed, the port is in use or the host is not an address of this machine.
    """

    def __init__(
        self,
        folder: Traversable,
        name: str,
        *,
        take: Callable[[PageConnection, Json], None],
        joined: Callable[[PageConnection], None] = _ignore,
        left: Callable[[PageConnection], None] = _ignore,
        host: str = "127.0.0.1",
        port: int = 0,
        message_max: int = 4096,
        content: Callable[[str], tuple[bytes, str] | None] = lambda name: None,
        option: str = "--port",
        clock: Clock = CLOCK,
    ) -> None:
        files = {f"{name}.{suffix}": suffix for suffix in CONTENT_TYPES}
        self._files = {file: ((folder / file).read_bytes(), CONTENT_TYPES[suffix]) for file, suffix in files.items()}
        self._files[""] = self._files[f"{name}.html"]
        self._take, self._joined, self._left, self._content = take, joined, left, content
        self._clock, self._token = clock, secrets.token_urlsafe(16)
        self._hosts = {"localhost", "127.0.0.1", "::1", host.lower()}
        self.public = is_address(host) and not ipaddress.ip_address(host).is_loopback
        self._pages, self._lock = set[PageConnection](), Lock()
        self._listener = WebListener(
            self._talk,
            host,
            port,
            connections_max=CONNECTIONS_MAX,
            what="the page",
            option=option,
            process_request=self._answer,
            open_timeout=5.0,
            close_timeout=CLOSE_S,
            max_size=message_max,
            max_queue=16,
        )
        self.address = self._listener.address
        self.url = f"http://{url_host(host)}:{self.address[1]}/{self._token}/"

    def open(self) -> None:
        """Start to answer."""
        self._listener.open()

    def close(self) -> None:
        """Send queued messages, then close every connection."""
        for page in self.pages:
            page.close(CLOSE_S)
        self._listener.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def pages(self) -> list[PageConnection]:
        """The pages that are open."""
        with self._lock:
            return list(self._pages)

    def send(self, message: object) -> None:
        """Send a message to every open page as JSON."""
        text = json.dumps(message)
        for page in self.pages:
            page.send_text(text)

    def _talk(self, connection: "ServerConnection") -> None:
        """Take the messages of a page until it closes."""
        from websockets.exceptions import ConnectionClosed

        page = PageConnection(connection)
        with self._lock:
            self._pages.add(page)
        try:
            self._joined(page)
            budget, last_s = MESSAGES_MAX_HZ, self._clock.now_s()
            for text in connection:
                now_s = self._clock.now_s()
                budget = min(budget + (now_s - last_s) * MESSAGES_MAX_HZ, MESSAGES_MAX_HZ) - 1.0
                last_s = now_s
                if budget < 0.0:
                    connection.close(1008, "too many messages")
                    break
                self._take_text(page, text)
        except ConnectionClosed:
            pass
        finally:
            with self._lock:
                self._pages.discard(page)
            try:
                self._left(page)
            finally:  # ends the thread of the page even if the callback raises
                page.close()

    def _take_text(self, page: PageConnection, text: str | bytes) -> None:
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            return
        self._take(page, message)

    def _answer(self, connection: "ServerConnection", request: "Request") -> "Response | None":
        """A file or a refusal; None for a WebSocket that is accepted."""
        try:
            reason = self._refusal(request)
        except (LookupError, ValueError):  # a header that appears twice or cannot be parsed
            reason = "invalid request"
        if reason:
            return _response(http.HTTPStatus.FORBIDDEN, reason.encode())
        name = request.path.partition("?")[0].rpartition("/")[2]
        if name == "socket":
            return None
        try:
            found = self._files.get(name) or self._content(name)
        except HapsceneError as error:
            return _response(http.HTTPStatus.NOT_FOUND, str(error).encode())
        if found is None:
            return _response(http.HTTPStatus.NOT_FOUND, b"no such file")
        return _response(http.HTTPStatus.OK, *found)

    def _refusal(self, request: "Request") -> str | None:
        upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
        if reason := refusal_reason(request.headers, self._hosts, self.public, upgrade):
            return reason
        token = request.path.partition("?")[0][1:].rpartition("/")[0]
        if hmac.compare_digest(token.encode(errors="replace"), self._token.encode()):
            return None
        return "invalid token: open the complete address that the terminal printed"


def _response(status: http.HTTPStatus, content: bytes, content_type: str = "text/plain; charset=utf-8") -> "Response":
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    headers = {
        "Content-Type": content_type,
        "Content-Length": str(len(content)),
        "Content-Security-Policy": POLICY,
        "Cache-Control": "no-store",
        "Connection": "close",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
    }
    return Response(int(status), status.phrase, Headers(headers), content)


def url_host(host: str) -> str:
    """A host as written in a URL; for "all addresses", the one by which other machines reach this one."""
    if host in ("0.0.0.0", "::", ""):
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(("192.0.2.1", 9))  # sends nothing: only the route is looked up
            host = probe.getsockname()[0]
    return f"[{host}]" if ":" in host else host


def refusal_reason(headers: Mapping[str, str], names: Collection[str], public: bool, upgrade: bool) -> str | None:
    """Why a request is refused; None if it is accepted.

    Args:
        headers: of the request.
        names: accepted host names.
        public: also accept any IP address as host. Unlike a name, an address cannot be redirected by DNS rebinding.
        upgrade: the request asks for a WebSocket; its origin must be the same host.

    Raises:
        ValueError: the host or the origin cannot be parsed.
    """
    host = headers.get("Host", "")
    name = urlsplit(f"//{host}").hostname
    if name is None or not (name in names or (public and is_address(name))):
        return "this host name is not served"
    if not upgrade:
        return None
    origin = headers.get("Origin", "")
    if urlsplit(origin).scheme not in ("http", "https") or urlsplit(origin).netloc.lower() != host.lower():
        return "another origin is not served"
    return None


def is_address(name: str) -> bool:
    """Whether a host name is an IP address."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
