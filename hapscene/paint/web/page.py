"""The page of `hapscene paint`: one scene, painted and touched in the browser.

All events are handled in order in the event loop of the server; long operations run in threads. The scene is stored in
the server: closing a browser tab loses nothing, and all open tabs show the same scene. Each tab has its own tool,
swatch, brush and theme.
"""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from hapscene.errors import HapsceneError, SceneError
from hapscene.paint.model.display import Display
from hapscene.paint.model.session import Session
from hapscene.paint.web.body_panel import BESIDE, MESHES, BodyPanel
from hapscene.paint.web.context import Client, ClientContext, PageContext
from hapscene.paint.web.file_panel import FilePanel
from hapscene.paint.web.hand import HandConfig, TouchHand
from hapscene.paint.web.haptics_panel import HandPanel, ParameterPanel
from hapscene.paint.web.monitor import Monitor
from hapscene.paint.web.server import SOCKET_PATH, PageServer, button_hints
from hapscene.paint.web.socket import (
    PIXEL_MAX,
    UPLOAD_PATH,
    Message,
    PageSocket,
    Uploads,
    client_of,
    number,
    pointer_of,
)
from hapscene.paint.web.swatch_panel import SwatchPanel
from hapscene.paint.web.tool_panel import ToolPanel
from hapscene.paint.web.tools import TOOLS, Tools
from hapscene.paint.web.view import VIEWS, SceneView, ToolMarks
from hapscene.view.feel_layer import SHOWS

__all__ = ["HOST", "PORT", "Page"]

TABS: Final = ("Paint", "Bodies", "Haptics", "File")
"""Tabs of the panel, from left to right."""

THEME: Final[Mapping[str, Any]] = {"show_share_button": False, "show_logo": False, "control_width": "medium"}

HOST: Final = "127.0.0.1"
PORT: Final = 8080

SHOWN_S: Final = 10.0
"""Longest time for which the start of the hand waits for a page that shows the scene [s]."""


REST_S: Final = 1.0
"""Time without painting after which work that can wait begins [s]: on few cores, it would delay strokes."""

OPENING: Final = ("hello", "theme", "frame")
"""Messages that a page sends before it shows the scene."""


class ClientPanels(NamedTuple):
    """What the page shows in one browser only."""

    context: ClientContext
    tool: ToolPanel
    swatches: SwatchPanel
    parameters: ParameterPanel


