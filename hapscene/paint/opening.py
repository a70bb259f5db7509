"""Open a scene to paint: a scene file, one or several meshes, a bundle, or a copy of the demo scene."""

import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from hapscene import assets
from hapscene.io.files import is_unitless
from hapscene.paint.model.session import Session
from hapscene.scene.scene import Scene
from hapscene.scene.scene_bundle import ZIP_SUFFIX, unpacked_beside
from hapscene.scene.scene_file import SUFFIX
from hapscene.touch import open_scene, step

__all__ = ["earlier_scenes", "open_session"]

DEMO: Final = Path("hapscene-demo")
"""Folder for the copy of the demo scene."""


def open_session(
    name: str | None,
    more: Sequence[str] = (),
    *,
    accept_changed: bool = False,
    say: Callable[[str], None] = lambda text: None,
    **reading: Any,
) -> Session:
    """Open a painting session.

    Args:
        name: scene, bundle or mesh file; None for a copy of the demo scene.
        more: further meshes for the same scene.
        accept_changed: see `Session.open`.
        say: called with progress messages.
        reading: options of `open_scene`. With several meshes, `unit` applies to formats without a unit.

    Raises:
        HapsceneError: a file cannot be loaded.
    """

    def opened(path: str) -> Scene:
        own = {} if not more or is_unitless(path) else {"unit": None}
        return open_scene(path, **(reading | own))

    if name is None:
        name = str(_copy_demo(DEMO))
        say(f"demo scene: {name}\n")
    with step(say, f"loading {name}"):
        if name.endswith(ZIP_SUFFIX):
            name = str(unpacked_beside(Path(name)))
            say(f"unpacked to {Path(name).parent}\n")
        changes = reading | {"scale": reading.get("scale", 1.0) != 1.0}
        is_scene = name.endswith(SUFFIX) and (bool(more) or not any(changes.values()))
        # with options for a mesh, a scene file goes through `opened`, which raises the error
        session = (
            Session.open(Path(name), accept_changed) if is_scene else Session(opened(name), _free_path(Path(name)))
        )
    for other in more:
        with step(say, f"loading {other}"):
            session.composing.add(opened(other))
    if not is_scene:
        session.history.clear()
    return session


def _copy_demo(folder: Path) -> Path:
    """Copy the demo scene to a folder unless it is there already; returns the scene file."""
    scene, source = folder / f"demo{SUFFIX}", assets.path("demo")
    if not scene.exists():
        (folder / "meshes").mkdir(parents=True, exist_ok=True)
        for file in sorted((source.parent / "meshes").iterdir()):
            if file.is_file():
                shutil.copyfile(file, folder / "meshes" / file.name)
        shutil.copyfile(source, scene)
    return scene


def _free_path(mesh: Path) -> Path:
    """An unused path in the working folder for the scene of a mesh."""
    return next(path for path in _names(mesh.name.removesuffix(SUFFIX).removesuffix(mesh.suffix)) if not path.exists())


def _names(stem: str, suffix: str = SUFFIX) -> Iterator[Path]:
    """Successive scene names of a mesh: cube, cube_2, cube_3."""
    return (Path(name + suffix) for name in (stem, *(f"{stem}_{i}" for i in range(2, 10_000))))


def earlier_scenes(path: Path | None, unpacked: bool = False) -> list[Path]:
    """Scene files from earlier sessions with the same mesh, which the user may want to continue.

    Args:
        path: path of the new scene.
        unpacked: whether it is a bundle that was just unpacked into a new folder; earlier folders are searched then.
    """
    if path is None or (path.exists() and not unpacked):
        return []
    new, suffix = (path.parent, "") if unpacked else (path, SUFFIX)
    stem = re.sub(r"_\d{1,4}$", "", new.name.removesuffix(suffix))
    earlier = takewhile(lambda other: other != new, _names(stem, suffix))
    return [file for other in earlier if (file := other / path.name if unpacked else other).is_file()]
