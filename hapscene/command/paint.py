"""`hapscene paint`."""

import argparse
import gc
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import takewhile
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import say
from hapscene.command.options import (
    HOST,
    UNITLESS,
    add_command,
    add_mesh_options,
    base_name,
    check_scene,
    find_asset,
    loading,
    port,
    reading,
    tell_size,
)
from hapscene.constants import DEFAULT_GRIP
from hapscene.interrupt import heard

if TYPE_CHECKING:
    from hapscene.paint.model.session import Session
    from hapscene.paint.web.page import Page
    from hapscene.scene.scene import Scene

SUFFIX: Final = ".scene.json"
ZIP_SUFFIX: Final = ".scene.zip"
NAP_S: Final = 0.5
"""How long the main thread sleeps at a time [s]: a signal that comes just before it falls asleep does not wake it."""

DEMO: Final = Path("hapscene-demo")
"""Where the demo scene is copied to."""


def add_paint(commands: Any) -> None:
    command = add_command(commands, "paint", _paint)
    command.add_argument(
        "scene",
        nargs="?",
        metavar="SCENE|MESH",
        help="a scene file (.scene.json), a file that export wrote, a mesh, or an asset, as toad; else the demo scene",
    )
    command.add_argument("more", nargs="*", metavar="MESH", help="further meshes, beside it in the same scene")
    add_mesh_options(command)
    command.add_argument(
        "--map",
        metavar="PICTURE",
        help="paint by a picture over the mesh's texture coordinates: its colours mean swatches as its legend says, a "
        '.json beside it, as {"#b5651d": "wood"}; without one, those of the scene by their colours',
    )
    command.add_argument(
        "--device",
        default="omni",
        help="what the hand holds: omni (default), or as a mass that reaches everywhere omni-point, phantom-1.0, "
        "premium-1.5",
    )
    command.add_argument("--grip", default=DEFAULT_GRIP, help=f"light, medium or firm (default {DEFAULT_GRIP})")
    command.add_argument(
        "--compensator",
        default="adaptive",
        metavar="NAME",
        help="what drives the voice coil in the handle: adaptive (default), flat, inverse, naive; or no-handle, to "
        "hear what the swatches ask for",
    )
    command.add_argument("--port", type=port, default=8080, help="where the page is (default 8080; the next if taken)")
    command.add_argument(
        "--host",
        default=HOST,
        metavar="ADDRESS",
        help="to serve at (default 127.0.0.1: this computer alone). At any other, whoever has the printed address "
        "may do all that the page can, without a password: paint, touch, save and export to any file that you may "
        "write, over those that are there too, and change your library of swatches",
    )
    command.add_argument(
        "--accept-changed",
        action="store_true",
        help="keep the painting of a scene whose mesh has changed, where it has as many faces",
    )
    command.add_argument("--no-hand", action="store_true", help="paint only: start no process that touches")
    command.add_argument("--no-browser", action="store_true", help="open no browser; print the address alone")


def _paint(options: argparse.Namespace) -> int:
    """Paint swatches onto a scene or a mesh in the browser, and feel it with the mouse.

    for example:
      hapscene paint                                  # a copy of the demo scene
      hapscene paint cup.scene.json
      hapscene paint bunny.ply --unit m --swatch wood
      hapscene paint cup.scene.json --device premium-1.5 --grip firm --compensator no-handle
      hapscene paint duck.glb --map duck.png          # with duck.json beside it: {"#b5651d": "wood"}
      hapscene paint cup.scene.json --port 9000 --no-browser
    """
    with ExitStack() as ends:
        with rare_collections():
            page = _open_page(options, ends)
        gc.freeze()  # what is there now stays
        _have_painted(page)
    return 0


@contextmanager
def rare_collections() -> Iterator[None]:
    """While it is open, garbage is seldom looked for: what is imported and loaded stays, and looking takes a fifth."""
    usual = gc.get_threshold()
    gc.set_threshold(100_000, 50, 100)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def _open_page(options: argparse.Namespace, ends: ExitStack) -> "Page":
    """The page of what is named, served until `ends`. The browser fetches it while the scene is loaded."""
    put_asset(options)
    for path in (options.scene, *options.more):
        if path is not None:
            check_scene(path, options.unit, options.swatch)
    from hapscene.paint.web.server import PageServer

    server = ends.enter_context(PageServer(options.host, options.port))
    if not options.no_browser:
        is_scene = str(options.scene).endswith(SUFFIX)
        lead_browser(server.url, Path(options.scene).parent if is_scene else Path(), ends)
    from hapscene.paint.web.hand import HandConfig
    from hapscene.paint.web.page import Page

    hand = HandConfig(options.device, options.grip, options.compensator)
    session = open_session(options, say)
    if options.map is not None:
        from hapscene.scene.uv_paint import paint_by_picture

        scene, picture = session.painting.snapshot(), Path(options.map)
        paint_by_picture(scene, None, picture)
        session.painting.take_painting(scene, f"picture {picture.name}")
    tell_size(session.scene, options.scene or "", options.device)
    _say_earlier(session.path, str(options.scene).endswith(ZIP_SUFFIX))
    return Page(session, with_hand=not options.no_hand, hand=hand, server=server)


