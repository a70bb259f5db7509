"""Files of a scene's own, beside its scene file: the meshes and swatches that no other file holds.

They are called NAME.WHAT.HASH.ply and .swatch, with a piece of their content's SHA-256: other content has another name.
So none is ever written over, neither ours nor anybody's; a scene file names what it was saved with, or nothing.
"""

import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from hapscene.errors import SceneError
from hapscene.output import write_whole

SCENE_SUFFIX: Final = ".scene.json"

PIECE_MIN: Final = 8
"""Shortest piece of the hash in a name [hexadecimal digits]."""

WHAT_MAX: Final = 40
"""Longest name of a body or swatch in the name of its file [characters]."""

_OWN: Final = re.compile(r".+\.(?=[0-9]*[a-f])([0-9a-f]{8,64})\.(?:ply|swatch)")  # digits alone may be a date


def is_own(file: Path) -> bool:
    """Whether a file is a scene's own, by its name."""
    return _OWN.fullmatch(file.name) is not None


class Beside:
    """What a scene file names. Made by `beside`.

    Args:
        path: the scene file.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._folder = path, path.parent.resolve()
        self._stem = path.name.removesuffix(SCENE_SUFFIX)
        self._named: set[str] = set()
        self._made: list[Path] = []

    def name(self, file: Path | None) -> str | None:
        """How the scene file names a file; None for what it must have beside it: in memory alone, or own elsewhere."""
        if file is None or (is_own(file) and (file.resolve().parent != self._folder or not file.is_file())):
            return None
        return self._relative(file.resolve())

    def put(self, what: str, suffix: str, content: bytes) -> str:
        """How the scene file names a file of its own with that content, which is written unless it is there.

        Raises:
            SceneError: it cannot be written.
        """
        plain = re.sub(r"[^\w.-]+", "_", what)[:WHAT_MAX]
        digest = hashlib.sha256(content).hexdigest()
        pieces = (digest[:size] for size in range(PIECE_MIN, len(digest) + 1))
        files = (self._folder / f"{self._stem}.{plain}.{piece}{suffix}" for piece in pieces)
        file = next(f for f in files if is_own(f) and (not os.path.lexists(f) or _holds(f, content)))
        if not file.exists():
            write_whole(file, content, SceneError)
            self._made.append(file)
        return self._relative(file)

    def undo(self) -> None:
        """Remove what was written."""
        for file in self._made:
            file.unlink(missing_ok=True)

    def clear(self, before: bytes) -> None:
        """Remove what the scene file named `before` and does no more, unless another one of its folder does."""
        for file in self._folder.glob("*"):
            name = file.name.encode(errors="surrogateescape")
            if file.name in self._named or name not in before or not file.name.startswith(f"{self._stem}."):
                continue
            with suppress(OSError):
                others = (f.read_bytes() for f in self._folder.glob(f"*{SCENE_SUFFIX}") if f.name != self._path.name)
                if _is_whole(file) and not any(name in other for other in others):
                    file.unlink()

    def _relative(self, file: Path) -> str:
        self._named.add(file.name)
        try:
            return Path(os.path.relpath(file, self._folder)).as_posix()
        except ValueError:  # another drive, on Windows
            return file.as_posix()


@contextmanager
def beside(path: Path) -> Iterator[Beside]:
    """While a scene file is written, the last of all: what goes wrong leaves the old one and its files as they were."""
    before = b""
    with suppress(OSError):
        before = path.read_bytes()
    files = Beside(path)
    try:
        yield files
    except BaseException:
        files.undo()
        raise
    files.clear(before)


def _holds(file: Path, content: bytes) -> bool:
    try:
        return file.stat().st_size == len(content) and file.read_bytes() == content
    except OSError:
        return False


def _is_whole(file: Path) -> bool:
    """Whether a file is a scene's own, and as it was written."""
    match = _OWN.fullmatch(file.name)
    return match is not None and hashlib.sha256(file.read_bytes()).hexdigest().startswith(match[1])
