"""Independent tasks on local processes, or with the same call on the workers of a Dask cluster, through joblib or Dask.

    results = run_tasks(tasks, journal=out / "tasks.jsonl", scheduler="tcp://host:8786")

The journal keeps each result as soon as it is known, one JSON line a task. A run that was interrupted or killed is
continued by running the same tasks again.
"""

import hashlib
import importlib
import json
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hapscene import __version__
from hapscene.errors import HapsceneError
from hapscene.io.files import Json

__all__ = ["Journal", "Task", "TaskError", "begin_process", "iterate_results", "run_tasks"]

CONNECT_S: Final = 10.0
"""Longest time in which a scheduler, and then its first worker, must answer [s]."""

WORKER_DIED: Final = "its worker process died, again: killed, or out of memory"


@dataclass(frozen=True)
class Task:
    """One call of a function.

    Attributes:
        key: name of the task, unique within a run.
        function: a function in a module that the workers can import; its result must be serialisable to JSON.
        arguments: keyword arguments, serialisable to JSON.
    """

    key: str
    function: Callable[..., Json]
    arguments: Mapping[str, Json]

    def digest(self) -> str:
        """Return a hash of the function, the arguments and the version of hapscene."""
        name = f"{self.function.__module__}:{self.function.__qualname__}"
        text = json.dumps([name, self.arguments, __version__], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


class TaskError(HapsceneError):
    """Why a task has no result."""


class Journal:
    """Results of tasks in a file of JSON lines, appended one by one; without a path, nothing is kept."""

    def __init__(self, path: Path | None) -> None:
        """Read what an earlier run has noted; a line that was cut off is skipped."""
        self._path = path
        self._cut = False
        self.results: dict[tuple[str, str], Json] = {}
        if path is None or not path.exists():
            return
        text = path.read_text(encoding="utf-8", errors="replace")
        self._cut = not text.endswith("\n") and text != ""  # else the next line would be lost with it
        for line in text.splitlines():
            try:
                row = json.loads(line)
                self._note(str(row["key"]), str(row["digest"]), row["result"])
            except (ValueError, TypeError, LookupError, RecursionError):
                continue

    def _note(self, key: str, digest: str, result: Json) -> None:
        self.results.pop((key, digest), None)  # keeps the newest result last
        self.results[key, digest] = result

    def add(self, task: Task, result: Json) -> None:
        """Append a result."""
        self._note(task.key, task.digest(), result)
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(
                    "\n" * self._cut + json.dumps({"key": task.key, "digest": task.digest(), "result": result}) + "\n"
                )
            self._cut = False


def run_tasks(
    tasks: Sequence[Task],
    *,
    journal: Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    after: Callable[[int, int, str], None] = lambda done, count, key: None,
) -> dict[str, Json]:
    """The result of each task by its key.

    Args:
        tasks: the work.
        journal: file of results; a task that it holds already is skipped.
        jobs: number of processes on this machine; None for one per core, 1 to run all tasks in this process.
        scheduler: address of a Dask scheduler, as tcp://host:8786; its workers run the tasks instead.
        after: called when a task is done, with the number of tasks done, of all tasks, and the key.

    Raises:
        HapsceneError: a key that is not unique, a task that failed, or a cluster that does not answer.
        OSError: the journal cannot be written.
    """
    keys = [task.key for task in tasks]
    if len(set(keys)) < len(keys):
        raise HapsceneError(f"two tasks have the key {max(keys, key=keys.count)!r}: keys must be unique")
    notes = Journal(journal)
    results = {
        task.key: notes.results[known] for task in tasks if (known := (task.key, task.digest())) in notes.results
    }
    left = [task for task in tasks if task.key not in results]
    for task, result in iterate_results(left, jobs, scheduler):
        if isinstance(result, TaskError):
            raise HapsceneError(f"{task.key}: {result}")
        notes.add(task, result)
        results[task.key] = result
        after(len(results), len(tasks), task.key)
    return {key: results[key] for key in keys}


def iterate_results(
    tasks: Sequence[Task], jobs: int | None = None, scheduler: str | None = None
) -> Iterator[tuple[Task, Json]]:
    """Yield each task with its result, or with a `TaskError`, as soon as it ends. Arguments as in `run_tasks`."""
    if scheduler is not None and tasks:
        yield from _on_cluster(tasks, scheduler)
    elif jobs == 1 or len(tasks) < 2:
        yield from map(_call, tasks)
    else:
        yield from _in_processes(tasks, jobs or os.cpu_count() or 1)


def _call(task: Task) -> tuple[Task, Json]:
    """A task and its result, in whichever process."""
    try:
        return task, task.function(**task.arguments)
    except HapsceneError as error:
        return task, TaskError(str(error))
    except Exception as error:
        return task, TaskError(f"{type(error).__name__}: {error}")


def _parallel(tasks: Iterable[Task], **backend: object) -> Iterator[tuple[Task, Json]]:
    """Results of tasks by joblib, in the order in which they are done."""
    import joblib

    with joblib.parallel_config(**backend):
        parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1)
    yield from parallel(joblib.delayed(_call)(task) for task in tasks)


