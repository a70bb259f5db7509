"""Checks of input and output paths, made before slow imports and computations."""

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
"""Suffixes of scene files."""

STEM_NEAR: Final = 0.75
"""Least similarity of two file names for a suggestion, as difflib's ratio [1]. Only the part before the first dot
counts: a common suffix makes all names similar."""

NAME_MAX: Final = 10_000
"""Most files of a folder that are compared with the given name [count]."""


def check_there(path: str | Path, what: str = "file") -> None:
    """Check that a path exists and is of the kind `what`: "file", "folder", or "file or folder".

    Raises:
        HapsceneError: it does not exist, or is of another kind.
    """
    path = Path(path)
    if path.is_dir():
        if "folder" not in what:
            raise HapsceneError(f"{path}: is a folder; expected a {what}")
    elif not path.exists():
        raise HapsceneError(missing(path, what))
    elif not path.is_file():
        raise HapsceneError(f"{path}: is a pipe or a device file; expected a regular {what}")
    elif what == "folder":
        raise HapsceneError(f"{path}: is a file; expected a folder")


def missing(path: Path, what: str = "file") -> str:
    """The message for a missing file or folder, with a suggestion if a similar name exists."""
    if not path.parent.is_dir():
        return f"{path}: no such {what}: there is no folder {path.parent}"
    names = []
    with suppress(OSError):  # the folder may not be readable
        files = (file for file in path.parent.iterdir() if file.exists() and not file.name.startswith("."))
        names = [file.name for file in islice(files, NAME_MAX)]
    stem = path.name.split(".")[0]
    similar = [name for name in names if get_close_matches(stem, [name.split(".")[0]], 1, STEM_NEAR)]
    near = get_close_matches(path.name, similar, 1)
    return f"{path}: no such {what}" + (f"; did you mean {path.with_name(near[0])}?" if near else "")


def check_swatch(name: str | Path) -> None:
    """Check that a .swatch file exists. Names of library swatches are looked up later."""
    if str(name).endswith(".swatch") or "/" in str(name) or os.sep in str(name):
        check_there(name)


def check_out_folder(path: str | Path) -> None:
    """Check that an output folder is not an existing file."""
    if Path(path).is_file():
        raise HapsceneError(f"{path}: is a file; expected a folder or a new name")


def base_name(path: str | Path) -> str:
    """The file name without folder and suffix: "bunny" for meshes/bunny.ply and for bunny.scene.json."""
    name = Path(path).name
    end = next((end for end in SCENES if name.endswith(end)), None)
    return name.removesuffix(end) if end else Path(path).stem


def new_file(name: str) -> Path:
    """The default output file. A default never replaces an existing file.

    Raises:
        HapsceneError: the file exists.
    """
    if Path(name).exists():
        raise HapsceneError(f"{name}: exists already; use -o {name} to replace it, or -o with another name")
    return Path(name)
