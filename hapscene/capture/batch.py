"""Fit a swatch to each of many recordings, on local processes or on a Dask cluster.

    result = fit_batch(find_recordings(["recordings/"]), "swatches", {"units": {"acceleration": "g"}})

Each swatch is written as soon as it is fitted, and noted in a journal beside it. What was fitted with the same content
and settings is skipped, so a batch that was interrupted is continued by running it again.
"""

import csv
import os
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from hapscene.capture.fit.swatch import FitOptions, fit_swatch
from hapscene.capture.io.recording import BridgedWarning, load_recording
from hapscene.errors import CaptureError, no_such
from hapscene.files import refusing
from hapscene.parallel import Journal, Task, TaskError, iterate_results
from hapscene.surface.swatch_file import save_swatch

__all__ = ["BatchResult", "Item", "find_recordings", "fit_batch", "read_list", "swatch_names"]

SUFFIXES: Final = (".csv", ".txt", ".wav", ".npz", ".mat", ".parquet", ".hsrec")
"""Suffixes of recordings in a folder; a file named by itself may have any."""

JOURNAL: Final = "journal.jsonl"
"""Name of the journal in the folder of the swatches."""

_LIST_COLUMNS: Final = ("recording", "name", "rate", "columns", "units")


@dataclass(frozen=True)
class Item:
    """A recording of a batch.

    Attributes:
        path: its file; of a published data set, its surface.
        name: of its swatch.
        reading: arguments of `load_recording`, which replace those of the batch.
    """

    path: Path
    name: str
    reading: Mapping[str, Any] = field(default_factory=dict)


@dataclass
class BatchResult:
    """How a batch ended: the swatches' files, the reasons of failures, and notes on recordings that were fitted."""

    fitted: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of recordings that are done."""
        return len(self.fitted) + len(self.skipped) + len(self.failed)


def find_recordings(places: Iterable[str | os.PathLike[str]]) -> list[Item]:
    """The recordings of files and folders, each once; those of a folder and of its folders are sorted by name.

    Args:
        places: files and folders.

    Raises:
        CaptureError: a place does not exist, or a folder has no recordings.
    """
    found: dict[Path, Item] = {}
    for place in map(Path, places):
        files = [place]
        if not place.exists():
            raise CaptureError(f"{place}: file or folder not found")
        if place.is_dir():
            files = sorted(f for f in place.rglob("*") if f.suffix.lower() in SUFFIXES and f.is_file())
            files = [f for f in files if not any(part.startswith(".") for part in f.relative_to(place).parts)]
            if not files:
                raise CaptureError(f"{place}: a folder without recordings ({' '.join(SUFFIXES)})")
        for file in files:
            found.setdefault(file.absolute(), Item(file, file.stem))
    return list(found.values())


def read_list(path: str | os.PathLike[str]) -> list[Item]:
    """The recordings of a CSV list.

    It has a column `recording` (a path relative to the list) and, where wanted, `name`, `rate`, `columns` and `units`,
    which hold what the options of those names do; an empty cell has no effect.

    Raises:
        CaptureError: the list is missing, or has an unknown column or an invalid line.
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
        raise CaptureError(f"{file}: invalid CSV: {error}") from None
    if not items:
        raise CaptureError(f"{file}: a list without recordings")
    return list({item.path.absolute(): item for item in items}.values())


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
            raise CaptureError(f"{where}: rate must be a number of Hz, is {row['rate']!r}") from None
    for key in ("columns", "units"):
        if row.get(key):
            pairs = [pair.partition("=") for pair in row[key].split(",")]
            if not all(quantity and equals and value for quantity, equals, value in pairs):
                raise CaptureError(f"{where}: {key} holds pairs as in force=N,speed=mm/s, not {row[key]!r}")
            reading[key] = {quantity.strip(): value.strip() for quantity, _, value in pairs}
    return Item(path, row.get("name") or path.stem, reading)


