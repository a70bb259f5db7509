"""Context that the panels of the page share: session, view, tools, hand, socket, dialogs and callbacks."""

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

__all__ = ["PageContext", "aria", "bounded", "card_html", "escape_html", "set_html"]


@dataclass(frozen=True)
class PageContext:
    """What makes up the page.

    Attributes:
        server: viser's.
        session, view, tools, touch, socket: one of each.
        refresh: shows what changed; called after whatever may have changed something.
        questions: dialogs that stand, the last on top.
    """

    server: Any
    session: Session
    view: SceneView
    tools: Tools
    touch: TouchHand
    socket: PageSocket
    refresh: Callable[[], None]
    questions: list[Any] = field(default_factory=list)

    def callback(self, act: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """A callback for viser that runs in its event loop, in the order of the events.

        What `act` refuses is shown to the user. Values that the page itself sets are no events.
        """

        async def run(event: Any) -> None:
            if event.client is None:
                return
            try:
                result = act(event.target)
                if inspect.isawaitable(result):
                    await result
            except (HapsceneError, OSError) as error:
                self.socket.say(str(error), "error")
            self.refresh()

        return run

    def ask(self, title: str, question: str, *choices: tuple[str, str | None, Callable[[], Any]]) -> None:
        """Ask a question; each answer with its colour and what it does. It stands until one of them succeeded.

        Enter gives the first: one that loses nothing. Escape does nothing of it.
        """
        modal = self.open_dialog(title)

        def answer(act: Callable[[], Any]) -> Callable[[Any], Any]:
            async def done(target: Any) -> None:
                result = act()
                if inspect.isawaitable(result):
                    await result
                self.close_dialog(modal)

            return self.callback(done)

        with modal:
            self.server.gui.add_html(card_html(escape_html(question)))
            for label, colour, act in choices:
                self.server.gui.add_button(label, color=colour).on_click(answer(act))

    def open_dialog(self, title: str) -> Any:
        """An empty dialog of viser's, which Escape closes."""
        self.questions.append(self.server.gui.add_modal(title))
        return self.questions[-1]

    def close_dialog(self, dialog: Any) -> None:
        """Close a dialog, if it is not closed yet."""
        if dialog in self.questions:
            self.questions.remove(dialog)
            dialog.close()

    def dismiss(self) -> None:
        """Close the dialog on top, unanswered."""
        if self.questions:
            self.questions.pop().close()

    def downloading(self, make: Callable[[], Awaitable[tuple[str, bytes]]]) -> Callable[[Any], Any]:
        """A callback for viser that has the browser of whoever pressed download a file, by its name and content."""

        async def run(event: Any) -> None:
            if event.client is None:
                return
            try:
                event.client.send_file_download(*await make(), save_immediately=True)
            except (HapsceneError, OSError) as error:
                self.socket.say(str(error), "error")

        return run


def escape_html(text: str) -> str:
    """A text from a file, to be put into HTML."""
    return html.escape(text, quote=True)


def set_html(handle: Any, content: str) -> None:
    """Have a piece of HTML say something; nothing is sent where it does already."""
    if handle.content != content:
        handle.content = content


def card_html(content: str, dim: bool = False) -> str:
    """A paragraph of the panel, of HTML; nothing of nothing."""
    return content and f'<div class="hs-card{" dim" * dim}">{content}</div>'


def bounded(value: Any, low: float, high: float, otherwise: float) -> float:
    """A number from a page within bounds; `otherwise` where it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return otherwise
    return min(max(float(value), low), high)


def aria(value: bool) -> str:
    """Yes or no as HTML's aria- attributes have it."""
    return "true" if value else "false"
