"""What is used of viser that it promises nobody, and what of a page's messages viser may see."""

from collections.abc import Mapping
from typing import Any

import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

import viser
from viser import _messages

from hapscene.paint.web.page import Page
from hapscene.paint.web.viser_inside import TAKEN, UNWANTED


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
