"""Files: written whole or not at all, read within bounds, JSON from strangers."""

import errno
import json
import os
import re
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

from hapscene.errors import FormatError, did_you_mean, printable

if TYPE_CHECKING:
    import zipfile

__all__ = [
    "CONTAINER_MAX",
    "MEMORY_FREE_B",
    "VALUE_MAX",
    "check_file",
    "check_file_size",
    "check_keys",
    "check_memory",
    "check_unpacked",
    "memory_most_B",
    "naming",
    "open_zip",
    "parse_format",
    "parse_json",
    "read_bytes",
    "refusing",
    "short",
    "unpacked_most_B",
    "whole_file",
    "whole_folder",
    "write_whole",
]

FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
FULL_HINT: Final = "; make room there, or write elsewhere"


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
    part = _temporary(path)
    lock = None
    try:
        lock = _make(part, path, lambda: os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)))
        with _said_of(path, part):
            yield part
        part.chmod(_mode(path))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
        _let_go(lock)


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
        why = str(reason.strerror or reason).removeprefix("cannot be written: ")
        raise error(f"{path}: cannot be written: {why}") from None


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
    part = _temporary(path)
    lock = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = _make(part, path, lambda: part.mkdir(0o700))
        with _said_of(path, part):
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
        _let_go(lock)
        if not path.exists():
            with suppress(OSError):  # somebody else has put something there meanwhile
                for parent in made:
                    parent.rmdir()


# What is written has a name of its own until it is whole: hidden, ours without doubt, locked by its writer for as long
# as that lives. What writers that were killed have left is removed by the next process that writes into the folder.


_TEMPORARY: Final = re.compile(r"\..*\.hapscene-[0-9a-f]{16}(\.[^.]*)?", re.DOTALL)

_NAME_KEPT: Final = 40
"""How much of the name is in the temporary one [characters], which may not be longer than 255 bytes."""

_LEFT_S: Final = 24 * 3600.0
"""Age from which a temporary file or folder has no writer any more [s], where nothing can be locked."""


def _temporary(path: Path) -> Path:
    """A name in the same folder that nobody has; chosen before it is made, so that whatever ends us can be tidied."""
    _tidy(path.parent.absolute())
    return path.parent / f".{path.name[:_NAME_KEPT]}.hapscene-{secrets.token_hex(8)}{path.suffix}"


def _make(part: Path, path: Path, make: Callable[[], object]) -> int | None:
    """Make the temporary file or folder, and lock it; what holds the lock, where there can be one.

    Raises:
        OSError: naming `path`.
    """
    try:
        while True:
            make()
            lock = _open_locked(part)
            if part.exists():
                return lock
            _let_go(lock)  # it was tidied away before it was locked
    except OSError as error:
        raise OSError(error.errno, f"cannot be written: {error.strerror}", str(path)) from None


@contextmanager
def _said_of(path: Path, part: Path) -> Iterator[None]:
    """What cannot be written of the temporary one, or has no room, is said of the one that was meant."""
    try:
        yield
    except OSError as error:
        full = error.filename is None and error.errno in FULL
        if not full and not str(error.filename).startswith(str(part)):
            raise
        why = str(error.strerror or error).removeprefix("cannot be written: ")
        if error.errno in FULL and FULL_HINT not in why:
            why += FULL_HINT
        raise OSError(error.errno, f"cannot be written: {why}", str(path)) from None


