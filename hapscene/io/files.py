"""File access: atomic writes, size limits for untrusted files, and JSON parsing."""

import errno
import json
import os
import re
import secrets
import shutil
import stat
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final, TypeAlias, TypeVar

from hapscene.constants import UNITLESS
from hapscene.errors import FormatError, printable

if TYPE_CHECKING:
    import zipfile

__all__ = [
    "MEMORY_FREE_B",
    "METRES",
    "Json",
    "check_file",
    "check_file_size",
    "check_memory",
    "check_unpacked",
    "is_unitless",
    "memory_most_B",
    "naming",
    "open_zip",
    "parse_format",
    "read_bytes",
    "refusing",
    "short",
    "to_struct",
    "unpacked_most_B",
    "whole_file",
    "whole_folder",
    "write_whole",
]

METRES: Final = b" unit m\n"
"""Comment near the start of PLY and OBJ files that hapscene writes: metres, z up."""


def is_unitless(path: str | Path) -> bool:
    """Return whether a mesh file states no unit of length: its format has none, nor has it the comment `METRES`."""
    path = Path(path)
    if path.suffix.lower()[1:] not in UNITLESS:
        return False
    with suppress(OSError), path.open("rb") as file:
        return METRES not in file.read(100)
    return True


FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
FULL_HINT: Final = "; free some space, or write elsewhere"


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Context manager for atomic writes: yields a temporary path, which replaces `path` on success.

    Args:
        path: target file. It is unchanged until the new file is complete, which inherits its permissions. A symbolic
            link is replaced, not followed.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    path = Path(path)
    part = _temporary(path)
    try:
        with _errors_name(path, part):
            os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
            yield part
        part.chmod(_mode(path))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def check_file(path: Path, error: type[Exception]) -> None:
    """Raise `error` if a file cannot be written; to be called before long computations."""
    if not path.parent.is_dir():
        raise error(f"{path}: cannot be written: the folder {path.parent} does not exist")
    if path.is_dir():
        raise error(f"{path}: cannot be written: it is a folder")
    if not os.access(path.parent, os.W_OK):
        raise error(f"{path}: cannot be written: no permission for the folder {path.parent}")


def write_whole(path: Path, content: bytes, error: type[Exception]) -> None:
    """Write a file atomically; failures raise `error` with path and reason."""
    try:
        with whole_file(path) as part:
            part.write_bytes(content)
    except OSError as reason:
        why = str(reason.strerror or reason).removeprefix("cannot be written: ")
        raise error(f"{path}: cannot be written: {why}") from None


