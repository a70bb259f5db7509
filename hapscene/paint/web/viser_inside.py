"""The one place that knows viser's private names: what viser takes from a page is looked at before viser sees it.

viser trusts whoever is connected: what cannot be read ends in a traceback, an update may name any attribute of a
control, and its share button opens a tunnel to the net.
"""

import logging
import math
from typing import Any, Final

TEXT_MAX: Final = 4096
"""Longest text that a field takes [characters]: a path."""

NUMBER_MAX: Final = 1e15
"""Largest number of a field without bounds, or of a camera [1]: what is larger cannot be sent to the other pages."""

UPDATE: Final = "GuiUpdateMessage"
HANDLES: Final = tuple(f"TransformControls{what}Message" for what in ("DragStart", "Update", "DragEnd"))
TAKEN: Final = ("ViewerCameraMessage", UPDATE, *HANDLES)
"""The messages of viser's that a page of ours sends: where it looks from, what its user did to a control, and to the
handles that move a body."""

UNWANTED: Final = ("ShareUrlRequest", "ShareUrlDisconnect")


def harden(server: Any, log: logging.Logger) -> None:
    """Take from a viser server what a page of ours needs not, and a page of others might use.

    Its share button would open a tunnel to the net. Its updates of controls may name any attribute of them: only
    values come through, of the type that the control has.
    """
    from viser import _messages

    base, gui = server._websock_server, server.gui

    async def update(client_id: Any, message: Any) -> None:
        handle = gui._gui_input_handle_from_uuid.get(message.uuid)
        if handle is None:
            return  # it was there when its user touched it
        if _is_value(message.updates, handle):
            await gui._handle_gui_updates(client_id, message)
        else:
            log.warning("malformed message refused: no value for its control")

    for name in (*UNWANTED, UPDATE):
        base.unregister_handler(getattr(_messages, name))
    base.register_handler(_messages.GuiUpdateMessage, update)


class CheckedConnection:
    """A WebSocket as viser sees it: what is none of its messages does not arrive, and is counted."""

    def __init__(self, connection: Any, log: logging.Logger) -> None:
        self._connection, self._log = connection, log

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    async def recv(self) -> Any:
        """The next message that viser may see."""
        while True:
            raw = await self._connection.recv()
            why = refusal_of(raw)
            if why is None:
                return raw
            self._log.warning(f"malformed message refused: {why}")


def refusal_of(raw: str | bytes) -> str | None:
    """Why viser must not see a message, in words of ours; None if it may."""
    import msgspec
    from viser import _messages

    if not isinstance(raw, bytes):
        return "text where bytes were expected"
    try:
        message = msgspec.msgpack.decode(raw)
    except (ValueError, RecursionError):
        return "no MessagePack"
    kind = message.pop("type", None) if isinstance(message, dict) else None
    if kind not in TAKEN:
        return "of no type that the page sends"
    wanted = getattr(_messages, kind)
    try:
        read = msgspec.convert(message, wanted)
    except (ValueError, RecursionError):
        return f"{kind} with a field missing, or of a wrong type"
    if message.keys() != vars(read).keys():
        return f"{kind} with a field too many"
    if kind != UPDATE and not all(map(_is_near, vars(read).values())):
        return f"{kind} with a number that is none, or beyond all bounds"
    return None


def _is_near(value: Any) -> bool:
    """Whether numbers are such that can be calculated with; and names of viser's short."""
    if isinstance(value, str):
        return len(value) <= TEXT_MAX
    return all(map(_is_near, value)) if isinstance(value, tuple) else abs(value) <= NUMBER_MAX


def button_hints(server: Any) -> dict[str, str]:
    """The hints of viser's buttons by their names in the page, where viser itself shows none."""
    from viser import GuiButtonHandle

    handles = server.gui._gui_input_handle_from_uuid.items()
    return {name: button.hint for name, button in handles if isinstance(button, GuiButtonHandle) and button.hint}


async def set_slider(server: Any, client: int, name: str, value: float) -> str | None:
    """Give a slider a number, as its user would; what else was made of it, in a sentence, or None.

    Args:
        server: viser's.
        client: who does.
        name: viser's name of the slider; any other control is left alone.
        value: the nearest that it can have counts.
    """
    from viser import GuiSliderHandle
    from viser._messages import GuiUpdateMessage

    slider = server.gui._gui_input_handle_from_uuid.get(name)
    if not isinstance(slider, GuiSliderHandle):
        return None
    bounded = min(max(value, slider.min), slider.max)
    await server.gui._handle_gui_updates(client, GuiUpdateMessage(name, {"value": bounded}))
    if not slider._impl.removed:
        told = GuiUpdateMessage(name, {"value": slider.value})
        server.gui._websock_interface.queue_message(told)  # to all: viser spares the one who typed
    if bounded == value:
        return None
    return f"{slider.label}: from {slider.min:g} to {slider.max:g}; {value:g} became {bounded:g}."


def _is_value(updates: Any, handle: Any) -> bool:
    """Whether an update is a value that a control may have."""
    if not isinstance(updates, dict) or set(updates) != {"value"}:
        return False
    value, known = updates["value"], handle._impl.value
    if isinstance(known, bool) or isinstance(value, bool):
        return isinstance(value, bool) and isinstance(known, bool)
    if isinstance(known, int | float):
        if not isinstance(value, int | float) or not math.isfinite(value):
            return False
        low, high = getattr(handle, "min", None), getattr(handle, "max", None)
        return (-NUMBER_MAX if low is None else low) <= value <= (NUMBER_MAX if high is None else high)
    if isinstance(known, tuple):  # a colour
        return isinstance(value, list | tuple) and len(value) == len(known) and all(_is_byte(part) for part in value)
    if isinstance(known, str):
        return isinstance(value, str) and len(value) <= TEXT_MAX
    return False


def _is_byte(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 255
