"""Server of the page of `hapscene play`: a `hapscene.web.server.WebServer` and the handlers of its messages.

Messages of pages are not trusted: each field is checked.
"""

import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import resources
from threading import Event, RLock, Thread
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.device.driver_registry import choose
from hapscene.errors import HapsceneError
from hapscene.exchange.html_page import scene_json
from hapscene.io.files import Json
from hapscene.play.line_of_sight import LineOfSight
from hapscene.play.pointer_link import PointerLink
from hapscene.view.palette import albedo_colours
from hapscene.wall_clock import CLOCK, Clock
from hapscene.web.server import PageConnection, WebServer

if TYPE_CHECKING:
    from hapscene.loop.servo import Servo
    from hapscene.scene.scene import Scene

__all__ = ["DEPTH_MAX_M", "STALE_S", "PageServer"]

DEPTH_MAX_M: Final = 0.003
"""Depth of a pen at full pressure [m]: gives 1 to 2 N on the shipped swatches."""

STALE_S: Final = 0.5
"""Time without a message after which a finger counts as lifted [s]; a page repeats its messages at 10 Hz."""

BEAT_S: Final = 0.03
"""Period of updates to pages and drivers [s]."""

BIN: Final = 3
"""Number of ticks for each value of a trace [count]."""

BINS_MAX: Final = 400
"""Largest number of values sent at once [count]; older values are dropped."""

SWITCHES: Final = ("wall", "friction", "lpc_texture", "tap")
"""Effects that the page can turn on and off."""

Sound = Callable[[bool, float], None]
"""Starts or stops sound at a volume of 0 to 1; raises HapsceneError on failure."""


