"""Companions of a mesh file: the files that it names, as a glTF's data, an OBJ's colours.

They are looked for beside it and below, and nowhere else: a stranger's file may name any. Both classes are what trimesh
calls a resolver, so far as its loaders use one.
"""

import posixpath
import zipfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from hapscene.errors import HapsceneError, MeshError


class FolderResources:
    """Those in a folder.

    Args:
        path: the file that names them; through links to it, its own folder comes first, then that of the link.
        most_B: how much is read, all together [bytes].
        error: what is raised.

    Attributes:
        found: the files that were asked for, and read.
    """

    def __init__(self, path: Path, most_B: int, error: type[HapsceneError] = MeshError) -> None:
        self._path, self._left_B, self._error = path, most_B, error
        self._folders = list(dict.fromkeys((path.resolve().parent, path.parent.resolve())))
        self.found: list[Path] = []

    def get(self, name: str) -> bytes:
        """The content of a file by its name, a relative path or a relative URI.

        Raises:
            `error`: it is not there, too large, or cannot be read.
        """
        file = self._find(name)
        if file is None:
            raise self._error(_missing(self._path, name))
        try:
            self._left_B -= file.stat().st_size
            if self._left_B < 0:
                raise self._error(f"{self._path}: {file.name}, which it needs, makes it too large to be read")
            self.found.append(file)
            return file.read_bytes()
        except OSError as error:
            raise self._error(f"{file}: cannot be read: {error.strerror}") from None

    __getitem__ = get

    def _find(self, name: str) -> Path | None:
        for spelling in _spellings(name):
            for folder in self._folders:
                try:
                    file = (folder / spelling).resolve()
                    if file.is_relative_to(folder) and file.is_file():
                        return file
                except (OSError, ValueError):  # no name that a file can have
                    continue
        return None


class ArchiveResources:
    """Those in an archive, each read when it is asked for.

    Args:
        path: the archive, for messages.
        archive: with content that is not too large.
        member: the file in it that names them.
    """

    def __init__(self, path: Path, archive: zipfile.ZipFile, member: str) -> None:
        self._path, self._archive, self._folder = path, archive, posixpath.dirname(member)
        self._read: dict[str, bytes] = {}  # held once, however often it is named

    def get(self, name: str) -> bytes:
        """The content of a file by its name.

        Raises:
            MeshError: it is not there, or cannot be read.
        """
        known = {posixpath.normpath(member): member for member in self._archive.namelist()}
        for spelling in _spellings(name):
            for folder in (self._folder, ""):
                if (place := posixpath.normpath(posixpath.join(folder, spelling))) in known:
                    return self.member(known[place])
        raise MeshError(_missing(self._path, name))

    __getitem__ = get

    def member(self, name: str) -> bytes:
        """The content of a file by its whole name.

        Raises:
            MeshError: it cannot be read.
        """
        try:
            return self._read.get(name) or self._read.setdefault(name, self._archive.read(name))
        except Exception as error:  # damaged, encrypted or packed in an odd way: zipfile raises anything at all
            raise MeshError(f"{self._path}: not a readable zip archive: {error}") from None


def _spellings(name: str) -> Iterator[str]:
    """How a file may be called; also one that is named where it lay once, on another computer."""
    last = name.strip().replace("\\", "/").rpartition("/")[2]
    yield from dict.fromkeys((name.strip(), unquote(name.strip()), last, unquote(last)))


def _missing(path: Path, name: str) -> str:
    return (
        f"{path}: needs the file {name[:100]!r}, which is not beside it: put it there, or export everything into one "
        "file (what lies elsewhere, or on the web, is not opened)"
    )
