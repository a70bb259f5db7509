"""The server of the page: one port for its files and its WebSocket, in the application's process.

Whatever a page sends is data of a stranger: who is let in, `web_listener.PageListener` says; messages are short, few,
and looked at field by field.
"""

import json
import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import resources
from threading import Event, RLock, Thread
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.device.driver_registry import DeviceChoice, choose
from hapscene.errors import HapsceneError
from hapscene.play.pointer_link import PointerLink
from hapscene.play.top_frame import TopFrame
from hapscene.view.palette import DARK, LIGHT, albedo_colours
from hapscene.wall_clock import CLOCK, Clock
from hapscene.web_listener import PageListener

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection

    from hapscene.scene.scene import Scene
    from hapscene.servo.servo import Servo

DEPTH_MAX_M: Final = 0.003
"""How deep a pen goes at full pressure [m]: 1 to 2 N on the swatches that are shipped."""

MESSAGE_MAX: Final = 4096
"""Longest message [bytes]; a page sends some hundred."""

MESSAGES_MAX_S: Final = 600.0
"""Most messages of a page in a second [1/s]; a page sends 250."""

STALE_S: Final = 0.5
"""After how long without a word a finger that is down counts as gone [s]: a page repeats it ten times a second."""

BEAT_S: Final = 0.03
"""How often pages and drivers are told the newest [s]."""

BIN: Final = 3
"""Ticks for each value of a trace [count]."""

BINS_MAX: Final = 400
"""Most values that a page is sent at once [count]: what it missed longer ago than that it never draws."""

SWITCHES: Final = ("wall", "friction", "lpc_texture", "tap")
"""Effects that the page switches off and on."""

