"""Processes that work side by side: of this machine, or the workers of a Dask cluster, with the same calls.

Both give futures of `concurrent.futures`. What they call is a function of a module that the processes can import, with
arguments that can be sent. Imported first thing in every process: nothing heavy at the top.
"""

import logging
import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from typing import Any, Final, Protocol, TypeVar

from hapscene.errors import HapsceneError

T = TypeVar("T")


def version() -> str:
    """Of hapscene in the process that is asked."""
    from hapscene import __version__

    return __version__


def begin_process() -> None:
    """Prepares a process of this machine: one thread for mathematics, Ctrl-C left to the parent, no life without it."""
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
    """What does jobs."""

    shares_files: bool
    """whether its processes see the files of this one"""

    def room(self) -> int:
        """How many jobs should be under way: some more than there are processes, so that none waits."""

    def submit(self, function: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Has a process call a function; never raises because a process died, the future does."""

    def died(self, error: BaseException) -> bool:
        """Whether the error says that all jobs under way were lost because one process died; then the pool is anew."""
        return False

    def reason(self, error: BaseException) -> str:
        """Why a job was given up, in words.

        Raises:
            HapsceneError: not the job but the whole pool was lost.
        """
        return f"{type(error).__name__}: {error}"

    def close(self, at_once: bool) -> None:
        """Ends the processes, or lets go of the cluster; `at_once`: without waiting for what is under way."""


class ProcessPool(Pool):
    """Processes of this machine, started afresh (spawn)."""

    shares_files = True

    def __init__(self, jobs: int | None) -> None:
        """Begins.

        Args:
            jobs: how many processes; None for one a core.
        """
        self._jobs = jobs or os.cpu_count() or 1
        self._executor = self._begun()

    def _begun(self) -> ProcessPoolExecutor:
        self._before = set(multiprocessing.active_children())
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._jobs, spawn, initializer=begin_process)

    def room(self) -> int:
        return 2 * self._jobs

    def submit(self, function: Callable[..., T], *arguments: Any) -> "Future[T]":
        try:
            return self._executor.submit(function, *arguments)
        except BrokenProcessPool as error:
            failed: Future[T] = Future()
            failed.set_exception(error)
            return failed

    def died(self, error: BaseException) -> bool:
        if not isinstance(error, BrokenProcessPool):
            return False
        self.close(at_once=True)
        self._executor = self._begun()
        return True

    def close(self, at_once: bool) -> None:
        if at_once:
            for process in set(multiprocessing.active_children()) - self._before:
                process.kill()
        self._executor.shutdown(wait=True, cancel_futures=True)


class ClusterPool(Pool):
    """The workers of a Dask cluster, through its executor; what they need is sent, no shared folder is needed.

    Dask itself gives the jobs of a worker that died to others; what kills several workers, it gives up.
    """

    shares_files = False

    def __init__(self, scheduler: str, error: type[HapsceneError] = HapsceneError) -> None:
        """Connects.

        Args:
            scheduler: its address, as tcp://host:8786.
            error: what is raised.

        Raises:
            HapsceneError: no package `distributed`; no scheduler, no workers, or none that has hapscene.
        """
        try:
            distributed: Any = import_module("distributed")
        except ImportError:
            raise error(
                "a cluster needs the package distributed, which is not installed: pip install 'hapscene[cluster]'"
            ) from None
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # a lost scheduler is told once, by us
        self._scheduler, self._error = scheduler, error
        try:
            # a client that is never made tries for 20 s to close, and then prints why it could not
            import_module("distributed.comm").resolve_address(scheduler)
            self._client: Any = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as told:  # TimeoutError is an OSError
            reason = " ".join(str(told).split()) or "no answer"
            raise error(f"{scheduler}: no Dask scheduler reached: {reason}; expected as in tcp://host:8786") from None
        try:
            self._client.wait_for_workers(1, timeout=CONNECT_S)
            self._client.submit(version, pure=False).result(timeout=CONNECT_S)
        except TimeoutError:
            self._client.close()
            raise error(f"{scheduler}: no worker answers: start one with: dask worker {scheduler}") from None
        except ImportError as told:
            self._client.close()
            raise error(f"{scheduler}: its workers cannot import hapscene: install it there ({told})") from None
        self._executor = self._client.get_executor(pure=False)

    def room(self) -> int:
        try:
            return max(4, 2 * int(sum(self._client.nthreads().values())))
        except OSError:
            raise self._lost() from None

    def submit(self, function: Callable[..., T], *arguments: Any) -> "Future[T]":
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # a recording is as large as it is
            future: Future[T] = self._executor.submit(function, *arguments)
        return future

    def reason(self, error: BaseException) -> str:
        if type(error).__name__ == "KilledWorker":
            return "every worker that had it died: killed, or out of memory"
        if self._client.status != "running" or type(error).__name__ in ("CancelledError", "FutureCancelledError"):
            raise self._lost()
        return super().reason(error)

    def close(self, at_once: bool) -> None:
        self._executor.shutdown(wait=not at_once)
        self._client.close()

    def _lost(self) -> HapsceneError:
        return self._error(f"{self._scheduler}: the scheduler was lost; run the same again to go on")
