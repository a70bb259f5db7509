"""Mouse, pen or finger on a page in the browser, as a position device without force.

The server of the page converts pointer events to positions on the surface and a depth below it, 60 to 240 times a
second. The aim moves linearly between two positions, and the tool follows the aim through a low-pass filter, so that
the steps are not perceptible. Frame D equals the frame of the scene (`Servo.start` at 0).
"""

import math
import socket
import time
from contextlib import suppress
from importlib.util import find_spec
from typing import Any, Final

from hapscene.constants import TICK_S
from hapscene.device.driver import Connection, Driver, Found, Option
from hapscene.errors import DeviceError
from hapscene.play.pointer_link import HELLO, PLACE, SILENCE_S, Place

FOLLOW_RAD_S: Final = 120.0
"""Corner of the critically damped filter [rad/s]: a lag of 17 ms behind a hand that moves at constant speed."""

SPAN_S: Final = (0.002, 0.04)
"""Shortest and longest duration of the linear movement between two positions [s]; normally their time difference."""

HOVER_M: Final = 0.0003
"""Height above the surface at which a touch starts [m]. The tool lands 5 to 10 ms later at the speed of a light tap."""

HELLO_S: Final = 2.0
"""Longest time until the server of the page answers [s]."""


class PointerConnection(Connection):
    """A tool that a page moves. One `read` is one tick.

    Args:
        door: UDP port of the page's server on this computer; 0 to serve a new page with a flat pad.
        key: key of that server for its drivers.
        tool: index of the tool.
        tick_s: period of `read` [s].
        host: address at which a new page is served.

    Raises:
        DeviceError: no answer from the server.
    """

    def __init__(self, door: int = 0, key: str = "", tool: int = 0, tick_s: float = TICK_S, host: str = "127.0.0.1"):
        super().__init__()
        self._page = None if door else _serve_page(host)
        if self._page is not None:
            door, key = self._page.link.port, self._page.link.key
        self._tick_s, self._hello = tick_s, HELLO.pack(key.encode()[:16], tool)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", door))  # accepts datagrams of the server only
        self._socket.setblocking(False)
        self._place: Place | None = None
        self._down = 0  # ticks since the pointer was pressed
        self._silent = 0  # ticks since the last datagram
        self._gap = 0  # ticks since the last new position
        self._span = 8e-3 / tick_s  # average ticks between positions
        self._left = 0.0  # ticks until the aim reaches the goal
        self._goal, self._aim = [0.0] * 3, [0.0] * 3
        self._p_m, self._v_m_s = [0.0] * 3, [0.0] * 3
        end_s = time.monotonic() + HELLO_S
        while self._place is None:
            self._receive()
            if time.monotonic() > end_s:
                self.close()
                raise DeviceError(
                    f"pointer: no answer from a page's server at port {door}; leave out option door to serve a page"
                )
            if self._place is None:
                self._say_hello()
                time.sleep(0.01)
        self.state.ready = 1

    def _say_hello(self) -> None:
        with suppress(OSError):  # the server is not running
            self._socket.send(self._hello)

    def read(self) -> None:
        """Update the state by one tick of movement towards the newest position."""
        self._receive()
        self._silent += 1
        self._gap += 1
        if self._silent * self._tick_s > SILENCE_S:
            self._down = 0
            self._say_hello()  # the server may have restarted
        place = self._place
        assert place is not None
        if self._down == 0:
            self._p_m, self._v_m_s = _towards_eye(self._p_m, place, place.clear_m), [0.0] * 3  # at once
        elif self._down <= 2:  # first above the scene, then down along the line of sight: no collision on the way
            above_m = place.clear_m if self._down == 1 else place.z_m + HOVER_M * place.back_z
            self._p_m = _towards_eye([place.x_m, place.y_m, place.z_m], place, above_m)
            self._aim, self._left = self._goal.copy(), 0.0
            self._down += 1
        else:
            self._follow()
        self.state.p_DT_m[0] = self._p_m
        self.state.buttons[0] = int(self._down > 0)
        self.state.count[0] += 1

    def _receive(self) -> None:
        """Process the datagrams that have arrived."""
        try:
            while True:
                data = self._socket.recv(PLACE.size + 1)
                if len(data) != PLACE.size:
                    continue
                place, before = Place(*PLACE.unpack(data)), self._place
                self._silent = 0
                if before is not None and place.number == before.number and place.down == (self._down > 0):
                    continue
                self._place = place
                normal = (place.normal_x, place.normal_y, place.normal_z)
                self._goal = [x - place.depth_m * n for x, n in zip(place[2:5], normal, strict=True)]
                if not place.down:
                    self._down = 0
                elif self._down == 0:
                    self._down = 1
                else:
                    self._span += 0.25 * (
                        min(max(self._gap, SPAN_S[0] / self._tick_s), SPAN_S[1] / self._tick_s) - self._span
                    )
                    self._left = self._span
                self._gap = 0
        except OSError:  # no further datagram, or no server
            pass

    def _follow(self) -> None:
        """One tick: move the aim linearly towards the goal, and the tool by the filter towards the aim."""
        fade, h_s = math.exp(-FOLLOW_RAD_S * self._tick_s), self._tick_s
        share = 1.0 if self._left <= 1.0 else 1.0 / self._left
        self._left = max(self._left - 1.0, 0.0)
        for i in range(3):
            self._aim[i] += share * (self._goal[i] - self._aim[i])
            ahead = self._p_m[i] - self._aim[i]
            pull = (self._v_m_s[i] + FOLLOW_RAD_S * ahead) * h_s
            self._p_m[i] = self._aim[i] + (ahead + pull) * fade
            self._v_m_s[i] = (self._v_m_s[i] - FOLLOW_RAD_S * pull) * fade

    def write(self) -> None:
        """Does nothing: a pointer has no force."""

    def close(self) -> None:
        self._socket.close()
        if self._page is not None:
            self._page.close()


def _towards_eye(p_m: list[float], place: Place, z_m: float) -> list[float]:
    """The point at height `z_m` on the line of sight through a point (3,)."""
    share = (z_m - p_m[2]) / place.back_z
    return [p_m[0] + share * place.back_x, p_m[1] + share * place.back_y, z_m]


def _serve_page(host: str) -> Any:
    from hapscene.play.page_server import PageServer

    page = PageServer(None, tools=1, host=host)
    page.__enter__()
    print(f"page of the pointer: {page.url}", flush=True)
    return page


def _find(**options: Any) -> list[Found]:
    if find_spec("websockets") is None:
        return [Found("browser page", trouble="websockets is not installed", remedy="pip install 'hapscene[serve]'")]
    return [Found("browser page")]


DRIVER = Driver(
    name="pointer",
    summary="Mouse, pen (with pressure) or fingers on a browser page: position, no force.",
    open=PointerConnection,
    find=_find,
    speed_m_s=math.inf,  # it jumps between lifting and pressing
    force=False,
    button_count=1,
    needs="websockets (pip install 'hapscene[serve]'), and a browser on this computer or in the same network",
    options=(
        Option("door", 0, "UDP port of a page's server on this computer; 0 serves a new page"),
        Option("key", "", "key of that server for its drivers"),
        Option("tool", 0, "index of the tool"),
        Option("tick_s", TICK_S, "period of the haptic tick [s]"),
        Option("host", "127.0.0.1", "address at which a new page is served"),
    ),
)
