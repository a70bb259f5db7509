"""A server of WebSockets with room for so many connections and no more, for whoever may knock."""

import contextlib
import importlib.util
import logging
import socket
from collections.abc import Callable
from threading import BoundedSemaphore, Event, Thread
from typing import TYPE_CHECKING, Any

from hapscene.errors import HapsceneError

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection


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
        self._sockets: set[socket.socket] = set()
        self._take, self._listener.handler = self._listener.handler, self._bounded
        self._thread = Thread(target=self._listener.serve_forever)

    def open(self) -> None:
        """Answer."""
        self._thread.start()

    def close(self) -> None:
        """Close it, and every connection."""
        self._ended.set()
        self._listener.shutdown()
        if self._thread.ident is not None:
            self._thread.join()
        for taken in list(self._sockets):
            with contextlib.suppress(OSError):
                taken.shutdown(socket.SHUT_RDWR)

    def _bounded(self, taken: socket.socket, address: Any) -> None:
        """Serve a connection, if there is room for one more."""
        let_in = not self._ended.is_set() and self._room.acquire(blocking=False)
        self._came(let_in)
        if not let_in:
            taken.close()
            return
        self._sockets.add(taken)
        try:
            self._take(taken, address)
        finally:
            self._sockets.discard(taken)
            self._room.release()
