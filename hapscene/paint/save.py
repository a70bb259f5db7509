"""Saving a scene over its file: never over what someone else wrote there meanwhile, unless told to."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from hapscene.errors import SaveConflict, SceneError, SwatchError

if TYPE_CHECKING:
    from hapscene.surface.swatch import Swatch


def stamp_of(path: Path) -> str:
    """What a file is, to see whether it has changed since: its SHA-256; "" where there is none.

    Raises:
        SceneError: it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None


def check_unchanged(path: Path, known: str | None) -> None:
    """Refuse to write over a file that has not the stamp known; None where none is.

    Raises:
        SaveConflict: it has another content, is gone, or is new.
    """
    now = stamp_of(path)
    if known is None:
        if now:
            raise SaveConflict(f"{path}: is there already; save over it, or under another name")
        return
    if now == known:
        return
    if not known:
        raise SaveConflict(f"{path}: was made by someone else meanwhile; save over it, or under another name")
    if not now:
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
        from hapscene.surface.library import add, find, library_folder

        if find(swatch.name) is not None and not replace_old:
            raise SwatchError(f"{swatch.name!r} is in the library already: choose another name")
        entry = add(swatch, replace=replace_old)
        file = library_folder() / entry.file
        return file.resolve(), file
    from hapscene.surface.swatch_file import save_swatch

    if path.exists() and not replace_old:
        raise SwatchError(f"{path}: is there already; save over it, or under another name")
    save_swatch(swatch, path)
    return path.resolve(), path