def _say_earlier(path: Path | None, unpacked: bool) -> None:
    """Print which scenes were made of the same mesh before, and how to continue them."""
    from hapscene.paint.model.document import earlier_words

    for earlier in earlier_scenes(path, unpacked):
        say(f"{earlier_words(earlier)} To continue it: hapscene paint {earlier}\n")


def put_asset(options: argparse.Namespace) -> None:
    """Put an asset's file in place of its name. The demo scene is copied first, as it is where no scene is named."""
    if options.scene == "demo" and not Path("demo").exists():
        options.scene = None
    elif options.scene is not None:
        options.scene, options.unit = find_asset(options.scene, options.unit)


def _have_painted(page: "Page") -> None:
    """Have it painted until Ctrl-C, and say what becomes of what is not saved."""
    with page:
        try:
            print(f"{page.url}   (Ctrl-C ends)", flush=True)
            if page.context.session.document.problem:
                say(f"{page.context.session.document.problem}\n")
            if page.public:
                say("open to the network: whoever has this address may paint here, and save over your files\n")
            told = ""
            while True:
                time.sleep(NAP_S)
                if (problem := page.context.touch.problem) != told:
                    say(f"{problem}\n" if problem else "")
                    told = problem
        except KeyboardInterrupt:
            heard()
    session = page.context.session
    if page.kept:
        say(f"not saved: kept beside {session.path}, and offered the next time it is painted\n")
    elif session.document.changed:
        say(f"not saved, and lost: {session.document.problem or 'no copy was kept'}\n")
    elif session.dirty:
        say(f"nothing was painted, so there is no {session.path}\n")


def lead_browser(url: str, folder: Path, ends: ExitStack) -> Path | None:
    """Open the browser by a file that leads it to the page, there until `ends`; None where it cannot be written.

    It stands between, since a command line, the browser's too, can be read by all users of a computer; the file's
    folder by its user alone. A browser may be slow to start: nobody waits for it.
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


def open_session(options: argparse.Namespace, say: Any) -> "Session":
    """The session of what is named on the command line; without a name, of a copy of the demo scene.

    Raises:
        HapsceneError: it cannot be loaded.
    """
    from hapscene.paint.model.session import Session
    from hapscene.touch import open_scene, step

    name, more = options.scene, getattr(options, "more", ())

    def opened(path: str) -> "Scene":  # among several, a file that says its unit keeps that
        is_told = not more or path.lower().endswith(UNITLESS)
        unit = options.unit if is_told else None
        return open_scene(path, unit, options.swatch, options.two_sided, say, **reading(options))

    if name is None:
        name = _copy_demo(DEMO)
        say(f"the demo scene, in {name}\n")
    with step(say, loading(name)):
        if str(name).endswith(ZIP_SUFFIX):
            from hapscene.scene.scene_bundle import unpacked_beside

            name = unpacked_beside(Path(name))
            say(f"unpacked into {name.parent}\n")
        plain = options.unit is options.swatch is options.up is None and options.scale == 1.0
        is_scene = str(name).endswith(SUFFIX) and (bool(more) or (plain and not options.two_sided))
        if is_scene:
            session = Session.open(Path(name), options.accept_changed)
        else:  # of a scene file, it refuses the options
            session = Session(opened(str(name)), _free(Path(name)))
    for other in more:
        with step(say, loading(other)):
            session.composing.add(opened(other))
    if not is_scene:
        session.history.clear()
    return session


def _copy_demo(folder: Path) -> Path:
    """The demo scene in a folder of the user's; as it was painted, where it is there already."""
    from hapscene import assets

    scene, source = folder / f"demo{SUFFIX}", assets.path("demo")
    if not scene.exists():
        (folder / "meshes").mkdir(parents=True, exist_ok=True)
        for file in sorted((source.parent / "meshes").iterdir()):
            if file.is_file():
                shutil.copyfile(file, folder / "meshes" / file.name)
        shutil.copyfile(source, scene)
    return scene


def _free(mesh: Path) -> Path:
    """Where the scene of a mesh is saved: in the working folder, over no other."""
    return next(path for path in _names(base_name(mesh)) if not path.exists())


def _names(stem: str, suffix: str = SUFFIX) -> Iterator[Path]:
    """What scenes of a mesh are called, one after the other: cube, cube_2, cube_3."""
    return (Path(name + suffix) for name in (stem, *(f"{stem}_{i}" for i in range(2, 10_000))))


def earlier_scenes(path: Path | None, unpacked: bool = False) -> list[Path]:
    """Scene files that were painted of a mesh before the one that would be made of it now; none of one that is there.

    Typed again after a crash, the same command finds what was painted, and names it. What was `unpacked` just now was
    so before into folders of such names.
    """
    if path is None or (path.exists() and not unpacked):
        return []
    mine, suffix = (path.parent, "") if unpacked else (path, SUFFIX)
    stem = re.sub(r"_\d{1,4}$", "", mine.name.removesuffix(suffix))
    before = takewhile(lambda other: other != mine, _names(stem, suffix))
    return [file for other in before if (file := other / path.name if unpacked else other).is_file()]
