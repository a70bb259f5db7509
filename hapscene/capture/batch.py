"""Thousands of recordings to swatches, in processes here or on a cluster: nothing lost, nothing fitted twice.

One process, this one, hands out recordings, writes each swatch whole under its name, and keeps the manifest. What
was done with the same content and settings is not done again, so a batch that was stopped, killed or partly failed
is gone on with by running it again.
"""

import csv
import hashlib
import json
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Final, Literal

from hapscene import __version__
from hapscene.capture.batch_job import FitOutcome, Job, content_sha256, fit_job, read_content
from hapscene.errors import CaptureError, no_such
from hapscene.files import read_bytes, refusing, write_whole
from hapscene.worker_pool import ClusterPool, Pool, ProcessPool

# What a batch fits: recordings named one by one, all of a folder, or those of a list; and where each swatch goes.


SUFFIXES: Final = (".csv", ".txt", ".wav", ".npz", ".mat", ".parquet", ".hsrec")
"""What is taken for a recording in a folder; a file named by itself may have any."""

_LIST_COLUMNS: Final = ("recording", "name", "rate", "columns", "units")


@dataclass(frozen=True)
class Item:
    """A recording of a batch."""

    path: Path
    name: str
    """of its swatch"""
    reading: Mapping[str, Any] = field(default_factory=dict)
    """what `load_recording` is to be told about this one, over what the batch says of all"""


def gather(places: Iterable[str | os.PathLike[str]]) -> list[Item]:
    """Recordings of files and folders, those of a folder sorted by name, its folders included; each once.

    Args:
        places: files and folders.

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
    whole = [path.relative_to(shared).as_posix() for path in paths]
    bare = [path.relative_to(shared).with_suffix("").as_posix() for path in paths]
    count = Counter(name.casefold() for name in bare)
    return [(b if count[b.casefold()] == 1 else w) + ".swatch" for b, w in zip(bare, whole, strict=True)]


# The manifest of a batch: what became of each recording. It makes a batch one that can be stopped and gone on with.


NAME: Final = "manifest.json"
FORMAT: Final = "hapscene batch"
VERSION: Final = 1

BYTES_MAX: Final = 256 << 20
"""Largest manifest that is opened [bytes]: half a million recordings."""

SAVE_S: Final = 1.0
"""Shortest time between two savings [s]. What a killed batch forgets is fitted again, into the same files."""

SAVE_SHARE: Final = 0.05
"""Largest share of the time that may go into saving [1]: counts when there are 10,000 recordings and more."""


@dataclass
class ManifestEntry:
    """What became of a recording."""

    recording: str
    """absolute path"""
    output: str
    """the swatch's file, relative to the manifest"""
    status: Literal["waiting", "ok", "failed"] = "waiting"
    reason: str = ""
    """why it failed"""
    sha256: str = ""
    """of the recording's file when it was fitted"""
    settings: str = ""
    """digest of how it was read and fitted, and of hapscene's version"""
    output_sha256: str = ""
    duration_s: float = 0.0
    """how long the fit took"""


class Manifest:
    """The entries of a batch's folder, by recording."""

    def __init__(self, folder: Path) -> None:
        """Opens the folder's manifest, or begins one.

        Raises:
            CaptureError: a manifest that is damaged or of a later version.
        """
        self.folder = folder
        self.path = folder / NAME
        self.entries = {e.recording: e for e in _read(self.path)} if self.path.exists() else {}
        self._saved_s = -1e9
        self._cost_s = 0.0

    def add(self, recording: Path, output: str) -> ManifestEntry:
        """The entry of a recording, a new one where it had none or its swatch was to go elsewhere.

        Raises:
            CaptureError: the output is that of another recording.
        """
        key = str(recording.absolute())
        entry = self.entries.get(key)
        if entry is None or entry.output != output:
            entry = self.entries[key] = ManifestEntry(key, output)
        return entry

    def check_outputs(self) -> None:
        """No swatch may be that of two recordings: a batch would silently replace what another one made."""
        owner: dict[str, str] = {}
        for entry in self.entries.values():
            other = owner.setdefault(entry.output.casefold(), entry.recording)
            if other != entry.recording:
                raise CaptureError(
                    f"{self.folder / entry.output}: is the swatch of {other} and would be that of {entry.recording}: "
                    "take another folder"
                )

    def is_done(self, entry: ManifestEntry, sha256: str, settings: str) -> bool:
        """Whether that content was fitted in that way and its swatch is still there."""
        same = entry.status == "ok" and entry.sha256 == sha256 and entry.settings == settings
        return same and (self.folder / entry.output).is_file()

    def save(self, at_once: bool = True) -> None:
        """Writes the manifest whole; with `at_once` false only if it is time for it."""
        start_s = time.monotonic()
        if not at_once and start_s - self._saved_s < max(SAVE_S, self._cost_s / SAVE_SHARE):
            return
        rows = [asdict(entry) for entry in self.entries.values()]
        text = json.dumps({"format": FORMAT, "version": VERSION, "recordings": rows}, indent=1, ensure_ascii=False)
        # undecodable bytes of a file's name become escapes, which JSON knows
        write_whole(self.path, text.encode(errors="backslashreplace"), CaptureError)
        self._saved_s = time.monotonic()
        self._cost_s = self._saved_s - start_s