FILES: Final = {
    "": ("page.html", "text/html; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
}

PICTURES: Final = {"light.png": LIGHT, "dark.png": DARK}

Sound = Callable[[bool, float], None]
"""Has sound start or stop, at a volume 0 … 1; raises HapsceneError where that fails."""


class PageServer:
    """Serves the page while it is open, and moves the tools of a servo by it.

    Args:
        scene: what is touched, as it stands now; None for a flat pad, for a driver that is opened alone.
        title: of the page.
        tools: how many fingers touch at a time.
        host, port: where to listen; port 0 for any that is free.
        kiosk_s: after how long without input all is as at the start [s]; infinite for never.
        tick_s: of the servo.
        clock: measures how long pages say nothing.

    Attributes:
        url: of the page, with its token: whoever has it may touch, nobody else.
        public: whether it is served to others than this machine.
        devices: what the servo is made with, one for each tool.
        sound: has sound started and stopped; None where there is none.

    Raises:
        HapsceneError: websockets is missing; the port is taken, the host not ours.
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
        self.frame = TopFrame(scene)
        folder = resources.files("hapscene.play")
        self._files = {name: ((folder / file).read_bytes(), kind) for name, (file, kind) in FILES.items()}
        self._pictures: dict[str, Future[bytes]] = {}
        self._listener = PageListener(
            self._talk, host, port, files=self._files, message_max=MESSAGE_MAX, more=self._picture
        )
        self.address, self.url, self.public = self._listener.address, self._listener.url, self._listener.public
        self.link = PointerLink(tools, self.frame.clear_m)
        told = {"door": self.link.port, "key": self.link.key, "tick_s": tick_s}
        self.devices: list[DeviceChoice] = [choose("pointer", tool=tool, **told) for tool in range(tools)]
        self._painters = ThreadPoolExecutor(1, "pictures")
        self._beats = Thread(target=self._beat_on)
        self._ended = Event()
        self._servo: Servo | None = None
        # what the pages have done
        self._lock = RLock()
        self._held: dict[tuple[int, int], tuple[int, float]] = {}  # page and pointer: the tool it has, when last heard
        self._input_s = self._clock.now_s()
        self._touched = False  # since all was as at the start
        self._version = 0
        self._resets = 0
        self._start_values()

    def _start_values(self) -> None:
        self._on = dict.fromkeys(SWITCHES, True)
        self._paused, self._sounds, self._volume, self._said = False, False, 0.7, ""

    def __enter__(self) -> "PageServer":
        for name, theme in PICTURES.items():
            self._pictures[name] = self._painters.submit(self.frame.picture, theme)
        self._listener.open()
        self._beats.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def attach(self, servo: "Servo") -> None:
        """Show what this servo feels, which was made with `devices` and started at 0, and order it."""
        self._servo = servo
        self._version += 1

    def close(self) -> None:
        """Close it, every connection, and lift the tools; twice does no harm."""
        if self._ended.is_set():
            return
        self._ended.set()
        self._listener.close()
        if self._beats.ident is not None:
            self._beats.join()
        self._painters.shutdown(wait=True, cancel_futures=True)
        self.lift()
        self.link.close()

    # --- requests and connections

    def _picture(self, name: str) -> tuple[bytes, str] | None:
        """The scene from above; without GL it cannot be drawn, and the page has a plain ground."""
        return (self._pictures[name].result(), "image/png") if name in self._pictures else None

    def _talk(self, connection: "ServerConnection") -> None:
        """Listen to a page until it goes; another thread tells it what is felt."""
        from websockets.exceptions import ConnectionClosed

        page, gone = id(connection), Event()
        teller = Thread(target=self._tell, args=(connection, gone))
        teller.start()
        left, last_s = MESSAGES_MAX_S, self._clock.now_s()
        try:
            while True:
                message = connection.recv()
                now_s = self._clock.now_s()
                left, last_s = min(left + (now_s - last_s) * MESSAGES_MAX_S, MESSAGES_MAX_S) - 1.0, now_s
                if left < 0.0:
                    connection.close(1008, "too many messages")
                    break
                self.take(page, message)
        except ConnectionClosed:
            pass
        finally:
            self.lift(page)
            gone.set()
            connection.close()
            teller.join()

    def _tell(self, connection: "ServerConnection", gone: Event) -> None:
        """Send a page the state whenever it has changed, and what was felt since, until it is gone."""
        from websockets.exceptions import ConnectionClosed

        version, since = -1, -1
        try:
            while not gone.wait(BEAT_S):
                if version != self._version:
                    version = self._version
                    connection.send(json.dumps(self.state()))
                if self._servo is not None:
                    try:
                        felt, since = self._felt(self._servo, since)
                    except HapsceneError as error:  # it has ended, or a device is gone
                        connection.send(json.dumps({"said": str(error)}))
                        break
                    connection.send(json.dumps(felt))
        except ConnectionClosed:
            pass

    def _beat_on(self) -> None:
        while not self._ended.wait(BEAT_S):
            self.beat()

    def beat(self) -> None:
        """Tell the drivers that we live; lift what is stale; put all back where nobody has touched for long."""
        self.link.beat()
        with self._lock:
            now_s = self._clock.now_s()
            for (page, pointer), (_, heard_s) in list(self._held.items()):
                if now_s - heard_s > STALE_S:
                    self._release(page, pointer)
            if self._touched and now_s - self._input_s > self._kiosk_s:
                self.reset()

    # --- what pages say

    def take(self, page: int, message: Any) -> None:
        """Do what a message of a page says; what is none is passed over."""
        try:
            said = json.loads(message)
        except (ValueError, RecursionError):
            return
        if not isinstance(said, dict) or len(said) > 8:
            return
        with self._lock:
            self._input_s, self._touched = self._clock.now_s(), True
            for order, value in said.items():
                do = ORDERS.get(order)
                if do is None:
                    continue
                try:
                    do(self, page, value)
                except HapsceneError as error:
                    self._say(str(error))
                except (TypeError, ValueError, LookupError, OverflowError):
                    pass

    def _points(self, page: int, value: Any) -> None:
        """[[pointer, u, v, depth as a share of the deepest], …]"""
        for pointer, u, v, depth in () if self._paused else value[:10]:
            u, v, depth = float(u), float(v), float(depth)
            if not (isinstance(pointer, int) and 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0 and 0.0 <= depth <= 1.0):
                continue
            key = (page, pointer)
            if key not in self._held:
                free = sorted({*range(self.tools)} - {tool for tool, _ in self._held.values()})
                if not free:
                    continue
                self._held[key] = free[0], 0.0
            tool = self._held[key][0]
            self._held[key] = tool, self._clock.now_s()
            place_m = self.frame.find(u, v)
            if place_m is None:
                self.link.send(tool, False, (0.0, 0.0, 0.0), 0.0)
            else:
                self.link.send(tool, True, place_m, depth * DEPTH_MAX_M)

    def _up(self, page: int, value: Any) -> None:
        for pointer in value[:10]:
            self._release(page, int(pointer))

    def _switch(self, page: int, value: Any) -> None:
        """[effect, whether it is on]"""
        effect, on = value
        if effect in SWITCHES and isinstance(on, bool):
            self._put(effect, on)
            self._say("")

    def _put(self, effect: str, on: bool) -> None:
        """Switch an effect."""
        servo = self._servo
        if servo is None or self._on[effect] == on:
            return
        servo.mute(effect, not on)
        self._on[effect] = on

    def _pause(self, page: int, value: Any) -> None:
        if self._servo is None or not isinstance(value, bool) or value == self._paused:
            return
        if value:
            self.lift()
            self._servo.pause()
        else:
            self._servo.resume()
        self._paused = value
        self._say("")

    def _hear(self, page: int, value: Any) -> None:
        """[whether there is sound, its volume]"""
        on, volume = value
        if self.sound is not None and isinstance(on, bool) and 0.0 <= float(volume) <= 1.0:
            self.sound(on, float(volume))
            self._sounds, self._volume = on, float(volume)
            self._say("")

    def lift(self, page: int | None = None) -> None:
        """Lift all tools, or those of a page."""
        with self._lock:
            for held in [key for key in self._held if page in (None, key[0])]:
                self._release(*held)

    def _release(self, page: int, pointer: int) -> None:
        tool, _ = self._held.pop((page, pointer), (-1, 0.0))
        if tool >= 0:
            self.link.send(tool, False, (0.0, 0.0, 0.0), 0.0)

    def reset(self) -> None:
        """All as at the start: tools lifted, effects on, no sound, not paused; pages clear their traces."""
        with self._lock:
            self._touched = False
            self.lift()
            try:
                for effect in SWITCHES:
                    self._put(effect, True)
                self._pause(0, False)
                if self._sounds:
                    self._hear(0, (False, self._volume))
                self._start_values()
            except HapsceneError as error:
                self._said = str(error)
            self._resets += 1
            self._say(self._said)

    def _say(self, text: str) -> None:
        """Have all pages told the state, and a sentence."""
        self._said = text
        self._version += 1

    # --- what pages are told

    def state(self) -> dict[str, Any]:
        """What a page is told first, and after each change."""
        swatches = [] if self._scene is None else self._scene.swatches
        return {
            "title": self.title,
            "size": self.frame.size,
            "width_m": self.frame.size_m[0],
            "depth_max_m": DEPTH_MAX_M,
            "tools": self.tools,
            "swatches": [[s.name, c] for s, c in zip(swatches, albedo_colours(swatches), strict=True)],
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

    def _felt(self, servo: "Servo", since: int) -> tuple[dict[str, Any], int]:
        """Traces from tick `since` on, of all tools together, where they are; and from which tick on to ask then."""
        states = [servo.state(tool=tool) for tool in range(self.tools)]
        done = states[0].tick + 1
        count = min(max(done - since, 0) // BIN, BINS_MAX) if since >= 0 else 0
        force, shake, slip = np.zeros((3, count))
        for tool in range(self.tools) if count else ():
            log = servo.read(done - (done - since) % BIN - count * BIN, tool=tool)
            if len(log.rows) < count * BIN:
                continue  # written over: a page that hung
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
                u, v = self.frame.point(float(state.p_WP_m[0]), float(state.p_WP_m[1]))
                newtons = float(np.linalg.norm(state.f_W_N))
                tools.append([round(u, 5), round(v, 5), round(newtons, 3), round(1e3 * state.depth_m, 3), state.swatch])
        traces = {"f": force, "a": shake, "v": slip}
        told: dict[str, Any] = {name: np.nan_to_num(trace).round(4).tolist() for name, trace in traces.items()}
        return told | {"felt": tools}, done - (done - max(since, 0)) % BIN


ORDERS: Final[dict[str, Callable[[PageServer, int, Any], None]]] = {
    "points": PageServer._points,
    "up": PageServer._up,
    "lift": lambda server, page, value: server.lift(),
    "switch": PageServer._switch,
    "pause": PageServer._pause,
    "hear": PageServer._hear,
    "here": lambda server, page, value: None,  # somebody is: a kiosk waits on
}
"""What a page may say: {"points": …, "up": …}."""
