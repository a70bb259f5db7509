"""Sends damaged files to a worker process and checks each result."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
from formats import FORMATS, Format
from mutate import mutant

HANG_S = 10.0
"""Longest processor time for reading a file [s]."""

CLOCK_S = 60.0
"""Longest elapsed time for reading a file [s]; long, for busy machines."""


@dataclass(frozen=True)
class Finding:
    """A damaged file that the reader did not handle correctly."""

    format: str
    kind: str
    what: str
    where: str
    text: str
    seed: str
    content: bytes

    @property
    def key(self) -> tuple[str, ...]:
        """Key of duplicates: findings with the same key count once."""
        return self.format, self.kind, self.what, self.where

    def __str__(self) -> str:
        words = (self.kind, self.what, self.where, self.text, f"{len(self.content)} bytes", f"seed {self.seed}")
        return f"{self.format}: " + "; ".join(filter(None, words))


class Worker:
    """Context manager of the worker process, which restarts it after a crash."""

    def __enter__(self) -> "Worker":
        self._place = tempfile.TemporaryDirectory()
        self._process: subprocess.Popen[str] | None = None
        self._warm: set[str] = set()
        return self

    def __exit__(self, *error: object) -> None:
        self._end()
        self._place.cleanup()

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None
            self._warm.clear()

    def read(self, name: str, content: bytes | None = None) -> dict[str, Any]:
        """Return the result of reading `content`, or the valid file of the format by default."""
        files = good(name)
        if name not in self._warm:
            for file, held in files.items():
                self._folder(name).mkdir(exist_ok=True)
                (self._folder(name) / file).write_bytes(held)
            self._ask(name, limited=False, most_s=300.0)  # excludes imports and compilation from the limits
            self._warm.add(name)
        (self._folder(name) / next(iter(files))).write_bytes(next(iter(files.values())) if content is None else content)
        return self._ask(name, limited=True, most_s=CLOCK_S)

    def _folder(self, name: str) -> Path:
        return Path(self._place.name) / name

    def _ask(self, name: str, limited: bool, most_s: float) -> dict[str, Any]:
        if self._process is None:
            threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MALLOC_ARENA_MAX"), "1")
            pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            worker = [sys.executable, str(Path(__file__).with_name("worker.py"))]
            threads["TMPDIR"] = str(place := Path(self._place.name, "temporary"))
            place.mkdir(exist_ok=True)  # must exist before `tempfile` chooses a folder
            environment = {**os.environ, **threads, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
            self._process = subprocess.Popen(worker, cwd=self._place.name, env=environment, text=True, **pipes)
        process = self._process
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(json.dumps([name, str(self._folder(name) / next(iter(good(name)))), limited]) + "\n")
        process.stdin.flush()
        if not select.select([process.stdout], [], [], most_s)[0]:
            self._end()
            return {"kind": "hang", "what": "", "where": "", "text": f"more than {most_s:g} s"}
        line = process.stdout.readline()
        if not line:
            code = process.wait()
            self._end()
            return {
                "kind": "crash",
                "what": signal.Signals(-code).name if code < 0 else f"exit {code}",
                "where": "",
                "text": "",
            }
        answer: dict[str, Any] = json.loads(line)
        return answer


_GOOD: dict[str, dict[str, bytes]] = {}


def good(name: str) -> dict[str, bytes]:
    """Return the valid file of a format and the files it refers to."""
    if name not in _GOOD:
        _GOOD[name] = dict(FORMATS[name].make())
    return _GOOD[name]


def fault_of(entry: Format, result: dict[str, Any], content: bytes, cut: bool, whole: int) -> dict[str, Any] | None:
    """Return the result with its fault, or None if it is correct. `whole`: number of elements of the valid file."""
    if result["kind"] not in ("loaded", "refused"):
        return result
    if result["seconds"] > HANG_S:
        return result | {"kind": "hang", "text": f"{result['seconds']:.0f} s"}
    if cut and result["kind"] == "loaded" and not result["warned"]:
        least = whole if entry.left is None else entry.left(content)
        if result["count"] < least:
            return result | {"kind": "smaller", "text": f"read {result['count']} of {least} elements without a warning"}
    return None


def campaign(worker: Worker, name: str, seed: str, count: int) -> Iterator[Finding]:
    """Read `count` mutants of a format; yield the first finding of each key."""
    entry, found = FORMATS[name], set()
    whole = worker.read(name)
    assert whole["kind"] == "loaded", f"the good file of {name} is not read: {whole}"
    first = next(iter(good(name).values()))
    for i in range(count):
        this = f"{seed}:{name}:{i}"
        content, cut = mutant(first, Random(this))
        wrong = fault_of(entry, worker.read(name, content), content, cut, whole["count"])
        if wrong is None:
            continue
        finding = Finding(name, wrong["kind"], wrong["what"], wrong["where"], wrong["text"], this, content)
        if finding.key not in found:
            found.add(finding.key)
            yield finding


def keep(finding: Finding, folder: Path) -> Path:
    """Write the file of a finding and its description."""
    folder.mkdir(parents=True, exist_ok=True)
    name = "-".join(filter(None, (*finding.key[:3], finding.where.replace(":", "."))))
    file = folder / f"{name.replace(' ', '_')}{''.join(Path(next(iter(good(finding.format)))).suffixes)}"
    file.write_bytes(finding.content)
    file.with_name(file.name + ".txt").write_text(f"{finding}\n", encoding="utf-8")
    return file
