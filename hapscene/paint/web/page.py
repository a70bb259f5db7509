"""The page that `hapscene paint` serves: one scene, painted and touched in the browser by all who have it open.

Everything that happens, happens in the event loop of the server, one thing after the other; what takes long goes on
beside it. The scene is in the server alone: a tab that is closed loses nothing, and a second one sees the same.
"""

import asyncio
import secrets
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import numpy as np

from hapscene.errors import HapsceneError, SceneError
from hapscene.paint.session import Session
from hapscene.paint.web.counted_log import CountedLog
from hapscene.paint.web.hand_config import HandConfig
from hapscene.paint.web.page_context import PageContext
from hapscene.paint.web.page_socket import PIXEL_MAX, PageSocket, number, pointer_of
from hapscene.paint.web.panels import FilePanel, HandPanel, NumberPanel, ShelfPanel, ToolPanel
from hapscene.paint.web.scene_view import SceneView
from hapscene.paint.web.secure_server import LOOPBACK, serve, stop
from hapscene.paint.web.tools import TOOLS, Tools
from hapscene.paint.web.touch_hand import TouchHand
from hapscene.paint.web.viser_inside import NUMBER_MAX, set_slider
from hapscene.servo import State

# The live monitor: what the hand feels, shown on the scene, told in a line, and sent to be plotted and heard.


MONITOR_S: Final = 0.015
"""How often what was felt is sent [s]; with the browser's own 35 ms ahead it is heard about 60 ms after it was felt."""

STATUS_S: Final = 0.2
"""How often the line under the picture changes [s]: any faster cannot be read."""


class Monitor:
    """Reads the hand and shows it.

    Args:
        context: the page.
        on_status: called whenever there may be another status.

    Attributes:
        status: what is felt, in a line.
    """

    def __init__(self, context: PageContext, on_status: Callable[[], None]) -> None:
        self._context = context
        self._on_status = on_status
        self.status = ""

    async def watch(self) -> None:
        """Show and send what the hand feels, for as long as it is let."""
        touch, view, socket = self._context.touch, self._context.view, self._context.socket
        next_status_s = 0.0
        shown = False
        while True:
            await asyncio.sleep(MONITOR_S)
            now_s = time.monotonic()
            try:
                read = touch.read(now_s)
            except HapsceneError as error:
                socket.say(str(error), "error")
                continue
            if read is not None and read[0].tick >= 0:
                state, force_N, a_m_s2 = read
                if len(force_N):
                    socket.trace(force_N, a_m_s2, touch.tick_s)
                view.show_touch(state.p_WT_m, state.p_WP_m, state.f_W_N)
                shown = True
            elif shown:
                view.show_touch(None)
                shown = False
            if now_s >= next_status_s:
                next_status_s = now_s + STATUS_S
                self.status = self._status_of(None if read is None else read[0])
                self._on_status()

    def _status_of(self, state: State | None) -> str:
        session, touch = self._context.session, self._context.touch
        if touch.status == "starting":
            return "The hand gets ready …"
        if touch.status != "ready":
            return touch.problem or "There is no hand to touch with."
        if state is None or state.tick < 0:
            return "The hand is ready: press 7, hold Shift and drag on the surface."
        if not state.touching or not 0 <= state.swatch < len(session.scene.swatches):
            return f"In the air · {touch.config}"
        force_N = float(np.linalg.norm(state.f_W_N))
        name = session.scene.swatches[state.swatch].name
        return f"{name}: {force_N:.2f} N · {1e3 * state.depth_m:.2f} mm deep · {1e3 * state.slip_m_s:.0f} mm/s"


HOST: Final = "127.0.0.1"
PORT: Final = 8080

TOKEN_BYTES: Final = 16
"""Of the secret in the page's address [bytes]: 128 bits cannot be guessed."""


