"""Access to the files that a mesh file refers to, such as the buffers of a glTF file or the materials of an OBJ file.

Only files in the folder of the mesh file and below are opened, since an untrusted file may name any path. The class
implements the resolver interface of trimesh.
"""

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from hapscene.errors import MeshError

__all__ = ["FolderResources"]


class FolderResources:
    """Reads files from the folder of a mesh file.

    Args:
        path: the mesh file. If it is a symbolic link, the folder of its target is searched before that of the link.
        most_B: maximum total size of the files [bytes].

    Attributes:
        folders: folders that are searched.
        found: files that were read.
        missing: names that were not found.
    """

    def __init__(self, path: Path, most_B: int) -> None:
        self._path, self._left_B = path, most_B
        self.folders = list(dict.fromkeys((path.resolve().parent, path.parent.resolve())))
        self.found: list[Path] = []
        self.missing: list[str] = []

    def get(self, name: str) -> bytes:
        """Read a file by its name, a relative path or URI.

        Raises:
            MeshError: the file is not found, too large, or cannot be read.
        """
        file = self._find(name)
        if file is None:
            self.missing.append(name)
            raise MeshError(_missing(self._path, name))
        try:
            self._left_B -= file.stat().st_size
            if self._left_B < 0:
                raise MeshError(f"{self._path}: too large: its file {file.name} exceeds the limit")
            self.found.append(file)
            return file.read_bytes()
        except OSError as error:
            raise MeshError(f"{file}: cannot be read: {error.strerror}") from None

    __getitem__ = get

    def _find(self, name: str) -> Path | None:
        for spelling in _spellings(name):
            for folder in self.folders:
                try:
                    file = (folder / spelling).resolve()
                    if file.is_relative_to(folder) and file.is_file():
                        return file
                except (OSError, ValueError):  # not a valid file name
                    continue
        return None


def _spellings(name: str) -> Iterator[str]:
    """Yield possible names of a file; absolute paths from another computer are reduced to the file name."""
    last = name.strip().replace("\\", "/").rpartition("/")[2]
    yield from dict.fromkeys((name.strip(), unquote(name.strip()), last, unquote(last)))


def _missing(path: Path, name: str) -> str:
    return (
        f"{path}: the file {name[:100]!r}, which it refers to, is not found: put it in the same folder, or export "
        "everything into one file (other folders and web addresses are not opened)"
    )