class Page:
    """The page, served while the context manager is open: `with Page(session) as page: print(page.url)`.

    Args:
        session: the session, which must have a path.
        port: port at this computer; if it is in use, a free one near it; 0 for any.
        with_hand: start the simulated hand.
        server: server that is open already, instead of one at `port`; it is closed with the page.
        ask_upright: ask whether new meshes whose files state no vertical axis are upright.
        tip_radius_m: radius of the tip of the simulated hand's tool; 0 for a point.

    Attributes:
        server: viser server.
        context: session, view, hand and socket.
        clients: tools and controls of each browser, by viser's number.
        kept: after closing, whether there is unsaved work to recover.

    Raises:
        ViewError: viser is missing, or the port cannot be used.
        SceneError: the session has no path, or another painter has the file open.
    """

    def __init__(
        self,
        session: Session,
        port: int = PORT,
        with_hand: bool = True,
        server: PageServer | None = None,
        ask_upright: bool = False,
        tip_radius_m: float = 0.0,
    ) -> None:
        if session.path is None:
            raise SceneError("the session has no file: give it a path, such as NAME.scene.json")
        self._with_hand = with_hand
        self.kept = False
        self._ends = ExitStack()
        self._served = server or PageServer(HOST, port)
        self._ends.callback(self._served.close)
        try:
            self._begin(session, ask_upright, HandConfig(session.tuning.device, tip_radius_m=tip_radius_m))
        except BaseException:
            self.close()
            raise

    def _begin(self, session: Session, ask_upright: bool, hand: HandConfig) -> None:
        session.document.start_autosave()
        self._ends.callback(self._keep, session)
        self._ends.callback(self._served.close)
        self.server = self._served.viser
        self._loop = self.server.get_event_loop()
        self._socket = PageSocket(self._act, self._state)
        uploads = Uploads(self._socket.say, (*MESHES, *BESIDE), lambda files: self._body_panel.take(files))
        self._served.handlers |= {SOCKET_PATH: self._socket.serve, UPLOAD_PATH: uploads.serve}
        self._touch = TouchHand(self._socket.say, hand)
        self._ends.callback(self._touch.close)
        self._shown, self._pointed_s = asyncio.Event(), -math.inf  # and the last time that a pointer was down
        self.clients: dict[int, ClientPanels] = {}
        self._parted: list[Tools] = []  # of browsers that have disconnected: a reloaded page gets them back
        self.context = PageContext(
            server=self.server,
            session=session,
            view=SceneView(self.server, session.painting, Display(session.painting)),
            touch=self._touch,
            socket=self._socket,
            until_idle=self._until_idle,
            refresh=self.refresh,
            finish=self._finish,
        )
        self._repaint_due = False
        self._monitor = Monitor(self.context, self._show_status)
        self._make_panel()
        self._listen()
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
    def network_url(self) -> str | None:
        """Address of the page for other computers; None if they cannot reach it."""
        return self._served.network_url

    def __enter__(self) -> "Page":
        self._start(self._monitor.run())
        self._touch.status = "starting" if self._with_hand else self._touch.status
        self._start(self._prepare())
        return self

    async def _prepare(self) -> None:
        """Do what can wait until a page shows the scene: on few cores it would delay the page."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._shown.wait(), SHOWN_S)
        self._shown.set()
        await asyncio.to_thread(self.context.view.display.prepare_strokes)
        await self._until_idle()
        await self._monitor.prepare()
        if self._with_hand:
            await self.context.touch.open(self.context.session.painting.snapshot())

    async def _until_idle(self) -> None:
        """Wait until a page shows the scene, and no stroke was made lately or the tool Touch is selected."""
        await self._shown.wait()
        while time.monotonic() - self._pointed_s < REST_S and not any(
            panels.context.tools.name == "touch" for panels in self.clients.values()
        ):
            await asyncio.sleep(REST_S / 4)

    def _start(self, task: Coroutine[object, object, None]) -> "Future[None]":
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
        session, panels = self.context.session, tuple(self.clients.values())
        changes = session.painting.changes()
        if changes:
            self.context.view.update(changes)
            self.server.flush()  # updates the view before the panel
        if changes.faces or changes.swatch_list or changes.bodies or changes.poses:
            self._repaint_due = True
        else:  # sending parameters alone is much faster than the painting
            for index in changes.swatches:
                values = {p.name: p.value for p in session.tuning.parameters(index) if p.applies}
                self.context.touch.tune(session.scene.swatches[index].name, values)
        busy = self._body_panel.dragging or any(panel.context.tools.stroking for panel in panels)
        if self._repaint_due and not busy:
            self._repaint_due = False
            self.context.touch.repaint(session.painting.snapshot())
        self._body_panel.show()
        for panel in panels:
            panel.tool.show(changes.bodies)
            panel.swatches.show(changes.swatch_list, changes.swatches)
            panel.parameters.show()
        self._socket.send_state()

    def _finish(self) -> None:
        for panels in self.clients.values():
            panels.context.tools.finish()

    async def _act(self, message: Message) -> None:
        """Handle a message of the page."""
        panels = self.clients.get(client_of(message))
        if panels is None:
            return
        if message["do"] not in OPENING:
            self._shown.set()
        try:
            if await self._follow_pointer(message, panels.context.tools):
                return
            await self._do(message, panels)
            await asyncio.sleep(0)  # the stream of the touch runs between painting and showing it
        except (HapsceneError, OSError) as error:
            panels.context.say(str(error), "error")
        self.refresh()

    async def _follow_pointer(self, message: Message, tools: Tools) -> bool:
        """Handle a pointer event; returns whether the scene cannot have changed."""
        do = message["do"]
        if do in ("leave", "cancel"):
            await (tools.release(None) if do == "leave" else tools.cancel())
            return False
        follow = {"hover": tools.hover, "down": tools.press, "move": tools.drag, "up": tools.release}.get(do)
        if follow is None:
            return False
        self._pointed_s = self._pointed_s if do == "hover" else time.monotonic()
        pointer = pointer_of(message)
        if pointer is not None:
            await follow(pointer)
        return do == "hover" or pointer is None

    async def _do(self, message: Message, panels: ClientPanels) -> None:
        client, do = panels.context, message["do"]
        tools = client.tools
        awaited: Mapping[str, Callable[[Message], Awaitable[None]]] = {
            "save": lambda _: self._file_panel.save(),
            "body": self._body_panel.act,
            "library": panels.swatches.act,
        }
        acts: Mapping[str, Callable[[Message], object]] = {
            "undo": lambda _: self._step_back("undo", client),
            "redo": lambda _: self._step_back("redo", client),
            "tool": lambda m: tools.choose_tool(m["name"]) if m.get("name") in TOOLS else None,
            "dismiss": lambda _: self.context.dismiss(),
            "theme": lambda m: client.gui.configure_theme(dark_mode=m.get("dark") is True, **THEME),
            "view": lambda m: self._look(m, client),
            "layers": lambda _: self._next_layers(client),
            "frame": lambda m: self._frame(m, client),
            "size": lambda m: tools.resize(tools.radius_m * (number(m, "factor", 0.1, 10.0) or 1.0)),
        }
        if do in awaited:
            await awaited[do](message)
        elif do in acts:
            acts[do](message)

    def _step_back(self, do: str, client: ClientContext) -> None:
        session = self.context.session
        self.context.finish()
        what = session.undo() if do == "undo" else session.redo()
        client.say(f"Nothing to {do}." if what is None else f"{do.capitalize()}: {what}.")

    def _frame(self, message: Message, client: ClientContext) -> None:
        """Fit the scene into the view of a new page whose canvas is higher than wide."""
        width, height = (number(message, key, 1.0, PIXEL_MAX) for key in ("w", "h"))
        if width is not None and height is not None and width < height:
            self.context.view.look(client.client.camera, aspect=width / height)

    def _look(self, message: Message, client: ClientContext) -> None:
        """Show the scene from one of the `VIEWS`; without a name, frame the selected body or that under the pointer."""
        pointer, name, view = pointer_of(message), str(message.get("name")), self.context.view
        if pointer is None:
            return
        scene, chosen = self.context.session.scene, None
        if name not in VIEWS:
            ray, chosen = view.ray(pointer), self._body_panel.chosen
            hit = self.context.session.pick(*ray) if ray is not None and chosen is None else None
            chosen = chosen if hit is None else scene.bodies[hit.body].name
        framed = [] if chosen is None else [scene.body(chosen)]
        view.look(client.client.camera, framed, pointer.width / pointer.height, name)

    def _next_layers(self, client: ClientContext) -> None:
        """Show the next choice of layers: the key V."""
        view = self.context.view
        view.show_layers(SHOWS[(SHOWS.index(view.show) + 1) % len(SHOWS)])
        what = {"look": "the materials of the mesh files", "feel": "the paint", "both": "the paint over the materials"}
        client.say(f"Shows {what[view.show]}.")

    def _state(self, client: int) -> Message:
        """State of the toolbar and the status line of a browser; empty if it is unknown."""
        panels = self.clients.get(client)
        if panels is None:
            return {}
        session, tools = self.context.session, panels.context.tools
        return {
            "tool": tools.name,
            "swatch": tools.chosen,
            "colour": panels.swatches.colour_of(tools.chosen),
            "undo": session.painting.undo_text,
            "redo": session.painting.redo_text,
            "dirty": session.dirty,
            "hints": button_hints(self.server.gui, panels.context.gui),
            "title": self._path.name,
            "status": self._monitor.status,
            "outline": tuple(tools.outline.corners),
            "grain": self.context.view.grain,
            "brush": tools.stamp(),
            "hand": self.context.touch.status,
        }

    def _show_status(self) -> None:
        """Show the status of the touch and the autosave."""
        self._file_panel.show()
        self._socket.send_state()

    # --- set-up ---

    def _make_panel(self) -> None:
        gui = self.server.gui
        gui.configure_theme(**THEME)
        gui.main_panel.dock_right()
        tabs = gui.add_tab_group()
        self._paint, bodies, self._haptics, file = (tabs.add_tab(name) for name in TABS)
        with self._paint:
            gui.add_html('<span class="hs-sticky"></span>')  # keeps the next folder in place while the swatches scroll
        self._body_panel = BodyPanel(self.context, bodies)
        HandPanel(self.context, self._haptics)
        self._file_panel = FilePanel(self.context, file, self._path)
        gui.set_panel_label(self._path.name)
        self._file_panel.offer_recovery()

    def _listen(self) -> None:
        """Handle connection and disconnection of browsers."""

        @self.server.on_client_connect  # type: ignore[untyped-decorator, unused-ignore]
        async def add(client: Client) -> None:
            common, name = self.context, client.client_id
            marks = ToolMarks(client.scene, common.view, common.session.painting)
            tools = self._parted.pop() if self._parted else Tools(common.session, common.view, common.touch)
            tools.attach(marks, lambda text: self._socket.say(text, "", name))
            own = ClientContext(**vars(common), client=client, tools=tools)
            panels = ToolPanel(own, self._paint), SwatchPanel(own, self._paint), ParameterPanel(own, self._haptics)
            self.clients[name] = ClientPanels(own, *panels)
            client.gui.add_html(f'<span id="hs-client" data-id="{name}" hidden></span>')

        @self.server.on_client_disconnect  # type: ignore[untyped-decorator, unused-ignore]
        async def remove(client: Client) -> None:
            self._body_panel.dragging = False
            panels = self.clients.pop(client.client_id, None)
            if panels is not None:
                panels.swatches.close()
                await panels.context.tools.release(None)
                self._parted.append(panels.context.tools)
                self.refresh()
