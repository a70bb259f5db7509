"""A library of swatches: a folder of .swatch files with an index, beside the shipped ones, which are read-only.

The index is a JSON text, `index.json`: name, file, sha256, size, figures, provenance and licence of each swatch. A
library folder behind any web server is what `hapscene.surface.fetch` gets swatches from.
"""

import hashlib
import json
import os
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from importlib import resources
from itertools import chain, count
from pathlib import Path
from typing import Any, Final

from hapscene.errors import SwatchError, no_such
from hapscene.output import whole_file
from hapscene.surface.portrait import figures, words
from hapscene.surface.strict_json import parse
from hapscene.surface.swatch import NAME_MAX, Swatch
from hapscene.surface.swatch_file import (
    BYTES_MAX,
    SUFFIX,
    load_swatch,
    shipped_swatches,
    swatch_from_json,
    swatch_to_json,
)

INDEX: Final = "index.json"
FORMAT: Final = "hapscene library"
VERSION: Final = 1

INDEX_BYTES_MAX: Final = 8 * 1024 * 1024
"""Largest index that is read [bytes]: some ten thousand swatches."""

ENVIRONMENT: Final = "HAPSCENE_LIBRARY"
"""Environment variable that names the folder of the library."""

_FILE_NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9 ._()+-]{0,120}\.swatch")
_RESERVED: Final = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)\b.*", re.IGNORECASE)  # devices on Windows


@dataclass(frozen=True)
class Entry:
    """What an index says of one swatch."""

    name: str
    file: str
    sha256: str
    bytes: int
    provenance: str = ""
    licence: str = ""
    figures: dict[str, float] = field(default_factory=dict)

    @property
    def words(self) -> list[str]:
        """How it feels, in words."""
        return words(self.figures)


def library_folder(folder: str | os.PathLike[str] | None = None) -> Path:
    """The folder of the library: the one given, else that of `HAPSCENE_LIBRARY`, else the user's data folder."""
    if folder is not None:
        return Path(folder)
    if os.environ.get(ENVIRONMENT):
        return Path(os.environ[ENVIRONMENT])
    from platformdirs import user_data_path

    return user_data_path("hapscene", appauthor=False) / "swatches"


def shipped_entries() -> list[Entry]:
    """The swatches that come with hapscene."""
    folder = resources.files("hapscene_swatches")
    return [entry_of(load_swatch(name), (folder / (name + SUFFIX)).read_bytes()) for name in shipped_swatches()]


def own_entries(folder: str | os.PathLike[str] | None = None) -> list[Entry]:
    """The swatches of the library, by name; none where there is no library yet.

    Raises:
        SwatchError: the index is damaged.
    """
    path = library_folder(folder) / INDEX
    if not path.is_file():
        return []
    try:
        with path.open("rb") as f:
            data = f.read(INDEX_BYTES_MAX + 1)
    except OSError as error:
        raise SwatchError(f"{path}: cannot be read: {error.strerror or error}") from None
    return parse_index(data, str(path))


def find(name: str, folder: str | os.PathLike[str] | None = None) -> Path | None:
    """The file of the library's swatch of that name, or None."""
    home = library_folder(folder)
    for entry in own_entries(home):
        if entry.name == name:
            return home / entry.file
    return None


def add(swatch: Swatch, folder: str | os.PathLike[str] | None = None, replace: bool = False) -> Entry:
    """Puts a swatch into the library, under its own name.

    Raises:
        SwatchError: the name is a shipped one's, or taken and not to be replaced; the folder cannot be written.
    """
    home = library_folder(folder)
    if swatch.name in shipped_swatches():
        raise SwatchError(f"{swatch.name!r} is a shipped swatch: add it under another name (--name)")
    if "/" in swatch.name or "\\" in swatch.name or swatch.name.endswith(SUFFIX):
        raise SwatchError(f"{swatch.name!r} reads like a file: add it under another name (--name)")
    entries = {entry.name: entry for entry in own_entries(home)}
    if swatch.name in entries and not replace:
        raise SwatchError(f"{swatch.name!r} is in the library already: replace it (--replace) or name it (--name)")
    text = swatch_to_json(swatch).encode("utf-8")
    taken = {entry.file.casefold() for entry in entries.values()} | {f.name.casefold() for f in home.glob("*")}
    old = entries.get(swatch.name)
    entry = entry_of(swatch, text, taken - ({old.file.casefold()} if old else set()))
    try:
        home.mkdir(parents=True, exist_ok=True)
        with whole_file(home / entry.file) as part:
            part.write_bytes(text)
    except OSError as error:
        raise SwatchError(f"{home / entry.file}: cannot be written: {error.strerror or error}") from None
    if old is not None and old.file != entry.file:
        (home / old.file).unlink(missing_ok=True)
    write_index(home, (entries | {entry.name: entry}).values())
    return entry


def remove(name: str, folder: str | os.PathLike[str] | None = None) -> Path:
    """Takes a swatch out of the library, its file too; the file that is gone.

    Raises:
        SwatchError: no such swatch in the library, or it cannot be removed.
    """
    home = library_folder(folder)
    entries = own_entries(home)
    gone = next((entry for entry in entries if entry.name == name), None)
    if gone is None:
        if name in shipped_swatches():
            raise SwatchError(f"{name!r} is a shipped swatch: it stays")
        raise SwatchError(no_such("swatch", name, (entry.name for entry in entries)) + f" in {home}")
    write_index(home, (entry for entry in entries if entry.name != name))
    try:
        (home / gone.file).unlink(missing_ok=True)
    except OSError as error:
        raise SwatchError(f"{home / gone.file}: cannot be removed: {error.strerror or error}") from None
    return home / gone.file


