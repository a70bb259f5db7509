"""Paths that are read and written: checked, before anything heavy is imported or computed."""

import os
from contextlib import suppress
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Final

from hapscene.constants import SCENE_SUFFIXES
from hapscene.errors import HapsceneError

__all__ = ["SCENES", "base_name", "check_out_folder", "check_swatch", "check_there", "missing", "new_file"]

SCENES: Final = SCENE_SUFFIXES
"""Ends of the names of scene files."""

STEM_NEAR: Final = 0.75
"""Least similarity of the part of a file's name before the first dot, for a suggestion: difflib's ratio [1]. Names with
one suffix are similar already: none.scene.json does not mean demo.scene.json."""

NAME_MAX: Final = 10_000
"""Most files of a folder that are compared with the name that was typed [count]."""


def check_there(path: str | Path, what: str = "file") -> None:
    """Raise where a path leads to no `what`: "file", "folder", or "file or folder"."""
    path = Path(path)
    if path.is_dir():
        if "folder" not in what:
            raise HapsceneError(f"{path}: is a folder; expected a {what}")
    elif not path.exists():
        raise HapsceneError(missing(path, what))
    elif not path.is_file():
        raise HapsceneError(f"{path}: is a pipe or a device, which is not read; expected a {what}")
    elif what == "folder":
        raise HapsceneError(f"{path}: is a file; expected a folder")


def missing(path: Path, what: str = "file") -> str:
    """The message about a missing file, with a file of a similar name."""
    if not path.parent.is_dir():
        return f"{path}: no such {what}: there is no folder {path.parent}"
    names = []
    with suppress(OSError):  # a folder that may not be listed
        files = (file for file in path.parent.iterdir() if file.exists() and not file.name.startswith("."))
        names = [file.name for file in islice(files, NAME_MAX)]
    stem = path.name.split(".")[0]
    alike = [name for name in names if get_close_matches(stem, [name.split(".")[0]], 1, STEM_NEAR)]
    near = get_close_matches(path.name, alike, 1)
    return f"{path}: no such {what}" + (f"; did you mean {path.with_name(near[0])}?" if near else "")


def check_swatch(name: str | Path) -> None:
    """Raise where a .swatch file is missing; names of the library are looked up later."""
    if str(name).endswith(".swatch") or "/" in str(name) or os.sep in str(name):
        check_there(name)


def check_out_folder(path: str | Path) -> None:
    """Raise, before the work is done, where a folder to write into is a file."""
    if Path(path).is_file():
        raise HapsceneError(f"{path}: is a file; expected a folder, or a name that is free")


def base_name(path: str | Path) -> str:
    """The name of what a file holds: "bunny" for meshes/bunny.ply and for bunny.scene.json."""
    name = Path(path).name
    end = next((end for end in SCENES if name.endswith(end)), None)
    return name.removesuffix(end) if end else Path(path).stem


def new_file(name: str) -> Path:
    """The file that is written where none was named; an existing file is not replaced.

    Raises:
        HapsceneError: it exists.
    """
    if Path(name).exists():
        raise HapsceneError(f"{name}: is there already; -o {name} replaces it, another name keeps it")
    return Path(name)
