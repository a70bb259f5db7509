"""What is used of viser that it promises nobody, and what of a page's messages viser may see."""

import asyncio
import logging
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

import msgspec
import viser
from viser import _messages

from hapscene.paint.web.page import Page
from hapscene.paint.web.viser_inside import TAKEN, UNWANTED, CheckedConnection


def private_names(server: Any) -> Mapping[str, object]:
    """What is used of viser that it promises nobody, by name; raises an AttributeError where this viser lacks one."""
    gui = server.gui
    return {
        "GuiApi._gui_input_handle_from_uuid": gui._gui_input_handle_from_uuid,
        "GuiApi._handle_gui_updates": gui._handle_gui_updates,
        "GuiApi._websock_interface.queue_message": gui._websock_interface.queue_message,
        "ViserServer._websock_server.register_handler": server._websock_server.register_handler,
        "ViserServer._websock_server.unregister_handler": server._websock_server.unregister_handler,
        **{f"viser._messages.{name}": getattr(_messages, name) for name in (*TAKEN, *UNWANTED)},
    }


def test_this_viser_has_all_that_is_used_of_it(page: Page) -> None:
    try:
        names = private_names(page.server)
    except AttributeError as error:
        pytest.fail(f"viser {viser.__version__} is not as hapscene.paint.web.viser_inside knows it: {error}")
    assert names["GuiApi._gui_input_handle_from_uuid"]
    controls: Any = names["GuiApi._gui_input_handle_from_uuid"]
    assert all({"value", "removed"} <= set(vars(control._impl)) for control in controls.values())
    unlike = {name for name, thing in names.items() if not callable(thing)} - {"GuiApi._gui_input_handle_from_uuid"}
    assert not unlike


def test_what_is_none_of_its_messages_is_told_of_and_the_next_one_comes(caplog: pytest.LogCaptureFixture) -> None:
    good = msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": 1}})
    arriving = iter(["text", b"\xc1", msgspec.msgpack.encode({"type": "Unheard"}), good])

    async def recv() -> Any:
        return next(arriving)

    connection = CheckedConnection(SimpleNamespace(recv=recv, path="/"), logging.getLogger("test"))
    assert asyncio.run(connection.recv()) == good and connection.path == "/"
    reasons = ["text where bytes were expected", "no MessagePack", "of no type that the page sends"]
    assert caplog.messages == [f"malformed message refused: {why}" for why in reasons]
