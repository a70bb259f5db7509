"""A server of WebSockets with room for so many connections and no more, for whoever may knock; and one of a page.

Whatever a page sends is data of a stranger: every request has the token that was drawn at the start, names a host that
is ours, and a WebSocket comes from a page of that same host.
"""

import contextlib
import hmac
import http
import importlib.util
import ipaddress
import logging
import secrets
import socket
import time
from collections.abc import Callable, Collection, Mapping
from threading import BoundedSemaphore, Event, Thread, current_thread
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from hapscene.errors import HapsceneError

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection

CLOSE_S: Final = 5.0
"""Longest wait for the connections' ends [s]."""


class WebListener:
    """Listens from the start, answers once it is opened, each connection in a thread of its own.

    Args:
        talk: is given each connection, until it returns.
        host, port: where to listen; port 0 for any that is free.
        room: connections at a time [count]; what comes beyond is shut at once.
        what, option: what is served and by which option its port is said, for errors: "the page", "--port".
        came: called with each connection that comes, and whether there is room for it.
        options: of `websockets.sync.server.serve`.

    Attributes:
        address: where it listens.

    Raises:
        HapsceneError: websockets is missing; the port is taken, the host not ours.
    """

    def __init__(
        self,
        talk: "Callable[[ServerConnection], None]",
        host: str,
        port: int,
        *,
        room: int,
        what: str,
        option: str,
        came: Callable[[bool], None] = lambda let_in: None,
        **options: Any,
    ) -> None:
        if importlib.util.find_spec("websockets") is None:
            raise HapsceneError(f"{what} needs one more package: pip install 'hapscene[serve]'")
        from websockets.sync.server import serve

        log = logging.getLogger(__name__)  # what strangers do wrong is told to them alone
        log.addHandler(logging.NullHandler())
        log.propagate = False
        try:
            self._listener = serve(talk, host, port, compression=None, logger=log, **options)
        except OSError as error:
            reason = f"{what} cannot be served at {host}:{port}: {error.strerror}; say another {option} or --host"
            raise HapsceneError(reason) from None
        self.address: tuple[str, int] = self._listener.socket.getsockname()[:2]
        self._room, self._ended, self._came = BoundedSemaphore(room), Event(), came
        self._talks: dict[socket.socket, Thread] = {}
        self._take, self._listener.handler = self._listener.handler, self._bounded
        self._thread = Thread(target=self._listener.serve_forever)

    def open(self) -> None:
        """Answer."""
        self._thread.start()

    def close(self) -> None:
        """Close it, and every connection: their threads have ended, but one that closes it or does not end in time."""
        self._ended.set()
        self._listener.shutdown()
        if self._thread.ident is not None:
            self._thread.join()
        talks = list(self._talks.items())
        for taken, _ in talks:
            with contextlib.suppress(OSError):
                taken.shutdown(socket.SHUT_RDWR)
        end_s = time.monotonic() + CLOSE_S
        for _, thread in talks:
            if thread is not current_thread():
                thread.join(max(0.0, end_s - time.monotonic()))

    def _bounded(self, taken: socket.socket, address: Any) -> None:
        """Serve a connection, if there is room for one more."""
        self._talks[taken] = current_thread()  # first: either `close` finds it, or it finds that all is closed
        let_in = not self._ended.is_set() and self._room.acquire(blocking=False)
        try:
            self._came(let_in)
            if let_in:
                self._take(taken, address)
            else:
                taken.close()
        finally:
            del self._talks[taken]
            if let_in:
                self._room.release()


CONNECTIONS_MAX: Final = 32
"""Connections of a page at a time [count]: it opens some for its files, and keeps one."""

POLICY: Final = "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"


class PageListener(WebListener):
    """One port for the files of a page and its WebSocket.

    Args:
        talk: is given each WebSocket, until it returns.
        host, port: where to listen; port 0 for any that is free.
        files: content and kind of each, by name; "" is the page.
        message_max: longest message [bytes].
        more: gives content and kind of what is no file, or None, or raises HapsceneError where it cannot be had.
        option: by which its port is said.

    Attributes:
        url: of the page, with its token: whoever has it is let in, nobody else.
        public: whether it is served to others than this machine.

    Raises:
        HapsceneError: websockets is missing; the port is taken, the host not ours.
    """

    def __init__(
        self,
        talk: "Callable[[ServerConnection], None]",
        host: str,
        port: int,
        *,
        files: Mapping[str, tuple[bytes, str]],
        message_max: int,
        more: Callable[[str], tuple[bytes, str] | None] = lambda name: None,
        option: str = "--port",
    ) -> None:
        self._token, self._files, self._more = secrets.token_urlsafe(16), files, more
        self._names = {"localhost", "127.0.0.1", "::1", host.lower()}
        self.public = _is_address(host) and not ipaddress.ip_address(host).is_loopback
        timing = {"open_timeout": 5.0, "close_timeout": 1.0, "max_size": message_max, "max_queue": 16}
        page = {"room": CONNECTIONS_MAX, "what": "the page", "option": option, "process_request": self._answer}
        super().__init__(talk, host, port, **page, **timing)  # type: ignore[arg-type]
        self.url = f"http://{_shown(host)}:{self.address[1]}/{self._token}/"

    def _answer(self, connection: "ServerConnection", request: Any) -> Any:
        """A file, a refusal, or None for a WebSocket that is let in."""
        try:
            why = self._refusal(request)
        except (LookupError, ValueError):  # a header twice, or none that can be read
            why = "this request is not understood"
        if why:
            return _response(http.HTTPStatus.FORBIDDEN, why.encode())
        name = request.path.partition("?")[0].rpartition("/")[2]
        if name == "socket":
            return None
        try:
            found = self._files.get(name) or self._more(name)
        except HapsceneError as error:
            return _response(http.HTTPStatus.NOT_FOUND, str(error).encode())
        if found is None:
            return _response(http.HTTPStatus.NOT_FOUND, b"there is no such file")
        return _response(http.HTTPStatus.OK, *found)

    def _refusal(self, request: Any) -> str:
        """Why a request gets nothing; empty if it is ours."""
        upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
        token = request.path.partition("?")[0][1:].rpartition("/")[0]
        known = hmac.compare_digest(token.encode(errors="replace"), self._token.encode())
        unknown = "" if known else "this page opens at the address that the terminal printed, with all its letters"
        return refusal_reason(request.headers, self._names, self.public, upgrade) or unknown


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


def _name(url: str) -> str | None:
    """Host name of a URL, lower case; None where there is none."""
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


def _response(status: http.HTTPStatus, content: bytes, kind: str = "text/plain; charset=utf-8") -> Any:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    headers = {"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": "no-store"}
    headers |= {"Content-Security-Policy": POLICY, "X-Content-Type-Options": "nosniff", "Connection": "close"}
    return Response(int(status), status.phrase, Headers(headers | {"Referrer-Policy": "no-referrer"}), content)


def _shown(host: str) -> str:
    """A host as it stands in an address; where that is all of this machine's, the one that others reach it by."""
    if host in ("0.0.0.0", "::", ""):
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(("192.0.2.1", 9))  # sends nothing: only has the way looked up
            host = probe.getsockname()[0]
    return f"[{host}]" if ":" in host else host


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