def _open_locked(part: Path, wait: bool = True) -> int | None:
    """What holds the lock, and None where nothing can be locked.

    Raises:
        BlockingIOError: another has it, and it is not waited for.
    """
    if sys.platform == "win32":  # where an open file could not be renamed
        return None
    import fcntl

    number = None
    try:
        number = os.open(part, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        fcntl.flock(number, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        return number
    except BlockingIOError:
        _let_go(number)
        raise
    except OSError:
        _let_go(number)
        return None


def _let_go(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


@cache
def _tidy(folder: Path) -> None:
    """Remove what writers that are gone have left in a folder; once in a process."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _TEMPORARY.fullmatch(entry.name):
                with suppress(OSError):  # another writes it, or it is another user's
                    _remove_left(Path(entry.path), entry.stat(follow_symlinks=False))


def _remove_left(part: Path, state: os.stat_result) -> None:
    lock = _open_locked(part, wait=False)
    try:
        if lock is None and time.time() - state.st_mtime < _LEFT_S:
            return
        if stat.S_ISDIR(state.st_mode):
            shutil.rmtree(part)
        else:
            part.unlink()
    finally:
        _let_go(lock)


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


# Files from strangers: bounded before anything is made of them, and refused with one sentence.
#
# The functions below raise `FormatError`; a room makes its own error of it with `refusing`, which also says where.


def read_bytes(path: Path, most_B: int, what: str) -> bytes:
    """The content of a file, bounded.

    Args:
        path: the file.
        most_B: its largest size [bytes].
        what: what it should be, for messages: "swatch".

    Raises:
        FormatError: no such file, a folder or a device, too large, or not to be read.
    """
    check_file_size(path, most_B, what)
    try:
        with path.open("rb") as file:
            size_B = os.fstat(file.fileno()).st_size  # as much is set aside for it
            content = file.read(min(most_B, size_B) + 1)
    except OSError as reason:
        raise FormatError(f"{path}: cannot be read: {reason.strerror}") from None
    if len(content) > most_B:
        raise FormatError(_too_large(path, most_B, what))
    return content


def check_file_size(path: Path, most_B: int, what: str) -> None:
    """Refuse, for a reader that opens it itself, what `read_bytes` refuses.

    Raises:
        FormatError: no such file, a folder or a device, or too large.
    """
    try:
        if "\0" in str(path):
            raise FormatError(f"{str(path)!r}: cannot be read: no file has such a name")
        if not path.is_file():
            raise FormatError(f"{path}: cannot be read: is no file" if path.exists() else f"{path}: no such file")
        if path.stat().st_size > most_B:
            raise FormatError(_too_large(path, most_B, what))
    except OSError as reason:
        raise FormatError(f"{path}: cannot be read: {reason.strerror}") from None


def _too_large(path: Path, most_B: int, what: str) -> str:
    most = f"{most_B >> 30} GiB" if most_B >= 1 << 30 else f"{most_B >> 20} MiB"
    return f"{path}: larger than {most}, which no {what} is"


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Whatever `FormatError` is raised within and does not say which file is said of this one."""
    try:
        yield
    except FormatError as fault:
        if printable(str(path)) in str(fault):
            raise
        raise type(fault)(f"{path}: {fault}") from None


@contextmanager
def refusing(error: type[FormatError], where: object = None) -> Iterator[None]:
    """Whatever `FormatError` is raised within becomes `error`, said of `where` if that is given."""
    try:
        yield
    except FormatError as fault:
        raise error(str(fault) if where is None else f"{where}: {fault}") from None


# One rule for the memory that a stranger's file may take, asked before anything is made of it: what is unpacked, and
# what follows from it (numbers of eight bytes, gaps filled, resampling).


UNPACKED_RATIO_MAX: Final = 100
"""Most times its own size that a file may unpack to [1]: meshes and recordings unpack to 2 to 20 times, what is made to
fill the memory to a thousand times."""

UNPACKED_FREE_B: Final = 5_000_000
"""Content that a file of any size may unpack to [bytes]."""

MEMORY_RATIO_MAX: Final = 4
"""Most memory that reading may take, in sizes of what is read, unpacked [1]: numbers of two bytes become eight."""

MEMORY_FREE_B: Final = 200_000_000
"""Memory that reading any file may take besides, whatever its size [bytes]."""

LISTING_MAX_B: Final = 1_000_000
"""Longest list of an archive's members [bytes], 15,000 of them: each takes ten times that in memory."""


def unpacked_most_B(packed_B: int, most_B: int) -> int:
    """What a file of that size may unpack to, `most_B` at most [bytes]."""
    return min(most_B, max(UNPACKED_RATIO_MAX * packed_B, UNPACKED_FREE_B))


def check_unpacked(packed_B: int, unpacked_B: int, most_B: int, advice: str) -> None:
    """Refuse what unpacks to more than `most_B`, or than its own size allows.

    Raises:
        FormatError: it does; `advice` is what to do.
    """
    most_B = unpacked_most_B(packed_B, most_B)
    if unpacked_B > most_B:
        raise FormatError(f"unpacks to {unpacked_B:,} bytes; of an archive this large {most_B:,} are read: {advice}")


def memory_most_B(own_B: int) -> int:
    """What may be taken to read so much, unpacked [bytes]."""
    return MEMORY_RATIO_MAX * own_B + MEMORY_FREE_B


def check_memory(needed_B: float, own_B: int, what: str, advice: str) -> None:
    """Refuse what takes more memory than the size of what is read, unpacked, allows.

    Raises:
        FormatError: it does; `what` takes it, `advice` is what to do.
    """
    if needed_B > memory_most_B(own_B):
        needed_MB, most_MB = needed_B / 1e6, memory_most_B(own_B) / 1e6
        raise FormatError(
            f"{what} would take {needed_MB:,.0f} MB of memory, and of a file this large {most_MB:,.0f} may be: {advice}"
        )


def open_zip(file: BinaryIO, most_B: int, advice: str) -> "zipfile.ZipFile":
    """A zip archive that unpacks to no more than `most_B` and its own size allow.

    Args:
        file: the archive, seekable.
        most_B: most that it may unpack to [bytes].
        advice: what to do where it is more.

    Raises:
        FormatError: it is no archive, or unpacks to more.
    """
    import zipfile

    packed_B = file.seek(0, os.SEEK_END)
    try:
        archive = zipfile.ZipFile(_Listing(file))  # has what it calls of a file
    except Exception as error:  # it raises of its own, struct's, and what is not implemented
        raise FormatError(f"not a readable zip archive, or truncated: {error}") from None
    archive.fp = file
    check_unpacked(packed_B, sum(member.file_size for member in archive.infolist()), most_B, advice)
    return archive


class _Listing:
    """An archive's file while its list of members is read, which is read in one go and must not be endless."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, size: int = -1) -> bytes:
        content = self._file.read(min(size, LISTING_MAX_B + 1) if size >= 0 else LISTING_MAX_B + 1)
        if len(content) > LISTING_MAX_B:
            raise ValueError(f"its list of members is longer than {LISTING_MAX_B:,} bytes")
        return content

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


CONTAINER_MAX: Final = 50_000
"""Most opening brackets and braces of a JSON text [count]: a list in a list costs 60 bytes for every 3 of text, so
lists, keys and values are counted before it is parsed, not bytes alone. The largest swatch has 12,300."""

KEY_MAX: Final = 50_000
"""Most colons of a JSON text [count]."""

VALUE_MAX: Final = 2_500_000
"""Most commas of a JSON text [count]. The largest texture has 1.1 million numbers, 4096 models of order 256."""


def parse_json(data: bytes | str, what: str) -> Any:
    """The value of a JSON text in UTF-8: every key once, no NaN and no infinity.

    Args:
        data: the text; the caller has bounded its length.
        what: what it should be, for messages: "a swatch".

    Raises:
        FormatError: not JSON, not UTF-8, too many values, NaN or Infinity, a key that stands twice.
    """
    for signs, most, kind in (("[{", CONTAINER_MAX, "lists"), (":", KEY_MAX, "keys"), (",", VALUE_MAX, "values")):
        found = sum(data.count(s.encode()) if isinstance(data, bytes) else data.count(s) for s in signs)
        if found > most:
            raise FormatError(f"not {what}: {found} {kind}, more than the {most} that one can have")
    try:
        text = data.decode("utf-8-sig") if isinstance(data, bytes) else data
        return json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse)
    except json.JSONDecodeError as error:
        reason = f"{error.msg} in line {error.lineno}, column {error.colno}"
    except UnicodeDecodeError as error:
        reason = f"no UTF-8 text at byte {error.start}"
    except (ValueError, RecursionError) as error:
        reason = str(error)
    raise FormatError(f"not {what}: {reason}")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        seen: set[str] = set()
        double = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"key {double[:50]!r} stands twice")
    return content


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number")


def parse_format(data: bytes | str, what: str, name: str, version: int) -> dict[str, Any]:
    """The object of a JSON text of ours, its format and version checked.

    Args:
        data: the text.
        what: what it should be, for messages: "a swatch".
        name: its "format".
        version: the last version that is read.

    Raises:
        FormatError: not JSON, of another format, or of a later version.
    """
    content = parse_json(data, what)
    if not isinstance(content, dict) or content.get("format") != name:
        raise FormatError(f'not {what}: the file must be a JSON object with "format": "{name}"')
    found = content.get("version")
    if type(found) is not int or found < 1:
        raise FormatError(f"version must be a whole number from 1 to {version}, is {short(found)}")
    if found > version:
        raise FormatError(
            f"format version {short(found)} is later than {version}, the last one read here: update hapscene"
        )
    return content


def check_keys(where: str, content: Any, known: Iterable[str], required: Iterable[str] | None = None) -> None:
    """Every key is known, and every one that is required is there (all, unless told): none is a silent default.

    Raises:
        FormatError: else, naming the key; `where` is the place in the file, "" for the whole.
    """
    if not isinstance(content, dict):
        raise FormatError(f"{where} must be an object, is {short(content)}")
    prefix, known = f"{where}." if where else "", list(known)
    for key in content:
        if key not in known:
            raise FormatError(f"unknown key {short(prefix + key)}{did_you_mean(key[:100], known)}")
    for key in known if required is None else required:
        if key not in content:
            raise FormatError(f"key {prefix + key!r} is missing")


def short(value: Any) -> str:
    """What a message shows of a value from a stranger's file."""
    value = value[:60] if isinstance(value, str) else value  # before it is escaped, which may be ten times as long
    text = repr(value) if isinstance(value, str | int | float | bool) or value is None else type(value).__name__
    return text if len(text) <= 60 else text[:57] + "…"
