"""The columns of a recording's file, before they have quantities and units; the rate and units that the file states.

| suffix | read as |
|---|---|
| `.wav` | channels "1", "2", …; integers as shares of full scale, ±1; the rate is the file's |
| `.npz` | arrays by name, (n, 3) as "name_x", "name_y", "name_z"; `rate_Hz` where present; never pickled objects |
| `.mat` | variables by name, likewise (MATLAB up to version 7, through SciPy) |
| `.parquet` | numeric columns by name (through pyarrow) |
| `.hsrec` | a probe's record (`hapscene capture record`), with its rate and units |
| any other | text: columns separated by commas, semicolons, tabs or spaces, with or without a line of names |
"""

import math
import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.io.hsrec import CutWarning, load_record
from hapscene.errors import CaptureError, FormatError, warn
from hapscene.io.confined import confined
from hapscene.io.files import check_file_size, check_unpacked, memory_most_B, refusing, unpacked_most_B
from hapscene.io.number_files import TOO_MUCH, lines_of, open_npz

__all__ = [
    "AXES",
    "BYTES_MAX",
    "Column",
    "RecordingSource",
    "check_range",
    "read_mat",
    "read_parquet",
    "read_recording_source",
]

BYTES_MAX: Final = 1 << 30
"""Largest file that is opened, and largest content that is unpacked [bytes]: 20 minutes of four columns at 10 kHz."""

VALUE_MAX: Final = 1e30
"""Largest magnitude of any measured number in SI units; larger ones would overflow when they are squared and summed."""

AXES: Final = ("x", "y", "z")

Column = NDArray[np.number[Any]]
"""A stream (n,) as the file holds it: numbers of any type, converted to float64 when they are used."""


@dataclass(frozen=True)
class RecordingSource:
    """The content of a file: streams (n,) by name, all of one length; rate and units where the file states them."""

    columns: Mapping[str, Column]
    rate_Hz: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    scale: float = 1.0
    """factor for all numbers"""
    own_B: int = 0
    """size of the file's content, unpacked [bytes]"""


def check_range(name: str, column: Column, scale: float = 1.0, most: float = VALUE_MAX) -> None:
    """Check that no scaled number of a column is infinite or larger than `most`; NaN marks a missing sample.

    Raises:
        CaptureError: a number is; it is named by its column and row, counted from 1 after the header.
    """
    with np.errstate(invalid="ignore"):
        beyond = np.flatnonzero(np.abs(scale * np.asarray(column, np.float64)) > most)
    if len(beyond):
        first = int(beyond[0])
        raise CaptureError(
            f"column {name!r}, row {first + 1}: invalid value {column[first]:g}; expected a finite number up to "
            f"{most / scale:.3g}: correct the file or its unit"
        )


def read_recording_source(file: Path) -> RecordingSource:
    """Reads a file by its suffix.

    Raises:
        CaptureError: a file that is missing, too large, not what its suffix says, or not of numbers.
    """
    with refusing(CaptureError):
        check_file_size(file, BYTES_MAX, "recording")
    with refusing(CaptureError, file):
        return _source(file)


def _source(file: Path) -> RecordingSource:
    readers = {".wav": _wav, ".npz": _npz, ".mat": _mat, ".parquet": _parquet}
    reader = readers.get(file.suffix.lower(), _text)
    try:
        source = _record(file) if file.suffix.lower() == ".hsrec" else reader(file)
    except OSError as error:
        raise CaptureError(f"cannot be read: {error.strerror or error}") from None
    lengths = {name: len(column) for name, column in source.columns.items()}
    if not lengths or min(lengths.values()) == 0:
        raise CaptureError("holds no streams of numbers")
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in lengths.items())
        raise CaptureError(f"streams of different length ({listed}): each needs one sample per time")
    if source.rate_Hz is not None and not 0.0 < source.rate_Hz < float("inf"):
        raise CaptureError(f"its rate must be a number of Hz above 0, is {source.rate_Hz:g}")
    return source


def _text(file: Path) -> RecordingSource:
    try:
        with file.open(encoding="utf-8-sig") as f:
            lines = enumerate(lines_of(file, f, 1), 1)
            skip, first = next(((n, line) for n, line in lines if line.strip() and not line.startswith("#")), (0, ""))
        delimiter = next((d for d in (";", "\t", ",") if d in first), None)
        names = [name.strip().strip('"') for name in first.strip().split(delimiter)]
        header = not all(_is_number(_pointed(name, delimiter)) for name in names)
        if not names or not names[0]:
            raise CaptureError("must begin with a header of column names, or with a line of numbers")
        skip = skip if header else 0  # the first line of numbers may follow comments
        with file.open(encoding="utf-8-sig") as f, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "no data": an error below
            rows = (_pointed(line, delimiter) for line in lines_of(file, f, 8 * len(names)))
            table = np.loadtxt(rows, delimiter=delimiter, skiprows=skip, ndmin=2)
    except UnicodeDecodeError:
        raise CaptureError("not a text file in UTF-8") from None
    except ValueError:
        raise CaptureError(f"not a table of numbers: {_fault(file, delimiter, skip, len(names))}") from None
    if len(table) == 0:
        raise CaptureError(f"holds no numbers, only the line {first.strip()[:40]!r}: columns expected, of numbers")
    if table.shape[1] != len(names):
        raise CaptureError(f"{len(names)} columns expected, {table.shape[1]} found")
    if not header:
        names = _numbered(len(names))
    if len(set(names)) < len(names):
        raise CaptureError(f"two columns have one name: {', '.join(names)}")
    return RecordingSource(dict(zip(names, table.T, strict=True)), own_B=file.stat().st_size)


