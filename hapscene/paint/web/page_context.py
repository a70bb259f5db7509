"""What the panels of the page work on, and how their callbacks are wrapped."""

import html
import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hapscene.errors import HapsceneError
from hapscene.paint.session import Session
from hapscene.paint.web.page_socket import PageSocket
from hapscene.paint.web.scene_view import SceneView
from hapscene.paint.web.tools import Tools
from hapscene.paint.web.touch_hand import TouchHand


@dataclass(frozen=True)
class PageContext:
    """What makes up the page.

    Attributes:
        server: viser's.
        session, view, tools, touch, socket: one of each.
        refresh: shows what changed; called after whatever may have changed something.
    """

    server: Any
    session: Session
    view: SceneView
    tools: Tools
    touch: TouchHand
    socket: PageSocket
    refresh: Callable[[], None]

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


def rgb_bytes(colour: tuple[float, float, float]) -> tuple[int, int, int]:
    """A colour of numbers from 0 to 1, 0 to 255 each."""
    red, green, blue = (round(255 * c) for c in colour)
    return red, green, blue
