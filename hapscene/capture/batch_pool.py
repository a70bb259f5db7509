"""Where a batch is fitted, imported by its workers alone: processes of this machine, or of a Dask cluster.

Both give futures of `concurrent.futures`.
"""

import logging
import os
import threading
import time
import warnings
from collections.abc import Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from hapscene.errors import CaptureError, HapsceneError
from hapscene.files import read_bytes, refusing

# What a process of a batch does: it fits one recording and gives back the text of the swatch's file.
#
# It writes nothing: the process that runs the batch does, so that a fit that is done twice, because a process died, is
# written once. Imported first thing in every process: nothing heavy at the top.


@dataclass(frozen=True)
class Job:
    """A recording to be fitted."""

    path: str
    name: str
    content: bytes | None
    """of the file; None: the process can read the file itself"""
    reading: Mapping[str, Any]
    """arguments of `load_recording`"""
    fitting: Mapping[str, Any]
    """arguments of `fit_parts` besides the recording and the name"""
    version: str
    """of the hapscene that runs the batch"""


@dataclass(frozen=True)
class FitOutcome:
    """What came of it: the text of a swatch, or why there is none."""

    sha256: str
    swatch: str | None
    reason: str
    duration_s: float
    note: str = ""
    """what is to be said of a recording that was fitted"""


def fit_job(job: Job) -> FitOutcome:
    """Fits a recording; what is wrong with it is told in the outcome, not raised."""
    import tempfile

    start_s = time.monotonic()
    sha256 = ""
    try:
        with tempfile.TemporaryDirectory(prefix="hapscene") as folder:
            copy = Path(folder) / f"recording{Path(job.path).suffix}"
            sha256 = _copied(job, copy)
            swatch, note = _swatch(job, copy)
        return FitOutcome(sha256, swatch, "", time.monotonic() - start_s, note)
    except HapsceneError as error:
        reason = str(error)
    except OSError as error:
        reason = f"{job.path}: cannot be read: {error.strerror or error}"
    except MemoryError:
        reason = f"{job.path}: not enough memory"
    except Exception as error:  # one odd recording must not end a batch of thousands
        reason = f"{job.path}: cannot be fitted, by a fault of ours or a damaged file ({type(error).__name__}: {error})"
    return FitOutcome(sha256, None, " ".join(reason.split()), time.monotonic() - start_s)


def _copied(job: Job, copy: Path) -> str:
    """Write the recording's content, as it is now, into a file of our own; its SHA-256."""
    import hashlib

    content = read_content(Path(job.path)) if job.content is None else job.content
    copy.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def _swatch(job: Job, copy: Path) -> tuple[str, str]:
    """The text of the swatch's file, and what is to be said of it.

    Of a copy: the recording may change meanwhile, or be on another machine.
    """
    from hapscene import __version__
    from hapscene.capture.recording_file import bridged_note, read_surface_recording
    from hapscene.capture.swatch_fit import fit_parts, prepare
    from hapscene.surface.swatch_file import swatch_to_json

    if job.version != __version__:
        raise CaptureError(f"{job.path}: the process has hapscene {__version__}, the batch {job.version}: update one")
    try:
        recording = read_surface_recording(copy, **job.reading)
    except CaptureError as error:
        raise CaptureError(str(error).replace(str(copy), job.path)) from None
    with refusing(CaptureError, job.path):
        swatch = fit_parts([prepare(recording)], job.name, **job.fitting)
    return swatch_to_json(swatch), bridged_note(recording)


def read_content(path: Path) -> bytes:
    """The whole file, if it is not larger than a recording may be.

    Raises:
        CaptureError: larger.
    """
    from hapscene.capture.recording_source import BYTES_MAX

    with refusing(CaptureError):
        if path.is_file():
            return read_bytes(path, BYTES_MAX, "recording")
        with path.open("rb") as pipe:
            return pipe.read(BYTES_MAX + 1)  # one too many is refused when it is read


def version() -> str:
    """Of hapscene in the process that is asked."""
    from hapscene import __version__

    return __version__


def begin_process() -> None:
    """Prepares a process of this machine: one thread for mathematics, Ctrl-C left to the parent, no life without it."""
    import multiprocessing
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"  # the processes share the cores already
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def follow() -> None:
        parent.join()
        os._exit(1)  # a killed parent cannot end its processes: without this they would wait for ever

    threading.Thread(target=follow, daemon=True).start()


