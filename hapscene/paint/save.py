"""Saving a scene over its file: never over what someone else wrote there meanwhile, unless told to."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hapscene.errors import SceneError, SwatchError

if TYPE_CHECKING:
    from hapscene.surface.swatch import Swatch


class SaveConflict(SceneError):
    """The file to be written is not the one that was loaded: ask, then save with force."""


@dataclass(frozen=True)
class Stamp:
    """What a file was: to see whether it has changed since. `sha256` is "" where there was no file."""

    mtime_ns: int
    size: int
    sha256: str


def stamp_of(path: Path) -> Stamp:
    """The stamp of a file as it is now.

    Raises:
        SceneError: it cannot be read.
    """
    try:
        with path.open("rb") as file:
            status = path.stat()
            return Stamp(status.st_mtime_ns, status.st_size, hashlib.file_digest(file, "sha256").hexdigest())
    except FileNotFoundError:
        return Stamp(0, 0, "")
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None


def check_unchanged(path: Path, known: Stamp | None) -> None:
    """Refuse to write over a file that is not the one known; None where none is.

    A file that was only touched, its content the same, counts as unchanged.

    Raises:
        SaveConflict: it has another content, is gone, or is new.
    """
    now = stamp_of(path)
    if known is None:
        if now.sha256:
            raise SaveConflict(f"{path}: is there already; save over it, or under another name")
        return
    if now.sha256 == known.sha256:
        return
    if not known.sha256:
        raise SaveConflict(f"{path}: was made by someone else meanwhile; save over it, or under another name")
    if not now.sha256:
        raise SaveConflict(f"{path}: was removed or renamed meanwhile; save it anew, or under another name")
    raise SaveConflict(
        f"{path}: was changed by someone else since it was opened; save over it, save under another name, or open "
        "it again and lose what was painted here"
    )


def write_swatch(swatch: "Swatch", path: Path | None, replace_old: bool) -> tuple[str | Path, Path]:
    """Write a swatch to a file, or (None) into the library; what `Scene.swatch_source` calls it, and its file.

    Raises:
        SwatchError: the name or the file is taken, and not to be replaced; it cannot be written.
    """
    if path is None:
        from hapscene.surface.library import add, library_folder

        entry = add(swatch, replace=replace_old)
        file = library_folder() / entry.file
        return file.resolve(), file
    from hapscene.surface.swatch_file import save_swatch

    if path.exists() and not replace_old:
        raise SwatchError(f"{path}: is there already; save over it, or under another name")
    save_swatch(swatch, path)
    return path.resolve(), path
