"""Thousands of recordings to swatches, in processes here or on a cluster: nothing lost, nothing fitted twice.

One process, this one, hands out recordings, writes each swatch whole under its name, and keeps the manifest. What
was done with the same content and settings is not done again, so a batch that was stopped, killed or partly failed
is gone on with by running it again.
"""

import hashlib
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from hapscene import __version__
from hapscene.capture.batch_input import Item, outputs
from hapscene.capture.batch_manifest import Entry, Manifest, digest
from hapscene.capture.batch_pool import ClusterPool, Pool, ProcessPool
from hapscene.capture.batch_worker import Job, Outcome, read_content
from hapscene.errors import CaptureError
from hapscene.output import write_whole

DEATHS_MAX: Final = 2
"""How often a process may die over a recording that it fits alone before that recording is given up [count]. Once may
be somebody else's doing: a kill, another program that took the memory."""

POLL_S: Final = 0.2
"""Longest time between two looks at whether the batch is to be stopped [s]."""


@dataclass
class Result:
    """How a batch ended."""

    fitted: list[Entry] = field(default_factory=list)
    skipped: list[Entry] = field(default_factory=list)
    """done by an earlier run"""
    failed: list[Entry] = field(default_factory=list)
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
    entry: Entry
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
    after: Callable[[Result, Entry], None] = lambda result, entry: None,
) -> Result:
    """Fits a swatch to each recording.

    Args:
        items: the recordings (`hapscene.capture.batch_input`).
        out: folder of the swatches and the manifest; made where it is missing.
        reading: arguments of `load_surface_recording` for all; an item's own come first.
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
    pool: Pool = ProcessPool(jobs) if scheduler is None else ClusterPool(scheduler)
    batch = _Batch(manifest, pool, dict(fitting or {}), stopped, after)
    at_once = True
    try:
        batch.run(tasks)
        at_once = False
    finally:
        pool.close(at_once)
        manifest.save()
    return batch.result


class _Batch:
    """The work under way."""

    def __init__(
        self,
        manifest: Manifest,
        pool: Pool,
        fitting: dict[str, Any],
        stopped: Callable[[], bool],
        after: Callable[[Result, Entry], None],
    ) -> None:
        self.result = Result()
        self._manifest = manifest
        self._pool = pool
        self._fitting = fitting
        self._stopped = stopped
        self._after = after
        self._under_way: dict[Future[Outcome], _Task] = {}
        self._suspects: deque[_Task] = deque()

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
                self._begin(task, self._job(task))
            return True
        room = self._pool.room()
        while len(self._under_way) < room:
            following = next(jobs, None)
            if following is None:
                return self._stopped()
            self._begin(*following)
        return True

    def _jobs(self, tasks: Sequence[_Task]) -> "Iterator[tuple[_Task, Job]]":
        """What is to be fitted, as it is asked for; what was done before or cannot be read is through at once."""
        for task in tasks:
            if self._stopped():
                return
            try:
                if task.entry.status == "ok":
                    sha256 = hashlib.sha256(read_content(task.item.path)).hexdigest()
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
        content = read_content(task.item.path) if self._pool.sends_content else None
        return Job(str(task.item.path), task.item.name, content, task.reading, self._fitting, __version__)

    def _begin(self, task: _Task, job: Job) -> None:
        self._under_way[self._pool.submit(job)] = task

    def _take(self, future: "Future[Outcome]") -> None:
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