@contextmanager
def whole_folder(path: str | Path, ours: Collection[str] = ()) -> Iterator[Path]:
    """Context manager for atomic writes of a folder: yields a temporary folder, whose files move to `path` on success.

    Other files in an existing folder are kept; files with the same names are replaced.

    Args:
        path: target folder; it and its parents are created if missing.
        ours: names of files from an earlier run that are removed.

    Raises:
        OSError: the folder cannot be created or written, or `path` is a file.
    """
    path = Path(path).absolute()
    if path.exists() and not path.is_dir():
        raise NotADirectoryError(20, "it is a file; expected a folder or a new name", str(path))
    made = [parent for parent in path.parents if not parent.exists()]
    part = _temporary(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with _errors_name(path, part):
            part.mkdir(0o700)
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
            with suppress(OSError):  # another process has written there meanwhile
                for parent in made:
                    parent.rmdir()


# Temporary files have hidden names with a random part. Those of processes that were killed are removed by the next
# process that writes into the folder, once they are old.


_TEMPORARY: Final = re.compile(r"\..*\.hapscene-[0-9a-f]{16}(\.[^.]*)?", re.DOTALL)

_NAME_KEPT: Final = 40
"""Length of the original name in a temporary name [characters]: file names are limited to 255 bytes."""

_LEFT_S: Final = 24 * 3600.0
"""Age after which a temporary file is removed [s]: no process writes for so long without a pause."""


def _temporary(path: Path) -> Path:
    """Return an unused temporary name in the same folder; remove old temporary files there."""
    _tidy(path.parent.absolute())
    return path.parent / f".{path.name[:_NAME_KEPT]}.hapscene-{secrets.token_hex(8)}{path.suffix}"


@contextmanager
def _errors_name(path: Path, part: Path) -> Iterator[None]:
    """Make errors about the temporary path or a full disk name `path` instead."""
    try:
        yield
    except OSError as error:
        full = error.filename is None and error.errno in FULL
        if not full and not str(error.filename).startswith(str(part)):
            raise
        why = str(error.strerror).removeprefix("cannot be written: ")
        if error.errno in FULL and FULL_HINT not in why:
            why += FULL_HINT
        raise OSError(error.errno, f"cannot be written: {why}", str(path)) from None


@cache
def _tidy(folder: Path) -> None:
    """Remove temporary files of ended processes from a folder, once per process."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _TEMPORARY.fullmatch(entry.name):
                with suppress(OSError):  # owned by another user
                    _remove_left(Path(entry.path), entry.stat(follow_symlinks=False))


def _remove_left(part: Path, state: os.stat_result) -> None:
    if time.time() - state.st_mtime < _LEFT_S:
        return
    if stat.S_ISDIR(state.st_mode):
        shutil.rmtree(part)
    else:
        part.unlink()


def _mode(path: Path) -> int:
    """Return the permissions for a new file: of the file that it replaces, or the default."""
    if path.is_file() and not path.is_symlink():
        return stat.S_IMODE(path.stat().st_mode)
    return 0o666 & ~_UMASK


def _read_umask() -> int:
    """Return the umask. It can only be read by setting it, so this must happen before other threads start."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


_UMASK: Final = _read_umask()


# Untrusted files: their size is checked before memory is allocated.
#
# The functions below raise `FormatError`. Callers convert it with `refusing` to their own class and add the location.


def read_bytes(path: Path, most_B: int, what: str) -> bytes:
    """Read a file up to a maximum size.

    Args:
        path: the file.
        most_B: maximum size [bytes].
        what: kind of file for messages, such as "swatch".

    Raises:
        FormatError: the file is missing, not a regular file, too large, or cannot be read.
    """
    check_file_size(path, most_B, what)
    try:
        with path.open("rb") as file:
            size_B = os.fstat(file.fileno()).st_size  # avoids allocating `most_B`
            content = file.read(min(most_B, size_B) + 1)
    except OSError as reason:
        raise FormatError(f"{path}: cannot be read: {reason.strerror}") from None
    if len(content) > most_B:
        raise FormatError(_too_large(path, most_B, what))
    return content


def check_file_size(path: Path, most_B: int, what: str) -> None:
    """Check existence and size of a file that another reader opens.

    Raises:
        FormatError: the file is missing, not a regular file, or too large.
    """
    try:
        if "\0" in str(path):
            raise FormatError(f"{str(path)!r}: cannot be read: invalid file name")
        if not path.is_file():
            raise FormatError(
                f"{path}: cannot be read: not a regular file" if path.exists() else f"{path}: no such file"
            )
        if path.stat().st_size > most_B:
            raise FormatError(_too_large(path, most_B, what))
    except OSError as reason:
        raise FormatError(f"{path}: cannot be read: {reason.strerror}") from None


def _too_large(path: Path, most_B: int, what: str) -> str:
    most = f"{most_B >> 30} GiB" if most_B >= 1 << 30 else f"{most_B >> 20} MiB"
    return f"{path}: larger than {most}, the maximum for a {what}"


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Context manager: add the path to every `FormatError` that does not contain it."""
    try:
        yield
    except FormatError as fault:
        if printable(str(path)) in str(fault):
            raise
        raise type(fault)(f"{path}: {fault}") from None


@contextmanager
def refusing(error: type[FormatError], where: object = None) -> Iterator[None]:
    """Context manager: convert every `FormatError` to `error`, prefixed with `where` if given."""
    try:
        yield
    except FormatError as fault:
        raise error(str(fault) if where is None else f"{where}: {fault}") from None


# Limits on the memory for an untrusted file, checked before allocation: its unpacked size, and the arrays made from it
# (8-byte numbers, filled gaps, resampling).


UNPACKED_RATIO_MAX: Final = 100
"""Maximum ratio of unpacked to packed size [1]: meshes and recordings have 2 to 20, archives that are made to exhaust
the memory a thousand."""

UNPACKED_FREE_B: Final = 5_000_000
"""Unpacked size that is always allowed [bytes]."""

MEMORY_RATIO_MAX: Final = 4
"""Maximum ratio of memory to unpacked size [1]: 2-byte numbers become 8-byte numbers."""

MEMORY_FREE_B: Final = 200_000_000
"""Additional memory that is always allowed [bytes]."""

LISTING_MAX_B: Final = 1_000_000
"""Maximum size of the directory of an archive [bytes]: 15,000 members. In memory it needs ten times as much."""


def unpacked_most_B(packed_B: int, most_B: int) -> int:
    """Return the maximum unpacked size of a file, at most `most_B` [bytes]."""
    return min(most_B, max(UNPACKED_RATIO_MAX * packed_B, UNPACKED_FREE_B))


def check_unpacked(packed_B: int, unpacked_B: int, most_B: int, advice: str) -> None:
    """Check the unpacked size of a file against `most_B` and its packed size.

    Raises:
        FormatError: it is too large; the message ends with `advice`.
    """
    most_B = unpacked_most_B(packed_B, most_B)
    if unpacked_B > most_B:
        raise FormatError(f"unpacks to {unpacked_B:,} bytes, at most {most_B:,} are allowed for its size: {advice}")


def memory_most_B(own_B: int) -> int:
    """Return the maximum memory for a file with this unpacked size [bytes]."""
    return MEMORY_RATIO_MAX * own_B + MEMORY_FREE_B


def check_memory(needed_B: float, own_B: int, what: str, advice: str) -> None:
    """Check the memory for `what` against the unpacked size of the file.

    Raises:
        FormatError: it is too much; the message ends with `advice`.
    """
    if needed_B > memory_most_B(own_B):
        needed_MB, most_MB = needed_B / 1e6, memory_most_B(own_B) / 1e6
        raise FormatError(
            f"{what} needs {needed_MB:,.0f} MB of memory, at most {most_MB:,.0f} MB are allowed for this file: {advice}"
        )


def open_zip(file: BinaryIO, most_B: int, advice: str) -> "zipfile.ZipFile":
    """Open a zip archive with a limited unpacked size.

    Args:
        file: the archive, seekable.
        most_B: maximum unpacked size [bytes].
        advice: what to do if it is larger.

    Raises:
        FormatError: not a zip archive, or too large.
    """
    import zipfile

    packed_B = file.seek(0, os.SEEK_END)
    try:
        archive = zipfile.ZipFile(_Listing(file))  # a file object with a limited read
    except Exception as error:  # zipfile raises several classes for damaged archives
        raise FormatError(f"not a valid zip archive, or truncated: {error}") from None
    archive.fp = file
    check_unpacked(packed_B, sum(member.file_size for member in archive.infolist()), most_B, advice)
    return archive


class _Listing:
    """File object that limits single reads, since zipfile reads the directory of an archive at once."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, size: int = -1) -> bytes:
        if size > LISTING_MAX_B:
            raise ValueError(f"its directory is longer than {LISTING_MAX_B:,} bytes")
        return self._file.read(size)  # without a size: the last 64 KiB

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


CONTAINER_MAX: Final = 50_000
"""Maximum number of lists and objects in JSON [count]: nested lists take 60 bytes of memory for 3 bytes of text, so a
limit on the size alone does not suffice. The largest swatch has 12,300."""

KEY_MAX: Final = 50_000
"""Maximum number of colons in JSON [count]."""

VALUE_MAX: Final = 2_500_000
"""Maximum number of commas in JSON [count]. The largest texture, with 4096 models of order 256, has 1.1 million
numbers."""


Json: TypeAlias = Any
"""A value of a JSON document: None, a bool, a number, a text, a list of values, or a dictionary of values by name."""


def parse_json(data: bytes | str, what: str) -> Json:
    """Parse untrusted JSON in UTF-8. Duplicate keys, NaN and Infinity are rejected.

    Args:
        data: the text; the caller has checked its length.
        what: kind of file for messages, such as "a swatch".

    Raises:
        FormatError: not valid JSON, or too many values.
    """
    for signs, most, kind in (("[{", CONTAINER_MAX, "lists"), (":", KEY_MAX, "keys"), (",", VALUE_MAX, "values")):
        found = sum(data.count(s.encode()) if isinstance(data, bytes) else data.count(s) for s in signs)
        if found > most:
            raise FormatError(f"not {what}: {found} {kind}, at most {most} are allowed")
    try:
        text = data.decode("utf-8-sig") if isinstance(data, bytes) else data
        return json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse)
    except json.JSONDecodeError as error:
        reason = f"{error.msg} in line {error.lineno}, column {error.colno}"
    except UnicodeDecodeError as error:
        reason = f"invalid UTF-8 at byte {error.start}"
    except (ValueError, RecursionError) as error:
        reason = str(error)
    raise FormatError(f"not {what}: {reason}")


