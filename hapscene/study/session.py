"""The session of one participant: the present trial, answers on disk, and resuming after an interruption."""

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Self

from filelock import FileLock, Timeout

from hapscene.errors import StudyError, warn
from hapscene.io.files import naming, read_bytes, refusing, write_whole
from hapscene.study.plan import PLAN_MAX_B, Plan, check_name, stimuli_sha256
from hapscene.study.trial_order import Trial, trials

__all__ = ["MISSING", "PLAN", "RESULTS", "Session", "load_rows"]

RESULTS: Final = "results.csv"
PLAN: Final = "plan.toml"


class Session:
    """The session of one participant; begins, or resumes at the next unanswered trial. Use as a context, or call
    `close`.

    The folder contains a copy of the plan, and `results.csv`, to which every answer appends a row. Only one session at
    a time can write to a folder. The order in which participants begin balances the orders of trials.

    Attributes:
        trial: the present trial; None when all are answered.
        done: number of answers.
        total: number of trials of this participant.
    """

    trial: Trial | None
    done: int
    total: int

    def __init__(self, plan: Plan, folder: str | Path, person: str) -> None:
        """Begin or resume a session.

        Args:
            plan: plan of the study.
            folder: folder for the answers; created if necessary.
            person: name of the participant; preferably a pseudonym such as P01.

        Raises:
            StudyError: the folder belongs to another plan or is in use by another session, the answers in it do not
                fit the plan, or recordings or swatches have changed since they were given.
        """
        self.plan, self.folder, self.person = plan, Path(folder), check_name("person", person)
        _keep_plan(plan, self.folder)
        self._file = ResultsFile(self.folder / RESULTS)
        try:
            self._resume()
        except BaseException:
            self.close()
            raise

    def _resume(self) -> None:
        rows, self._sha256 = self._file.rows, stimuli_sha256(self.plan)
        for row in rows if self._sha256 else ():
            if row["stimuli_sha256"] not in (MISSING, self._sha256):
                raise StudyError(
                    f"{self.folder / RESULTS}: {row['person']}, trial {row['trial']}: a recording or swatch of the "
                    "plan has changed since this answer; restore the file, or use another folder"
                )
        mine = [row for row in rows if row["person"] == self.person]
        others = {row["person"] for row in rows} - {self.person}
        self._place = _integer(mine[0], "place") if mine else len(others)
        self._trials = trials(self.plan, self.person, self._place)
        self.trial, self.done = next(self._trials, None), 0
        self.total = self.plan.trial_count
        for row in mine:
            self._replay(row)

    def answer(self, choice: int, *, latency_s: float, replays: int = 0) -> None:
        """Record the answer to the present trial; it is on disk when this returns, and `trial` is the next one.

        Args:
            choice: index of a choice of the trial.
            latency_s: response time from the end of the last interval [s].
            replays: number of repeated intervals [count].

        Raises:
            StudyError: an argument is out of range, no trial is left, or the answer could not be written.
        """
        trial = self.trial
        if trial is None:
            raise StudyError(f"{self.person} has already answered all {self.done} trials")
        if not 0 <= choice < len(trial.choices):
            raise StudyError(
                f"choice {choice} is out of range; expected 0 to {len(trial.choices) - 1} ({', '.join(trial.choices)})"
            )
        if not 0.0 <= latency_s < math.inf:
            raise StudyError(f"latency_s is {latency_s:g}; expected a finite time of at least 0 s")
        self._file.add(
            {
                **self._expected(trial),
                "choice": trial.choices[choice],
                "rating": trial.choices[choice] if trial.block.kind == "rating" else None,
                "answer": choice,
                "correct": None if trial.correct is None else int(choice == trial.correct),
                "level": trial.level,
                "stimuli_sha256": self._sha256,
                "latency_s": f"{latency_s:.3f}",
                "replays": replays,
                "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
            }
        )
        self._advance(choice, None)

    def _expected(self, trial: Trial) -> dict[str, object]:
        """The fields of a row that follow from the plan. They must be equal when a session resumes."""
        return {
            "person": self.person,
            "place": self._place,
            "channel": self.plan.channel,
            "trial": trial.number,
            "block": trial.block.name,
            "kind": trial.block.kind,
            **{f"stimulus_{number}": one.stimulus.name for number, one in enumerate(trial.intervals, 1)},
            "parameter": getattr(trial.block, "parameter", None),
            "correct_answer": trial.correct,
            "plan_sha256": self.plan.sha256,
        }

    def _advance(self, choice: int, level: float | None) -> None:
        try:
            self.trial = self._trials.send((choice, level))
        except StopIteration:
            self.trial = None
        self.done += 1

    def _replay(self, row: Mapping[str, str]) -> None:
        """Answer the present trial as recorded in a row of the file."""
        where = f"{self.folder / RESULTS}: {self.person}, trial {row['trial']}"
        if self.trial is None:
            raise StudyError(f"{where}: the plan has fewer trials; use another folder")
        for name, value in self._expected(self.trial).items():
            if row[name] != (MISSING if value is None else str(value)):
                raise StudyError(f"{where}: {name} is {row[name]!r}; the plan has {value!r}; use another folder")
        choice = _integer(row, "answer")
        if not 0 <= choice < len(self.trial.choices):
            raise StudyError(f"{where}: answer {choice} is out of range; expected 0 to {len(self.trial.choices) - 1}")
        try:
            level = None if self.trial.level is None else float(row["level"])
        except ValueError:
            raise StudyError(f"{where}: level is {row['level']!r}; expected a number") from None
        self._advance(choice, level)

    def close(self) -> None:
        """Close the results file, so that another session can use the folder."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _keep_plan(plan: Plan, folder: Path) -> None:
    """Create the folder and copy the plan into it; refuse a folder of another plan."""
    path = folder / PLAN
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as reason:
        raise StudyError(f"{folder}: cannot be created: {reason.strerror}") from None
    if not path.exists():
        if (folder / RESULTS).exists():
            raise StudyError(f"{folder}: has answers but no {PLAN}; use another folder")
        write_whole(path, plan.content, StudyError)
    with refusing(StudyError):
        if read_bytes(path, PLAN_MAX_B, "plan of a study") != plan.content:
            raise StudyError(f"{folder}: belongs to another plan, {path}; use that plan, or another folder")


def _integer(row: Mapping[str, str], name: str) -> int:
    try:
        return int(row[name])
    except ValueError:
        raise StudyError(f"{RESULTS}: trial {row['trial']}: {name} is {row[name]!r}; expected an integer") from None


# The results file of a study: a CSV (RFC 4180) to which each answer appends a row.
#
# pandas.read_csv and R's read.csv read it directly: plain header, UTF-8, NA for columns that do not apply.

COLUMNS: Final = (
    *("person", "place", "channel", "trial", "block", "kind", "stimulus_1", "stimulus_2", "parameter"),
    *("level", "choice", "rating", "answer", "correct_answer", "correct", "latency_s", "replays", "time"),
    *("stimuli_sha256", "plan_sha256"),
)
"""`answer` and `correct_answer` are indices of choices from 0; `correct` is 1 or 0."""

RESULTS_MAX_B: Final = 1 << 28
"""Largest results file [bytes]: a million answers."""

MISSING: Final = "NA"
"""Value that pandas and R both read as missing."""


class ResultsFile:
    """A results file that one writer has open.

    Attributes:
        rows: rows of the file when it was opened, by column.
    """

    rows: Sequence[Mapping[str, str]]

    def __init__(self, path: Path) -> None:
        """Open or create the file. An incomplete last row of an interrupted writer is removed.

        Raises:
            StudyError: the file is open in another writer, is not a results file, or is not writable.
        """
        self._path, self._lock = path, FileLock(f"{path}.lock")
        try:
            self._lock.acquire(blocking=False)
            self._file = path.open("a+b", buffering=0)
        except Timeout:
            raise StudyError(f"{path}: in use by another session; end that session, or use another folder") from None
        except OSError as reason:
            self._lock.release()
            raise StudyError(f"{path}: cannot be written: {reason.strerror}") from None
        try:
            content = read_bytes(path, RESULTS_MAX_B, "file of results")
            complete = _complete_rows(content)
            with refusing(StudyError), naming(path):
                self.rows = _parse(complete)
            self._file.truncate(len(complete))
            if not complete:
                self._write(COLUMNS)
        except BaseException:
            self.close()
            raise

    def add(self, row: Mapping[str, object]) -> None:
        """Append a row and flush it to disk. Missing fields and None are written as NA.

        Raises:
            StudyError: the row could not be written; no part of it remains in the file.
        """
        self._write([row.get(name) for name in COLUMNS])

    def _write(self, row: Sequence[object]) -> None:
        text = io.StringIO()
        csv.writer(text).writerow([MISSING if cell is None else cell for cell in row])
        line, before_B = text.getvalue().encode(), os.fstat(self._file.fileno()).st_size
        try:
            if self._file.write(line) < len(line):
                raise OSError(28, "no space left")
            os.fsync(self._file)
        except OSError as reason:
            self._file.truncate(before_B)
            raise StudyError(f"{self._path}: cannot be written: {reason.strerror}") from None

    def close(self) -> None:
        """Close the file, and release the lock. Calling it twice has no effect."""
        self._file.close()
        self._lock.release()


def load_rows(path: Path) -> list[dict[str, str]]:
    """Read the complete rows of a results file, by column. A writer may have the file open; an incomplete last row
    is skipped with a UserWarning. Raises StudyError: the file is missing, or is not a results file."""
    with refusing(StudyError), naming(path):
        content = read_bytes(path, RESULTS_MAX_B, "file of results")
        complete = _complete_rows(content)
        if len(complete) < len(content):
            warn(f"{path}: the last row is incomplete and was skipped", UserWarning)
        return _parse(complete)


def _complete_rows(content: bytes) -> bytes:
    """The content without an incomplete last row or header, which has no line end."""
    before, end, _ = content.rpartition(b"\n")
    header = ",".join(COLUMNS).encode()
    return before + end if end or header.startswith(content) else content  # other content is refused, not removed


def _parse(content: bytes) -> list[dict[str, str]]:
    """The rows of the file, by column."""
    if not content:
        return []
    try:
        lines = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True)
        rows = []
        if tuple(next(lines)) != COLUMNS:
            raise StudyError(f"not a results file: expected the header {','.join(COLUMNS)}")
        for row in filter(None, lines):
            if len(row) != len(COLUMNS):
                raise StudyError(f"line {lines.line_num} has {len(row)} fields; expected {len(COLUMNS)}")
            rows.append({name: cell or MISSING for name, cell in zip(COLUMNS, row, strict=True)})
    except (UnicodeDecodeError, csv.Error, StopIteration) as error:
        raise StudyError(f"not a results file in UTF-8: {error}") from None
    return rows