def _pointed(text: str, delimiter: str | None) -> str:
    """With decimal points: a table with semicolons between its columns has decimal commas."""
    return text.replace(",", ".") if delimiter == ";" else text


def _fault(file: Path, delimiter: str | None, skip: int, count: int) -> str:
    """The first line that is not `count` numbers, and why."""
    with file.open(encoding="utf-8-sig", errors="replace") as f:
        for number, line in enumerate(lines_of(file, f, 1), 1):
            text = line.split("#", 1)[0].strip("\r\n")
            if number <= skip or not text.strip():
                continue
            cells = [cell.strip() for cell in text.split(delimiter)]
            if len(cells) != count:
                return f"line {number}: {count} columns expected, {len(cells)} found"
            for column, cell in enumerate(cells, 1):
                if not _is_number(_pointed(cell, delimiter)):
                    return f"line {number}: a number expected in column {column}, found {cell[:40]!r}"
    return f"{count} numbers a line expected"


def _wav(file: Path) -> RecordingSource:
    _check_wav(file)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # chunks that SciPy does not know
            rate, data = scipy.io.wavfile.read(file)
        data = data.reshape(len(data), -1)
    except OSError:
        raise
    except Exception as error:  # a damaged header raises anything; only ValueError explains
        said = str(error)[:200] if isinstance(error, ValueError) else "its header is damaged"
        raise CaptureError(f"not a WAV file that can be read: {said}") from None
    if data.dtype == np.uint8:
        data = (data ^ 128).view(np.int8)  # unsigned, 128 is zero
    scale = 1.0 if data.dtype.kind == "f" else 1.0 / (float(np.iinfo(data.dtype).max) + 1.0)
    columns = dict(zip(_numbered(data.shape[1]), data.T, strict=True))
    return RecordingSource(columns, float(rate), scale=scale, own_B=file.stat().st_size)


def _check_wav(file: Path) -> None:
    """Refuse a truncated file, which SciPy reads as a shorter one, and one with endless chunks before its samples."""
    with file.open("rb") as f:
        if f.read(12)[:4] != b"RIFF":
            return  # SciPy raises its own error
        for _ in range(_CHUNK_MAX):
            name, size_B = f.read(4), int.from_bytes(f.read(4), "little")
            left_B = os.fstat(f.fileno()).st_size - f.tell()
            if name == b"data" and size_B > left_B and size_B != _UNKNOWN_B:
                said = f"its header says {size_B:,} bytes of samples, there are {left_B:,}"
                raise CaptureError(f"not a WAV file that can be read: it is truncated: {said}")
            if name == b"data" or left_B <= size_B:
                return
            f.seek(size_B + size_B % 2, os.SEEK_CUR)
    raise CaptureError(f"not a WAV file that can be read: more than {_CHUNK_MAX} chunks before its samples")


_CHUNK_MAX: Final = 1000
_UNKNOWN_B: Final = 0xFFFFFFFF  # written into a pipe: the length is unknown


def _npz(file: Path) -> RecordingSource:
    try:
        with open_npz(file, BYTES_MAX, TOO_MUCH) as archive:
            headers = {name: archive.header(name) for name in archive.names}
            if any(dtype.hasobject for _, dtype in headers.values()):
                raise CaptureError("it holds pickled objects, which are never opened")
            wanted = [name for name, (_, dtype) in headers.items() if dtype.kind in _NUMBERS or name == "units"]
            return _named({name: archive.read(name) for name in wanted})
    except FormatError as error:
        raise CaptureError(f"not an NPZ file that can be read: {error}") from None


def _mat(file: Path) -> RecordingSource:
    return _confined(read_mat, file, "SciPy's reader of MATLAB files", "scipy.io")


_MAT_B: Final = {"double": 8, "single": 4, "logical": 1, "char": 4} | {
    f"{sign}int{8 * size}": size for sign in ("", "u") for size in (1, 2, 4, 8)
}
"""Size of a number of each of MATLAB's classes [bytes]."""


