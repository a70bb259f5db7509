"""Files: written whole or not at all, read within bounds, JSON from strangers."""

import json
import os
import shutil
import stat
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from hapscene.errors import SwatchError


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Give a temporary path in the same folder; on a clean exit it becomes `path`, on any other it is gone.

    Args:
        path: where the file shall be; an old file there stays untouched until the new one is complete, which gets its
            permissions. A link is replaced, not followed.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    path = Path(path)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    part = Path(name)
    try:
        yield part
        part.chmod(_mode(path))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def check_file(path: Path, error: type[Exception]) -> None:
    """Refuse with `error`, before the work is done, a file that could not be written after it."""
    if not path.parent.is_dir():
        raise error(f"{path}: cannot be written: there is no folder {path.parent}")
    if path.is_dir():
        raise error(f"{path}: cannot be written: is a folder")
    if not os.access(path.parent, os.W_OK):
        raise error(f"{path}: cannot be written: nothing may be written into {path.parent}")


def write_whole(path: Path, content: bytes, error: type[Exception]) -> None:
    """Write a file whole or not at all; what goes wrong becomes `error`, with the path and the reason."""
    try:
        with whole_file(path) as part:
            part.write_bytes(content)
    except OSError as reason:
        raise error(f"{path}: cannot be written: {reason.strerror or reason}") from None


@contextmanager
def whole_folder(path: str | Path, ours: Collection[str] = ()) -> Iterator[Path]:
    """Give a temporary folder beside `path`; on a clean exit its files move into `path`, else it is gone.

    A folder that is there already keeps its other files; those of the same name are replaced.

    Args:
        path: the folder that shall hold the files; it and its parents are made when they are missing.
        ours: names of files of an earlier run that must not stay beside the new ones.

    Raises:
        OSError: the folder cannot be made or written, or `path` is a file.
    """
    path = Path(path).absolute()
    if path.exists() and not path.is_dir():
        raise NotADirectoryError(20, "is a file; expected a folder, or a name that is free", str(path))
    made = [parent for parent in path.parents if not parent.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        yield part
        if path.exists():
            for name in ours:
                if not (part / name).exists():
                    (path / name).unlink(missing_ok=True)
            for file in sorted(part.iterdir()):
                if (path / file.name).is_file():
                    file.chmod(_mode(path / file.name))
                file.replace(path / file.name)
        else:
            part.chmod(0o777 & ~_UMASK)
            part.replace(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        if not path.exists():
            for parent in made:
                parent.rmdir()


def _mode(path: Path) -> int:
    """Permissions for a file: those of the one that it replaces, else the usual ones."""
    if path.is_file() and not path.is_symlink():
        return stat.S_IMODE(path.stat().st_mode)
    return 0o666 & ~_UMASK


def _read_umask() -> int:
    """The process's umask, which can only be read by setting it: once, for threads would find each other's."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


_UMASK: Final = _read_umask()


# JSON from strangers: bounded in memory, every key once, no number that is none.
#
# What a text can grow to is bounded before it is parsed: a list in a list costs 60 bytes for every 3 of text, so it is
# lists, keys and values that are counted, not bytes alone.


CONTAINER_MAX: Final = 50_000
"""Most opening brackets and braces of a file [count]. The largest swatch has 12,300: a row per model and triangle."""

KEY_MAX: Final = 50_000
"""Most colons of a file [count]."""

VALUE_MAX: Final = 2_500_000
"""Most commas of a file [count]. The largest texture has 1.1 million numbers, 4096 models of order 256."""


def parse_json(data: bytes | str, what: str) -> Any:
    """The value of a JSON text in UTF-8.

    Args:
        data: the text; the caller has bounded its length.
        what: what it should be, for messages: "a swatch".

    Raises:
        SwatchError: not JSON, not UTF-8, too many values, NaN or Infinity, a key that stands twice.
    """
    for signs, most, kind in (("[{", CONTAINER_MAX, "lists"), (":", KEY_MAX, "keys"), (",", VALUE_MAX, "values")):
        found = sum(data.count(s.encode()) if isinstance(data, bytes) else data.count(s) for s in signs)
        if found > most:
            raise SwatchError(f"not {what}: {found} {kind}, more than the {most} that one can have")
    try:
        text = data.decode("utf-8-sig") if isinstance(data, bytes) else data
        return json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse)
    except SwatchError as error:
        raise SwatchError(f"not {what}: {error}") from None
    except json.JSONDecodeError as error:
        raise SwatchError(f"not {what}: {error.msg} in line {error.lineno}, column {error.colno}") from None
    except UnicodeDecodeError as error:
        raise SwatchError(f"not {what}: no UTF-8 text at byte {error.start}") from None
    except (ValueError, RecursionError) as error:
        raise SwatchError(f"not {what}: {error}") from None


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        seen: set[str] = set()
        double = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise SwatchError(f"key {double[:50]!r} stands twice")
    return content


def _refuse(constant: str) -> None:
    raise SwatchError(f"{constant} is no number that a surface can have")
