"""The answers of a study: a CSV (RFC 4180) that is only added to, a row an answer, on the disk before it counts.

pandas.read_csv and R's read.csv read it as it is: plain header, UTF-8, NA for what does not apply.
"""

import csv
import io
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from hapscene.errors import StudyError, warn
from hapscene.files import naming, read_bytes, refusing

COLUMNS: Final = (
    *("person", "place", "channel", "trial", "block", "kind", "stimulus_1", "stimulus_2", "stimulus_3", "parameter"),
    *("level", "choice", "rating", "answer", "correct_answer", "correct", "latency_s", "replays", "time"),
    "plan_sha256",
)
"""`answer` and `correct_answer` are indices of choices from 0; `correct` is 1 or 0."""

RESULTS_MAX_B: Final = 1 << 28
"""Largest file of results [bytes]: a million answers."""

MISSING: Final = "NA"
"""Read as missing by pandas and R alike."""


class ResultsFile:
    """A file of results, held by one writer at a time.

    Attributes:
        rows: what it held when it was opened, by column.
        cut_B: bytes at its end that were no whole row: a writer was killed as it wrote, and they are gone [bytes].
    """

    rows: Sequence[Mapping[str, str]]
    cut_B: int

    def __init__(self, path: Path) -> None:
        """Opens, or makes; what a killed writer left half is cut off.

        Raises:
            StudyError: held by another, no file of results, or not to be written.
        """
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as reason:
            raise StudyError(f"{path}: cannot be written: {reason.strerror}") from None
        try:
            self._lock(path)
            content = read_bytes(path, RESULTS_MAX_B, "file of results")
            whole = content[: content.rfind(b"\n") + 1]
            self.cut_B = len(content) - len(whole)
            with refusing(StudyError), naming(path):
                self.rows = parse_rows(whole)
            if self.cut_B:
                os.ftruncate(self._file, len(whole))
            self._path = path
            if not whole:
                self._write(COLUMNS)
                _flush_folder(path.parent)
        except BaseException:
            self.close()
            raise

    def _lock(self, path: Path) -> None:
        if sys.platform == "win32":
            return
        import fcntl

        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(f"{path}: another sitting writes it: end that, or give another folder") from None

    def add(self, row: Mapping[str, object]) -> None:
        """Writes a row; it is on the disk when this returns. What a row does not have, or has as None, is missing.

        Raises:
            StudyError: it could not be written; nothing of it stays.
        """
        self._write([row.get(name) for name in COLUMNS])

    def _write(self, fields: Sequence[object]) -> None:
        text = io.StringIO()
        csv.writer(text).writerow([MISSING if field is None else field for field in fields])
        line = text.getvalue().encode()
        before_B = os.fstat(self._file).st_size
        try:
            if os.write(self._file, line) < len(line):
                raise OSError(28, "no space left")
            os.fsync(self._file)
        except OSError as reason:
            os.ftruncate(self._file, before_B)
            raise StudyError(f"{self._path}: cannot be written: {reason.strerror}") from None

    def close(self) -> None:
        """Lets others write; once is enough."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def load_rows(path: Path) -> list[dict[str, str]]:
    """The whole rows of a file of results, whoever writes it meanwhile.

    Raises:
        StudyError: no such file, or none of results.

    Warns:
        UserWarning: its last line is cut off, and left out.
    """
    with refusing(StudyError), naming(path):
        content = read_bytes(path, RESULTS_MAX_B, "file of results")
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            warn(f"{path}: its last line is cut off, and left out", UserWarning)
        return parse_rows(whole)


def parse_rows(content: bytes) -> list[dict[str, str]]:
    """The rows of a file's content, by column.

    Raises:
        StudyError: names the line.
    """
    if not content:
        return []
    try:
        lines = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True)
        header = next(lines)
        if tuple(header) != COLUMNS:
            raise StudyError(f"is no file of results: its header must be {','.join(COLUMNS)}")
        rows = []
        for fields in lines:
            if len(fields) != len(COLUMNS):
                raise StudyError(f"line {lines.line_num} has {len(fields)} fields; expected {len(COLUMNS)}")
            rows.append(dict(zip(COLUMNS, fields, strict=True)))
    except (UnicodeDecodeError, csv.Error, StopIteration) as error:
        raise StudyError(f"is no file of results: {error}") from None
    return rows


def _flush_folder(folder: Path) -> None:
    """The file's name is on the disk, too; where folders cannot be opened, nothing is done."""
    if sys.platform != "win32":
        number = os.open(folder, os.O_RDONLY)
        os.fsync(number)
        os.close(number)
