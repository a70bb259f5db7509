"""Handle files: an identified handle as JSON, with the suffix .handle.

Files from unknown sources are safe to open: reading executes no code and checks every type and number against the
annotations of `Identification`.
"""

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Final

import msgspec

from hapscene.errors import HandleError
from hapscene.handle.fit import Identification
from hapscene.io.files import parse_format, read_bytes, refusing, write_whole

__all__ = ["BYTES_MAX", "SUFFIX", "handle_from_json", "handle_to_json", "load_handle", "save_handle"]

SUFFIX: Final = ".handle"
FORMAT: Final = "hapscene handle"
VERSION: Final = 1
"""Version of the format. Increased when older versions of hapscene would misread a new file."""

BYTES_MAX: Final = 1 << 20
"""Size limit of a file [bytes]. A file with 20 grips has 15 kB."""


def save_handle(handle: Identification, path: str | os.PathLike[str]) -> None:
    """Write a handle to `path` (suffix .handle), atomically.

    Raises:
        HandleError: wrong suffix, values out of range, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix != SUFFIX:
        raise HandleError(f"{target}: the name of a handle file must end in {SUFFIX}")
    text = handle_to_json(handle)
    handle_from_json(text)  # write no file that cannot be read
    write_whole(target, text.encode(errors="backslashreplace"), HandleError)


def load_handle(path: str | os.PathLike[str]) -> Identification:
    """Read a handle file.

    Raises:
        HandleError: the file does not exist, is too large or damaged, has a later version, or is not a handle file.
    """
    file = Path(path)
    with refusing(HandleError):
        data = read_bytes(file, BYTES_MAX, "handle")
    with refusing(HandleError, file):
        return handle_from_json(data)


def handle_to_json(handle: Identification) -> str:
    """The content of a handle file. Numbers are written exactly."""
    content = {"format": FORMAT, "version": VERSION, **asdict(handle)}
    try:
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    except ValueError as error:
        raise HandleError(f"the numbers of a handle must be finite: {error}") from None


def handle_from_json(data: bytes | str) -> Identification:
    """Parse the content of a handle file.

    Raises:
        HandleError: not JSON, not a handle file, a later version, or a missing key, invalid type or number.
    """
    with refusing(HandleError):
        content = parse_format(data, "a handle", FORMAT, VERSION)
    try:
        return msgspec.convert(content, Identification)
    except msgspec.ValidationError as error:
        raise HandleError(f"invalid handle: {error}") from None
