"""What is in a recording's file, before anything is made of it: columns by name, and the rate where the file says it.

| suffix | read as |
|---|---|
| `.wav` | channels "1", "2", …; whole numbers as shares of full scale, ±1; the rate is the file's |
| `.npz` | arrays by name, (n, 3) as "name_x", "name_y", "name_z"; `rate_Hz` where there; never pickled objects |
| `.mat` | variables by name, likewise (MATLAB up to version 7, through SciPy) |
| `.parquet` | columns of numbers by name (through pyarrow) |
| `.hsrec` | a probe's record (`hapscene capture record`), with its rate and units |
| any other | text: columns apart by commas, semicolons, tabs or spaces, with or without a line of names |
"""

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.confined import confined
from hapscene.errors import CaptureError, FormatError, warn
from hapscene.files import check_file_size, check_unpacked, memory_most_B, read_bytes, refusing, unpacked_most_B
from hapscene.number_files import TOO_MUCH, lines_of, open_npz

BYTES_MAX: Final = 1 << 30
"""Largest file that is opened, and largest content that is unpacked [bytes]: 20 minutes of four columns at 10 kHz."""

AXES: Final = ("x", "y", "z")

Column = NDArray[Any]
"""A stream (n,) as the file holds it: numbers of any type, each to become eight bytes only once it is used."""


@dataclass(frozen=True)
class RecordingSource:
    """The content of a file: streams (n,) by name, all of one length; rate and units where the file says them."""

    columns: Mapping[str, Column]
    rate_Hz: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    scale: float = 1.0
    """by which all numbers are to be multiplied"""
    own_B: int = 0
    """size of what the file holds, unpacked [bytes]"""


def read_recording_source(file: Path) -> RecordingSource:
    """Reads the file by its suffix.

    Raises:
        CaptureError: a file that is missing, too large, not what its suffix says, or not of numbers.
    """
    with refusing(CaptureError):
        check_file_size(file, BYTES_MAX, "recording")
    with refusing(CaptureError, file):
        return _source(file)


def _source(file: Path) -> RecordingSource:
    reader = {".wav": _wav, ".npz": _npz, ".mat": _mat, ".parquet": _parquet, ".hsrec": _record}.get(
        file.suffix.lower(), _text
    )
    try:
        source = reader(file)
    except OSError as error:
        raise CaptureError(f"cannot be read: {error.strerror or error}") from None
    lengths = {name: len(column) for name, column in source.columns.items()}
    if not lengths or min(lengths.values()) == 0:
        raise CaptureError("holds no streams of numbers")
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} {count}" for name, count in lengths.items())
        raise CaptureError(f"streams of different length ({said}): each needs one sample per time")
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
        skip = skip if header else 0  # the line itself may stand below comments
        with file.open(encoding="utf-8-sig") as f, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "no data", which is told below
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
    """With decimal points: where semicolons part columns, as in half of Europe's spreadsheets, a comma is one."""
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
            warnings.simplefilter("ignore")  # chunks that it does not know
            rate, data = scipy.io.wavfile.read(file)
        data = data.reshape(len(data), -1)
    except OSError:
        raise
    except Exception as error:  # a damaged header leads it anywhere: only ValueError says where
        said = str(error)[:200] if isinstance(error, ValueError) else "its header is damaged"
        raise CaptureError(f"not a WAV file that can be read: {said}") from None
    if data.dtype == np.uint8:
        data = (data ^ 128).view(np.int8)  # less its middle
    scale = 1.0 if data.dtype.kind == "f" else 1.0 / (float(np.iinfo(data.dtype).max) + 1.0)
    columns = dict(zip(_numbered(data.shape[1]), data.T, strict=True))
    return RecordingSource(columns, float(rate), scale=scale, own_B=file.stat().st_size)


def _check_wav(file: Path) -> None:
    """Refuse a file that was cut, which SciPy takes for a shorter one, or has no end of chunks before its samples."""
    with file.open("rb") as f:
        if f.read(12)[:4] != b"RIFF":
            return  # SciPy says what is wrong, or knows better
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
_UNKNOWN_B: Final = 0xFFFFFFFF  # what is written into a pipe, where its length is not known


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
    most_B = unpacked_most_B(file.stat().st_size, BYTES_MAX)
    with file.open("rb") as f:
        arrays = confined(
            read_mat,
            f,
            BYTES_MAX,
            by="SciPy's reader of MATLAB files",
            memory_B=memory_most_B(most_B),
            output_B=most_B,
            imports=("scipy.io",),
        ).arrays
    return _named(arrays)


_MAT_B: Final = {"double": 8, "single": 4, "logical": 1, "char": 4} | {
    f"{sign}int{8 * size}": size for sign in ("", "u") for size in (1, 2, 4, 8)
}
"""Size of a number of each of MATLAB's classes [bytes]."""


