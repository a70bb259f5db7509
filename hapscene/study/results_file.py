"""The answers of a study: a CSV (RFC 4180) that is only appended to, one row an answer, on the disk before it counts.

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
    *("stimuli_sha256", "plan_sha256"),
)
"""`answer` and `correct_answer` are indices of choices from 0; `correct` is 1 or 0; `stimulus_3` is always missing."""

EARLIER: Final = tuple(name for name in COLUMNS if name != "stimuli_sha256")
"""Columns of earlier files, which are read, and appended to as they are."""

SHA256_LENGTH: Final = 64
"""Of the last field of a whole row [characters]."""

RESULTS_MAX_B: Final = 1 << 28
"""Largest file of results [bytes]: a million answers."""

MISSING: Final = "NA"
"""Read as missing by pandas and R alike."""


class ResultsFile:
    """A file of results, opened by one writer at a time.

    Attributes:
        rows: what it held when it was opened, by column.
        cut_B: length of an unfinished last row that was removed: its writer was killed [bytes].
    """

    rows: Sequence[Mapping[str, str]]
    cut_B: int

    def __init__(self, path: Path) -> None:
        """Open or create the file; an unfinished last row is removed.

        Raises:
            StudyError: open in another writer, not a file of results, or not writable.
        """
        self._path = path
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as reason:
            raise StudyError(f"{path}: cannot be written: {reason.strerror}") from None
        try:
            self._lock()
            content = read_bytes(path, RESULTS_MAX_B, "file of results")
            whole = _whole_rows(content)
            with refusing(StudyError), naming(path):
                self.rows = parse_rows(whole)
            self.cut_B = len(content) - len(whole)
            if self.cut_B:
                os.ftruncate(self._file, len(whole))
            self._columns = EARLIER if whole and b"stimuli_sha256" not in whole.partition(b"\n")[0] else COLUMNS
            if not whole:
                self._write(COLUMNS)
                _flush_folder(path.parent)
            elif not whole.endswith(b"\n"):  # an editor has left it without
                os.write(self._file, b"\r\n")
        except BaseException:
            self.close()
            raise

    def _lock(self) -> None:
        if sys.platform == "win32":
            return
        import fcntl

        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(f"{self._path}: another session writes it: end that, or give another folder") from None

    def add(self, row: Mapping[str, object]) -> None:
        """Append a row; it is on the disk when this returns. Missing and None fields are written as NA.

        Raises:
            StudyError: it could not be written; nothing of it stays.
        """
        self._write([row.get(name) for name in self._columns])

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
        """Let others write; calling it twice does no harm."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def load_rows(path: Path) -> list[dict[str, str]]:
    """The whole rows of a file of results, which may be being written.

    Raises:
        StudyError: no such file, or not a file of results.

    Warns:
        UserWarning: an unfinished last row is left out.
    """
    with refusing(StudyError), naming(path):
        content = read_bytes(path, RESULTS_MAX_B, "file of results")
        whole = _whole_rows(content)
        if len(whole) < len(content):
            warn(f"{path}: its last row is unfinished, and is left out", UserWarning)
        return parse_rows(whole)


def _whole_rows(content: bytes) -> bytes:
    """The content without an unfinished last row, or unfinished header; of any other file all of it."""
    if content.endswith(b"\n"):
        return content
    begins = content.rfind(b"\n") + 1
    if not begins:
        return b"" if any(",".join(one).encode().startswith(content) for one in (COLUMNS, EARLIER)) else content
    lines = [content.partition(b"\n")[0], content[begins:]]
    header, last = (next(csv.reader([line.decode(errors="replace")]), [""]) for line in lines)
    return content if len(last) == len(header) and len(last[-1]) == SHA256_LENGTH else content[:begins]


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
        if tuple(header) not in (COLUMNS, EARLIER):
            raise StudyError(f"is not a file of results: its header must be {','.join(COLUMNS)}")
        rows = []
        for fields in filter(None, lines):
            if len(fields) != len(header):
                raise StudyError(f"line {lines.line_num} has {len(fields)} fields; expected {len(header)}")
            named = {name: field or MISSING for name, field in zip(header, fields, strict=True)}
            rows.append({"stimuli_sha256": MISSING, **named})
    except (UnicodeDecodeError, csv.Error, StopIteration) as error:
        raise StudyError(f"is not a file of results in UTF-8: {error}") from None
    return rows


def _flush_folder(folder: Path) -> None:
    """Put the file's name on the disk, where folders can be opened."""
    if sys.platform != "win32":
        number = os.open(folder, os.O_RDONLY)
        os.fsync(number)
        os.close(number)
