"""Objects that the panels of the page share: session, view, simulated hand, socket, dialogs, callbacks.

`PageContext` is common to all browsers; `ClientContext` adds what each browser has of its own.
"""

import html
import inspect
import math
from collections.abc import Awaitable, Callable, Coroutine, Hashable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from hapscene.errors import HapsceneError
from hapscene.paint.model.session import Session
from hapscene.paint.web.hand import TouchHand
from hapscene.paint.web.socket import PageSocket
from hapscene.paint.web.tools import Tools
from hapscene.paint.web.view import SceneView

if TYPE_CHECKING:
    import viser
    from viser._gui_handles import GuiModalHandle

__all__ = ["ClientContext", "PageContext", "aria", "bounded", "card_html", "escape_html", "set_html"]

Container: TypeAlias = AbstractContextManager[object]
"""Tab or folder of viser."""

Client: TypeAlias = "viser.ClientHandle"
Event: TypeAlias = "viser.GuiEvent[Any]"
Callback: TypeAlias = Callable[[Event], Coroutine[object, object, None]]


class Control(Protocol):
    """A control of viser, whose value comes from a page."""

    label: str
    value: Any


@dataclass(frozen=True, kw_only=True)
class PageContext:
    """Objects of the page.

    Attributes:
        server: viser server.
        session, view, touch, socket: one object each.
        until_idle: waits until a page shows the scene and no stroke was made lately: work that can wait begins then.
        refresh: updates the page; call it after each operation that may have changed the scene.
        finish: ends the operations of all pointers.
        previews: pictures of swatches as data URLs, by everything that they depend on.
        questions: open dialogs, the topmost last.
    """

    server: "viser.ViserServer"
    session: Session
    view: SceneView
    touch: TouchHand
    socket: PageSocket
    until_idle: Callable[[], Awaitable[None]]
    refresh: Callable[[], None]
    finish: Callable[[], None]
    previews: dict[tuple[Hashable, ...], str] = field(default_factory=dict)
    questions: "list[GuiModalHandle]" = field(default_factory=list)

    @property
    def gui(self) -> Any:
        """Where controls are added: viser's GUI of all browsers, or of one."""
        return self.server.gui

    def say(self, text: str, kind: str = "") -> None:
        """Show a message; `kind` is "error" or ""."""
        self.socket.say(text, kind)

    def callback(self, act: Callable[[Any], object]) -> Callback:
        """A viser callback that runs in the event loop and shows errors of `act` to the user.

        It ignores changes of values that the program makes itself.
        """

        async def run(event: Event) -> None:
            if event.client is None:
                return
            try:
                result = act(event.target)
                if inspect.isawaitable(result):
                    await result
            except (HapsceneError, OSError) as error:
                self.say(str(error), "error")
            self.refresh()

        return run

    def ask(self, title: str, question: str, *choices: tuple[str, str | None, Callable[[], object]]) -> None:
        """Open a dialog with a question, which stays until an answer succeeds. Escape closes it without an answer.

        Args:
            title: title of the dialog.
            question: text of the dialog.
            choices: label, colour and action of each answer. Enter chooses the first, which must lose no data. The
                dialog stays open after an action that returns True.
        """
        modal = self.gui.add_modal(title)
        self.questions.append(modal)

        def answer(act: Callable[[], object]) -> Callback:
            async def done(target: object) -> None:
                result = act()
                if inspect.isawaitable(result):
                    await result
                elif result is True:
                    return
                if modal in self.questions:  # not closed meanwhile
                    self.questions.remove(modal)
                    modal.close()

            return self.callback(done)

        with modal:
            self.gui.add_html(card_html(escape_html(question)))
            for label, colour, act in choices:
                self.gui.add_button(label, color=colour).on_click(answer(act))

    def dismiss(self) -> None:
        """Close the topmost dialog without an answer."""
        if self.questions:
            self.questions.pop().close()

    def downloading(self, make: Callable[[], Awaitable[tuple[str, bytes]]]) -> Callback:
        """A viser callback that makes the browser of the user download a file, given by name and content."""

        async def run(event: Event) -> None:
            if event.client is None:
                return
            try:
                event.client.send_file_download(*await make(), save_immediately=True)
            except (HapsceneError, OSError) as error:
                self.say(str(error), "error")

        return run


@dataclass(frozen=True, kw_only=True)
class ClientContext(PageContext):
    """Objects of one browser: tools, controls and messages are its own.

    Attributes:
        client: viser's handle of the browser.
        tools: its tools.
    """

    client: Client
    tools: Tools

    @property
    def gui(self) -> Any:
        """viser's GUI of this browser."""
        return self.client.gui

    def say(self, text: str, kind: str = "") -> None:
        """Show a message in this browser; `kind` is "error" or ""."""
        self.socket.say(text, kind, self.client.client_id)


def escape_html(text: str) -> str:
    """Escape a text for HTML."""
    return html.escape(text, quote=True)


def set_html(handle: "viser.GuiHtmlHandle", content: str) -> None:
    """Set the content of an HTML element; nothing is sent if it is unchanged."""
    if handle.content != content:
        handle.content = content


def card_html(content: str, dim: bool = False) -> str:
    """A paragraph of the panel with HTML content; "" for empty content."""
    return content and f'<div class="hs-card{" dim" * dim}">{content}</div>'


def bounded(value: object, low: float, high: float, otherwise: float) -> float:
    """A value from a page, limited to a range; `otherwise` if it is not a number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return otherwise
    return min(max(float(value), low), high)


def aria(value: bool) -> str:
    """A boolean as the value of an aria- attribute."""
    return "true" if value else "false"
