"""Mouse, pen or finger on a page in the browser as a device: position, no force.

The page's server turns what the pointer does into places on the surface, and a depth below it. They come 60 to 240
times a second; the tool goes straight from one to the next, and follows that smoothly, so that the steps are neither
felt nor heard. Its frame D is that of the scene: `Servo.start` at 0.
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
"""How fast the tool follows, critically damped [rad/s]: 17 ms behind a hand that moves evenly."""

SPAN_S: Final = (0.002, 0.04)
"""Least and longest time in which it goes straight from a place to the next [s]: as long as they are apart."""

HOVER_M: Final = 0.0003
"""How far over the surface a touch begins [m]: it lands 5 to 10 ms later, with the speed of a light tap."""

HELLO_S: Final = 2.0
"""How long the page's server may take to answer [s]."""


class PointerConnection(Connection):
    """A tool that a page moves. One `read` is one tick.

    Args:
        door: port of the page's server on this machine; 0 to open a page of its own, with a flat pad.
        key: what that server knows its drivers by.
        tool: which of its tools.
        tick_s: how often it is read.
        host: where a page of its own is served.

    Raises:
        DeviceError: nobody answers.
    """

    def __init__(self, door: int = 0, key: str = "", tool: int = 0, tick_s: float = TICK_S, host: str = "127.0.0.1"):
        super().__init__()
        self._page = None if door else _own_page(host)
        if self._page is not None:
            door, key = self._page.link.port, self._page.link.key
        self._tick_s, self._hello = tick_s, HELLO.pack(key.encode()[:16], tool)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", door))  # from now on only the server is heard
        self._socket.setblocking(False)
        self._place: Place | None = None
        self._down = 0  # ticks since it went down
        self._silent = 0  # since anything was heard, in ticks
        self._gap = 0  # since the last place
        self._span = 8e-3 / tick_s  # between places, in ticks
        self._left = 0.0  # until it is straight at the goal, in ticks
        self._goal, self._aim = [0.0] * 3, [0.0] * 3
        self._p_m, self._v_m_s = [0.0] * 3, [0.0] * 3
        end_s = time.monotonic() + HELLO_S
        while self._place is None:
            self._hear()
            if time.monotonic() > end_s:
                self.close()
                raise DeviceError(f"no server of a page answers at port {door}; without door a page is opened")
            if self._place is None:
                self._say_hello()
                time.sleep(0.01)
        self.state.ready = 1

    def _say_hello(self) -> None:
        with suppress(OSError):  # nobody is there, or no longer
            self._socket.send(self._hello)

    def read(self) -> None:
        """The newest place, and a tick's way towards it."""
        self._hear()
        self._silent += 1
        self._gap += 1
        if self._silent * self._tick_s > SILENCE_S:
            self._down = 0
            self._say_hello()  # a server that comes back
        place = self._place
        assert place is not None
        if self._down == 0:
            self._p_m[2], self._v_m_s = place.clear_m, [0.0] * 3  # straight up, at once
        elif self._down <= 2:  # to above the place, then straight down to it: it meets nothing on the way
            self._p_m = [place.x_m, place.y_m, place.clear_m if self._down == 1 else place.z_m + HOVER_M]
            self._aim, self._left = self._goal.copy(), 0.0
            self._down += 1
        else:
            self._follow()
        self.state.p_DT_m[0] = self._p_m
        self.state.buttons[0] = int(self._down > 0)
        self.state.count[0] += 1

    def _hear(self) -> None:
        """Take the newest datagram."""
        try:
            while True:
                said = self._socket.recv(PLACE.size + 1)
                if len(said) != PLACE.size:
                    continue
                place, before = Place(*PLACE.unpack(said)), self._place
                self._silent = 0
                if before is not None and place.number == before.number and place.down == (self._down > 0):
                    continue
                self._place, self._goal = place, [place.x_m, place.y_m, place.z_m - place.depth_m]
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
        except OSError:  # nothing more; or nobody there
            pass

    def _follow(self) -> None:
        """Go on for a tick: the aim straight to the goal, the tool after the aim."""
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
        """A pointer gives no force."""

    def close(self) -> None:
        self._socket.close()
        if self._page is not None:
            self._page.close()


def _own_page(host: str) -> Any:
    from hapscene.play.page_server import PageServer

    page = PageServer(None, tools=1, host=host)
    page.__enter__()
    print(f"the pointer's page: {page.url}", flush=True)
    return page


def _find(**options: Any) -> list[Found]:
    if find_spec("websockets") is None:
        return [Found("a page", trouble="its page needs websockets", remedy="pip install 'hapscene[serve]'")]
    return [Found("a page in the browser")]


DRIVER = Driver(
    name="pointer",
    summary="Mouse, pen with pressure, or fingers, on a page in the browser: position, no force.",
    open=PointerConnection,
    find=_find,
    speed_m_s=math.inf,  # it jumps from where it was lifted to where it is put down
    force=False,
    button_count=1,
    needs="websockets (pip install 'hapscene[serve]'); a browser here, or on a phone in the same network",
    options=(
        Option("door", 0, "port of a page's server on this machine; 0 opens a page of its own"),
        Option("key", "", "what that server knows its drivers by"),
        Option("tool", 0, "which of its tools this is"),
        Option("tick_s", TICK_S, "how often it is read [s]"),
        Option("host", "127.0.0.1", "address at which a page of its own is served"),
    ),
)