class PageServer:
    """Serves the page while it is open, and moves the tools of a servo.

    Args:
        scene: touched scene; None for a flat pad.
        title: title of the page.
        tools: number of fingers that can touch at the same time.
        host, port: address to listen at; port 0 for any free one.
        kiosk_s: time without input after which the page is reset [s]; infinite for never.
        tick_s: tick period of the servo [s].
        clock: measures the time without messages.

    Attributes:
        url: address of the page with its token, which gives access.
        public: whether other machines can reach the page.
        devices: devices for the servo, one for each tool.
        sound: starts and stops sound; None without sound.

    Raises:
        HapsceneError: websockets is not installed, the port is in use, or the host is not an address of this machine.
    """

    def __init__(
        self,
        scene: "Scene | None",
        *,
        title: str = "",
        tools: int = 2,
        host: str = "127.0.0.1",
        port: int = 0,
        kiosk_s: float = math.inf,
        tick_s: float = TICK_S,
        clock: Clock = CLOCK,
    ) -> None:
        self.title, self.tools, self._clock = title, tools, clock
        self.sound: Sound | None = None
        self._scene, self._kiosk_s = scene, kiosk_s
        self.sight = LineOfSight(scene)
        self._drawn: Future[str] | None = None
        self._server = WebServer(
            resources.files("hapscene.play"),
            "page",
            take=self.take,
            joined=lambda page: page.send(self.state()),
            left=self.lift,
            host=host,
            port=port,
            content=self._content,
            clock=clock,
        )
        self.address, self.url, self.public = self._server.address, self._server.url, self._server.public
        self.link = PointerLink(tools, self.sight.clear_m)
        self.devices = [
            choose("pointer", tool=tool, door=self.link.port, key=self.link.key, tick_s=tick_s) for tool in range(tools)
        ]
        self._drawer = ThreadPoolExecutor(1, "scene of the page")
        self._beats = Thread(target=self._beat_on)
        self._ended = Event()
        self._servo: Servo | None = None
        # state set by the pages
        self._lock = RLock()
        self._held: dict[tuple[PageConnection, int], tuple[int, float]] = {}  # tool, time of the last message
        self._input_s = self._clock.now_s()
        self._touched = False  # whether there was input since the last reset
        self._version = 0
        self._resets = 0
        self._start_values()

    def _start_values(self) -> None:
        self._on = dict.fromkeys(SWITCHES, True)
        self._paused, self._sounds, self._volume, self._said = False, False, 0.7, ""

    def __enter__(self) -> "PageServer":
        if self._scene is not None and self._scene.bodies:
            self._drawn = self._drawer.submit(scene_json, self._scene, self.title)
        self._server.open()
        self._beats.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def attach(self, servo: "Servo") -> None:
        """Connect a servo, which was made with `devices` and started at the origin."""
        self._servo = servo
        self._version += 1

    def close(self) -> None:
        """Close every connection and lift the tools. A second call has no effect."""
        if self._ended.is_set():
            return
        self._ended.set()
        self._server.close()
        if self._beats.ident is not None:
            self._beats.join()
        self._drawer.shutdown(wait=True, cancel_futures=True)
        self.lift()
        self.link.close()

    # --- requests and connections

    def _content(self, name: str) -> tuple[bytes, str] | None:
        """The script that draws the scene, and its data, which do not exist without bodies."""
        if name == "view.js":
            script = resources.files("hapscene.web").joinpath("touch_page", name)
            return script.read_bytes(), "text/javascript; charset=utf-8"
        if name == "scene.json" and self._drawn is not None:
            return self._drawn.result().encode(), "application/json"
        return None

    def _beat_on(self) -> None:
        version, since = self._version, -1
        while not self._ended.wait(BEAT_S):
            self.beat()
            if version != self._version:
                version = self._version
                self._server.send(self.state())
            since = self._send_felt(since)

    def beat(self) -> None:
        """Send the drivers a heartbeat, lift tools without messages, and reset a kiosk without input."""
        self.link.beat()
        with self._lock:
            now_s = self._clock.now_s()
            for (page, pointer), (_, message_s) in list(self._held.items()):
                if now_s - message_s > STALE_S:
                    self._release(page, pointer)
            if self._touched and now_s - self._input_s > self._kiosk_s:
                self.reset()

    def _send_felt(self, since: int) -> int:
        """Send traces from tick `since` on to all pages; returns the tick at which the next message begins."""
        if self._servo is None or not self._server.pages:
            return -1
        try:
            felt, since = self._felt(self._servo, since)
        except HapsceneError as error:  # the servo has ended, or its device is disconnected
            felt = {"said": str(error)}
        self._server.send(felt)
        return since

    # --- messages of pages

    def take(self, page: PageConnection, message: Json) -> None:
        """Handle a message of a page; an invalid message has no effect."""
        if not isinstance(message, dict) or len(message) > 8:
            return
        with self._lock:
            self._input_s, self._touched = self._clock.now_s(), True
            for order, value in message.items():
                do = ORDERS.get(order)
                if do is None:
                    continue
                try:
                    do(self, page, value)
                except HapsceneError as error:
                    self._say(str(error))
                except (TypeError, ValueError, LookupError, OverflowError):
                    pass

    def _points(self, page: PageConnection, value: Json) -> None:
        """Handle [[pointer, position of the eye [m], direction, depth relative to DEPTH_MAX_M], …]."""
        for pointer, eye, direction, depth in () if self._paused else value[:10]:
            (x, y, z), (dx, dy, dz), depth = map(float, eye), map(float, direction), float(depth)
            if not (isinstance(pointer, int) and 0.0 <= depth <= 1.0):
                continue
            key = (page, pointer)
            if key not in self._held:
                free = sorted({*range(self.tools)} - {tool for tool, _ in self._held.values()})
                if not free:
                    continue
                self._held[key] = free[0], 0.0
            tool = self._held[key][0]
            self._held[key] = tool, self._clock.now_s()
            found = self.sight.find((x, y, z), (dx, dy, dz))
            if found is None:
                self.link.lift(tool)
            else:
                self.link.press(tool, *found, depth * DEPTH_MAX_M)

    def _up(self, page: PageConnection, value: Json) -> None:
        for pointer in value[:10]:
            self._release(page, int(pointer))

    def _switch(self, page: PageConnection, value: Json) -> None:
        """Handle [effect, whether it is on]."""
        effect, on = value
        if effect in SWITCHES and isinstance(on, bool):
            self._set_effect(effect, on)
            self._say("")

    def _set_effect(self, effect: str, on: bool) -> None:
        servo = self._servo
        if servo is None or self._on[effect] == on:
            return
        servo.mute(effect, not on)
        self._on[effect] = on

    def _pause(self, page: PageConnection, value: Json) -> None:
        """Handle whether to pause."""
        if isinstance(value, bool):
            self._set_paused(value)

    def _set_paused(self, paused: bool) -> None:
        if self._servo is None or paused == self._paused:
            return
        if paused:
            self.lift()
            self._servo.pause()
        else:
            self._servo.resume()
        self._paused = paused
        self._say("")

    def _sound(self, page: PageConnection, value: Json) -> None:
        """Handle [whether sound is on, volume]."""
        on, volume = value
        if isinstance(on, bool) and 0.0 <= float(volume) <= 1.0:
            self._set_sound(on, float(volume))

    def _set_sound(self, on: bool, volume: float) -> None:
        if self.sound is not None:
            self.sound(on, volume)
            self._sounds, self._volume = on, volume
            self._say("")

    def lift(self, page: PageConnection | None = None) -> None:
        """Lift all tools, or the tools of a page."""
        with self._lock:
            for held in [key for key in self._held if page in (None, key[0])]:
                self._release(*held)

    def _release(self, page: PageConnection, pointer: int) -> None:
        tool, _ = self._held.pop((page, pointer), (-1, 0.0))
        if tool >= 0:
            self.link.lift(tool)

    def reset(self) -> None:
        """Restore the initial state: tools lifted, effects on, sound off, not paused, traces cleared."""
        with self._lock:
            self._touched = False
            self.lift()
            try:
                for effect in SWITCHES:
                    self._set_effect(effect, True)
                self._set_paused(False)
                if self._sounds:
                    self._set_sound(False, self._volume)
                self._start_values()
            except HapsceneError as error:
                self._said = str(error)
            self._resets += 1
            self._say(self._said)

    def _say(self, text: str) -> None:
        """Send the state and a message to all pages."""
        self._said = text
        self._version += 1

    # --- messages to pages

    def state(self) -> dict[str, Json]:
        """State that a page receives first, and after each change."""
        swatches = [] if self._scene is None else self._scene.swatches
        bodies = [] if self._scene is None else self._scene.bodies
        return {
            "title": self.title,
            "low": self.sight.low_m.tolist(),
            "size": self.sight.size_m.tolist(),
            "depth_max_m": DEPTH_MAX_M,
            "tools": self.tools,
            "swatches": [[s.name, c] for s, c in zip(swatches, albedo_colours(swatches), strict=True)],
            "used": sorted({int(k) for body in bodies for k in np.unique(body.face_swatch)}),
            "bodies": len(bodies),
            "effects": self._on,
            "paused": self._paused,
            "sound": None if self.sound is None else self._sounds,
            "volume": self._volume,
            "kiosk": math.isfinite(self._kiosk_s),
            "resets": self._resets,
            "said": self._said,
            "ready": self._servo is not None or self._scene is None,
            "bin_s": BIN * (TICK_S if self._servo is None else self._servo.tick_s),
        }

    def _felt(self, servo: "Servo", since: int) -> tuple[dict[str, Json], int]:
        """Traces of all tools from tick `since` on, with their positions; and the tick for the next call."""
        states = [servo.state(tool=tool) for tool in range(self.tools)]
        done = states[0].tick + 1
        count = min(max(done - since, 0) // BIN, BINS_MAX) if since >= 0 else 0
        force, shake, slip = np.zeros((3, count))
        for tool in range(self.tools) if count else ():
            log = servo.read(done - (done - since) % BIN - count * BIN, tool=tool)
            if len(log.rows) < count * BIN:
                continue  # the log was overwritten because this call came too late
            rows = log.rows[: count * BIN]
            binned = np.linalg.norm(rows["f_W_N"], axis=1).reshape(count, BIN)
            force = np.maximum(force, binned.max(axis=1))
            slip = np.maximum(slip, rows["slip_m_s"].reshape(count, BIN).max(axis=1))
            samples = log.a_m_s2[: count * BIN].reshape(count, -1)
            peak = np.take_along_axis(samples, np.abs(samples).argmax(axis=1)[:, None], axis=1)[:, 0]
            shake = np.where(np.abs(peak) > np.abs(shake), peak, shake)
        tools = []
        for state in states:
            if state.touching:
                newtons = float(np.linalg.norm(state.f_W_N))
                place_m = [round(float(x_m), 6) for x_m in state.p_WP_m]
                tools.append([place_m, round(newtons, 3), round(1e3 * state.depth_m, 3), state.swatch])
        traces = {"f": force, "a": shake, "v": slip}
        message: dict[str, Json] = {name: np.nan_to_num(trace).round(4).tolist() for name, trace in traces.items()}
        return message | {"felt": tools}, done - (done - max(since, 0)) % BIN


ORDERS: Final[dict[str, Callable[[PageServer, PageConnection, Json], None]]] = {
    "points": PageServer._points,
    "up": PageServer._up,
    "lift": lambda server, page, value: server.lift(),
    "switch": PageServer._switch,
    "pause": PageServer._pause,
    "sound": PageServer._sound,
    "active": lambda server, page, value: None,  # input on the page itself, which postpones the reset of a kiosk
}
"""Handlers of messages such as {"points": …, "up": …}."""
