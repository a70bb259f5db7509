"""The bridge over WebSocket: a designer's page or script gives orders as JSON; a game in a browser sends its packets.

Any web page may have a browser open a WebSocket to this machine: so only pages of this machine, or of the host that is
listened at, are let in. What is no browser says no Origin.
"""

import json
import re
from concurrent.futures import CancelledError, Future
from typing import TYPE_CHECKING, Any, Final

from hapscene.bridge.conventions import Convention
from hapscene.bridge.packets import VERSION, PacketError, unpack_json
from hapscene.bridge.server import Answer, BridgeServer
from hapscene.web.listener import WebListener

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection

__all__ = ["CONNECTIONS_MAX", "MESSAGE_MAX", "WebDoor"]

MESSAGE_MAX: Final = 32 * 1024 * 1024
"""Longest message [bytes]: a mesh of half a million faces."""

CONNECTIONS_MAX: Final = 8
"""Connections at a time [count]; each may have two of the longest messages wait."""

OPEN_S: Final = 5.0
"""How long a connection may take to say what it wants [s]."""


class WebDoor:
    """Takes connections while it is open, each in a thread of its own.

    Args:
        server: whose orders are given, and whose packets are taken in binary messages.
        host, port: where to listen; port 0 for any that is free.

    Attributes:
        address: where it listens.

    Raises:
        HapsceneError: websockets is missing; the port is taken, the host not ours.
    """

    def __init__(self, server: BridgeServer, host: str, port: int) -> None:
        ours = "|".join(re.escape(name) for name in ("localhost", "127.0.0.1", "[::1]", host))
        self._server, self._orders = server, server.orders
        self._listener = WebListener(
            self._talk,
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

    def __enter__(self) -> "WebDoor":
        """Open it: the servo runs by now."""
        self._listener.open()
        return self

    def __exit__(self, *error: object) -> None:
        """Close it, and every connection."""
        self._listener.close()

    def _count(self, let_in: bool) -> None:
        self._orders.counts["web"] += 1
        self._orders.counts["web full"] += not let_in

    def _talk(self, connection: "ServerConnection") -> None:
        """Answer one client until it goes."""
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
                    to, told = self._greet(message)
                    answer = json.dumps(told)
                else:
                    answer = self._order(to, message)
                if isinstance(answer, Future):
                    answer = answer.result()
                if answer is not None:
                    connection.send(answer)
        except ConnectionClosed as error:
            if error.sent is not None and not error.rcvd_then_sent:
                self._orders.counts["web bad"] += 1
        except (CancelledError, RuntimeError):  # it ends
            pass

    def _greet(self, message: str) -> tuple[Convention | None, dict[str, Any]]:
        """A client's frame, None where it says none, and what it is told."""
        try:
            hello = unpack_json(message)
            if hello.get("version") != VERSION:
                raise PacketError(f"version {VERSION} is spoken here: say it first, with your frame")
            return Convention.of(hello), self._orders.welcome()
        except PacketError as error:
            self._orders.counts["no orders"] += 1
            return None, {"error": str(error)}

    def _order(self, to: Convention, message: str) -> "Future[str]":
        number: Any = None

        def read() -> dict[str, Any]:  # in its turn: of several long messages one at a time is taken apart
            nonlocal number
            order = unpack_json(message)
            asked = order.pop("id", None)
            if not isinstance(asked, int | str):
                raise PacketError("an order has an id, a whole number or a text")
            number = asked
            return order

        return self._orders.submit(to, read, lambda told: json.dumps({"id": number} | told))
