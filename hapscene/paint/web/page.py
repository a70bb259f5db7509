"""The page that `hapscene paint` serves: one scene, painted and touched in the browser by all who have it open.

Everything happens in the event loop of the server, one thing after the other; what takes long runs beside it. The scene
is in the server alone: a closed tab loses nothing, and a second one shows the same.
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
from hapscene.paint.web.feel_panel import HandPanel, NumberPanel
from hapscene.paint.web.file_panel import FilePanel
from hapscene.paint.web.hand import HandConfig, TouchHand
from hapscene.paint.web.monitor import Monitor
from hapscene.paint.web.server import SOCKET_PATH, PageServer, button_hints
from hapscene.paint.web.socket import PIXEL_MAX, UPLOAD_PATH, Message, PageSocket, Uploads, number, pointer_of
from hapscene.paint.web.swatch_panel import LOOK, SwatchPanel
from hapscene.paint.web.tool_panel import ToolPanel
from hapscene.paint.web.tools import TOOLS, Tools
from hapscene.paint.web.view import VIEWS, SceneView
from hapscene.surface.swatch_file import SUFFIX as SWATCH_SUFFIX

__all__ = ["HOST", "PORT", "Page"]

TABS: Final = ("Paint", "Bodies", "Feel", "File")
"""Tabs of the panel, from left to right."""

HOST: Final = "127.0.0.1"
PORT: Final = 8080

SHOWN_S: Final = 2.0
"""Longest wait of the hand's start for a page that shows the scene [s]."""

DRAWN_S: Final = 0.3
"""Time from a page's connection until its panel is drawn [s]: about."""


