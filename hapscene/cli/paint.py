"""`hapscene paint`."""

import gc
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

from hapscene.cli.console import say
from hapscene.cli.inputs import check_scene, find_asset, tell_size
from hapscene.cli.options import Grip, Help, InFile, MeshOptions, PageOptions
from hapscene.constants import BUNDLE_SUFFIX, DEFAULT_GRIP, SCENE_SUFFIX
from hapscene.interrupt import clear_interrupt

if TYPE_CHECKING:
    from hapscene.paint.web.page import Page

__all__ = ["paint"]

NAP_S: Final = 0.5
"""How long the main thread sleeps at a time [s]: a signal that comes just before it falls asleep does not wake it."""


@Parameter(name="*", group="Hand that touches what is painted")
@dataclass(frozen=True)
class TouchOptions:
    """What the hand holds."""

    device: Annotated[str, Help("Device: omni, omni-point, phantom-1.0 or premium-1.5")] = "omni"
    grip: Grip = DEFAULT_GRIP
    compensator: Annotated[str, Help("Compensator: adaptive, flat, inverse, naive; or no-handle")] = "adaptive"
    no_hand: Annotated[bool, Help("Paint only; start no process that touches")] = False


def paint(
    scene: Annotated[str | None, Help("Scene, mesh, or name of an asset (default: a copy of the demo)")] = None,
    /,
    *more: Annotated[str, Help("Further meshes for the same scene")],
    picture: Annotated[
        InFile | None, Parameter(name="--map"), Help("Picture over the texture coordinates, to paint by")
    ] = None,
    accept_changed: Annotated[
        bool, Help("Keep the painting where the mesh has changed, but not its face count")
    ] = False,
    mesh: MeshOptions = MeshOptions(),
    hand: TouchOptions = TouchOptions(),
    page: PageOptions = PageOptions(),
) -> None:
    """Paint swatches onto a scene or a mesh in the browser, and feel it with the mouse.

    for example:
      hapscene paint                         # a copy of the demo scene
      hapscene paint cup.scene.json
      hapscene paint bunny.ply --unit m --swatch wood
      hapscene paint cup.scene.json --device premium-1.5 --grip firm
      hapscene paint duck.glb --map duck.png
      hapscene paint cup.scene.json --port 9000 --no-browser
    """
    with ExitStack() as ends:
        with rare_collections():
            shown = _open_page(scene, more, picture, accept_changed, mesh, hand, page, ends)
        gc.freeze()  # what is loaded stays
        _paint_until_ended(shown)


@contextmanager
def rare_collections() -> Iterator[None]:
    """Collect garbage seldom: while modules are imported and a scene is loaded, it takes a fifth of the time."""
    usual = gc.get_threshold()
    gc.set_threshold(100_000, 50, 100)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def _open_page(
    scene: str | None,
    more: Sequence[str],
    picture: Path | None,
    accept_changed: bool,
    mesh: MeshOptions,
    hand: TouchOptions,
    page: PageOptions,
    ends: ExitStack,
) -> "Page":
    """The page of a scene, served until `ends`. The browser fetches it while the scene is loaded."""
    if scene is not None and (scene != "demo" or Path(scene).exists()):
        scene, mesh = find_asset(scene, mesh)
    else:
        scene = None
    for path in (scene, *more):
        if path is not None:
            check_scene(path, mesh)
    from hapscene.paint.web.server import PageServer

    server = ends.enter_context(PageServer(page.host, page.port))
    if not page.no_browser:
        is_scene = scene is not None and scene.endswith(SCENE_SUFFIX)
        lead_browser(server.url, Path(str(scene)).parent if is_scene else Path(), ends)
    from hapscene.paint.model.document import describe_scene_file
    from hapscene.paint.opening import earlier_scenes, open_session
    from hapscene.paint.web.hand import HandConfig
    from hapscene.paint.web.page import Page

    config = HandConfig(hand.device, hand.grip, hand.compensator)
    session = open_session(scene, more, accept_changed=accept_changed, say=say, **asdict(mesh))
    if picture is not None:
        from hapscene.scene.uv_paint import paint_by_picture

        painted = session.painting.snapshot()
        paint_by_picture(painted, None, picture)
        session.painting.take_painting(painted, f"picture {picture.name}")
    tell_size(session.scene, scene or "", hand.device)
    for earlier in earlier_scenes(session.path, str(scene).endswith(BUNDLE_SUFFIX)):
        say(f"{describe_scene_file(earlier)} To continue it: hapscene paint {earlier}\n")
    return Page(session, with_hand=not hand.no_hand, hand=config, server=server)


def _paint_until_ended(page: "Page") -> None:
    """Serve the page until Ctrl-C, and print what becomes of what is not saved."""
    with page:
        try:
            print(f"{page.url}   (Ctrl-C ends)", flush=True)
            if page.context.session.document.problem:
                say(f"{page.context.session.document.problem}\n")
            if page.public:
                say("open to the network: whoever has this address may paint here, and save over your files\n")
            shown = ""
            while True:
                time.sleep(NAP_S)
                if (problem := page.context.touch.problem) != shown:
                    say(f"{problem}\n" if problem else "")
                    shown = problem
        except KeyboardInterrupt:
            clear_interrupt()
    session = page.context.session
    if page.kept:
        say(f"not saved: kept beside {session.path}, and offered the next time it is painted\n")
    elif session.document.changed:
        say(f"not saved, and lost: {session.document.problem or 'no copy was kept'}\n")
    elif session.dirty:
        say(f"nothing was painted, so there is no {session.path}\n")


def lead_browser(url: str, folder: Path, ends: ExitStack) -> Path | None:
    """Open the browser by a file that leads it to the page, there until `ends`; None where it cannot be written.

    All users of a computer can read a command line, the browser's too, and the address has the page's token; the file's
    folder is read by its user alone. A browser may be slow to start: nothing waits for it.
    """
    import webbrowser
    from tempfile import TemporaryDirectory

    with suppress(OSError):  # the disk is full: the address is on the terminal
        made = TemporaryDirectory(prefix=".hapscene-", dir=folder, ignore_cleanup_errors=True)  # a browser may hold it
        opener = Path(ends.enter_context(made), "open.html")
        opener.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={url}">', encoding="utf-8")
        Thread(target=webbrowser.open, args=(opener.absolute().as_uri(),), daemon=True).start()
        return opener
    return None
