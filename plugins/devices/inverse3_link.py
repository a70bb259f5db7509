"""WebSocket to Haply's Inverse service, read without another thread. Not a driver."""

import socket
import time
from contextlib import suppress
from typing import Any, Final, Self

from hapscene.errors import DeviceError

__all__ = ["Link"]

SIZE: Final = 1 << 16
"""Most bytes of one read from the system."""

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
        self._socket = socket.socket()
        self._messages: list[bytes] = []
        self._frames: list[bytes] = []  # of a message that is not complete
        try:
            place = parse_uri(uri)
            self._protocol: Any = ClientProtocol(place, max_size=1 << 20)
            self._socket.close()
            self._socket = socket.create_connection((place.host, place.port), wait_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._protocol.send_request(self._protocol.connect())
            end_s = time.monotonic() + wait_s
            while not self._is_open():
                self._flush()
                self._take(max(1e-3, end_s - time.monotonic()))
        except (OSError, ValueError, WebSocketException) as error:
            self._socket.close()
            raise DeviceError(
                f"inverse3: {uri}: no answer ({error}); start Haply's Inverse service, or name its address by "
                "--option uri="
            ) from None

    def receive(self, wait_s: float) -> bytes | None:
        """Return the next message; None if none arrives within a time.

        Raises:
            OSError: the service has closed the connection.
        """
        if not self._messages:
            with suppress(TimeoutError, BlockingIOError):
                self._take(wait_s)
        return self._messages.pop(0) if self._messages else None

    def send(self, message: bytes) -> None:
        """Send a message.

        Raises:
            OSError: the service has closed the connection, or accepts no data for 50 ms.
        """
        if not self._is_open():
            raise ConnectionResetError("closed")
        self._protocol.send_text(message)
        self._flush()

    def close(self) -> None:
        """Close the connection. Raises nothing; may be called twice."""
        with suppress(OSError):
            if self._is_open():
                self._protocol.send_close()
                self._flush()
                end_s = time.monotonic() + CLOSE_S
                while time.monotonic() < end_s:  # unread data would reset the connection, and discard what was sent
                    self._take(CLOSE_S)
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _is_open(self) -> bool:
        if self._protocol.handshake_exc is not None:
            raise self._protocol.handshake_exc
        return self._protocol.state.name == "OPEN"

    def _take(self, wait_s: float) -> None:
        """Receive what has arrived, or arrives within a time."""
        self._socket.settimeout(wait_s)
        data = self._socket.recv(SIZE)
        self._protocol.receive_data(data) if data else self._protocol.receive_eof()
        for event in self._protocol.events_received():
            if getattr(event, "opcode", 8) < 8:  # neither the answer to the handshake nor a control frame
                self._frames.append(bytes(event.data))
                if event.fin:
                    self._messages.append(b"".join(self._frames))
                    self._frames.clear()
        self._flush()  # answers to pings
        if not data:
            raise ConnectionResetError("closed")

    def _flush(self) -> None:
        if data := b"".join(self._protocol.data_to_send()):
            self._socket.settimeout(0.05)
            self._socket.sendall(data)