def swatch_names(items: Sequence[Item]) -> list[str]:
    """The file of each swatch, relative to the batch's folder: as the recordings lie below the folder they share.

    Recordings that differ by their suffix only keep it, as in oak.csv.swatch and oak.wav.swatch.
    """
    paths = [item.path.absolute() for item in items]
    shared = Path(os.path.commonpath([path.parent for path in paths]))
    whole = [path.relative_to(shared).as_posix() for path in paths]
    bare = [path.relative_to(shared).with_suffix("").as_posix() for path in paths]
    count = Counter(name.casefold() for name in bare)
    return [(b if count[b.casefold()] == 1 else w) + ".swatch" for b, w in zip(bare, whole, strict=True)]


def fit_batch(
    items: Sequence[Item],
    out: str | os.PathLike[str],
    reading: Mapping[str, Any] | None = None,
    options: FitOptions | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    after: Callable[[BatchResult], None] = lambda result: None,
) -> BatchResult:
    """Fit a swatch to each recording.

    Args:
        items: the recordings.
        out: folder of the swatches and of the journal; made where it is missing.
        reading: arguments of `load_recording` for all; an item's own come first.
        options: of the fit; each swatch has its item's name.
        jobs: number of processes on this machine; None for one per core.
        scheduler: address of a Dask scheduler, as tcp://host:8786: its workers fit instead, and read and write the same
            paths.
        after: called when a recording is done.

    Raises:
        CaptureError: the folder cannot be made, or holds the swatch of another recording under the same name.
        HapsceneError: the cluster does not answer.
    """
    folder = Path(out).absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CaptureError(f"{folder}: cannot be made: {error.strerror}") from None
    journal, result, tasks = Journal(folder / JOURNAL), BatchResult(), []
    latest = {recording: digest for recording, digest in journal.results}  # an earlier fit's swatch is replaced
    owners = {name: recording for (recording, _), name in journal.results.items() if name}
    for item, name in zip(items, swatch_names(items), strict=True):
        task = _task(item, folder / name, reading or {}, options or FitOptions())
        if owners.setdefault(name, task.key) != task.key:
            raise CaptureError(
                f"{folder / name}: is the swatch of {owners[name]}, not of {task.key}: name another folder"
            )
        if latest.get(task.key) == task.digest() and (folder / name).is_file():
            result.skipped.append(name)
        else:
            tasks.append(task)
    for task, outcome in iterate_results(tasks, jobs, scheduler):
        if isinstance(outcome, TaskError):
            result.failed.append(str(outcome) if task.key in str(outcome) else f"{task.key}: {outcome}")
        else:
            name = Path(task.arguments["output"]).relative_to(folder).as_posix()
            journal.add(task, name)
            result.fitted.append(name)
            result.notes += [f"{task.key}: {note}" for note in outcome]
        after(result)
    return result


def _task(item: Item, output: Path, reading: Mapping[str, Any], options: FitOptions) -> Task:
    """The fit of one recording; its digest covers size and time of change of the file."""
    reading = {**reading, **item.reading}
    path = item.path.absolute()
    try:
        stat = path.stat()
        state = [stat.st_size, stat.st_mtime_ns]
    except OSError:
        state = []  # the task itself fails, with the reason
    output.parent.mkdir(parents=True, exist_ok=True)
    options = replace(options, name=item.name)
    arguments = {"path": str(path), "output": str(output), "reading": reading, "options": asdict(options)}
    return Task(str(path), fit_file, arguments | {"state": state})


def fit_file(
    path: str, output: str, reading: Mapping[str, Any], options: Mapping[str, Any], state: Sequence[int]
) -> list[str]:
    """Fit a swatch to the recording at `path` and write it; notes on the recording, such as bridged samples.

    `state` of the file is part of the task's identity only.

    Raises:
        HapsceneError: the recording cannot be read or fitted, or the swatch cannot be written.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", BridgedWarning)
        recording = load_recording(path, **reading)
    with refusing(CaptureError, path):
        swatch = fit_swatch(recording, FitOptions(**options))
    save_swatch(swatch, output)
    return [str(warning.message) for warning in caught if issubclass(warning.category, BridgedWarning)]
