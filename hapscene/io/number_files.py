"""Readers of untrusted tables and NumPy archives with a limit on memory.

They raise `FormatError`, see `hapscene.io.files`.
"""

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from hapscene.errors import FormatError
from hapscene.io.files import check_memory, memory_most_B, open_zip

if TYPE_CHECKING:
    import zipfile

    import numpy as np
    from numpy.typing import NDArray

__all__ = ["TOO_MUCH", "Npz", "numbered", "open_npz", "read_table"]

LINE_MAX: Final = 65_536
"""Maximum length of a line in a table [characters]: more than a thousand columns."""

TOO_MUCH: Final = "divide it into shorter files"
"""Advice for files that need too much memory."""


def lines_of(path: Path, file: IO[str], line_B: int) -> Iterator[str]:
    """Yield the lines of a table; each becomes `line_B` bytes of numbers.

    Raises:
        FormatError: a line is longer than `LINE_MAX`, or the numbers need too much memory.
    """
    own_B = path.stat().st_size
    most = memory_most_B(own_B) // line_B
    for number in range(1, most + 1):
        line = file.readline(LINE_MAX + 1)
        if not line:
            return
        if len(line) > LINE_MAX:
            raise FormatError(f"line {number} is longer than {LINE_MAX:,} characters")
        yield line
    check_memory((most + 1) * line_B, own_B, "the table", TOO_MUCH)


def read_table(path: Path, wanted: Sequence[str] = ()) -> "dict[str, NDArray[np.float64]]":
    """Read the columns (n,) of a text table by name; without a header line they are called "1", "2", ….

    Columns are separated by commas, semicolons, tabs or spaces; with semicolons, numbers may have decimal commas.

    Args:
        path: the file, in UTF-8. Lines that start with # are ignored.
        wanted: columns to read, from a table with a header line; by default all.

    Raises:
        FormatError: a column is missing or named twice, a cell is not a number, or there are no rows.
    """
    import numpy as np

    try:
        with path.open(encoding="utf-8-sig") as file:
            lines = enumerate(lines_of(path, file, 1), 1)
            skip, first = next(((n, line) for n, line in lines if line.strip() and not line.startswith("#")), (0, ""))
        delimiter = next((d for d in (";", "\t", ",") if d in first), None)
        names = [name.strip().strip('"') for name in first.strip().split(delimiter)]
        header = bool(wanted) or not all(_is_number(_with_decimal_points(name, delimiter)) for name in names)
        if not names or not names[0]:
            raise FormatError("the file must begin with a header line of column names or with a line of numbers")
        for name in wanted:
            if name not in names:
                raise FormatError(f"no column {name!r}; expected {', '.join(wanted)}, found {', '.join(names)[:200]}")
        chosen = [names.index(name) for name in wanted or names] if header else list(range(len(names)))
        skip = skip if header else 0  # comments before the numbers are skipped by NumPy
        with path.open(encoding="utf-8-sig") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a file without data is reported below
            rows = (_with_decimal_points(line, delimiter) for line in lines_of(path, file, 8 * len(names)))
            columns = chosen if wanted else None
            table = np.loadtxt(rows, delimiter=delimiter, skiprows=skip, ndmin=2, usecols=columns)
    except UnicodeDecodeError:
        raise FormatError("not a text file in UTF-8") from None
    except ValueError:
        reason = _first_invalid_line(path, delimiter, skip, len(names), chosen)
        raise FormatError(f"not a table of numbers: {reason}") from None
    if len(table) == 0:
        raise FormatError(f"the file contains no numbers after its first line {first.strip()[:40]!r}")
    if table.shape[1] != len(chosen):
        raise FormatError(f"the header names {len(names)} columns, but the rows have {table.shape[1]}")
    if len(set(names)) < len(names) and header:
        raise FormatError(f"duplicate column names: {', '.join(names)}")
    return dict(zip(wanted or (names if header else numbered(len(names))), table.T, strict=True))


def numbered(count: int) -> list[str]:
    """Names of columns without a header: "1", "2", …."""
    return [str(i + 1) for i in range(count)]


def _with_decimal_points(text: str, delimiter: str | None) -> str:
    """Replace decimal commas by points; tables with semicolons between the columns use decimal commas."""
    return text.replace(",", ".") if delimiter == ";" else text


def _first_invalid_line(path: Path, delimiter: str | None, skip: int, count: int, chosen: Sequence[int]) -> str:
    """Describe the first line that does not hold `count` cells with numbers in the chosen columns."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(lines_of(path, file, 1), 1):
            text = line.split("#", 1)[0].strip("\r\n")
            if number <= skip or not text.strip():
                continue
            cells = [cell.strip() for cell in text.split(delimiter)]
            if len(cells) != count:
                return f"line {number}: {count} columns expected, {len(cells)} found"
            for column in chosen:
                if not _is_number(_with_decimal_points(cells[column], delimiter)):
                    return f"line {number}, column {column + 1}: expected a number, found {cells[column][:40]!r}"
    return f"expected {count} numbers per line"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@contextmanager
def open_npz(path: Path, most_B: int, advice: str) -> "Iterator[Npz]":
    """Open an archive of arrays from `numpy.savez`; a context manager.

    Args:
        path: the file.
        most_B: maximum unpacked size [bytes].
        advice: what to do if it is larger.

    Raises:
        FormatError: the archive is missing or damaged; also for errors in the body of the context.
    """
    try:
        with path.open("rb") as file, open_zip(file, most_B, advice) as archive:
            yield Npz(archive)
    except (FormatError, MemoryError):
        raise
    except OSError as error:
        raise FormatError(error.strerror or str(error)) from None
    except Exception as error:  # zipfile, decompressors and NumPy have no common exception class
        raise FormatError(f"damaged: {error}"[:200]) from None


class Npz:
    """Arrays of an archive; the header of an array is checked before its numbers are read."""

    def __init__(self, archive: "zipfile.ZipFile") -> None:
        self._archive = archive
        self.names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]

    def header(self, name: str) -> "tuple[tuple[int, ...], np.dtype[np.generic]]":
        """Return shape and type of an array.

        Raises:
            FormatError: no such array, an unsupported compression, or a size that exceeds the file.
        """
        import zipfile

        import numpy as np

        try:
            member = self._archive.getinfo(f"{name}.npy")
        except KeyError:
            raise FormatError(f"array {name!r} is missing") from None
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or member.flag_bits & 1:
            raise FormatError(f"array {name!r} has a compression or encryption that NumPy does not write")
        with self._archive.open(member) as file:
            try:
                version = np.lib.format.read_magic(file)
                one = version == (1, 0)
                read = np.lib.format.read_array_header_1_0 if one else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(file)
            except Exception:  # NumPy parses it as Python, and deep nesting exhausts the parser
                raise FormatError(f"array {name!r} has an invalid header") from None
        if min(shape, default=0) < 0 or dtype.itemsize * math.prod(shape) > member.file_size:
            raise FormatError(f"array {name!r} of shape {shape} exceeds the file, which is truncated or forged")
        return shape, dtype

    def read(self, name: str) -> "NDArray[Any]":
        """Return an array; call `header` first."""
        import numpy as np

        with self._archive.open(f"{name}.npy") as file:
            array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
        return array