# Local processes.


def _in_processes(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, Json]]:
    """Results by processes of this machine.

    Where a process dies, all tasks under way are lost, whichever of them was the reason. So each is run again by
    itself, and the one with which a process dies again has an error.
    """
    loky = {"backend": "loky", "initializer": begin_process, "inner_max_num_threads": 1}
    left = {task.key: task for task in tasks}
    while left:
        try:
            for task, result in _parallel(list(left.values()), n_jobs=jobs, **loky):
                yield left.pop(task.key), result
        except BrokenProcessPool:
            under_way = list(left.values())[: 2 * jobs]  # joblib dispatches this many tasks at once
            for task in under_way:
                try:
                    ((_, result),) = _parallel([task], n_jobs=2, **loky)
                except BrokenProcessPool:
                    result = TaskError(WORKER_DIED)
                yield left.pop(task.key), result


def begin_process() -> None:
    """Prepare a worker process: Ctrl-C is left to the parent process, and without that it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if (parent := multiprocessing.parent_process()) is None:
        return

    def follow() -> None:
        alive = parent.is_alive if os.name == "nt" else lambda: os.getppid() == parent.pid  # joblib: no sentinel
        while alive():
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


# A Dask cluster. The Dask backend of joblib hangs when a worker dies; Dask itself restarts the task.


def _on_cluster(tasks: Sequence[Task], scheduler: str) -> Iterator[tuple[Task, Json]]:
    """Yield results from the workers of a Dask scheduler, which reassigns the tasks of a worker that dies.

    Raises:
        HapsceneError: the package distributed is missing; the scheduler or its workers do not answer.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise HapsceneError(
            "a cluster needs the package distributed, which is not installed: pip install 'hapscene[cluster]'"
        ) from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # repeats the errors below
    try:
        distributed.comm.resolve_address(scheduler)  # a client takes 20 s to give up an invalid address
        client = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        reason = " ".join(str(error).split()) or "no answer"
        raise HapsceneError(f"{scheduler}: no Dask scheduler found: {reason}; expected as in tcp://host:8786") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError:
            raise HapsceneError(f"{scheduler}: no worker answers: start one with: dask worker {scheduler}") from None
        futures = {client.get_executor(pure=False).submit(_call, task): task for task in tasks}
        for future in as_completed(futures):
            failure = CancelledError() if future.cancelled() else future.exception()
            if failure is None:
                yield future.result()
            elif type(failure).__name__ == "KilledWorker":
                yield futures[future], TaskError(WORKER_DIED)
            elif client.status != "running" or "Cancelled" in type(failure).__name__:
                raise HapsceneError(f"{scheduler}: connection lost: run the same again to continue")
            else:
                yield futures[future], TaskError(f"{type(failure).__name__}: {failure}")