def read_mat(file: Any, most_B: int) -> dict[str, NDArray[Any]]:
    """The numeric variables of a MATLAB file, and its `units`; run confined, because SciPy may crash on a damaged one.

    Raises:
        FormatError: of version 7.3, or it unpacks to more than its size allows.
    """
    try:
        held = scipy.io.whosmat(file)
    except NotImplementedError:
        raise FormatError("a MATLAB 7.3 file is not read: save it with -v7") from None
    wanted = [each for each in held if each[2] in _MAT_B and (each[2] != "char" or each[0] == "units")]
    unpacked_B = sum(_MAT_B[kind] * math.prod(max(length, 0) for length in shape) for _, shape, kind in wanted)
    check_unpacked(os.fstat(file.fileno()).st_size, unpacked_B, most_B, TOO_MUCH)
    file.seek(0)
    names = [name for name, _, _ in held]
    content = scipy.io.loadmat(file, variable_names=names) if names else {}
    return {name: content[name] for name in names if content[name].dtype.kind in f"{_NUMBERS}U"}


def _parquet(file: Path) -> RecordingSource:
    if find_spec("pyarrow") is None:
        raise CaptureError("Parquet needs pyarrow: pip install 'hapscene[parquet]'")
    return _confined(read_parquet, file, "pyarrow's reader of Parquet files", "pyarrow.parquet")


def read_parquet(file: BinaryIO, most_B: int) -> dict[str, NDArray[Any]]:
    """The numeric columns of a Parquet file; run confined, because pyarrow may crash on a damaged one.

    Raises:
        FormatError: not a Parquet file, or it unpacks to more than its size allows.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.ParquetFile(file, pre_buffer=False)  # no threads
        wanted = [f.name for f in table.schema_arrow if pa.types.is_integer(f.type) or pa.types.is_floating(f.type)]
        size_B = os.fstat(file.fileno()).st_size
        check_unpacked(size_B, 8 * table.metadata.num_rows * len(wanted), most_B, TOO_MUCH)
        columns = table.read(columns=wanted, use_threads=False)
    except pa.ArrowException as error:
        raise FormatError(f"not a Parquet file that can be read: {str(error)[:200]}") from None
    return {name: columns.column(name).to_numpy() for name in wanted}


def _confined(
    reader: Callable[[BinaryIO, int], dict[str, NDArray[Any]]], file: Path, name: str, library: str
) -> RecordingSource:
    """The streams that a reader finds in a process of its own with bounded memory."""
    most_B = unpacked_most_B(file.stat().st_size, BYTES_MAX)
    memory_B = memory_most_B(most_B)
    with file.open("rb") as f:
        read = confined(reader, f, BYTES_MAX, by=name, memory_B=memory_B, output_B=most_B, imports=(library,))
    return _named(read.arrays)


def _record(file: Path) -> RecordingSource:
    record = load_record(file)
    if record.ended is None:
        count = len(record.missing)
        warn(f"{file}: cut off, by a kill, a loss of power or damage: {count:,} samples are left", CutWarning)
    return RecordingSource(record.streams, record.rate_Hz, record.units, own_B=file.stat().st_size)


_NUMBERS: Final = "fiu"
"""Kinds of NumPy's types that are real numbers."""


def _named(arrays: Mapping[str, NDArray[Any]]) -> RecordingSource:
    """Streams among named arrays: three columns are a vector, four a quaternion; other arrays are left out."""
    columns: dict[str, Column] = {}
    for name, rows in arrays.items():
        if rows.dtype.kind not in _NUMBERS or rows.size <= 1:
            continue
        if rows.ndim == 2 and rows.shape[0] in (1, 3, 4) and rows.shape[1] > 4:
            rows = rows.T
        if rows.ndim == 2 and rows.shape[1] == 1:
            rows = rows[:, 0]
        if rows.ndim == 1:
            columns[name] = rows
        elif rows.ndim == 2 and rows.shape[1] in (3, 4):
            axes = ("w", *AXES)[-rows.shape[1] :]
            columns |= {f"{name}_{axis}": part for axis, part in zip(axes, rows.T, strict=True)}
    rate, own_B = arrays.get("rate_Hz"), sum(array.nbytes for array in arrays.values())
    if rate is not None and (rate.dtype.kind not in _NUMBERS or rate.size != 1):
        raise CaptureError("rate_Hz must be one number")
    rate_Hz = None if rate is None else float(rate.reshape(-1)[0])
    return RecordingSource(columns, rate_Hz, _units(arrays.get("units")), own_B=own_B)


def _units(value: NDArray[Any] | None) -> dict[str, str]:
    """Units as `hapscene capture record` writes them into an NPZ file: a list of "name=unit"."""
    if value is None or value.dtype.kind != "U":
        return {}
    pairs = (str(text).partition("=") for text in value.reshape(-1)[:1000])
    return {name: unit.strip() for name, equals, unit in pairs if equals}  # MATLAB pads the shorter ones


def _numbered(count: int) -> list[str]:
    return [str(i + 1) for i in range(count)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
