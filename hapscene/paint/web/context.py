"""Objects that the panels of the page share: session, view, simulated hand, socket, dialogs, callbacks.

`PageContext` is common to all browsers; `ClientContext` adds what each browser has of its own.
"""

import html
import inspect
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

from hapscene.errors import HapsceneError
from hapscene.paint.model.session import Session
from hapscene.paint.web.hand import TouchHand
from hapscene.paint.web.socket import PageSocket
from hapscene.paint.web.tools import Tools
from hapscene.paint.web.view import SceneView

__all__ = ["ClientContext", "PageContext", "aria", "bounded", "card_html", "escape_html", "set_html"]


@dataclass(frozen=True, kw_only=True)
class PageContext:
    """Objects of the page.

    Attributes:
        server: viser server.
        session, view, touch, socket: one object each.
        refresh: updates the page; call it after each operation that may have changed the scene.
        finish: ends the operations of all pointers.
        previews: pictures of swatches as data URLs, by everything that they depend on.
        questions: open dialogs, the topmost last.
    """

    server: Any
    session: Session
    view: SceneView
    touch: TouchHand
    socket: PageSocket
    refresh: Callable[[], None]
    finish: Callable[[], None]
    previews: dict[tuple[Any, ...], str] = field(default_factory=dict)
    questions: list[Any] = field(default_factory=list)

    @property
    def gui(self) -> Any:
        """Where controls are added: viser's GUI of all browsers, or of one."""
        return self.server.gui

    def say(self, text: str, kind: str = "") -> None:
        """Show a message; `kind` is "error" or ""."""
        self.socket.say(text, kind)

    def callback(self, act: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """A viser callback that runs in the event loop and shows errors of `act` to the user.

        It ignores changes of values that the program makes itself.
        """

        async def run(event: Any) -> None:
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

    def ask(self, title: str, question: str, *choices: tuple[str, str | None, Callable[[], Any]]) -> None:
        """Open a dialog with a question, which stays until an answer succeeds. Escape closes it without an answer.

        Args:
            title: title of the dialog.
            question: text of the dialog.
            choices: label, colour and action of each answer. Enter chooses the first, which must lose no data. The
                dialog stays open after an action that returns True.
        """
        modal = self.open_dialog(title)

        def answer(act: Callable[[], Any]) -> Callable[[Any], Any]:
            async def done(target: Any) -> None:
                result = act()
                if inspect.isawaitable(result):
                    await result
                elif result is True:
                    return
                self.close_dialog(modal)

            return self.callback(done)

        with modal:
            self.gui.add_html(card_html(escape_html(question)))
            for label, colour, act in choices:
                self.gui.add_button(label, color=colour).on_click(answer(act))

    def open_dialog(self, title: str) -> Any:
        """Open an empty dialog. Escape closes it."""
        self.questions.append(self.gui.add_modal(title))
        return self.questions[-1]

    def close_dialog(self, dialog: Any) -> None:
        """Close a dialog unless it is closed already."""
        if dialog in self.questions:
            self.questions.remove(dialog)
            dialog.close()

    def dismiss(self) -> bool:
        """Close the topmost dialog without an answer; returns whether there was one."""
        if self.questions:
            self.questions.pop().close()
            return True
        return False

    def downloading(self, make: Callable[[], Awaitable[tuple[str, bytes]]]) -> Callable[[Any], Any]:
        """A viser callback that makes the browser of the user download a file, given by name and content."""

        async def run(event: Any) -> None:
            if event.client is None:
                return
            try:
                event.client.send_file_download(*await make(), save_immediately=True)
            except (HapsceneError, OSError) as error:
                self.say(str(error), "error")

        return run


@dataclass(frozen=True, kw_only=True)
class ClientContext(PageContext):
    """Objects of one browser: tools, controls, messages and dialogs are its own.

    Attributes:
        client: viser's handle of the browser.
        tools: its tools.
    """

    client: Any
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


def set_html(handle: Any, content: str) -> None:
    """Set the content of an HTML element; nothing is sent if it is unchanged."""
    if handle.content != content:
        handle.content = content


def card_html(content: str, dim: bool = False) -> str:
    """A paragraph of the panel with HTML content; "" for empty content."""
    return content and f'<div class="hs-card{" dim" * dim}">{content}</div>'


def bounded(value: Any, low: float, high: float, otherwise: float) -> float:
    """A value from a page, limited to a range; `otherwise` if it is not a number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return otherwise
    return min(max(float(value), low), high)


def aria(value: bool) -> str:
    """A boolean as the value of an aria- attribute."""
    return "true" if value else "false"
