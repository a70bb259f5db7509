"""The bridge over WebSocket: JSON orders from a web page or script, and binary packets from a game in the browser.

Any web page can open a WebSocket to this computer. Therefore, only pages of this computer and of the served host are
accepted; programs other than browsers send no Origin.
"""

import json
import re
from concurrent.futures import CancelledError, Future
from typing import TYPE_CHECKING, Final

from hapscene.bridge.conventions import Convention
from hapscene.bridge.packets import VERSION, PacketError, unpack_json
from hapscene.bridge.server import Answer, BridgeServer
from hapscene.io.files import Json
from hapscene.web.server import WebListener

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection

__all__ = ["WebSocketBridge"]

MESSAGE_MAX: Final = 32 * 1024 * 1024
"""Longest message [bytes]: a mesh of half a million faces."""

CONNECTIONS_MAX: Final = 8
"""Most simultaneous connections [count]; each can have two messages of full length waiting."""

OPEN_S: Final = 5.0
"""Time limit for the handshake of a connection [s]."""


class WebSocketBridge:
    """Accepts connections while it is open, each in a separate thread.

    Args:
        server: the bridge; executes orders, and answers packets in binary messages.
        host, port: address to listen at; port 0 selects a free one.

    Attributes:
        address: the address of the server.

    Raises:
        HapsceneError: websockets is not installed, or the address cannot be used.
    """

    def __init__(self, server: BridgeServer, host: str, port: int) -> None:
        ours = "|".join(re.escape(name) for name in ("localhost", "127.0.0.1", "[::1]", host))
        self._server, self._orders = server, server.orders
        self._listener = WebListener(
            self._serve_client,
            host,
            port,
            connections_max=CONNECTIONS_MAX,
            what="the bridge's WebSocket",
            option="--ws port",
            on_connection=self._count,
            origins=[None, re.compile(rf"https?://({ours})(:\d+)?", re.IGNORECASE)],
            open_timeout=OPEN_S,
            max_size=MESSAGE_MAX,
            max_queue=1,
        )
        self.address = self._listener.address

    def __enter__(self) -> "WebSocketBridge":
        """Open it; the servo must be running."""
        self._listener.open()
        return self

    def __exit__(self, *error: object) -> None:
        """Close it, and all connections."""
        self._listener.close()

    def _count(self, let_in: bool) -> None:
        self._orders.counts["web"] += 1
        self._orders.counts["web full"] += not let_in

    def _serve_client(self, connection: "ServerConnection") -> None:
        """Answer the messages of a client until it disconnects."""
        from websockets.exceptions import ConnectionClosed

        self._orders.counts["web let in"] += 1
        to: Convention | None = None
        try:
            while True:
                message = connection.recv()
                answer: str | Future[str] | Answer
                if isinstance(message, bytes):
                    answer = self._server.answer(message, connection.id)
                elif to is None:
                    to, content = self._welcome_client(message)
                    answer = json.dumps(content)
                else:
                    answer = self._order(to, message)
                if isinstance(answer, Future):
                    answer = answer.result()
                if answer is not None:
                    connection.send(answer)
        except ConnectionClosed as error:
            if error.sent is not None and not error.rcvd_then_sent:
                self._orders.counts["web bad"] += 1
        except (CancelledError, RuntimeError):  # the server is closing
            pass

    def _welcome_client(self, message: str) -> tuple[Convention | None, dict[str, Json]]:
        """The convention of a client, None if it is invalid, and the answer."""
        try:
            hello = unpack_json(message)
            if hello.get("version") != VERSION:
                raise PacketError(f"unsupported protocol version; expected a first message with version {VERSION}")
            return Convention.of(hello), self._orders.welcome()
        except PacketError as error:
            self._orders.counts["no orders"] += 1
            return None, {"error": str(error)}

    def _order(self, to: Convention, message: str) -> "Future[str]":
        number: Json = None

        def read() -> dict[str, Json]:  # runs in the thread of the orders, so that only one long message is parsed
            nonlocal number
            order = unpack_json(message)
            identifier = order.pop("id", None)
            if not isinstance(identifier, int | str):
                raise PacketError("id: expected an integer or a text")
            number = identifier
            return order

        return self._orders.submit(to, read, lambda result: json.dumps({"id": number} | result))