class Page:
    """The page, served from entry to exit: `with Page(session) as page: print(page.url)`.

    Args:
        session: the scene, with the file that it is saved to.
        host: the address to serve at; all but loopback is open to the network.
        port: the port; a free one near it where it is taken, any for 0.
        with_hand: whether the hand that touches is started.
        with_autosave: whether what is not saved yet is written beside the scene, and found again.
        hand: what the hand holds at first; None for the session's device.

    Attributes:
        server: viser's.
        context: session, view, tools, touch and socket.
        kept: once it is closed, whether there is work that is not saved, and offered the next time.

    Raises:
        ViewError: viser is not there, or the port cannot be had.
        SceneError: no file to save to, or another painter has it open.
    """

    def __init__(
        self,
        session: Session,
        host: str = HOST,
        port: int = PORT,
        with_hand: bool = True,
        with_autosave: bool = True,
        hand: HandConfig | None = None,
    ) -> None:
        if session.path is None:
            raise SceneError("where shall the scene be saved? give the session a file NAME.scene.json")
        self._with_autosave, self._with_hand = with_autosave, with_hand
        self._ready = self.kept = False
        self._ends = ExitStack()
        try:
            self._begin(session, host, port, hand or HandConfig(session.device))
        except BaseException:
            self.close()
            raise

    def _begin(self, session: Session, host: str, port: int, hand: HandConfig) -> None:
        if self._with_autosave:
            session.document.start_autosave()
        self._ends.callback(self._keep, session)
        log = CountedLog()
        self._ends.callback(log.close)
        self._socket = PageSocket(self._act, self._state, log.logger)
        self._token = secrets.token_urlsafe(TOKEN_BYTES)
        self.server = serve(host, port, self._token, self._socket.serve, log)
        self._ends.callback(stop, self.server)
        self._loop = self.server.get_event_loop()
        view = SceneView(self.server, session.painting)
        touch = TouchHand(self._socket.say, hand)
        self._ends.callback(touch.close)
        tools = Tools(session, view, touch, self._socket.say)
        self.context = PageContext(self.server, session, view, tools, touch, self._socket, self.refresh)
        self._sent: Mapping[str, Any] | None = None
        self._repaint_due = False
        self._monitor = Monitor(self.context, self._show_status)
        self._make_panel()

    @property
    def url(self) -> str:
        """Where a browser finds it: the only key to it. Whoever has this address may do all that the page can."""
        host = self.server.get_host()
        name = {"0.0.0.0": "localhost", "::": "localhost"}.get(host, host)
        return f"http://{f'[{name}]' if ':' in name else name}:{self.server.get_port()}/{self._token}/"

    @property
    def public(self) -> bool:
        """Whether other computers may reach it."""
        return self.server.get_host() not in LOOPBACK

    def __enter__(self) -> "Page":
        self._start(self._monitor.watch())
        if self._with_hand:
            session = self.context.session
            self._start(self.context.touch.open(session.painting.snapshot(), session.tuning.tick_s))
        return self

    def _start(self, task: Coroutine[Any, Any, None]) -> None:
        """Do something in the event loop until the page closes."""
        self._ends.callback(asyncio.run_coroutine_threadsafe(task, self._loop).cancel)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop to serve. What is not saved stays beside the scene, and is offered the next time."""
        self._ends.close()

    def _keep(self, session: Session) -> None:
        session.end_stroke()
        self.kept = session.document.close(keep=True)

    # --- what happens ---

    def refresh(self) -> None:
        """Show, and have felt, what changed. Called in the event loop after whatever may have changed something."""
        session, tools = self.context.session, self.context.tools
        changes = session.painting.changes()
        if changes:
            self.context.view.update(changes)
            self.server.flush()  # the picture first, the panel after it
        if changes.faces or changes.shelf:
            self._repaint_due = True
        elif changes.swatches:
            self._tune(changes.swatches)
        if self._repaint_due and not (tools.client is not None and tools.name in ("brush", "eraser")):
            self._repaint_due = False
            self.context.touch.repaint(session.painting.snapshot())
        self._tool_panel.show()
        self._shelf_panel.show(changes.shelf, changes.swatches)
        self._number_panel.show()
        self._send_state()

    def _tune(self, swatches: tuple[int, ...]) -> None:
        """Have the numbers of swatches felt that alone are others: much quicker than all of the painting."""
        session = self.context.session
        for index in swatches:
            numbers = {p.name: p.value for p in session.tuning.parameters(index) if p.applies}
            self.context.touch.tune(session.scene.swatches[index].name, numbers)

    async def _act(self, message: Mapping[str, Any]) -> None:
        """Do what a page's own message says."""
        if not self._ready:
            return
        try:
            if await self._follow_pointer(message):
                return
            await self._do(message)
        except (HapsceneError, OSError) as error:
            self._socket.say(str(error), "error")
        self.refresh()

    async def _follow_pointer(self, message: Mapping[str, Any]) -> bool:
        """Follow the pointer; whether nothing can have changed."""
        tools = self.context.tools
        do = message["do"]
        if do == "leave":
            await tools.release(None)
            return False
        follow = {"hover": tools.hover, "down": tools.press, "move": tools.drag, "up": tools.release}.get(do)
        if follow is None:
            return False
        pointer = pointer_of(message)
        if pointer is not None:
            await follow(pointer)
        return do == "hover" or pointer is None

    async def _do(self, message: Mapping[str, Any]) -> None:
        session, tools = self.context.session, self.context.tools
        do = message["do"]
        if do == "tool" and message.get("name") in TOOLS:
            tools.choose_tool(message["name"])
        elif do in ("undo", "redo"):
            tools.finish()
            what = session.undo() if do == "undo" else session.redo()
            self._socket.say(f"{'Undone' if do == 'undo' else 'Done again'}: {what}." if what else f"Nothing to {do}.")
        elif do == "save":
            await self._file_panel.save()
        elif do == "look":
            self._file_panel.prefer_look(message.get("dark") is True)
        elif do == "number":
            client, value = number(message, "client", 0, 2**53), number(message, "value", -NUMBER_MAX, NUMBER_MAX)
            if client is not None and value is not None:
                said = await set_slider(self.server, int(client), str(message.get("id")), value)
                if said:
                    self._socket.say(said, "error")
        elif do == "frame":
            client = number(message, "client", 0, 2**53)
            width, height = (number(message, key, 1.0, PIXEL_MAX) for key in ("w", "h"))
            if client is not None and width is not None and height is not None:
                self.context.view.frame(int(client), width / height)
        elif do == "size":
            factor = number(message, "factor", 0.1, 10.0)
            if factor is not None:
                tools.resize(tools.radius_m * factor)

    def _state(self) -> Mapping[str, Any]:
        """What the bar over the picture shows."""
        if not self._ready:
            return {}
        session = self.context.session
        return {
            "tool": self.context.tools.name,
            "swatch": self.context.tools.chosen,
            "colour": self._shelf_panel.colour_of(self.context.tools.chosen),
            "undo": session.painting.undo_text,
            "redo": session.painting.redo_text,
            "dirty": session.dirty,
            "title": _path(session).name,
            "word": self._monitor.status,
            "hand": self.context.touch.status,
        }

    def _send_state(self) -> None:
        state = self._state()
        if state != self._sent:
            self._sent = state
            self._socket.send(state=state)

    def _show_status(self) -> None:
        """Also what changes by itself: what is felt, and what becomes of the copy."""
        self._file_panel.show()
        self._send_state()

    # --- how it is set up ---

    def _make_panel(self) -> None:
        gui = self.server.gui
        gui.main_panel.dock_right()
        tabs = gui.add_tab_group()
        paint, feel, compare, file = (tabs.add_tab(name) for name in ("Paint", "Feel", "Compare", "File"))
        with paint:
            self._tool_panel = ToolPanel(self.context)
        self._shelf_panel = ShelfPanel(self.context, paint, compare)
        HandPanel(self.context, feel)
        self._number_panel = NumberPanel(self.context, feel)
        self._file_panel = FilePanel(self.context, file, _path(self.context.session))
        gui.set_panel_label(_path(self.context.session).name)
        if self._with_autosave:
            self._file_panel.offer_recovery()
        self._ready = True

        @self.server.on_client_connect  # type: ignore[untyped-decorator, unused-ignore]
        async def name_client(client: Any) -> None:
            client.gui.add_html(f'<span id="hs-client" data-id="{client.client_id}" hidden></span>')

        @self.server.on_client_disconnect  # type: ignore[untyped-decorator, unused-ignore]
        async def lift(client: Any) -> None:
            if self.context.tools.client == client.client_id:
                await self.context.tools.release(None)
                self.refresh()


def _path(session: Session) -> Path:
    assert session.path is not None  # checked at the start, and never taken away
    return session.path