CONNECT_S: Final = 10.0
"""How long a scheduler, and then its first worker, may take to answer [s]."""


class Pool(Protocol):
    """What fits jobs."""

    sends_content: bool
    """whether jobs carry the recording's content, for processes that may not see its file"""

    def room(self) -> int:
        """How many jobs should be under way: some more than there are processes, so that none waits."""

    def submit(self, job: Job) -> "Future[FitOutcome]":
        """Fits a job; never raises because a process died, the future does."""

    def died(self, error: BaseException) -> bool:
        """Whether the error says that all jobs under way were lost because one process died; then the pool is anew."""
        return False

    def reason(self, error: BaseException) -> str:
        """Why a job was given up, in words.

        Raises:
            CaptureError: not the job but the whole pool was lost.
        """
        return f"{type(error).__name__}: {error}"

    def close(self, at_once: bool) -> None:
        """Ends the processes, or lets go of the cluster; `at_once`: without waiting for what is under way."""


class ProcessPool(Pool):
    """Processes of this machine, started afresh (spawn)."""

    sends_content = False

    def __init__(self, jobs: int | None) -> None:
        self._jobs = jobs or os.cpu_count() or 1
        self._executor = self._begun()

    def _begun(self) -> ProcessPoolExecutor:
        import multiprocessing

        self._before = set(multiprocessing.active_children())
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._jobs, spawn, initializer=begin_process)

    def room(self) -> int:
        return 2 * self._jobs

    def submit(self, job: Job) -> "Future[FitOutcome]":
        try:
            return self._executor.submit(fit_job, job)
        except BrokenProcessPool as error:
            failed: Future[FitOutcome] = Future()
            failed.set_exception(error)
            return failed

    def died(self, error: BaseException) -> bool:
        if not isinstance(error, BrokenProcessPool):
            return False
        self.close(at_once=True)
        self._executor = self._begun()
        return True

    def close(self, at_once: bool) -> None:
        import multiprocessing

        if at_once:
            for process in set(multiprocessing.active_children()) - self._before:
                process.kill()
        self._executor.shutdown(wait=True, cancel_futures=True)


class ClusterPool(Pool):
    """The workers of a Dask cluster, through its executor; recordings are sent, no shared folder is needed.

    Dask itself gives the jobs of a worker that died to others; what kills several workers, it gives up.
    """

    sends_content = True

    def __init__(self, scheduler: str) -> None:
        """Connects.

        Raises:
            CaptureError: no package `distributed`; no scheduler, no workers, or none that has hapscene.
        """
        from importlib import import_module

        try:
            distributed: Any = import_module("distributed")
        except ImportError:
            raise CaptureError(
                "a cluster needs the package distributed, which is not installed: pip install 'hapscene[cluster]'"
            ) from None
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # a lost scheduler is told once, by us
        self._scheduler = scheduler
        try:
            self._client: Any = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            reason = " ".join(str(error).split()) or "no answer"
            raise CaptureError(
                f"{scheduler}: no Dask scheduler reached: {reason}; expected as in tcp://host:8786"
            ) from None
        try:
            self._client.wait_for_workers(1, timeout=CONNECT_S)
            self._client.submit(version, pure=False).result(timeout=CONNECT_S)
        except TimeoutError:
            self._client.close()
            raise CaptureError(f"{scheduler}: no worker answers: start one with: dask worker {scheduler}") from None
        except ImportError as error:
            self._client.close()
            raise CaptureError(f"{scheduler}: its workers cannot import hapscene: install it there ({error})") from None
        self._executor = self._client.get_executor(pure=False)

    def room(self) -> int:
        try:
            return max(4, 2 * int(sum(self._client.nthreads().values())))
        except OSError:
            raise self._lost() from None

    def submit(self, job: Job) -> "Future[FitOutcome]":
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # a recording is as large as it is
            future: Future[FitOutcome] = self._executor.submit(fit_job, job)
        return future

    def reason(self, error: BaseException) -> str:
        if type(error).__name__ == "KilledWorker":
            return "every worker that fitted it died: killed, or out of memory"
        if self._client.status != "running" or type(error).__name__ in ("CancelledError", "FutureCancelledError"):
            raise self._lost()
        return super().reason(error)

    def close(self, at_once: bool) -> None:
        self._executor.shutdown(wait=not at_once)
        self._client.close()

    def _lost(self) -> CaptureError:
        return CaptureError(f"{self._scheduler}: the scheduler was lost; run the same again to go on")
