"""The page's own socket, beside viser's: pointer, keys and buttons come in; state, traces and sound go out."""

import contextlib
import json
import logging
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.paint.web.scene_view import Pointer

MESSAGE_BYTES_MAX: Final = 10_000
"""Longest message that is read [bytes]; a page sends some hundred."""

BACKLOG_BYTES_MAX: Final = 500_000
"""How much may wait for a page that does not read [bytes]: some seconds of traces; no more of them is sent to it."""

PIXEL_MAX: Final = 1e5
"""Largest canvas that is believed [pixels]."""

Act = Callable[[Mapping[str, Any]], Awaitable[None]]


class PageSocket:
    """All pages that are open. Its methods are called in the server's event loop.

    Args:
        act: does what a message says.
        state: what a page that comes is told first.
        log: is told of messages that are none.
    """

    def __init__(self, act: Act, state: Callable[[], Mapping[str, Any]], log: logging.Logger) -> None:
        self._act = act
        self._log = log
        self._state = state
        self._sockets: set[Any] = set()
        self._muted: set[Any] = set()
        self.refused = 0
        """How many messages were none of ours."""

    async def serve(self, connection: Any) -> None:
        """Serve a page until it goes. One message after the other: none overtakes another."""
        from websockets.exceptions import ConnectionClosed

        self._sockets.add(connection)
        try:
            self._send_to(connection, json.dumps({"state": self._state()}))
            async for raw in connection:
                message = parse(raw)
                if message is None:
                    self.refused += 1
                    self._log.warning("malformed message refused: not of the page's own")
                elif message["do"] == "listen":
                    (self._muted.discard if message.get("on") else self._muted.add)(connection)
                else:
                    await self._act(message)
        except ConnectionClosed:
            pass
        finally:
            self._sockets.discard(connection)
            self._muted.discard(connection)

    def send(self, **content: Any) -> None:
        """Send to all pages."""
        text = json.dumps(content)
        for connection in self._sockets:
            self._send_to(connection, text)

    def say(self, text: str, kind: str = "") -> None:
        """Show a line to all who look; `kind` is "error" or nothing."""
        self.send(say=text, kind=kind)

    def trace(self, force_N: NDArray[Any], a_m_s2: NDArray[Any], tick_s: float) -> None:
        """What was felt: force (n,) [N] and acceleration (n, block) [m/s²]."""
        head = (1.0, tick_s, len(force_N), a_m_s2.shape[1])
        self._send_numbers(np.concatenate((head, force_N, a_m_s2.ravel())))

    def sound(self, a_m_s2: NDArray[Any], rate_Hz: float) -> None:
        """An acceleration (n,) [m/s²] to be heard at once."""
        self._send_numbers(np.concatenate(((2.0, rate_Hz), a_m_s2)))

    def _send_numbers(self, numbers: NDArray[Any]) -> None:
        content = numbers.astype("<f4").tobytes()
        for connection in self._sockets:
            self._send_to(connection, content)

    def _send_to(self, connection: Any, content: str | bytes) -> None:
        from websockets.asyncio.server import broadcast

        waits = connection.transport.get_write_buffer_size()
        if isinstance(content, bytes) and waits >= BACKLOG_BYTES_MAX:
            return  # a trace, a sound; a text is sent once
        if waits >= 10 * BACKLOG_BYTES_MAX:
            connection.transport.abort()  # it reads nothing any more
            return
        with contextlib.suppress(RuntimeError):  # it is closing
            broadcast([connection], content)


def parse(raw: str | bytes) -> dict[str, Any] | None:
    """A message from anybody: a small object whose "do" is a text; else None."""
    if not isinstance(raw, str) or len(raw) > MESSAGE_BYTES_MAX:
        return None
    try:
        message = json.loads(raw)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) and isinstance(message.get("do"), str) else None


def number(message: Mapping[str, Any], key: str, low: float, high: float) -> float | None:
    """A number of a message within bounds; None where it is none."""
    value = message.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        return None
    return float(value)


def pointer_of(message: Mapping[str, Any]) -> Pointer | None:
    """Where the pointer is, of a message from anybody; None where it does not say."""
    client = number(message, "client", 0, 2**53)
    x, y = number(message, "x", -10.0, 10.0), number(message, "y", -10.0, 10.0)
    width, height = number(message, "w", 1.0, PIXEL_MAX), number(message, "h", 1.0, PIXEL_MAX)
    if client is None or x is None or y is None or width is None or height is None:
        return None
    return Pointer(int(client), x, y, width, height)
