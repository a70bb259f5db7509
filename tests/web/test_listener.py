"""The server of WebSockets: its end, also while somebody comes."""

import contextlib
from threading import Thread

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")

from websockets.exceptions import ConnectionClosed, InvalidMessage
from websockets.sync.client import connect
from websockets.sync.server import ServerConnection

from hapscene.web.listener import WebListener


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
    with pytest.raises(refused), connect(address, open_timeout=60) as page:
        page.recv(timeout=60)
    closers[0].join(60)
    assert not closers[0].is_alive()
