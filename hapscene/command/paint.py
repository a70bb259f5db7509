"""`hapscene paint`."""

import argparse
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.word import add_command
from hapscene.errors import SceneError

if TYPE_CHECKING:
    from hapscene.paint.session import Session

SUFFIX: Final = ".scene.json"
DEMO: Final = Path("hapscene-demo")
"""Where the demo scene is copied to."""


def add_paint(commands: Any) -> None:
    command = add_command(
        commands,
        "paint",
        _paint,
        "paint swatches onto a scene or a mesh in the browser, and feel it with the mouse",
        "hapscene paint                                  # a copy of the demo scene",
        "hapscene paint cup.scene.json",
        "hapscene paint bunny.ply --unit m --swatch wood",
        "hapscene paint cup.scene.json --device premium-1.5 --port 9000 --no-browser",
    )
    command.add_argument(
        "scene", nargs="?", metavar="SCENE|MESH", help="a scene file (.scene.json), or a mesh file; else the demo scene"
    )
    command.add_argument("--unit", help="of the mesh, where its file carries none: m, mm, in, …")
    command.add_argument("--swatch", help="of the whole mesh: a name, or a .swatch file")
    command.add_argument("--two-sided", action="store_true", help="feel the mesh's inner side as well")
    command.add_argument(
        "--device", default="omni", help="what the hand holds: omni (default), phantom-1.0 or premium-1.5"
    )
    command.add_argument("--port", type=_port, default=8080, help="where the page is (default 8080; the next if taken)")
    command.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="to serve at; any but the default lets others on the network paint and save too",
    )
    command.add_argument("--no-hand", action="store_true", help="paint only: start no process that touches")
    command.add_argument("--no-browser", action="store_true", help="open no browser; print the address alone")


def _paint(options: argparse.Namespace) -> int:
    import webbrowser

    from hapscene.paint.page import Page
    from hapscene.touch import speak

    session = open_session(options, speak)
    with Page(session, options.host, options.port, with_hand=not options.no_hand) as page:
        print(f"{page.url}   (Ctrl-C ends)", flush=True)
        if not options.no_browser:
            webbrowser.open(page.url)
        try:
            while True:
                time.sleep(3600.0)
        except KeyboardInterrupt:
            pass
    if session.dirty:
        speak(f"not saved: kept beside {session.path}, and offered the next time it is painted\n")
    return 0


def open_session(options: argparse.Namespace, say: Any) -> "Session":
    """The session of what is named on the command line; without a name, of a copy of the demo scene.

    Raises:
        HapsceneError: it cannot be loaded.
    """
    from hapscene.device.model import device_named
    from hapscene.paint.session import Session
    from hapscene.touch import open_scene

    if device_named(options.device).point is None:
        raise SceneError("an ideal device has no mass to move; choose --device omni, phantom-1.0 or premium-1.5")
    name = options.scene
    if name is None:
        name = _copy_demo(DEMO)
        say(f"the demo scene, in {name}\n")
    else:
        say(f"loading {name}\n")
    if str(name).endswith(SUFFIX) and not (options.unit or options.swatch or options.two_sided):
        session = Session.open(Path(name))
    else:  # of a scene file, it refuses the options
        session = Session(open_scene(name, options.unit, options.swatch, options.two_sided), _free(Path(name)))
    session.choose_device(options.device)
    return session


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
    stem = mesh.name.split(".")[0] or "mesh"
    names = (stem, *(f"{stem}_{i}" for i in range(2, 10_000)))
    return next(path for path in (Path(name + SUFFIX) for name in names) if not path.exists())


def _port(text: str) -> int:
    value = int(text)
    if not 0 <= value <= 65535:
        raise argparse.ArgumentTypeError("a port is a whole number from 0 to 65535")
    return value
