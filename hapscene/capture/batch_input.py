"""What a batch fits: recordings named one by one, all of a folder, or those of a list; and where each swatch goes."""

import csv
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from hapscene.errors import CaptureError, no_such

SUFFIXES: Final = (".csv", ".txt", ".wav", ".npz", ".mat", ".hsrec")
"""What is taken for a recording in a folder; a file named by itself may have any."""

_LIST_COLUMNS: Final = ("recording", "name", "rate", "columns", "units")


@dataclass(frozen=True)
class Item:
    """A recording of a batch."""

    path: Path
    name: str
    """of its swatch"""
    reading: Mapping[str, Any] = field(default_factory=dict)
    """what `load_surface_recording` is to be told about this one, over what the batch says of all"""


def gather(places: Iterable[str | os.PathLike[str]]) -> list[Item]:
    """Recordings of files and folders, those of a folder sorted by name, its folders included; each once.

    Raises:
        CaptureError: a place that is not there, or a folder without recordings.
    """
    found: dict[Path, Item] = {}
    for place in map(Path, places):
        files = [place]
        if place.is_dir():
            files = sorted(f for f in place.rglob("*") if f.suffix.lower() in SUFFIXES and f.is_file())
            files = [f for f in files if not any(part.startswith(".") for part in f.relative_to(place).parts)]
            if not files:
                raise CaptureError(f"{place}: a folder without recordings ({' '.join(SUFFIXES)})")
        elif not place.exists():
            raise CaptureError(f"{place}: no such file or folder")
        for file in files:
            found.setdefault(file.absolute(), Item(file, file.stem))
    return list(found.values())


def read_list(path: str | os.PathLike[str]) -> list[Item]:
    """Recordings of a CSV list: a column `recording` (relative to the list), and where wanted `name`, `rate`,
    `columns` and `units`, which hold what the options of those names do; empty cells say nothing.

    Raises:
        CaptureError: a list that is missing, has unknown columns, or a line that cannot be understood.
    """
    file = Path(path)
    try:
        with file.open(encoding="utf-8-sig", newline="") as f:
            reader = csv.DictReader(f, strict=True)
            names = list(reader.fieldnames or [])
            if "recording" not in names:
                raise CaptureError(f'{file}: must begin with a line of column names, "recording" among them')
            for name in names:
                if name not in _LIST_COLUMNS:
                    raise CaptureError(f"{file}: {no_such('column', name, _LIST_COLUMNS)}")
            items = [_item(file, reader.line_num, row) for row in reader]
    except OSError as error:
        raise CaptureError(f"{file}: cannot be read: {error.strerror}") from None
    except (csv.Error, UnicodeDecodeError) as error:
        raise CaptureError(f"{file}: not a CSV list: {error}") from None
    found = {item.path.absolute(): item for item in items}
    if not found:
        raise CaptureError(f"{file}: a list without recordings")
    return list(found.values())


def _item(file: Path, line: int, row: Mapping[str | None, Any]) -> Item:
    """A line of the list."""
    where = f"{file}: line {line}"
    if None in row or not row["recording"]:
        raise CaptureError(f"{where}: a recording and one cell a column expected")
    path = file.parent / row["recording"]
    reading: dict[str, Any] = {}
    if row.get("rate"):
        try:
            reading["rate_Hz"] = float(row["rate"])
        except ValueError:
            raise CaptureError(f"{where}: rate is a number of Hz, not {row['rate']!r}") from None
    for key in ("columns", "units"):
        if row.get(key):
            pairs = [pair.partition("=") for pair in row[key].split(",")]
            if not all(quantity and equals and value for quantity, equals, value in pairs):
                raise CaptureError(f"{where}: {key} holds pairs as in force=N,speed=mm/s, not {row[key]!r}")
            reading[key] = {quantity.strip(): value.strip() for quantity, _, value in pairs}
    return Item(path, row.get("name") or path.stem, reading)


def outputs(items: Sequence[Item]) -> list[str]:
    """Where each swatch goes, relative to the batch's folder: as the recordings lie below the folder they share.

    Recordings that differ by their suffix only keep it, as in oak.csv.swatch and oak.wav.swatch.
    """
    paths = [item.path.absolute() for item in items]
    shared = Path(os.path.commonpath([path.parent for path in paths]))
    places = [path.relative_to(shared) for path in paths]
    count = Counter(str(place.with_suffix("")).casefold() for place in places)
    return [
        (place.with_suffix("") if count[str(place.with_suffix("")).casefold()] == 1 else place).as_posix() + ".swatch"
        for place in places
    ]
