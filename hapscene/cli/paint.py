"""`hapscene paint`: the painter, a page in the browser."""

import gc
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Any, Final

from hapscene.cli.console import print_progress
from hapscene.cli.inputs import check_scene, find_asset, print_size_advice
from hapscene.cli.options import Help, MeshOptions, PageOptions, TipRadius
from hapscene.constants import BUNDLE_SUFFIX, SCENE_SUFFIX
from hapscene.interrupt import clear_interrupt
from hapscene.io.files import is_unitless

if TYPE_CHECKING:
    from hapscene.paint.web.page import Page

__all__ = ["paint"]

NAP_S: Final = 0.5
"""Polling interval of the main thread [s]. Short, since a signal that arrives just before a sleep does not end it."""


def paint(
    scene: Annotated[str | None, Help("Scene, mesh, or name of an asset (default: a copy of the demo)")] = None,
    /,
    *more: Annotated[str, Help("More meshes to add to the scene")],
    accept_changed: Annotated[bool, Help("Keep the painting of a changed mesh, if its face count is the same")] = False,
    mesh: MeshOptions = MeshOptions(),
    no_hand: Annotated[bool, Help("Paint without touching: do not start the process of the hand")] = False,
    tip_radius: TipRadius = 0.0,
    page: PageOptions = PageOptions(),
) -> None:
    """Paint swatches onto a scene or mesh in the browser, and touch it with the mouse.

    examples:
      hapscene paint                         # a copy of the demo scene
      hapscene paint cup.scene.json
      hapscene paint bunny.ply --unit m --swatch wood
    """
    with ExitStack() as ends:
        shown = _serve(scene, more, accept_changed, mesh, page, ends, with_hand=not no_hand, tip_radius_m=tip_radius)
        gc.freeze()  # loaded objects live until the end: the collector can skip them
        _paint_until_ended(shown)


def _serve(
    scene: str | None,
    more: Sequence[str],
    accept_changed: bool,
    mesh: MeshOptions,
    page: PageOptions,
    ends: ExitStack,
    **made: Any,
) -> "Page":
    """Serve the page of a scene, with further arguments of `Page`, until `ends` is closed."""
    is_file = scene is not None and is_unitless(scene)  # assets and scenes are upright
    if scene is not None and (scene != "demo" or Path(scene).exists()):
        scene, mesh = find_asset(scene, mesh)
    else:
        scene = None
    for path in (scene, *more):
        if path is not None:
            check_scene(path, mesh)
    from hapscene.paint.web.server import PageServer

    server = ends.enter_context(PageServer(page.host, page.port))
    if not page.no_browser:  # it fetches the page while the scene is loaded
        is_scene = scene is not None and scene.endswith(SCENE_SUFFIX)
        lead_browser(server.url, Path(str(scene)).parent if is_scene else Path(), ends)
    from hapscene.paint.model.document import describe_scene_file
    from hapscene.paint.opening import earlier_scenes, open_session
    from hapscene.paint.web.page import Page

    session = open_session(scene, more, accept_changed=accept_changed, say=print_progress, **asdict(mesh))
    print_size_advice(session.scene, scene or "")
    for earlier in earlier_scenes(session.path, str(scene).endswith(BUNDLE_SUFFIX)):
        print_progress(f"{describe_scene_file(earlier)} To continue it: hapscene paint {earlier}\n")
    ask_upright = is_file and mesh.up is None
    return Page(session, server=server, ask_upright=ask_upright, **made)


def _paint_until_ended(page: "Page") -> None:
    """Serve the page until Ctrl-C, then print the state of unsaved changes."""
    with page:
        try:
            print(f"{page.url}   (press Ctrl-C to end)", flush=True)
            if page.context.session.document.problem:
                print_progress(f"{page.context.session.document.problem}\n")
            if page.network_url is not None:
                print_progress(f"open to the network: anyone can paint and overwrite files at {page.network_url}\n")
            shown = ""
            while True:
                time.sleep(NAP_S)
                if (problem := page.context.touch.problem) != shown:
                    print_progress(f"{problem}\n" if problem else "")
                    shown = problem
        except KeyboardInterrupt:
            clear_interrupt()
    session = page.context.session
    if page.kept:
        print_progress(
            f"unsaved changes: kept beside {session.path}; the next `hapscene paint` offers to restore them\n"
        )
    elif session.document.changed:
        print_progress(f"unsaved changes are lost: {session.document.problem or 'no copy was kept'}\n")
    elif session.dirty:
        print_progress(f"no changes: {session.path} was not written\n")


def lead_browser(url: str, folder: Path, ends: ExitStack) -> Path | None:
    """Open the browser with a private file that redirects to the page; return None if the file cannot be written.

    The address contains the access token of the page, and other users of the computer can read command lines. The file
    lies in a folder that only its user can read; it is deleted when `ends` is closed. The browser starts in a thread,
    since it may be slow.
    """
    import webbrowser
    from tempfile import TemporaryDirectory

    with suppress(OSError):  # for example a full disk; the address is printed anyway
        # a browser may still hold the file open when it is deleted
        made = TemporaryDirectory(prefix=".hapscene-", dir=folder, ignore_cleanup_errors=True)
        opener = Path(ends.enter_context(made), "open.html")
        opener.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={url}">', encoding="utf-8")
        Thread(target=webbrowser.open, args=(opener.absolute().as_uri(),), daemon=True).start()
        return opener
    return None