def read_mat(file: Any, most_B: int) -> dict[str, NDArray[Any]]:
    """The variables of a MATLAB file that are numbers, and its `units`: to be run confined, for SciPy may crash on it.

    Raises:
        FormatError: of version 7.3, or it unpacks to more than it may.
    """
    try:
        held = scipy.io.whosmat(file)
    except NotImplementedError:
        raise FormatError("a MATLAB 7.3 file is not read: save it with -v7") from None
    wanted = [
        variable for variable in held if variable[2] in _MAT_B and (variable[2] != "char" or variable[0] == "units")
    ]
    unpacked_B = sum(_MAT_B[kind] * math.prod(max(length, 0) for length in shape) for _, shape, kind in wanted)
    check_unpacked(os.fstat(file.fileno()).st_size, unpacked_B, most_B, TOO_MUCH)
    file.seek(0)
    names = [name for name, _, _ in held]
    content = scipy.io.loadmat(file, variable_names=names) if names else {}
    return {name: content[name] for name in names if content[name].dtype.kind in f"{_NUMBERS}U"}


def _parquet(file: Path) -> RecordingSource:
    return _parquets([file])[0]


def _parquets(files: Sequence[Path]) -> list[RecordingSource]:
    """Many at once: each process of its own would take longer than all of them in one."""
    if find_spec("pyarrow") is None:
        raise CaptureError("Parquet needs pyarrow: pip install 'hapscene[parquet]'")
    most_B = sum(unpacked_most_B(file.stat().st_size, BYTES_MAX) for file in files)
    with files[0].open("rb") as f:
        arrays = confined(
            read_parquet,
            f,
            *(str(file) for file in files),
            by="pyarrow's reader of Parquet files",
            memory_B=memory_most_B(most_B),
            output_B=most_B,
            imports=("pyarrow.parquet",),
        ).arrays
    found: list[dict[str, NDArray[Any]]] = [{} for _ in files]
    for key, array in arrays.items():
        number, _, name = key.partition(" ")
        found[int(number)][name] = array
    return [_named(each) for each in found]


def read_parquet(file: Any, *paths: str) -> dict[str, NDArray[Any]]:
    """The columns of numbers of Parquet files, by "0 name", "1 name": to be run confined, for what is damaged.

    Raises:
        FormatError: not such a file, or it unpacks to more than its size allows.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    found: dict[str, NDArray[Any]] = {}
    for i, path in enumerate(paths):
        try:
            table = pq.ParquetFile(path, pre_buffer=False)  # no threads
            schema = table.schema_arrow
            wanted = [f.name for f in schema if pa.types.is_integer(f.type) or pa.types.is_floating(f.type)]
            check_unpacked(Path(path).stat().st_size, 8 * table.metadata.num_rows * len(wanted), BYTES_MAX, TOO_MUCH)
            columns = table.read(columns=wanted, use_threads=False)
        except pa.ArrowException as error:
            raise FormatError(f"{path}: not a Parquet file that can be read: {str(error)[:200]}") from None
        for name in wanted:
            found[f"{i} {name}"] = columns.column(name).to_numpy()
    return found


def read_tables(files: Sequence[Path]) -> list[RecordingSource]:
    """As `read_recording_source` each, quicker where they are Parquet.

    Raises:
        CaptureError: as there.
    """
    for file in files:
        with refusing(CaptureError):
            check_file_size(file, BYTES_MAX, "recording")
    packed = [file for file in files if file.suffix.lower() == ".parquet"]
    with refusing(CaptureError):
        read = dict(zip(packed, _parquets(packed) if packed else [], strict=True))
    return [read[file] if file in read else read_recording_source(file) for file in files]


def _record(file: Path) -> RecordingSource:
    from hapscene.capture.record_file import CutWarning, parse_record

    data = read_bytes(file, BYTES_MAX, "record")
    record = parse_record(data)
    if record.ended is None:
        count = len(record.missing)
        warn(f"{file}: cut off, by a kill, a loss of power or damage: {count:,} samples are there", CutWarning)
    return RecordingSource(record.streams, record.rate_Hz, record.units, own_B=len(data))


_NUMBERS: Final = "fiu"
"""Kinds of NumPy's types that are real numbers."""


def _named(arrays: Mapping[str, NDArray[Any]]) -> RecordingSource:
    """Streams among named arrays; one of three columns is a vector, one of four a quaternion. All else is left out."""
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
    return RecordingSource(columns, None if rate is None else _rate(rate), _units(arrays.get("units")), own_B=own_B)


def _rate(value: Any) -> float:
    array = np.asarray(value)
    if array.dtype.kind not in _NUMBERS or array.size != 1:
        raise CaptureError("rate_Hz must be one number")
    return float(array.reshape(-1)[0])


def _units(value: Any) -> dict[str, str]:
    """Units as `hapscene capture record` writes them into an NPZ file: a list of "name=unit"."""
    if not isinstance(value, np.ndarray) or value.dtype.kind != "U":
        return {}
    pairs = (str(text).partition("=") for text in value.reshape(-1)[:1000])
    return {name: unit.strip() for name, equals, unit in pairs if equals}  # MATLAB fills the shorter ones up


def _numbered(count: int) -> list[str]:
    return [str(i + 1) for i in range(count)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
