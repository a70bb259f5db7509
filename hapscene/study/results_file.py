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
    *("stimuli_sha256", "plan_sha256"),
)
"""`answer` and `correct_answer` are indices of choices from 0; `correct` is 1 or 0."""

EARLIER: Final = tuple(name for name in COLUMNS if name != "stimuli_sha256")
"""What files had before it was kept what was played; they are gone on with as they are."""

WHOLE: Final = ("place", "trial", "rating", "answer", "correct_answer", "correct", "replays")
"""Columns of whole numbers, which pandas writes as 1.0 where others of them are missing."""

SHA256_LENGTH: Final = 64
"""Of the last field of a row that is whole [characters]."""

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
            whole = _whole_rows(content)
            self.cut_B = len(content) - len(whole)
            with refusing(StudyError), naming(path):
                self.rows = parse_rows(whole)
            if self.cut_B:
                os.ftruncate(self._file, len(whole))
            self._path, self._ends = path, not whole or whole.endswith(b"\n")
            self._columns = COLUMNS if not whole or b"stimuli_sha256" in whole.partition(b"\n")[0] else EARLIER
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
        self._write([row.get(name) for name in self._columns])

    def _write(self, fields: Sequence[object]) -> None:
        text = io.StringIO()
        csv.writer(text).writerow([MISSING if field is None else field for field in fields])
        line = (text.getvalue() if self._ends else "\r\n" + text.getvalue()).encode()
        before_B = os.fstat(self._file).st_size
        try:
            if os.write(self._file, line) < len(line):
                raise OSError(28, "no space left")
            os.fsync(self._file)
            self._ends = True
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
        whole = _whole_rows(content)
        if len(whole) < len(content):
            warn(f"{path}: its last line is cut off, and left out", UserWarning)
        return parse_rows(whole)


def _whole_rows(content: bytes) -> bytes:
    """Without a row that a killed writer left half; one that an editor left without its end of line is whole."""
    begins = content.rfind(b"\n") + 1
    lines = content.partition(b"\n")[0], content[begins:]
    try:
        header, last = (next(csv.reader([line.decode(errors="replace")])) for line in lines)
    except csv.Error:
        return content  # written by somebody else: what it is will be said as it is read
    whole = 1 < len(last) == len(header) and len(last[-1]) == SHA256_LENGTH
    ours = begins or any(",".join(one).encode().startswith(content.rstrip()) for one in (COLUMNS, EARLIER))
    return content if whole or not ours else content[:begins]


def parse_rows(content: bytes) -> list[dict[str, str]]:
    """The rows of a file's content, by column, as they were written: what pandas makes of a number is undone.

    Raises:
        StudyError: names the line.
    """
    if not content:
        return []
    try:
        lines = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True)
        header = next(lines)
        if tuple(header) not in (COLUMNS, EARLIER):
            raise StudyError(
                f"is no file of results, with commas as it was written: its header must be {','.join(COLUMNS)}"
            )
        rows = []
        for fields in filter(None, lines):
            if len(fields) != len(header):
                raise StudyError(f"line {lines.line_num} has {len(fields)} fields; expected {len(header)}")
            row = {
                "stimuli_sha256": MISSING,
                **{name: field or MISSING for name, field in zip(header, fields, strict=True)},
            }
            rows.append(row | {name: row[name].removesuffix(".0") for name in WHOLE})
    except (UnicodeDecodeError, csv.Error, StopIteration) as error:
        raise StudyError(f"is no file of results, in UTF-8 as it was written: {error}") from None
    return rows


def _flush_folder(folder: Path) -> None:
    """The file's name is on the disk, too; where folders cannot be opened, nothing is done."""
    if sys.platform != "win32":
        number = os.open(folder, os.O_RDONLY)
        os.fsync(number)
        os.close(number)
