"""Where a batch is fitted: processes of this machine, or the workers of a Dask cluster.

Both give futures of `concurrent.futures`.
"""

import logging
import os
import warnings
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Final, Protocol

from hapscene.capture.batch_worker import Job, Outcome, begin_process, fit_job, version
from hapscene.errors import CaptureError

CONNECT_S: Final = 10.0
"""How long a scheduler, and then its first worker, may take to answer [s]."""


class Pool(Protocol):
    """What fits jobs."""

    sends_content: bool
    """whether jobs carry the recording's content, for processes that may not see its file"""

    def room(self) -> int:
        """How many jobs should be under way: some more than there are processes, so that none waits."""

    def submit(self, job: Job) -> "Future[Outcome]":
        """Fits a job; never raises because a process died, the future does."""

    def died(self, error: BaseException) -> bool:
        """Whether the error says that all jobs under way were lost because one process died; then the pool is anew."""

    def reason(self, error: BaseException) -> str:
        """Why a job was given up, in words.

        Raises:
            CaptureError: not the job but the whole pool was lost.
        """

    def close(self, at_once: bool) -> None:
        """Ends the processes, or lets go of the cluster; `at_once`: without waiting for what is under way."""


class ProcessPool:
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

    def submit(self, job: Job) -> "Future[Outcome]":
        try:
            return self._executor.submit(fit_job, job)
        except BrokenProcessPool as error:
            failed: Future[Outcome] = Future()
            failed.set_exception(error)
            return failed

    def died(self, error: BaseException) -> bool:
        if not isinstance(error, BrokenProcessPool):
            return False
        self.close(at_once=True)
        self._executor = self._begun()
        return True

    def reason(self, error: BaseException) -> str:
        return f"{type(error).__name__}: {error}"

    def close(self, at_once: bool) -> None:
        import multiprocessing

        if at_once:
            for process in set(multiprocessing.active_children()) - self._before:
                process.kill()
        self._executor.shutdown(wait=True, cancel_futures=True)


class ClusterPool:
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

    def submit(self, job: Job) -> "Future[Outcome]":
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # a recording is as large as it is
            future: Future[Outcome] = self._executor.submit(fit_job, job)
        return future

    def died(self, error: BaseException) -> bool:
        return False

    def reason(self, error: BaseException) -> str:
        if type(error).__name__ == "KilledWorker":
            return "every worker that fitted it died: killed, or out of memory"
        if self._client.status != "running" or type(error).__name__ in ("CancelledError", "FutureCancelledError"):
            raise self._lost()
        return f"{type(error).__name__}: {error}"

    def close(self, at_once: bool) -> None:
        self._executor.shutdown(wait=not at_once)
        self._client.close()

    def _lost(self) -> CaptureError:
        return CaptureError(f"{self._scheduler}: the scheduler was lost; run the same again to go on")