def _unique(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    content = dict(pairs)
    if len(content) < len(pairs):
        seen: set[str] = set()
        double = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"duplicate key {double[:50]!r}")
    return content


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not allowed")


def parse_format(data: bytes | str, what: str, name: str, version: int) -> dict[str, Json]:
    """Parse a JSON object with format and version.

    Args:
        data: the text.
        what: kind of file for messages, such as "a swatch".
        name: required value of "format".
        version: latest supported version.

    Raises:
        FormatError: not JSON, another format, or a later version.
    """
    content = parse_json(data, what)
    if not isinstance(content, dict) or content.get("format") != name:
        raise FormatError(f'not {what}: expected a JSON object with "format": "{name}"')
    found = content.get("version")
    if type(found) is not int or found < 1:
        raise FormatError(f"version must be an integer from 1 to {version}, not {short(found)}")
    if found > version:
        raise FormatError(
            f"format version {short(found)} is later than {version}, the latest supported version: update hapscene"
        )
    return content


REASON_MAX: Final = 200
"""Longest reason in an error message [characters]."""

_T = TypeVar("_T")


def to_struct(content: Json, kind: type[_T]) -> _T:
    """Convert parsed JSON of a stranger to a msgspec type.

    Raises:
        FormatError: a key is unknown or invalid, or a value is missing, of another type or out of range.
    """
    import msgspec

    try:
        return msgspec.convert(content, kind)
    except (msgspec.ValidationError, UnicodeError) as error:  # half of a surrogate pair in a key
        raise FormatError(printable(str(error), REASON_MAX)) from None


def short(value: object) -> str:
    """Return a short representation of an untrusted value for a message."""
    value = value[:60] if isinstance(value, str) else value  # before escaping, which can increase the length tenfold
    text = repr(value) if isinstance(value, str | int | float | bool) or value is None else type(value).__name__
    return text if len(text) <= 60 else text[:57] + "…"
