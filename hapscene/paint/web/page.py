"""The page that `hapscene paint` serves: one scene, painted and touched in the browser by all who have it open.

Everything that happens, happens in the event loop of the server, one thing after the other; what takes long goes on
beside it. The scene is in the server alone: a tab that is closed loses nothing, and a second one sees the same.
"""

import asyncio
from collections.abc import Coroutine, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

from hapscene.errors import HapsceneError, SceneError
from hapscene.paint.display import Display
from hapscene.paint.recent import note_scene
from hapscene.paint.session import Session
from hapscene.paint.web.body_panel import BESIDE, MESHES, BodyPanel
from hapscene.paint.web.file_panel import FilePanel
from hapscene.paint.web.hand_config import HandConfig
from hapscene.paint.web.hand_panel import HandPanel
from hapscene.paint.web.history_panel import HistoryPanel
from hapscene.paint.web.number_panel import NumberPanel
from hapscene.paint.web.page_context import PageContext
from hapscene.paint.web.page_socket import PIXEL_MAX, PageSocket, number, pointer_of
from hapscene.paint.web.picture_panel import LEGEND, PICTURES, PicturePanel
from hapscene.paint.web.record_panel import RecordPanel
from hapscene.paint.web.scene_panel import ScenePanel
from hapscene.paint.web.scene_view import SceneView
from hapscene.paint.web.secure_server import SOCKET_PATH, PageServer
from hapscene.paint.web.share_panel import SharePanel
from hapscene.paint.web.shelf_panel import IMPORTED, LOOK, ShelfPanel
from hapscene.paint.web.standard_view import VIEWS, look
from hapscene.paint.web.tool_panel import ToolPanel
from hapscene.paint.web.tools import TOOLS, Tools
from hapscene.paint.web.touch_hand import TouchHand
from hapscene.paint.web.touch_monitor import Monitor
from hapscene.paint.web.upload import UPLOAD_PATH, Uploads
from hapscene.paint.web.viser_inside import NUMBER_MAX, button_hints, set_slider

TABS: Final = ("Paint", "Bodies", "Feel", "File")
"""Of the panel, from left to right."""

HOST: Final = "127.0.0.1"
PORT: Final = 8080

SHOWN_S: Final = 2.0
"""How long the hand's start waits for a page to show the scene [s]: whoever looks, comes by then."""

DRAWN_S: Final = 0.3
"""From when a page has its camera until its panel is drawn [s]: about."""


