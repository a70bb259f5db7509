"""A sweep: many independent pieces of work, done in processes here or on a Dask cluster, and gone on with when stopped.

    results = sweep(pieces, journal=out / "sweep.jsonl", scheduler=None)

The same line does both. What is done is noted at once in the journal, a line a piece, so a sweep that was stopped or
killed goes on where it was when the same is run again. Pieces that are timed are done alone, here, after the others.
"""

import hashlib
import importlib
import json
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hapscene import __version__
from hapscene.errors import HapsceneError
from hapscene.worker_pool import ClusterPool, Pool, ProcessPool

DEATHS_MAX: Final = 2
"""Processes that a piece may take with it, done by itself, before it is given up [count]."""


@dataclass(frozen=True)
class Piece:
    """A piece of work.

    Attributes:
        key: its name, one of its own in the sweep.
        function: what does it, as "package.module:name"; gives what JSON can hold.
        arguments: of it, which JSON can hold.
        alone: done in this process with nothing beside it, because it is timed.
    """

    key: str
    function: str
    arguments: Mapping[str, Any]
    alone: bool = False

    def digest(self) -> str:
        """What tells this piece from others: another function, argument or version is done anew."""
        told = json.dumps([self.function, self.arguments, __version__], sort_keys=True)
        return hashlib.sha256(told.encode()).hexdigest()[:16]


def call(function: str, arguments: Mapping[str, Any]) -> Any:
    """The result of a piece, in whichever process."""
    module, _, name = function.partition(":")
    return getattr(importlib.import_module(module), name)(**arguments)


def sweep(
    pieces: Sequence[Piece],
    *,
    journal: Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    after: Callable[[int, int, str], None] = lambda done, count, key: None,
) -> dict[str, Any]:
    """The result of each piece by its key.

    Args:
        pieces: the work.
        journal: where what is done is noted, and read when the same is run again; None to keep nothing.
        jobs: processes of this machine; None for one a core, 1 to do all in this one.
        scheduler: of a Dask cluster in their place, as tcp://host:8786.
        after: called when a piece is through, with how many are, of how many, and its key.

    Raises:
        HapsceneError: two pieces of one key; a cluster that is not reached or lost; a piece whose process died twice.
        OSError: the journal cannot be written.
    """
    keys = [piece.key for piece in pieces]
    if len(set(keys)) < len(keys):
        raise HapsceneError(f"two pieces of a sweep are called {max(keys, key=keys.count)!r}")
    known = {} if journal is None else _read(journal)
    results: dict[str, Any] = {}
    with ExitStack() as stack:
        file = None if journal is None else stack.enter_context(journal.open("a", encoding="utf-8"))

        def take(piece: Piece, result: Any) -> None:
            results[piece.key] = result
            if file is not None:
                file.write(json.dumps({"key": piece.key, "digest": piece.digest(), "result": result}) + "\n")
                file.flush()
            after(len(results), len(pieces), piece.key)

        left = []
        for piece in pieces:
            if (piece.key, piece.digest()) in known:
                results[piece.key] = known[piece.key, piece.digest()]
            else:
                left.append(piece)
        beside = [piece for piece in left if not piece.alone]
        if scheduler is None and (jobs == 1 or len(beside) < 2):
            left, beside = beside + [piece for piece in left if piece.alone], []
        if beside:
            pool: Pool = ProcessPool(jobs) if scheduler is None else ClusterPool(scheduler)
            at_once = True
            try:
                _side_by_side(beside, pool, take)
                at_once = False
            finally:
                pool.close(at_once)
            left = [piece for piece in left if piece.alone]
        for piece in left:
            take(piece, call(piece.function, piece.arguments))
    return {key: results[key] for key in keys}


def _side_by_side(pieces: Sequence[Piece], pool: Pool, take: Callable[[Piece, Any], None]) -> None:
    """Have a pool do pieces; those that a process died with are done again, one at a time."""
    waiting, suspects = deque(pieces), deque[Piece]()
    under_way: dict[Future[Any], Piece] = {}
    deaths = Counter[str]()
    while waiting or suspects or under_way:
        if suspects and not under_way:
            piece = suspects.popleft()
            under_way[pool.submit(call, piece.function, dict(piece.arguments))] = piece
        while waiting and not suspects and len(under_way) < pool.room():
            piece = waiting.popleft()
            under_way[pool.submit(call, piece.function, dict(piece.arguments))] = piece
        done, _ = wait(under_way, return_when=FIRST_COMPLETED)
        for future in done:
            error = future.exception()
            if error is not None and pool.died(error):
                lost = list(under_way.values())
                under_way.clear()
                if len(lost) == 1:
                    deaths[lost[0].key] += 1
                    if deaths[lost[0].key] >= DEATHS_MAX:
                        raise HapsceneError(f"{lost[0].key}: its process died, again: killed, or out of memory")
                suspects.extend(lost)
                break
            piece = under_way.pop(future)
            if isinstance(error, HapsceneError):
                raise error
            if error is not None:
                raise HapsceneError(f"{piece.key}: {pool.reason(error)}") from error
            take(piece, future.result())


def _read(journal: Path) -> dict[tuple[str, str], Any]:
    """What a journal tells, by key and digest; a last line that was cut off tells nothing."""
    found: dict[tuple[str, str], Any] = {}
    if not journal.exists():
        return found
    text = journal.read_text(encoding="utf-8", errors="replace")
    if text and not text.endswith("\n"):  # or the next line would be lost with it
        text = text[: text.rfind("\n") + 1]
        journal.write_text(text, encoding="utf-8", newline="\n")
    for line in text.splitlines():
        try:
            told = json.loads(line)
            found[str(told["key"]), str(told["digest"])] = told["result"]
        except (ValueError, TypeError, LookupError, RecursionError):
            continue
    return found
