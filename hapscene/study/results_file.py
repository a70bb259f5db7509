"""The results file of a study: a CSV (RFC 4180) to which each answer appends a row.

pandas.read_csv and R's read.csv read it directly: plain header, UTF-8, NA for columns that do not apply.
"""

import csv
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from filelock import FileLock, Timeout

from hapscene.errors import StudyError, warn
from hapscene.io.files import naming, read_bytes, refusing

__all__ = ["COLUMNS", "MISSING", "ResultsFile", "load_rows"]

COLUMNS: Final = (
    *("person", "place", "channel", "trial", "block", "kind", "stimulus_1", "stimulus_2", "parameter"),
    *("level", "choice", "rating", "answer", "correct_answer", "correct", "latency_s", "replays", "time"),
    *("stimuli_sha256", "plan_sha256"),
)
"""`answer` and `correct_answer` are indices of choices from 0; `correct` is 1 or 0."""

SHA256_LENGTH: Final = 64
"""Length of the last field of a complete row [characters]."""

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
            elif not complete.endswith(b"\n"):  # an editor may have removed the last line end
                self._file.write(b"\r\n")
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
    """Read the complete rows of a results file, by column. A writer may have the file open.

    Raises:
        StudyError: the file is missing, or is not a results file.

    Warns:
        UserWarning: an incomplete last row was skipped.
    """
    with refusing(StudyError), naming(path):
        content = read_bytes(path, RESULTS_MAX_B, "file of results")
        complete = _complete_rows(content)
        if len(complete) < len(content):
            warn(f"{path}: the last row is incomplete and was skipped", UserWarning)
        return _parse(complete)


def _complete_rows(content: bytes) -> bytes:
    """The content without an incomplete last row or header."""
    before, end, last = content.rpartition(b"\n")
    if not last or (not end and not ",".join(COLUMNS).encode().startswith(last)):
        return content
    row = next(csv.reader([last.decode(errors="replace")]), [""])
    count = content.partition(b"\n")[0].count(b",") + 1
    return content if len(row) == count and len(row[-1]) == SHA256_LENGTH else before + end


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