def write_index(folder: Path, entries: Iterable[Entry]) -> None:
    """Writes a library's index, whole or not at all."""
    rows = [asdict(entry) for entry in sorted(entries, key=lambda entry: entry.name)]
    text = json.dumps({"format": FORMAT, "version": VERSION, "swatches": rows}, indent=1, ensure_ascii=False)
    try:
        with whole_file(folder / INDEX) as part:
            part.write_text(text + "\n", encoding="utf-8", newline="\n")
    except OSError as error:
        raise SwatchError(f"{folder / INDEX}: cannot be written: {error.strerror or error}") from None


def entry_of(swatch: Swatch, data: bytes, taken: Iterable[str] = ()) -> Entry:
    """The index's entry of a swatch whose file holds `data`, with a file name that is not among `taken`."""
    stem = re.sub(r"[^A-Za-z0-9_+-]+", "_", swatch.name).strip("_+-")[:80] or "swatch"
    stem = f"_{stem}" if _RESERVED.fullmatch(stem) else stem
    names = (stem + tail + SUFFIX for tail in chain(("",), (f"_{i}" for i in count(2))))
    held = set(taken)
    file = next(name for name in names if name.casefold() not in held)
    digest = hashlib.sha256(data).hexdigest()
    return Entry(swatch.name, file, digest, len(data), swatch.provenance, swatch.licence, figures(swatch))


def verified(entry: Entry, data: bytes, where: str) -> Swatch:
    """The swatch of a file's content, which must be what the entry says.

    Raises:
        SwatchError: another content, another name, or no valid swatch.
    """
    if hashlib.sha256(data).hexdigest() != entry.sha256:
        raise SwatchError(f"{where}: its content is not what the index says (sha256): not opened")
    try:
        swatch = swatch_from_json(data)
    except SwatchError as error:
        raise SwatchError(f"{where}: {error}") from None
    if swatch.name != entry.name:
        raise SwatchError(f"{where}: calls itself {swatch.name!r}, the index says {entry.name!r}: not taken")
    return swatch


def parse_index(data: bytes, where: str) -> list[Entry]:
    """The entries of an index from anybody; nothing in it can name a file outside of its folder.

    Raises:
        SwatchError: not an index, of a later version, or an entry that is wrong.
    """
    if len(data) > INDEX_BYTES_MAX:
        raise SwatchError(f"{where}: larger than {INDEX_BYTES_MAX >> 20} MiB, which no index is")
    try:
        content = parse(data, "an index of swatches")
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise SwatchError(f'not an index of swatches: expected a JSON object with "format": "{FORMAT}"')
        if content.get("version") != VERSION:
            raise SwatchError(f"the index's version must be {VERSION}: is hapscene up to date?")
        rows = content.get("swatches")
        if not isinstance(rows, list):
            raise SwatchError('"swatches" must be a list')
        entries = [_entry(row, f"swatches[{i}]") for i, row in enumerate(rows)]
        for key in ("name", "file"):
            values = [getattr(entry, key).casefold() if key == "file" else getattr(entry, key) for entry in entries]
            if len(set(values)) < len(values):
                raise SwatchError(f"two swatches have one {key}")
    except SwatchError as error:
        raise SwatchError(f"{where}: {error}") from None
    return entries


def _entry(row: Any, place: str) -> Entry:
    """One entry, checked."""
    if not isinstance(row, dict):
        raise SwatchError(f"{place} must be an object")
    texts = {key: row.get(key, "") for key in ("name", "file", "sha256", "provenance", "licence")}
    for key, value in texts.items():
        if not isinstance(value, str) or any("\ud800" <= c <= "\udfff" for c in value):
            raise SwatchError(f"{place}.{key} must be a text")
    if not 1 <= len(texts["name"]) <= NAME_MAX or not texts["name"].isprintable():
        raise SwatchError(f"{place}.name must be 1 to {NAME_MAX} printable characters")
    if not _FILE_NAME.fullmatch(texts["file"]) or _RESERVED.fullmatch(texts["file"]):
        raise SwatchError(f"{place}.file must be a plain file name ending in {SUFFIX}, is {texts['file'][:60]!r}")
    if not re.fullmatch(r"[0-9a-f]{64}", texts["sha256"]):
        raise SwatchError(f"{place}.sha256 must be 64 hexadecimal digits")
    size = row.get("bytes")
    if type(size) is not int or not 0 < size <= BYTES_MAX:
        raise SwatchError(f"{place}.bytes must be a whole number from 1 to {BYTES_MAX}")
    numbers = row.get("figures", {})
    if not isinstance(numbers, dict) or not all(
        type(v) in (int, float) and -1e300 < v < 1e300 for v in numbers.values()
    ):
        raise SwatchError(f"{place}.figures must be an object of numbers")
    return Entry(**texts, bytes=size, figures={key: float(value) for key, value in numbers.items()})