class Page:
    """The page, served from entry to exit: `with Page(session) as page: print(page.url)`.

    Args:
        session: the scene, with the file that it is saved to.
        host: the address to serve at; all but loopback is open to the network.
        port: the port; a free one near it where it is taken, any for 0.
        with_hand: whether the hand that touches is started.
        with_autosave: whether what is not saved yet is written beside the scene, and found again.
        hand: what the hand holds at first; None for the session's device.
        earlier: scene files of the same mesh that were painted before: the page asks whether to go on with one.
        server: what it is served by, where that is open already; it is closed with the page.

    Attributes:
        server: viser's.
        uploads: takes the files that are dropped on the page.
        context: session, view, tools, touch and socket.
        earlier: as given.
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
        earlier: Sequence[Path] = (),
        server: PageServer | None = None,
    ) -> None:
        if session.path is None:
            raise SceneError("where shall the scene be saved? give the session a file NAME.scene.json")
        self._with_autosave, self._with_hand = with_autosave, with_hand
        self._ready = self.kept = False
        self._first, self.earlier = session, tuple(earlier)
        self._watching: Future[None] | None = None
        self._ends = ExitStack()
        self._served = server or PageServer(host, port)
        try:
            self._begin(session, self._served, hand or HandConfig(session.device))
        except BaseException:
            self.close()
            self._served.close()
            raise

    def _begin(self, session: Session, server: PageServer, hand: HandConfig) -> None:
        if self._with_autosave:
            session.document.start_autosave()
        self._ends.callback(self._keep)
        self._ends.callback(server.close)
        self.server = server.viser
        self._socket = PageSocket(self._act, self._state, server.log.logger)
        self.uploads = Uploads(self._socket.say, server.log.logger)
        self.uploads.take((*MESHES, *BESIDE, *PICTURES, LEGEND, ".zip"), self._take)
        self.uploads.take(IMPORTED, lambda files: self._shelf_panel.take(files))
        self.uploads.take((LOOK,), lambda files: self._shelf_panel.take_picture(files))
        server.handlers |= {SOCKET_PATH: self._socket.serve, UPLOAD_PATH: self.uploads.serve}
        self._loop = self.server.get_event_loop()
        self._touch = TouchHand(self._socket.say, hand)
        self._ends.callback(self._touch.close)
        self._sent: Mapping[str, Any] | None = None
        self._seen = asyncio.Event()
        self._listen()
        self._make(session, Display(session.painting))
        self._ends.callback(lambda: self._shelf_panel.close())
        self._scene_panel.offer_earlier(self.earlier)
        if not self.earlier and not _path(session).exists():  # of meshes that were just opened
            self._body_panel.ask_sizes(session.scene.bodies)
        server.admit()

    def _make(self, session: Session, display: Display) -> None:
        """All that shows one session."""
        view = SceneView(self.server, session.painting, display)
        tools = Tools(session, view, self._touch, self._socket.say)
        self.context = PageContext(self.server, session, view, tools, self._touch, self._socket, self.refresh)
        if _path(session).is_file():
            note_scene(_path(session))
        self._repaint_due = False
        self._before = 0  # where the history stood when the pointer went down
        self._monitor = Monitor(self.context, self._show_status)
        self._make_panel()

    async def show_session(self, session: Session, recover: bool = False) -> None:
        """Show another session in the place of this one, whose work is kept if it is not saved, and offered again.

        With `recover`, what a killed painter of it left is brought back first.

        Raises:
            HapsceneError: another painter has its file open, or what it left cannot be loaded. Then the old one stays.
        """

        def prepare() -> Display:
            if self._with_autosave:
                session.document.start_autosave()
            left = session.document.recovery() if recover else None
            if left is not None:
                session.document.recover(left)
            return Display(session.painting)

        try:
            display = await asyncio.to_thread(prepare)
        except BaseException:
            session.document.close(keep=True)
            raise
        old, look = self.context, self._file_panel.dark
        old.tools.finish()
        self._ready = False
        watched = self._watching is not None and self._watching.cancel()
        self._keep()
        self._touch.forget()
        self._shelf_panel.close()
        self._body_panel.closed = True
        while old.questions:
            old.dismiss()
        self.server.scene.reset()
        self.server.gui.reset()
        self._make(session, display)
        self._file_panel.prefer_look(look)
        for client in self.server.get_clients().values():
            self.context.view.look_at_all(client)
        if watched:
            self._watching = self._start(self._monitor.watch())
        if self._with_hand:
            self._start(self._touch.open(session.painting.snapshot(), session.tuning.tick_s))
        kept = f" What was not saved of {_path(old.session).name} is kept, and offered when you open it."
        self._socket.say(f"{_path(session).name} is open." + kept * self.kept)
        self.refresh()

    @property
    def url(self) -> str:
        """Where a browser finds it: the only key to it. Whoever has this address may do all that the page can."""
        return self._served.url

    @property
    def public(self) -> bool:
        """Whether other computers may reach it."""
        return self._served.public

    def __enter__(self) -> "Page":
        self._watching = self._start(self._monitor.watch())
        if self._with_hand:
            self._touch.status = "starting"
            self._start(self._open_hand())
        return self

    async def _open_hand(self) -> None:
        await self._shown()
        session = self.context.session
        await self.context.touch.open(session.painting.snapshot(), session.tuning.tick_s)

    async def _shown(self) -> None:
        """Wait until a page shows the scene; no longer than it may take."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._seen.wait(), SHOWN_S)

    def _start(self, task: Coroutine[Any, Any, None]) -> "Future[None]":
        """Do something in the event loop until the page closes."""
        going = asyncio.run_coroutine_threadsafe(task, self._loop)
        self._ends.callback(going.cancel)
        return going

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop to serve. What is not saved stays beside the scene, and is offered the next time."""
        self._ends.close()

    def _keep(self) -> None:
        session = self.context.session if hasattr(self, "context") else self._first
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
        if changes.bodies:
            self._tool_panel.show_bodies()
        if changes.faces or changes.shelf or changes.bodies or changes.poses:
            self._repaint_due = True
        elif changes.swatches:
            self._tune(changes.swatches)
        going = self._body_panel.dragging or (tools.client is not None and tools.name in ("brush", "eraser"))
        if self._repaint_due and not going:
            self._repaint_due = False
            self.context.touch.repaint(session.painting.snapshot())
        self._tool_panel.show()
        self._history_panel.show()
        self._body_panel.show()
        self._shelf_panel.show(changes.shelf, changes.swatches)
        self._number_panel.show()
        self._send_state()

    def _tune(self, swatches: tuple[int, ...]) -> None:
        """Have the numbers of swatches felt that alone are others: much quicker than all of the painting."""
        session = self.context.session
        for index in swatches:
            numbers = {p.name: p.value for p in session.tuning.parameters(index) if p.applies}
            self.context.touch.tune(session.scene.swatches[index].name, numbers)

    async def _take(self, files: Sequence[Path]) -> None:
        """Give files that were dropped on the page to whom they are for."""
        kinds = {file.suffix.lower() for file in files}
        if ".zip" in kinds:
            await self._share_panel.take(files)
        elif kinds <= {*PICTURES, LEGEND}:
            await self._picture_panel.take(files)
        else:
            await self._body_panel.take(files)

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

    async def _do(self, message: Mapping[str, Any]) -> None:
        session, tools = self.context.session, self.context.tools
        do = message["do"]
        if do == "tool" and message.get("name") in TOOLS:
            tools.choose_tool(message["name"])
        elif do == "sample":
            client = number(message, "client", 0, 2**53)
            if client is not None:
                tools.sample(int(client))
        elif do == "close":
            tools.close_outline()
        elif do in ("undo", "redo"):
            tools.finish()
            what = session.undo() if do == "undo" else session.redo()
            self._socket.say(f"{'Undone' if do == 'undo' else 'Done again'}: {what}." if what else f"Nothing to {do}.")
        elif do == "save":
            await self._file_panel.save()
        elif do == "dismiss":
            self.context.dismiss()
        elif do == "look":
            self._file_panel.prefer_look(message.get("dark") is True)
        elif do == "number":
            client, value = number(message, "client", 0, 2**53), number(message, "value", -NUMBER_MAX, NUMBER_MAX)
            if client is not None and value is not None:
                said = await set_slider(self.server, int(client), str(message.get("id")), value)
                if said:
                    self._socket.say(said, "error")
        elif do == "view":
            self._look(message)
        elif do == "frame":
            client = number(message, "client", 0, 2**53)
            width, height = (number(message, key, 1.0, PIXEL_MAX) for key in ("w", "h"))
            if client is not None and width is not None and height is not None:
                self.context.view.frame(int(client), width / height)
        elif do == "body":
            await self._body_panel.act(message)
        elif do == "shelf":
            await self._shelf_panel.act(message)
        elif do == "size":
            factor = number(message, "factor", 0.1, 10.0)
            if factor is not None:
                tools.resize(tools.radius_m * factor)

    def _look(self, message: Mapping[str, Any]) -> None:
        """Have a page see all from one of the `VIEWS`; or, from where it looks now, the chosen body, or the one under
        its pointer."""
        pointer, name, view = pointer_of(message), str(message.get("name")), self.context.view
        page = self.server.get_clients().get(pointer.client) if pointer is not None else None
        if pointer is None or page is None:
            return
        painting, chosen = self.context.session.painting, None
        bodies = [body for body in painting.scene.bodies if body.name not in painting.hidden] or painting.scene.bodies
        if name not in VIEWS:
            ray, chosen = view.ray(pointer), self._body_panel.chosen
            hit = self.context.session.pick(*ray) if ray is not None and chosen is None else None
            chosen = chosen if hit is None else painting.scene.bodies[hit.body].name
        framed = bodies if chosen is None else [painting.scene.body(chosen)]
        look(page.camera, view, framed, pointer.width / pointer.height, name)

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
            "hints": button_hints(self.server),
            "title": _path(session).name,
            "word": self._monitor.status,
            "outline": self.context.tools.outline.told,
            "hand": self.context.touch.status,
        }

    def _send_state(self) -> None:
        state = self._state()
        if state != self._sent:
            if self._sent and self._sent["dirty"] and not state["dirty"]:  # it was saved
                note_scene(_path(self.context.session))
            self._sent = state
            self._socket.send(state=state)

    def _show_status(self) -> None:
        """Also what changes by itself: what is felt, and what becomes of the copy."""
        self._file_panel.show()
        self._record_panel.show()
        self._picture_panel.show()
        self._send_state()

    # --- how it is set up ---

    def _make_panel(self) -> None:
        gui = self.server.gui
        gui.main_panel.dock_right()
        tabs = gui.add_tab_group()
        paint, bodies, feel, file = (tabs.add_tab(name) for name in TABS)
        with paint:
            gui.add_html('<span class="hs-stays"></span>')  # what comes next stays while the shelf scrolls
            self._tool_panel = ToolPanel(self.context)
            self._history_panel = HistoryPanel(self.context)
            compare = gui.add_folder("Compare", expand_by_default=False)
        self._shelf_panel = ShelfPanel(self.context, paint, compare)
        self._body_panel = BodyPanel(self.context, bodies)
        self._hand_panel = HandPanel(self.context, feel)
        self._record_panel = RecordPanel(self.context, feel, self._monitor.recorder)
        self._number_panel = NumberPanel(self.context, feel)
        self._file_panel = FilePanel(self.context, file, _path(self.context.session))
        self._picture_panel = PicturePanel(self.context, file)
        self._share_panel = SharePanel(
            self.context, file, self._served.addresses(), lambda path: self._scene_panel.open(path)
        )
        gui.set_panel_label(_path(self.context.session).name)
        if self._with_autosave:
            self._file_panel.offer_recovery()
        self._scene_panel = ScenePanel(self.context, file, self.show_session, self._file_panel.order)
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


def _path(session: Session) -> Path:
    assert session.path is not None  # checked at the start, and never taken away
    return session.path
