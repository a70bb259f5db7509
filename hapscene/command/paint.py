"""`hapscene paint`."""

import argparse
import shutil
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import say
from hapscene.command.options import HOST, add_command, add_mesh_options, base_name, check_scene, loading, port
from hapscene.constants import DEFAULT_GRIP
from hapscene.interrupt import heard

if TYPE_CHECKING:
    from hapscene.paint.session import Session
    from hapscene.paint.web.page import Page

SUFFIX: Final = ".scene.json"
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
        help="a scene file (.scene.json), a file that export wrote, or a mesh; else the demo scene",
    )
    add_mesh_options(command)
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
      hapscene paint cup.scene.json --port 9000 --no-browser
    """
    if options.scene is not None:
        check_scene(options.scene, options.unit, options.swatch)
    import webbrowser

    from hapscene.paint.web.hand_config import HandConfig
    from hapscene.paint.web.page import Page

    hand = HandConfig(options.device, options.grip, options.compensator)
    session = open_session(options, say)
    page = Page(session, options.host, options.port, with_hand=not options.no_hand, hand=hand)
    with page:
        try:
            print(f"{page.url}   (Ctrl-C ends)", flush=True)
            if session.document.problem:
                say(f"{session.document.problem}\n")
            if page.public:
                say("open to the network: whoever has this address may paint here, and save over your files\n")
            if not options.no_browser and (opener := write_opener(page)) is not None:
                webbrowser.open(opener.as_uri())
            told = ""
            while True:
                time.sleep(NAP_S)
                if (problem := page.context.touch.problem) != told:
                    say(f"{problem}\n" if problem else "")
                    told = problem
        except KeyboardInterrupt:
            heard()
    if page.kept:
        say(f"not saved: kept beside {session.path}, and offered the next time it is painted\n")
    elif session.document.changed:
        say(f"not saved, and lost: {session.document.problem or 'no copy was kept'}\n")
    elif session.dirty:
        say(f"nothing was painted, so there is no {session.path}\n")
    return 0


def write_opener(page: "Page") -> Path | None:
    """A file that leads a browser to the page; None where it cannot be written, or nothing is autosaved.

    It stands between, since a command line, the browser's too, can be read by all users of a computer; the autosave's
    folder by its user alone.
    """
    autosave = page.context.session.document.autosave
    if autosave is None:
        return None
    opener = autosave.file.resolve().with_name("open.html")
    with suppress(OSError):  # the disk is full: the address is on the terminal
        opener.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={page.url}">', encoding="utf-8")
        return opener
    return None


def open_session(options: argparse.Namespace, say: Any) -> "Session":
    """The session of what is named on the command line; without a name, of a copy of the demo scene.

    Raises:
        HapsceneError: it cannot be loaded.
    """
    from hapscene.paint.session import Session
    from hapscene.touch import open_scene, step

    name = options.scene
    if name is None:
        name = _copy_demo(DEMO)
        say(f"the demo scene, in {name}\n")
    with step(say, loading(name)):
        if str(name).endswith(SUFFIX) and not (options.unit or options.swatch or options.two_sided):
            return Session.open(Path(name), options.accept_changed)
        # of a scene file, it refuses the options
        words = options.unit, options.swatch, options.two_sided, say
        return Session(open_scene(name, *words, accept_damaged=options.accept_damaged), _free(Path(name)))


def _copy_demo(folder: Path) -> Path:
    """The demo scene in a folder of the user's; as it was painted, where it is there already."""
    from importlib.resources import as_file, files

    scene = folder / f"demo{SUFFIX}"
    if not scene.exists():
        with as_file(files("hapscene_assets")) as source:
            (folder / "meshes").mkdir(parents=True, exist_ok=True)
            for file in sorted((source / "meshes").iterdir()):
                if file.is_file():
                    shutil.copyfile(file, folder / "meshes" / file.name)
            shutil.copyfile(source / scene.name, scene)
    return scene


def _free(mesh: Path) -> Path:
    """Where the scene of a mesh is saved: in the working folder, over no other."""
    stem = base_name(mesh)
    names = (stem, *(f"{stem}_{i}" for i in range(2, 10_000)))
    return next(path for path in (Path(name + SUFFIX) for name in names) if not path.exists())
