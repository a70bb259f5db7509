"""The files that a mesh file names, such as the data of a glTF or the colours of an OBJ.

They are looked for beside it and below, and nowhere else: a file from a stranger may name any file. The class is what
trimesh calls a resolver, as far as its loaders use one.
"""

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from hapscene.errors import HapsceneError, MeshError

__all__ = ["FolderResources"]


class FolderResources:
    """Those in a folder.

    Args:
        path: the file that names them; through links to it, its own folder comes first, then that of the link.
        most_B: how much is read, all together [bytes].
        error: what is raised.

    Attributes:
        folders: where the files are looked for.
        found: the files that were asked for, and read.
    """

    def __init__(self, path: Path, most_B: int, error: type[HapsceneError] = MeshError) -> None:
        self._path, self._left_B, self._error = path, most_B, error
        self.folders = list(dict.fromkeys((path.resolve().parent, path.parent.resolve())))
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
            for folder in self.folders:
                try:
                    file = (folder / spelling).resolve()
                    if file.is_relative_to(folder) and file.is_file():
                        return file
                except (OSError, ValueError):  # no name that a file can have
                    continue
        return None


def _spellings(name: str) -> Iterator[str]:
    """How a file may be called; also one that is named where it lay once, on another computer."""
    last = name.strip().replace("\\", "/").rpartition("/")[2]
    yield from dict.fromkeys((name.strip(), unquote(name.strip()), last, unquote(last)))


def _missing(path: Path, name: str) -> str:
    return (
        f"{path}: needs the file {name[:100]!r}, which is not beside it: put it there, or export everything into one "
        "file (what lies elsewhere, or on the web, is not opened)"
    )
