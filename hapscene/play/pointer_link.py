"""Datagrams between the page server and the device `pointer` in the process of the servo, on this machine.

The driver sends a hello message with a key that it got from the server. From then on the server repeatedly sends the
latest target position. A driver that receives no message for `SILENCE_S` lifts its tool.
"""

import math
import secrets
import socket
import struct
from contextlib import suppress
from threading import Lock
from typing import Final, NamedTuple

from hapscene.geometry import Vector

__all__ = ["HELLO", "PLACE", "SILENCE_S", "Place", "PointerLink"]

SILENCE_S: Final = 0.25
"""Time without a message after which the tool is lifted [s], because the application has ended or does not respond."""

HELLO: Final = struct.Struct("<16sB")
"""Hello message: key, tool."""

MASK: Final = 2**32 - 1

PLACE: Final = struct.Struct("<I?11d")
"""Target message: the fields of a `Place`."""


TURN: Final = 0.2
"""Share by which the pressing direction turns towards the normal with each target [1]: a stroke over small faces would
otherwise shake the tool."""

EDGE: Final = 0.5
"""Cosine of the angle to the normal above which the direction takes the normal at once [1], as behind an edge."""


class Place(NamedTuple):
    """Target position of a tool.

    Attributes:
        number: sequence number.
        down: whether the tool touches; otherwise it is held above the scene.
        x_m, y_m, z_m: surface point under the pointer, in W.
        depth_m: depth below the surface, against its normal.
        clear_m: height above the whole scene.
        back_x, back_y, back_z: unit vector from the surface point to the eye, upwards.
        normal_x, normal_y, normal_z: direction against which the tool presses: the normal of the surface. A tool that
            pressed along the line of sight would slide along a face that is seen from the side, and below its body.
    """

    number: int
    down: bool
    x_m: float
    y_m: float
    z_m: float
    depth_m: float
    clear_m: float
    back_x: float = 0.0
    back_y: float = 0.0
    back_z: float = 1.0
    normal_x: float = 0.0
    normal_y: float = 0.0
    normal_z: float = 1.0


class PointerLink:
    """The server's side of the link.

    Attributes:
        port, key: options for the drivers.
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

    def press(self, tool: int, place_m: Vector, back: Vector, normal: Vector, depth_m: float) -> None:
        """Set the target of a tool, with the direction from it to the eye and the normal there, and send it."""
        with self._lock:
            before = self._places[tool]
            if before.down:
                normal = _turned(before[-3:], normal)
            place = Place(before.number + 1 & MASK, True, *place_m, depth_m, before.clear_m, *back, *normal)
            self._places[tool] = place
            self._send(tool)

    def lift(self, tool: int) -> None:
        """Lift a tool along its last direction."""
        with self._lock:
            before = self._places[tool]
            self._places[tool] = before._replace(number=before.number + 1 & MASK, down=False)
            self._send(tool)

    def beat(self) -> None:
        """Receive hello messages and repeat all targets. Call this several times within `SILENCE_S`."""
        with self._lock:
            for _ in range(64):
                try:
                    message, address = self._socket.recvfrom(HELLO.size + 1)
                except BlockingIOError:
                    break
                except OSError:  # a driver has ended
                    continue
                if len(message) == HELLO.size:
                    key, tool = HELLO.unpack(message)
                    if secrets.compare_digest(key, self.key.encode()) and tool < len(self._places):
                        self._drivers[tool] = address
            for tool in self._drivers:
                self._send(tool)

    def close(self) -> None:
        """Close the socket."""
        with self._lock:
            self._socket.close()
            self._drivers.clear()

    def _send(self, tool: int) -> None:
        if tool in self._drivers:
            with suppress(OSError):  # the driver has ended, or the socket is closed
                self._socket.sendto(PLACE.pack(*self._places[tool]), self._drivers[tool])


def _turned(before: tuple[float, ...], normal: Vector) -> Vector:
    """A unit vector turned towards a normal by `TURN`, or the normal itself behind an edge."""
    x, y, z = (a + TURN * (b - a) for a, b in zip(before, normal, strict=True))
    size = math.hypot(x, y, z)
    if x * normal[0] + y * normal[1] + z * normal[2] <= EDGE * size:
        return normal
    return x / size, y / size, z / size