def digest(settings: Mapping[str, Any]) -> str:
    """Short text that differs where settings do."""
    text = json.dumps(settings, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _read(path: Path) -> list[ManifestEntry]:
    with refusing(CaptureError):
        data = read_bytes(path, BYTES_MAX, "manifest")
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CaptureError(f"{path}: not the manifest of a batch: take another folder")
    if content.get("version") != VERSION:
        raise CaptureError(f"{path}: a manifest of version {content.get('version')}, read here is {VERSION}")
    kinds = {f.name: float if f.name == "duration_s" else str for f in fields(ManifestEntry)}
    rows: Any = content.get("recordings")
    for row in rows if isinstance(rows, list) else [None]:
        if not isinstance(row, dict) or any(not isinstance(row.get(key), kind) for key, kind in kinds.items()):
            raise CaptureError(f"{path}: a damaged manifest: remove it, or take another folder")
    return [ManifestEntry(**{key: row[key] for key in kinds}) for row in rows]


DEATHS_MAX: Final = 2
"""How often a process may die over a recording that it fits alone before that recording is given up [count]. Once may
be somebody else's doing: a kill, another program that took the memory."""

POLL_S: Final = 0.2
"""Longest time between two looks at whether the batch is to be stopped [s]."""


@dataclass
class Result:
    """How a batch ended."""

    fitted: list[ManifestEntry] = field(default_factory=list)
    skipped: list[ManifestEntry] = field(default_factory=list)
    """done by an earlier run"""
    failed: list[ManifestEntry] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """what is to be said of recordings that were fitted, as missing samples that were bridged"""
    stopped: bool = False
    """ended by the user with recordings left"""

    @property
    def count(self) -> int:
        """Recordings that are through."""
        return len(self.fitted) + len(self.skipped) + len(self.failed)


@dataclass
class _Task:
    """A recording on its way through the batch."""

    item: Item
    entry: ManifestEntry
    reading: dict[str, Any]
    settings: str
    deaths: int = 0


def fit_batch(
    items: Sequence[Item],
    out: str | os.PathLike[str],
    reading: Mapping[str, Any] | None = None,
    fitting: Mapping[str, Any] | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    stopped: Callable[[], bool] = lambda: False,
    after: Callable[[Result, ManifestEntry], None] = lambda result, entry: None,
) -> Result:
    """Fits a swatch to each recording.

    Args:
        items: the recordings (`hapscene.capture.batch`).
        out: folder of the swatches and the manifest; made where it is missing.
        reading: arguments of `load_recording` for all; an item's own come first.
        fitting: arguments of `fit` besides the streams and the name, as {"order": 20}.
        jobs: processes of this machine; None: one per core.
        scheduler: address of a Dask scheduler, as "tcp://host:8786": its workers fit, instead of processes here.
        stopped: asked some times a second; once true, what is under way is finished and nothing more begun.
        after: called when a recording is through.

    Raises:
        CaptureError: two recordings of one swatch, a folder or manifest that cannot be used, a cluster that is lost.
    """
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CaptureError(f"{folder}: cannot be made: {error.strerror}") from None
    manifest = Manifest(folder)
    tasks = []
    for item, output in zip(items, outputs(items), strict=True):
        own = {**(reading or {}), **item.reading}
        settings = digest({"reading": own, "fitting": fitting, "name": item.name, "version": __version__})
        tasks.append(_Task(item, manifest.add(item.path, output), own, settings))
    manifest.check_outputs()
    manifest.save()
    pool: Pool = ProcessPool(jobs) if scheduler is None else ClusterPool(scheduler, CaptureError)
    batch = _Batch(manifest, pool, dict(fitting or {}), stopped, after)
    at_once = True
    try:
        batch.run(tasks)
        at_once = False
    finally:
        pool.close(at_once)
        manifest.save()
    return batch.result


@dataclass
class _Batch:
    """The work under way."""

    _manifest: Manifest
    _pool: Pool
    _fitting: dict[str, Any]
    _stopped: Callable[[], bool]
    _after: Callable[[Result, ManifestEntry], None]
    result: Result = field(default_factory=Result)
    _under_way: "dict[Future[FitOutcome], _Task]" = field(default_factory=dict)
    _suspects: deque[_Task] = field(default_factory=deque)

    def run(self, tasks: Sequence[_Task]) -> None:
        """All tasks, or until stopped."""
        jobs = self._jobs(tasks)
        more = True
        while more or self._suspects or self._under_way:
            if self._stopped():
                more = False
                self._suspects.clear()
                for future in [f for f in self._under_way if f.cancel()]:
                    del self._under_way[future]
            elif more or self._suspects:
                more = self._fill(jobs)
            done, _ = wait(self._under_way, timeout=POLL_S, return_when=FIRST_COMPLETED)
            for future in done:
                if future in self._under_way:  # not lost meanwhile with a process that died
                    self._take(future)
            self._manifest.save(at_once=False)
        self.result.stopped = self.result.count < len(tasks)

    def _fill(self, jobs: "Iterator[tuple[_Task, Job]]") -> bool:
        """Gives the pool what it has room for; suspects of killing a process one at a time. Whether more may come."""
        if self._suspects:
            if not self._under_way:
                task = self._suspects.popleft()
                self._under_way[self._pool.submit(fit_job, self._job(task))] = task
            return True
        room = self._pool.room()
        while len(self._under_way) < room:
            following = next(jobs, None)
            if following is None:
                return self._stopped()
            task, job = following
            self._under_way[self._pool.submit(fit_job, job)] = task
        return True

    def _jobs(self, tasks: Sequence[_Task]) -> "Iterator[tuple[_Task, Job]]":
        """What is to be fitted, as it is asked for; what was done before or cannot be read is through at once."""
        for task in tasks:
            if self._stopped():
                return
            try:
                if task.entry.status == "ok":
                    sha256 = content_sha256(task.item.path)
                    if self._manifest.is_done(task.entry, sha256, task.settings):
                        self.result.skipped.append(task.entry)
                        self._after(self.result, task.entry)
                        continue
                yield task, self._job(task)
            except OSError as error:
                self._fail(task, f"{task.item.path}: cannot be read: {error.strerror}")
            except CaptureError as error:
                self._fail(task, str(error))

    def _job(self, task: _Task) -> Job:
        content = read_content(task.item.path) if not self._pool.shares_files else None
        return Job(str(task.item.path), task.item.name, content, task.reading, self._fitting, __version__)

    def _take(self, future: "Future[FitOutcome]") -> None:
        """A job is through: its swatch is written, or why there is none noted."""
        error = CancelledError() if future.cancelled() else future.exception()
        if error is not None and self._pool.died(error):
            self._bereave()
            return
        task = self._under_way.pop(future)
        if error is not None:
            self._fail(task, f"{task.item.path}: {self._pool.reason(error)}")
            return
        outcome = future.result()
        task.entry.sha256, task.entry.duration_s = outcome.sha256, round(outcome.duration_s, 3)
        if outcome.swatch is None:
            self._fail(task, outcome.reason)
            return
        content = outcome.swatch.encode()
        place = self._manifest.folder / task.entry.output
        place.parent.mkdir(parents=True, exist_ok=True)
        write_whole(place, content, CaptureError)
        task.entry.output_sha256 = hashlib.sha256(content).hexdigest()
        task.entry.status, task.entry.reason, task.entry.settings = "ok", "", task.settings
        self.result.fitted.append(task.entry)
        if outcome.note:
            self.result.notes.append(f"{task.item.path}: {outcome.note}")
        self._after(self.result, task.entry)

    def _bereave(self) -> None:
        """A process died, and with it all jobs under way, whosever fault it was: they are done again, one by one."""
        lost = [self._under_way.pop(future) for future in list(self._under_way)]
        for task in lost:
            task.deaths += len(lost) == 1
            if task.deaths < DEATHS_MAX:
                self._suspects.append(task)
            else:
                self._fail(task, f"{task.item.path}: the process that fitted it died, again: killed, or out of memory")

    def _fail(self, task: _Task, reason: str) -> None:
        task.entry.status, task.entry.reason = "failed", reason
        self.result.failed.append(task.entry)
        self._after(self.result, task.entry)
