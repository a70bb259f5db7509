"""A WebSocket server with a limit on open connections, and the check of a request's host and origin."""

import contextlib
import importlib.util
import ipaddress
import logging
import socket
import time
from collections.abc import Callable, Collection, Mapping
from threading import BoundedSemaphore, Event, Thread, current_thread
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from hapscene.errors import HapsceneError

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection

__all__ = ["WebListener", "is_address", "refusal_reason"]

CLOSE_S: Final = 5.0
"""Longest wait for the connections' threads to end [s]."""


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
        """Close the port and every connection; wait for their threads, up to `CLOSE_S`."""
        self._closed.set()
        self._listener.shutdown()
        if self._thread.ident is not None:
            self._thread.join()
        threads = list(self._threads.items())
        for connection, _ in threads:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        end_s = time.monotonic() + CLOSE_S
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


def refusal_reason(headers: Mapping[str, str], names: Collection[str], public: bool, upgrade: bool) -> str | None:
    """Why a request is refused; None if it is accepted.

    Args:
        headers: of the request.
        names: accepted host names.
        public: also accept any IP address as host. Unlike a name, an address cannot be redirected by DNS rebinding.
        upgrade: the request asks for a WebSocket; its origin must be the same host.
    """
    host = headers.get("Host", "")
    name = _host_name(f"//{host}")
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


def _host_name(url: str) -> str | None:
    """Host name of a URL in lower case; None for an invalid URL."""
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
