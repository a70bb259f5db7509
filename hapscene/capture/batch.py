"""Fit a swatch to each of many recordings, on local processes or on a Dask cluster.

    result = fit_batch(find_recordings(["recordings/"]), "swatches", {"units": {"acceleration": "g"}})

Each swatch is written as soon as it is fitted and recorded in a journal in the same folder. A recording that was fitted
before is skipped if its content and the settings are unchanged, so running an interrupted batch again resumes it.
"""

import os
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

from hapscene.capture.fit.swatch import QUALITY, FitOptions, fit_swatch, verdict
from hapscene.capture.io.recording import InterpolatedWarning, load_recording
from hapscene.errors import CaptureError
from hapscene.io.files import Json, refusing
from hapscene.parallel import Journal, Task, TaskError, iterate_results
from hapscene.surface.swatch_file import save_swatch

__all__ = ["BatchResult", "find_recordings", "fit_batch"]

SUFFIXES: Final = (".csv", ".txt", ".wav", ".npz", ".mat", ".hsrec")
"""Suffixes of the recordings that are found in a folder; a file that is named directly may have any suffix."""

JOURNAL: Final = "journal.jsonl"
"""Name of the journal in the output folder."""


@dataclass
class BatchResult:
    """Result of a batch: the files of the swatches, the errors, and notes on the fitted recordings."""

    fitted: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of recordings that were fitted, skipped or failed."""
        return len(self.fitted) + len(self.skipped) + len(self.failed)


def find_recordings(places: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Lists the recordings in files and folders, each once.

    Args:
        places: files and folders. Folders are searched recursively, in alphabetical order.

    Raises:
        CaptureError: a file or folder does not exist, or a folder contains no recordings.
    """
    found: dict[Path, Path] = {}
    for place in map(Path, places):
        files = [place]
        if not place.exists():
            raise CaptureError(f"{place}: file or folder not found")
        if place.is_dir():
            files = sorted(f for f in place.rglob("*") if f.suffix.lower() in SUFFIXES and f.is_file())
            files = [f for f in files if not any(part.startswith(".") for part in f.relative_to(place).parts)]
            if not files:
                raise CaptureError(f"{place}: no recordings found; expected files that end in {' '.join(SUFFIXES)}")
        for file in files:
            found.setdefault(file.absolute(), file)
    return list(found.values())


def swatch_names(recordings: Sequence[Path]) -> list[str]:
    """File of each swatch, relative to the output folder.

    The path is that of the recording below the common folder of all recordings. If two recordings differ only in their
    suffix, the suffix becomes part of the name: oak.csv.swatch and oak.wav.swatch.
    """
    paths = [path.absolute() for path in recordings]
    shared = Path(os.path.commonpath([path.parent for path in paths]))
    whole = [path.relative_to(shared).as_posix() for path in paths]
    bare = [path.relative_to(shared).with_suffix("").as_posix() for path in paths]
    count = Counter(name.casefold() for name in bare)
    return [(b if count[b.casefold()] == 1 else w) + ".swatch" for b, w in zip(bare, whole, strict=True)]


def fit_batch(
    recordings: Sequence[Path],
    out: str | os.PathLike[str],
    reading: Mapping[str, Json] | None = None,
    options: FitOptions | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    after: Callable[[BatchResult], None] = lambda result: None,
) -> BatchResult:
    """Fits a swatch to each recording.

    Args:
        recordings: the files.
        out: output folder for the swatches and the journal; it is created if it does not exist.
        reading: arguments of `load_recording` for all recordings.
        options: options of the fit; the name is replaced by that of the file without its suffix.
        jobs: number of processes on this machine; None for one per core.
        scheduler: address of a Dask scheduler, for example tcp://host:8786. The workers of the cluster then run the
            fits; they must see the same file paths.
        after: called after each recording.

    Raises:
        CaptureError: the folder cannot be created, or it contains a swatch of the same name for another recording.
        HapsceneError: the cluster does not respond.
    """
    folder = Path(out).absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CaptureError(f"{folder}: the folder cannot be created: {error.strerror}") from None
    journal, result, tasks = Journal(folder / JOURNAL), BatchResult(), []
    latest = {recording: digest for recording, digest in journal.results}  # the latest entry counts
    owners = {name: recording for (recording, _), name in journal.results.items() if name}
    for path, name in zip(recordings, swatch_names(recordings), strict=True):
        task = _task(path.absolute(), folder / name, reading or {}, options or FitOptions())
        if owners.setdefault(name, task.key) != task.key:
            raise CaptureError(
                f"{folder / name}: exists already and was fitted to {owners[name]}, not to {task.key}: choose another "
                "output folder"
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


def _task(path: Path, output: Path, reading: Mapping[str, Json], options: FitOptions) -> Task:
    """The task that fits one recording; its digest covers size and modification time of the file."""
    try:
        stat = path.stat()
        state = [stat.st_size, stat.st_mtime_ns]
    except OSError:
        state = []  # the task will raise the error
    output.parent.mkdir(parents=True, exist_ok=True)
    options = replace(options, name=path.stem)
    arguments = {"path": str(path), "output": str(output), "reading": reading, "options": asdict(options)}
    return Task(str(path), fit_file, arguments | {"state": state})


def fit_file(
    path: str, output: str, reading: Mapping[str, Json], options: Mapping[str, Json], state: Sequence[int]
) -> list[str]:
    """Fits a swatch to the recording at `path`, writes it, and returns notes on the recording.

    `state`, size and modification time of the file, is only part of the task's digest.

    Raises:
        HapsceneError: the recording cannot be read or fitted, or the swatch cannot be written.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InterpolatedWarning)
        recording = load_recording(path, **reading)
    with refusing(CaptureError, path):
        swatch = fit_swatch(recording, FitOptions(**options))
    save_swatch(swatch, output)
    notes = [str(warning.message) for warning in caught if issubclass(warning.category, InterpolatedWarning)]
    return notes + ([verdict(swatch)] if QUALITY in swatch.absent else [])
