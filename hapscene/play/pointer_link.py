"""What passes between the page's server and the device `pointer` in the servo's process: datagrams on this machine.

The driver says hello, with a key that the server gave it; from then on the server sends it places, the newest one again
and again: a driver that hears nothing for `SILENCE_S` lifts its tool.
"""

import secrets
import socket
import struct
from contextlib import suppress
from threading import Lock
from typing import Final, NamedTuple

__all__ = ["HELLO", "PLACE", "SILENCE_S", "Place", "PointerLink"]

SILENCE_S: Final = 0.25
"""After how long without a word the tool is lifted [s]: the application is gone, stopped or too busy."""

HELLO: Final = struct.Struct("<16sB")
"""Key, tool."""

PLACE: Final = struct.Struct("<I?5d")
"""A `Place`."""


class Place(NamedTuple):
    """Where a tool shall be.

    Attributes:
        number: one more with each place.
        down: whether it touches; else it is held over the scene.
        x_m, y_m, z_m: the surface under the pointer, in W.
        depth_m: how far below it.
        clear_m: height over everything.
    """

    number: int
    down: bool
    x_m: float
    y_m: float
    z_m: float
    depth_m: float
    clear_m: float


class PointerLink:
    """The server's end.

    Attributes:
        port, key: what drivers are told.
    """

    def __init__(self, tools: int, clear_m: float) -> None:
        self.key = secrets.token_hex(HELLO.size // 2)[:16]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self._places = [Place(0, False, 0.0, 0.0, 0.0, 0.0, clear_m)] * tools
        self._drivers: dict[int, tuple[str, int]] = {}
        self._lock = Lock()

    def send(self, tool: int, down: bool, place_m: tuple[float, float, float], depth_m: float) -> None:
        """Have a tool go to a place."""
        with self._lock:
            before = self._places[tool]
            self._places[tool] = Place((before.number + 1) % 2**32, down, *place_m, depth_m, before.clear_m)
            self._send(tool)

    def beat(self) -> None:
        """Hear who came, and tell all where their tools shall be; many times within `SILENCE_S`."""
        with self._lock:
            for _ in range(64):
                try:
                    said, address = self._socket.recvfrom(HELLO.size + 1)
                except BlockingIOError:
                    break
                except OSError:  # a driver that is gone
                    continue
                if len(said) == HELLO.size:
                    key, tool = HELLO.unpack(said)
                    if secrets.compare_digest(key, self.key.encode()) and tool < len(self._places):
                        self._drivers[tool] = address
            for tool in self._drivers:
                self._send(tool)

    def close(self) -> None:
        with self._lock:
            self._socket.close()
            self._drivers.clear()

    def _send(self, tool: int) -> None:
        if tool in self._drivers:
            with suppress(OSError):  # it is gone, or this is closed
                self._socket.sendto(PLACE.pack(*self._places[tool]), self._drivers[tool])
