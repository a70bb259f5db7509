"""WebSocket (RFC 6455) to Haply's Inverse service, read without another thread. Not a driver.

The package websockets makes the connection. Its frames take ten times as long as those here, and need a thread, for
which a tick would wait.
"""

import select
import socket
import struct
import time
from contextlib import suppress
from typing import Final, Self

from hapscene.errors import DeviceError

__all__ = ["LINK_MODULES", "Link"]

LINK_MODULES: Final = ("websockets.client", "websockets.exceptions", "websockets.uri")
"""Modules that are imported when a link is opened (`Driver.imports`)."""

CONTINUATION, TEXT, BINARY, CLOSE, PING, PONG = 0, 1, 2, 8, 9, 10

LAST, MASKED = 0x80, 0x80
"""Bit of the last frame of a message, and of a frame with a mask."""

MESSAGE_MAX: Final = 1 << 20
"""Largest message [bytes]."""

WRITE_S: Final = 0.05
"""Longest time that a message may block [s]."""

CLOSE_S: Final = 0.2
"""Time that the service has to answer the closing message [s]."""


class Link:
    """An open WebSocket. Use it as a context manager."""

    def __init__(self, uri: str, wait_s: float) -> None:
        """Connect to the service.

        Raises:
            DeviceError: websockets is not installed, or the service does not answer in time.
        """
        try:
            from websockets.client import ClientProtocol
            from websockets.exceptions import WebSocketException
            from websockets.uri import parse_uri
        except ImportError:
            raise DeviceError("inverse3: websockets is not installed; pip install 'hapscene[serve]'") from None
        self._socket, self._data, self._message = socket.socket(), b"", b""
        try:
            place = parse_uri(uri)
            self._socket.close()
            self._socket = socket.create_connection((place.host, place.port), wait_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            handshake = ClientProtocol(place)
            handshake.send_request(handshake.connect())
            self._socket.sendall(b"".join(handshake.data_to_send()))
            answer, end_s = b"", time.monotonic() + wait_s
            while b"\r\n\r\n" not in answer:
                self._socket.settimeout(max(1e-3, end_s - time.monotonic()))
                if not (data := self._socket.recv(1 << 16)):
                    raise ConnectionResetError("closed")
                answer += data
            head, _, self._data = answer.partition(b"\r\n\r\n")
            handshake.receive_data(head + b"\r\n\r\n")
            if handshake.handshake_exc is not None:
                raise handshake.handshake_exc
            self._socket.settimeout(0.0)
        except (OSError, ValueError, WebSocketException) as error:
            self._socket.close()
            raise DeviceError(
                f"inverse3: {uri}: no answer ({error}); start Haply's Inverse service, or name its address by "
                "--option uri="
            ) from None

    def receive(self, wait_s: float) -> bytes | None:
        """Return the next message; None if none arrives within a time.

        Raises:
            OSError: the service has closed the connection, or sends invalid frames.
        """
        message = self._next()
        if message is None:
            if wait_s > 0.0:
                select.select([self._socket], [], [], wait_s)
            with suppress(BlockingIOError):
                if not (data := self._socket.recv(1 << 16)):
                    raise ConnectionResetError("closed")
                self._data += data
                message = self._next()
        return message

    def send(self, data: bytes, kind: int = TEXT) -> None:
        """Send a message.

        Raises:
            OSError: the service has closed the connection, or accepts no data for `WRITE_S`.
        """
        # a mask of 0 leaves the data as they are; masks protect proxies, which are not used on this computer
        size = bytes((MASKED | len(data),)) if len(data) < 126 else struct.pack(">BH", MASKED | 126, len(data))
        frame, end_s = bytes((LAST | kind,)) + size + b"\0\0\0\0" + data, time.monotonic() + WRITE_S
        while frame:
            try:
                frame = frame[self._socket.send(frame) :]
            except BlockingIOError:
                if time.monotonic() > end_s:
                    raise TimeoutError("it accepts no data") from None
                select.select([], [self._socket], [], WRITE_S)

    def close(self) -> None:
        """Close the connection. Raises nothing; may be called twice."""
        with suppress(OSError, ValueError):  # select raises ValueError for a closed socket
            self.send(struct.pack(">H", 1000), CLOSE)
            end_s = time.monotonic() + CLOSE_S
            while time.monotonic() < end_s:  # unread data would reset the connection, and discard what was sent
                self.receive(CLOSE_S)
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _next(self) -> bytes | None:
        """Remove the next message from the received data; None if it is not complete."""
        data = self._data
        while len(data) >= 2:
            head, size, at = data[0], data[1], 2
            if size == 126 and len(data) >= 4:
                (size,), at = struct.unpack_from(">H", data, 2), 4
            elif size == 127 and len(data) >= 10:
                (size,), at = struct.unpack_from(">Q", data, 2), 10
            elif size > 125:
                if size > 127:
                    raise ConnectionAbortedError("a frame of the service has a mask")
                return None
            if size + len(self._message) > MESSAGE_MAX:
                raise ConnectionAbortedError("a message of the service is too long")
            if len(data) < at + size:
                return None
            content, data = data[at : at + size], data[at + size :]
            self._data = data
            kind = head & 0x0F
            if kind == CLOSE:
                raise ConnectionResetError("closed")
            if kind == PING:
                self.send(content, PONG)
            if kind <= BINARY:
                self._message += content
                if head & LAST:
                    message, self._message = self._message, b""
                    return message
        return None