class Page:
    """The page, served from entry to exit: `with Page(session) as page: print(page.url)`.

    Args:
        session: the scene, with the file that it is saved to.
        host: the address to serve at; all but loopback is open to the network.
        port: the port; a free one near it where it is taken, any for 0.
        with_hand: whether the hand that touches is started.
        with_autosave: whether unsaved work is written beside the scene and offered again.
        hand: what the hand holds at first; None for the session's device.
        server: the server, if it is open already; it is closed with the page.

    Attributes:
        server: viser's.
        uploads: receives the files that are dropped on the page.
        context: session, view, tools, touch and socket.
        kept: after closing, whether there is unsaved work, to be offered the next time.

    Raises:
        ViewError: viser is missing, or the port cannot be used.
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
        server: PageServer | None = None,
    ) -> None:
        if session.path is None:
            raise SceneError("where shall the scene be saved? give the session a file NAME.scene.json")
        self._with_autosave, self._with_hand = with_autosave, with_hand
        self._ready = self.kept = False
        self._ends = ExitStack()
        self._served = server or PageServer(host, port)
        self._ends.callback(self._served.close)
        try:
            self._begin(session, hand or HandConfig(session.device))
        except BaseException:
            self.close()
            raise

    def _begin(self, session: Session, hand: HandConfig) -> None:
        if self._with_autosave:
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
        self._seen = asyncio.Event()
        self._listen()
        view = SceneView(self.server, session.painting, Display(session.painting))
        tools = Tools(session, view, self._touch, self._socket.say)
        self.context = PageContext(self.server, session, view, tools, self._touch, self._socket, self.refresh)
        self._repaint_due = False
        self._before = 0  # state of the history when the pointer went down
        self._monitor = Monitor(self.context, self._show_status)
        self._make_panel()
        self._ends.callback(self._swatch_panel.close)
        if not self._path.exists():  # of meshes that were just opened
            self._body_panel.ask_sizes(session.scene.bodies)
        self._served.admit()

    @property
    def url(self) -> str:
        """Address of the page, with its token: whoever has it may do all that the page can."""
        return self._served.url

    @property
    def _path(self) -> Path:
        assert self.context.session.path is not None  # checked at the start, and never removed
        return self.context.session.path

    @property
    def public(self) -> bool:
        """Whether other computers may reach it."""
        return self._served.public

    def __enter__(self) -> "Page":
        self._start(self._monitor.watch())
        if self._with_hand:
            self._touch.status = "starting"
            self._start(self._open_hand())
        return self

    async def _open_hand(self) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(self._seen.wait(), SHOWN_S)
        session = self.context.session
        await self.context.touch.open(session.painting.snapshot(), session.tuning.tick_s)

    def _start(self, task: Coroutine[Any, Any, None]) -> "Future[None]":
        """Run a task in the event loop until the page closes."""
        going = asyncio.run_coroutine_threadsafe(task, self._loop)
        self._ends.callback(going.cancel)
        return going

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the server. Unsaved work stays beside the scene, and is offered the next time."""
        self._ends.close()

    def _keep(self, session: Session) -> None:
        session.end_stroke()
        self.kept = session.document.close(keep=True)

    # --- events ---

    def refresh(self) -> None:
        """Show what changed, and let the hand feel it. Called in the event loop after anything that may change."""
        session, tools = self.context.session, self.context.tools
        changes = session.painting.changes()
        if changes:
            self.context.view.update(changes)
            self.server.flush()  # the picture first, the panel after it
        if changes.bodies:
            self._tool_panel.show_bodies()
        if changes.faces or changes.shelf or changes.bodies or changes.poses:
            self._repaint_due = True
        else:  # numbers alone are much quicker than the whole painting
            for index in changes.swatches:
                numbers = {p.name: p.value for p in session.tuning.parameters(index) if p.applies}
                self.context.touch.tune(session.scene.swatches[index].name, numbers)
        busy = self._body_panel.dragging or (tools.client is not None and tools.name in ("brush", "eraser"))
        if self._repaint_due and not busy:
            self._repaint_due = False
            self.context.touch.repaint(session.painting.snapshot())
        self._tool_panel.show()
        self._body_panel.show()
        self._swatch_panel.show(changes.shelf, changes.swatches)
        self._number_panel.show()
        self._send_state()

    async def _act(self, message: Message) -> None:
        """Do what a message of the page says."""
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
        """Follow the pointer; returns whether nothing can have changed."""
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
            "shelf": self._swatch_panel.act,
        }
        acts: Mapping[str, Callable[[Message], None]] = {
            "undo": lambda _: self._step_back("undo"),
            "redo": lambda _: self._step_back("redo"),
            "tool": lambda m: tools.choose_tool(m["name"]) if m.get("name") in TOOLS else None,
            "sample": lambda m: tools.sample(_client(m)),
            "close": lambda _: tools.close_outline(),
            "dismiss": lambda _: self.context.dismiss(),
            "look": lambda m: self._file_panel.prefer_look(m.get("dark") is True),
            "view": self._look,
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
        self._socket.say(f"{'Undone' if do == 'undo' else 'Done again'}: {what}." if what else f"Nothing to {do}.")

    def _frame(self, message: Message) -> None:
        """Have all in view of a new page, whose picture may be higher than wide."""
        page = self.server.get_clients().get(_client(message))
        width, height = (number(message, key, 1.0, PIXEL_MAX) for key in ("w", "h"))
        if page is not None and width is not None and height is not None and width < height:
            self.context.view.look(page.camera, aspect=width / height)

    def _look(self, message: Message) -> None:
        """Show all from one of the `VIEWS`; else, from here, the chosen body or the one under the pointer."""
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

    def _state(self) -> Message:
        """What the bar over the picture shows."""
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
            "word": self._monitor.status,
            "outline": tools.outline.told,
            "hand": self.context.touch.status,
        }

    def _send_state(self) -> None:
        state = self._state()
        if state != self._sent:
            self._sent = state
            self._socket.send(state=state)

    def _show_status(self) -> None:
        """Show what changes by itself: the touch, and the autosave."""
        self._file_panel.show()
        self._send_state()

    # --- set-up ---

    def _make_panel(self) -> None:
        gui = self.server.gui
        gui.main_panel.dock_right()
        tabs = gui.add_tab_group()
        paint, bodies, feel, file = (tabs.add_tab(name) for name in TABS)
        with paint:
            gui.add_html('<span class="hs-stays"></span>')  # what follows stays while the swatches scroll
            self._tool_panel = ToolPanel(self.context)
        self._swatch_panel = SwatchPanel(self.context, paint)
        self._body_panel = BodyPanel(self.context, bodies)
        HandPanel(self.context, feel)
        self._number_panel = NumberPanel(self.context, feel)
        self._file_panel = FilePanel(self.context, file, self._path, self._served.addresses())
        gui.set_panel_label(self._path.name)
        if self._with_autosave:
            self._file_panel.offer_recovery()
        self._ready = True

    def _listen(self) -> None:
        """Take note of pages that come and go."""

        @self.server.on_client_connect  # type: ignore[untyped-decorator, unused-ignore]
        async def name_client(client: Any) -> None:
            client.gui.add_html(f'<span id="hs-client" data-id="{client.client_id}" hidden></span>')
            self._loop.call_later(DRAWN_S, self._seen.set)

        @self.server.on_client_disconnect  # type: ignore[untyped-decorator, unused-ignore]
        async def lift(client: Any) -> None:
            self._body_panel.dragging = False
            if self.context.tools.client == client.client_id:
                await self.context.tools.release(None)
                self.refresh()


def _client(message: Message) -> int:
    """Number of the page that sent a message; −1, which no page has, where it is missing."""
    client = number(message, "client", 0, 2**53)
    return -1 if client is None else int(client)
