"""Opening what is painted: a scene, a mesh as a new scene, several meshes, a bundle, or a copy of the demo scene."""

import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from hapscene import assets
from hapscene.paint.model.session import Session
from hapscene.scene.scene import Scene
from hapscene.scene.scene_bundle import ZIP_SUFFIX, unpacked_beside
from hapscene.scene.scene_file import SUFFIX
from hapscene.touch import open_scene, step

__all__ = ["earlier_scenes", "open_session"]

UNITLESS: Final = (".stl", ".obj", ".ply", ".off")

DEMO: Final = Path("hapscene-demo")
"""Where the demo scene is copied to."""


def open_session(
    name: str | None,
    more: Sequence[str] = (),
    *,
    accept_changed: bool = False,
    say: Callable[[str], None] = lambda text: None,
    **reading: Any,
) -> Session:
    """The session of a scene and further meshes; without a name, of a copy of the demo scene.

    Args:
        name: scene, bundle or mesh file.
        more: further meshes for the same scene.
        accept_changed: as `Session.open`.
        say: is given the progress.
        reading: how meshes are read, as `open_scene`. Among several, `unit` is for those that carry none.

    Raises:
        HapsceneError: a file cannot be loaded.
    """

    def opened(path: str) -> Scene:
        own = {} if not more or path.lower().endswith(UNITLESS) else {"unit": None}
        return open_scene(path, say=say, **(reading | own))

    if name is None:
        name = str(_copy_demo(DEMO))
        say(f"the demo scene, in {name}\n")
    with step(say, f"loading {name}"):
        if name.endswith(ZIP_SUFFIX):
            name = str(unpacked_beside(Path(name)))
            say(f"unpacked into {Path(name).parent}\n")
        changes = reading | {"scale": reading.get("scale", 1.0) != 1.0, "accept_damaged": False}
        is_scene = name.endswith(SUFFIX) and (bool(more) or not any(changes.values()))
        # `opened` refuses the options of a scene file
        session = Session.open(Path(name), accept_changed) if is_scene else Session(opened(name), _free(Path(name)))
    for other in more:
        with step(say, f"loading {other}"):
            session.composing.add(opened(other))
    if not is_scene:
        session.history.clear()
    return session


def _copy_demo(folder: Path) -> Path:
    """The demo scene in a folder of the user's; as it was painted, where it is there already."""
    scene, source = folder / f"demo{SUFFIX}", assets.path("demo")
    if not scene.exists():
        (folder / "meshes").mkdir(parents=True, exist_ok=True)
        for file in sorted((source.parent / "meshes").iterdir()):
            if file.is_file():
                shutil.copyfile(file, folder / "meshes" / file.name)
        shutil.copyfile(source, scene)
    return scene


def _free(mesh: Path) -> Path:
    """Where the scene of a mesh is saved: in the working folder, replacing no other."""
    return next(path for path in _names(mesh.name.removesuffix(SUFFIX).removesuffix(mesh.suffix)) if not path.exists())


def _names(stem: str, suffix: str = SUFFIX) -> Iterator[Path]:
    """The names of a mesh's scenes, one after the other: cube, cube_2, cube_3."""
    return (Path(name + suffix) for name in (stem, *(f"{stem}_{i}" for i in range(2, 10_000))))


def earlier_scenes(path: Path | None, unpacked: bool = False) -> list[Path]:
    """Scene files that were painted of a mesh before the one that would be made of it now.

    The command prints them, so that work can be continued after a crash. A bundle
    that was `unpacked` just now was unpacked before into folders of such names.
    """
    if path is None or (path.exists() and not unpacked):
        return []
    mine, suffix = (path.parent, "") if unpacked else (path, SUFFIX)
    stem = re.sub(r"_\d{1,4}$", "", mine.name.removesuffix(suffix))
    before = takewhile(lambda other: other != mine, _names(stem, suffix))
    return [file for other in before if (file := other / path.name if unpacked else other).is_file()]
