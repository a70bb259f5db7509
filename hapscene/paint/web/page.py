"""The page of `hapscene paint`: one scene, painted and touched in the browser.

All events are handled in order in the event loop of the server; long operations run in threads. The scene is stored in
the server: closing a browser tab loses nothing, and all open tabs show the same scene.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

from hapscene.errors import HapsceneError, SceneError
from hapscene.paint.model.display import Display
from hapscene.paint.model.session import Session
from hapscene.paint.web.body_panel import BESIDE, MESHES, BodyPanel
from hapscene.paint.web.context import PageContext
from hapscene.paint.web.file_panel import FilePanel
from hapscene.paint.web.hand import HandConfig, TouchHand
from hapscene.paint.web.haptics_panel import HandPanel, ParameterPanel
from hapscene.paint.web.monitor import Monitor
from hapscene.paint.web.server import SOCKET_PATH, PageServer, button_hints
from hapscene.paint.web.socket import PIXEL_MAX, UPLOAD_PATH, Message, PageSocket, Uploads, number, pointer_of
from hapscene.paint.web.swatch_panel import LOOK, SwatchPanel
from hapscene.paint.web.tool_panel import ToolPanel
from hapscene.paint.web.tools import TOOLS, Tools
from hapscene.paint.web.view import VIEWS, SceneView
from hapscene.surface.swatch_file import SUFFIX as SWATCH_SUFFIX
from hapscene.view.feel_layer import SHOWS

__all__ = ["HOST", "PORT", "Page"]

TABS: Final = ("Paint", "Bodies", "Haptics", "File")
"""Tabs of the panel, from left to right."""

THEME: Final[Mapping[str, Any]] = {"show_share_button": False, "show_logo": False, "control_width": "medium"}

HOST: Final = "127.0.0.1"
PORT: Final = 8080

SHOWN_S: Final = 2.0
"""Longest time for which the start of the hand waits for a page that shows the scene [s]."""

DRAWN_S: Final = 0.3
"""Approximate time from the connection of a page until its panel is drawn [s]."""


class Page:
    """The page, served while the context manager is open: `with Page(session) as page: print(page.url)`.

    Args:
        session: the session, which must have a path.
        host: address to listen at; any but loopback is open to the network.
        port: port; if it is in use, a free one near it; 0 for any.
        with_hand: start the simulated hand.
        hand: configuration of the hand; None for the device of the session.
        server: server that is open already; it is closed with the page.
        ask_upright: ask whether new meshes whose files state no vertical axis are upright.

    Attributes:
        server: viser server.
        uploads: receives files that are dropped on the page.
        context: session, view, tools, hand and socket.
        kept: after closing, whether there is unsaved work to recover.

    Raises:
        ViewError: viser is missing, or the port cannot be used.
        SceneError: the session has no path, or another painter has the file open.
    """

    def __init__(
        self,
        session: Session,
        host: str = HOST,
        port: int = PORT,
        with_hand: bool = True,
        hand: HandConfig | None = None,
        server: PageServer | None = None,
        ask_upright: bool = False,
    ) -> None:
        if session.path is None:
            raise SceneError("the session has no file: give it a path, such as NAME.scene.json")
        self._with_hand = with_hand
        self._ready = self.kept = False
        self._ends = ExitStack()
        self._served = server or PageServer(host, port)
        self._ends.callback(self._served.close)
        try:
            self._begin(session, hand or HandConfig(session.tuning.device), ask_upright)
        except BaseException:
            self.close()
            raise

    def _begin(self, session: Session, hand: HandConfig, ask_upright: bool) -> None:
        session.document.start_autosave()
        self._ends.callback(self._keep, session)
        self._ends.callback(self._served.close)
        self.server = self._served.viser
        self._loop = self.server.get_event_loop()
        self._socket = PageSocket(self._act, self._state)
        self.uploads = Uploads(self._socket.say)
        self.uploads.take((*MESHES, *BESIDE), lambda files: self._body_panel.take(files))
        self.uploads.take((SWATCH_SUFFIX,), lambda files: self._swatch_panel.take(files))
        self.uploads.take((LOOK,), lambda files: self._swatch_panel.take_picture(files))
        self._served.handlers |= {SOCKET_PATH: self._socket.serve, UPLOAD_PATH: self.uploads.serve}
        self._touch = TouchHand(self._socket.say, hand)
        self._ends.callback(self._touch.close)
        self._sent: Message | None = None
        self._page_shown = asyncio.Event()
        self._listen()
        view = SceneView(self.server, session.painting, Display(session.painting))
        tools = Tools(session, view, self._touch, self._socket.say)
        self.context = PageContext(self.server, session, view, tools, self._touch, self._socket, self.refresh)
        self._repaint_due = False
        self._before = 0  # state of the history when the pointer button was pressed
        self._monitor = Monitor(self.context, self._show_status)
        self._make_panel()
        self._ends.callback(self._swatch_panel.close)
        if not self._path.exists():  # a new scene of meshes
            if ask_upright:
                self._body_panel.ask_upright(session.scene.bodies)
            self._body_panel.ask_sizes(session.scene.bodies)
        self._served.admit()

    @property
    def url(self) -> str:
        """Address of the page with its token, which gives full access."""
        return self._served.url

    @property
    def _path(self) -> Path:
        assert self.context.session.path is not None  # checked in `__init__`, and never unset
        return self.context.session.path

    @property
    def public(self) -> bool:
        """Whether other computers can reach the page."""
        return self._served.public

    def __enter__(self) -> "Page":
        self._start(self._monitor.run())
        if self._with_hand:
            self._touch.status = "starting"
            self._start(self._open_hand())
        return self

    async def _open_hand(self) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(self._page_shown.wait(), SHOWN_S)
        await self.context.touch.open(self.context.session.painting.snapshot())

    def _start(self, task: Coroutine[Any, Any, None]) -> "Future[None]":
        """Run a task in the event loop until the page closes."""
        running = asyncio.run_coroutine_threadsafe(task, self._loop)
        self._ends.callback(running.cancel)
        return running

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the server. Unsaved work is kept for recovery."""
        self._ends.close()

    def _keep(self, session: Session) -> None:
        session.end_stroke()
        self.kept = session.document.close(keep=True)

    # --- events ---

    def refresh(self) -> None:
        """Show changes of the scene and send them to the hand. Must be called in the event loop."""
        session, tools = self.context.session, self.context.tools
        changes = session.painting.changes()
        if changes:
            self.context.view.update(changes)
            self.server.flush()  # updates the view before the panel
        if changes.bodies:
            self._tool_panel.show_bodies()
        if changes.faces or changes.swatch_list or changes.bodies or changes.poses:
            self._repaint_due = True
        else:  # sending parameters alone is much faster than the painting
            for index in changes.swatches:
                values = {p.name: p.value for p in session.tuning.parameters(index) if p.applies}
                self.context.touch.tune(session.scene.swatches[index].name, values)
        busy = self._body_panel.dragging or (tools.client is not None and tools.name in ("brush", "eraser"))
        if self._repaint_due and not busy:
            self._repaint_due = False
            self.context.touch.repaint(session.painting.snapshot())
        self._tool_panel.show()
        self._body_panel.show()
        self._swatch_panel.show(changes.swatch_list, changes.swatches)
        self._parameter_panel.show()
        self._send_state()

    async def _act(self, message: Message) -> None:
        """Handle a message of the page."""
        if not self._ready:
            return
        try:
            if await self._follow_pointer(message):
                return
            await self._do(message)
        except (HapsceneError, OSError) as error:
            self._socket.say(str(error), "error")
        self.refresh()

    async def _follow_pointer(self, message: Message) -> bool:
        """Handle a pointer event; returns whether the scene cannot have changed."""
        tools = self.context.tools
        do = message["do"]
        if do == "down":
            self._before = self.context.session.history.state
        if do in ("leave", "cancel"):
            session, drawing = self.context.session, tools.client is not None
            await tools.release(None)
            if do == "cancel" and drawing and session.history.state != self._before:
                self._socket.say(f"Cancelled: {session.undo()}.")
            return False
        follow = {"hover": tools.hover, "down": tools.press, "move": tools.drag, "up": tools.release}.get(do)
        if follow is None:
            return False
        pointer = pointer_of(message)
        if pointer is not None:
            await follow(pointer)
        return do == "hover" or pointer is None

    async def _do(self, message: Message) -> None:
        tools, do = self.context.tools, message["do"]
        awaited: Mapping[str, Callable[[Message], Awaitable[None]]] = {
            "save": lambda _: self._file_panel.save(),
            "body": self._body_panel.act,
            "library": self._swatch_panel.act,
        }
        acts: Mapping[str, Callable[[Message], None]] = {
            "undo": lambda _: self._step_back("undo"),
            "redo": lambda _: self._step_back("redo"),
            "tool": lambda m: tools.choose_tool(m["name"]) if m.get("name") in TOOLS else None,
            "dismiss": lambda _: self.context.dismiss(),
            "theme": self._set_theme,
            "view": self._look,
            "layers": lambda _: self._next_layers(),
            "frame": self._frame,
            "size": lambda m: tools.resize(tools.radius_m * (number(m, "factor", 0.1, 10.0) or 1.0)),
        }
        if do in awaited:
            await awaited[do](message)
        elif do in acts:
            acts[do](message)

    def _step_back(self, do: str) -> None:
        session = self.context.session
        self.context.tools.finish()
        what = session.undo() if do == "undo" else session.redo()
        self._socket.say(f"Nothing to {do}." if what is None else f"{do.capitalize()}: {what}.")

    def _set_theme(self, message: Message) -> None:
        """Set the theme of the page that asks."""
        page = self.server.get_clients().get(_client(message))
        if page is not None:
            page.gui.configure_theme(dark_mode=message.get("dark") is True, **THEME)

    def _frame(self, message: Message) -> None:
        """Fit the scene into the view of a new page whose canvas is higher than wide."""
        page = self.server.get_clients().get(_client(message))
        width, height = (number(message, key, 1.0, PIXEL_MAX) for key in ("w", "h"))
        if page is not None and width is not None and height is not None and width < height:
            self.context.view.look(page.camera, aspect=width / height)

    def _look(self, message: Message) -> None:
        """Show the scene from one of the `VIEWS`; without a name, frame the selected body or that under the pointer."""
        pointer, name, view = pointer_of(message), str(message.get("name")), self.context.view
        page = self.server.get_clients().get(pointer.client) if pointer is not None else None
        if pointer is None or page is None:
            return
        scene, chosen = self.context.session.scene, None
        if name not in VIEWS:
            ray, chosen = view.ray(pointer), self._body_panel.chosen
            hit = self.context.session.pick(*ray) if ray is not None and chosen is None else None
            chosen = chosen if hit is None else scene.bodies[hit.body].name
        framed = [] if chosen is None else [scene.body(chosen)]
        view.look(page.camera, framed, pointer.width / pointer.height, name)

    def _next_layers(self) -> None:
        """Show the next choice of layers: the key V."""
        view = self.context.view
        view.show_layers(SHOWS[(SHOWS.index(view.show) + 1) % len(SHOWS)])
        what = {"look": "the materials of the mesh files", "feel": "the paint", "both": "the paint over the materials"}
        self._socket.say(f"Shows {what[view.show]}.")

    def _state(self) -> Message:
        """State of the toolbar and the status line, sent to the pages."""
        if not self._ready:
            return {}
        session, tools = self.context.session, self.context.tools
        return {
            "tool": tools.name,
            "swatch": tools.chosen,
            "colour": self._swatch_panel.colour_of(tools.chosen),
            "undo": session.painting.undo_text,
            "redo": session.painting.redo_text,
            "dirty": session.dirty,
            "hints": button_hints(self.server),
            "title": self._path.name,
            "status": self._monitor.status,
            "outline": tools.outline.state,
            "grain": self.context.view.grain,
            "hand": self.context.touch.status,
        }

    def _send_state(self) -> None:
        state = self._state()
        if state != self._sent:
            self._sent = state
            self._socket.send(state=state)

    def _show_status(self) -> None:
        """Show the status of the touch and the autosave."""
        self._file_panel.show()
        self._send_state()

    # --- set-up ---

    def _make_panel(self) -> None:
        gui = self.server.gui
        gui.configure_theme(**THEME)
        gui.main_panel.dock_right()
        tabs = gui.add_tab_group()
        paint, bodies, haptics, file = (tabs.add_tab(name) for name in TABS)
        with paint:
            gui.add_html('<span class="hs-sticky"></span>')  # keeps the next folder in place while the swatches scroll
            self._tool_panel = ToolPanel(self.context)
        self._swatch_panel = SwatchPanel(self.context, paint)
        self._body_panel = BodyPanel(self.context, bodies)
        HandPanel(self.context, haptics)
        self._parameter_panel = ParameterPanel(self.context, haptics)
        self._file_panel = FilePanel(self.context, file, self._path, self._served.addresses())
        gui.set_panel_label(self._path.name)
        self._file_panel.offer_recovery()
        self._ready = True

    def _listen(self) -> None:
        """Handle connection and disconnection of pages."""

        @self.server.on_client_connect  # type: ignore[untyped-decorator, unused-ignore]
        async def name_client(client: Any) -> None:
            client.gui.add_html(f'<span id="hs-client" data-id="{client.client_id}" hidden></span>')
            self._loop.call_later(DRAWN_S, self._page_shown.set)

        @self.server.on_client_disconnect  # type: ignore[untyped-decorator, unused-ignore]
        async def lift(client: Any) -> None:
            self._body_panel.dragging = False
            if self.context.tools.client == client.client_id:
                await self.context.tools.release(None)
                self.refresh()


def _client(message: Message) -> int:
    """Number of the page that sent a message; −1 if it is missing."""
    client = number(message, "client", 0, 2**53)
    return -1 if client is None else int(client)
