"""What is in a recording's file, before anything is made of it: columns by name, and the rate where the file says it.

| suffix | read as |
|---|---|
| `.wav` | channels "1", "2", …; whole numbers as shares of full scale, ±1; the rate is the file's |
| `.npz` | arrays by name, (n, 3) as "name_x", "name_y", "name_z"; `rate_Hz` where there; never pickled objects |
| `.mat` | variables by name, likewise (MATLAB up to version 7, through SciPy) |
| `.hsrec` | a probe's record (`hapscene capture record`), with its rate and units |
| any other | text: columns apart by commas, semicolons, tabs or spaces, with or without a line of names |
"""

import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.capture.streams import Array
from hapscene.errors import CaptureError
from hapscene.files import check_file_size, refusing

BYTES_MAX: Final = 1 << 30
"""Largest file that is opened, and largest content that is unpacked [bytes]: 20 minutes of four columns at 10 kHz."""

MISSING_MAX: Final = 0.01
"""Largest share of samples that a probe may have dropped [1]: what lies between is bridged by straight lines."""

AXES: Final = ("x", "y", "z")


@dataclass(frozen=True)
class RecordingSource:
    """The content of a file: streams (n,) by name, all of one length; rate and units where the file says them."""

    columns: Mapping[str, Array]
    rate_Hz: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    bridged: Mapping[str, int] = field(default_factory=dict)
    """how many missing samples of a stream were put on straight lines; streams without any are left out"""


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
    reader = {".wav": _wav, ".npz": _npz, ".mat": _mat, ".hsrec": _record}.get(file.suffix.lower(), _text)
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
    return source


def _text(file: Path) -> RecordingSource:
    try:
        with file.open(encoding="utf-8-sig") as f:
            lines = ((number, line) for number, line in enumerate(f, 1) if line.strip() and not line.startswith("#"))
            skip, first = next(lines, (0, ""))
    except UnicodeDecodeError:
        raise CaptureError("not a text file") from None
    delimiter = next((d for d in (";", "\t", ",") if d in first), None)
    names = [name.strip().strip('"') for name in first.strip().split(delimiter)]
    header = not all(_is_number(name) for name in names)
    if not names or not names[0]:
        raise CaptureError("must begin with a header of column names, or with a line of numbers")
    skip = skip if header else 0  # the line itself may stand below comments
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "no data", which is told below
            table = np.loadtxt(file, delimiter=delimiter, skiprows=skip, ndmin=2, encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise CaptureError("not a text file") from None
    except ValueError:
        raise CaptureError(f"not a table of numbers: {_fault(file, delimiter, skip, len(names))}") from None
    if len(table) == 0 or table.shape[1] != len(names):
        raise CaptureError(f"{len(names)} columns expected, {table.shape[1] if len(table) else 0} found")
    if not header:
        names = _numbered(len(names))
    if len(set(names)) < len(names):
        raise CaptureError(f"two columns have one name: {', '.join(names)}")
    return RecordingSource(dict(zip(names, table.T.copy(), strict=True)))


def _fault(file: Path, delimiter: str | None, skip: int, count: int) -> str:
    """The first line that is not `count` numbers, and why."""
    with file.open(encoding="utf-8-sig", errors="replace") as f:
        for number, line in enumerate(f, 1):
            text = line.split("#", 1)[0].strip("\r\n")
            if number <= skip or not text.strip():
                continue
            cells = [cell.strip() for cell in text.split(delimiter)]
            if len(cells) != count:
                return f"line {number}: {count} columns expected, {len(cells)} found"
            for column, cell in enumerate(cells, 1):
                if not _is_number(cell):
                    return f"line {number}: a number expected in column {column}, found {cell[:40]!r}"
    return f"{count} numbers a line expected"


def _wav(file: Path) -> RecordingSource:
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # chunks that it does not know
            rate, data = wavfile.read(file)
    except (ValueError, EOFError) as error:
        raise CaptureError(f"not a WAV file that can be read: {error}") from None
    values = np.asarray(data, dtype=np.float64).reshape(len(data), -1)
    if data.dtype == np.uint8:
        values = values / 128.0 - 1.0
    elif data.dtype.kind == "i":
        values /= float(np.iinfo(data.dtype).max) + 1.0
    return RecordingSource(dict(zip(_numbered(values.shape[1]), values.T.copy(), strict=True)), float(rate))


def _npz(file: Path) -> RecordingSource:
    try:
        with zipfile.ZipFile(file) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > BYTES_MAX:
                raise CaptureError(f"unpacks to more than {BYTES_MAX >> 20} MiB")
        with np.load(file, allow_pickle=False) as arrays:
            return _named({name: arrays[name] for name in arrays.files})
    except (zipfile.BadZipFile, ValueError, EOFError, KeyError) as error:
        raise CaptureError(f"not an NPZ file that can be read: {error}") from None


def _mat(file: Path) -> RecordingSource:
    from scipy.io import loadmat

    try:
        content = loadmat(file)
    except NotImplementedError:
        raise CaptureError("a MATLAB 7.3 file is not read: save it with -v7") from None
    except OSError:
        raise
    except Exception as error:  # the reader names no class of its own for damaged files
        raise CaptureError(f"not a MATLAB file that can be read: {error}") from None
    return _named({name: value for name, value in content.items() if not name.startswith("__")})


def _record(file: Path) -> RecordingSource:
    from hapscene.capture.record_file import parse_record

    record = parse_record(file.read_bytes())
    columns, bridged = _bridged(record.streams)
    return RecordingSource(columns, record.rate_Hz, record.units, bridged)


def _named(arrays: Mapping[str, Any]) -> RecordingSource:
    """Streams among named arrays; one of three columns is a vector. What is neither is left out."""
    columns: dict[str, Array] = {}
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu" or array.size <= 1:
            continue
        rows = np.asarray(array, dtype=np.float64)
        if rows.ndim == 2 and rows.shape[0] in (1, 3) and rows.shape[1] > 3:
            rows = rows.T
        if rows.ndim == 2 and rows.shape[1] == 1:
            rows = rows[:, 0]
        if rows.ndim == 1:
            columns[name] = rows
        elif rows.ndim == 2 and rows.shape[1] == 3:
            columns |= {f"{name}_{axis}": part.copy() for axis, part in zip(AXES, rows.T, strict=True)}
    whole, bridged = _bridged(columns)
    rate = arrays.get("rate_Hz")
    return RecordingSource(whole, None if rate is None else _rate(rate), _units(arrays.get("units")), bridged)


def _rate(value: Any) -> float:
    array = np.asarray(value)
    if array.dtype.kind not in "fiu" or array.size != 1:
        raise CaptureError("rate_Hz must be one number")
    return float(array.reshape(-1)[0])


def _units(value: Any) -> dict[str, str]:
    """Units as `hapscene capture record` writes them into an NPZ file: a list of "name=unit"."""
    if not isinstance(value, np.ndarray) or value.dtype.kind != "U":
        return {}
    pairs = (str(text).partition("=") for text in value.reshape(-1)[:1000])
    return {name: unit for name, equals, unit in pairs if equals}


def _bridged(streams: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, int]]:
    """The streams with samples that are NaN, dropped by the probe, put on straight lines; and how many of which."""
    whole: dict[str, Array] = {}
    count: dict[str, int] = {}
    for name, stream in streams.items():
        missing = np.isnan(stream)
        share = float(missing.mean()) if len(stream) else 0.0
        if share > MISSING_MAX:
            most = f"at most {100 * MISSING_MAX:g} % may be"
            raise CaptureError(f"{name}: {100 * share:.1f} % of the samples are missing, {most}")
        whole[name] = stream
        if share > 0.0:
            index = np.arange(len(stream))
            whole[name] = np.where(missing, np.interp(index, index[~missing], stream[~missing]), stream)
            count[name] = int(missing.sum())
    return whole, count


def _numbered(count: int) -> list[str]:
    return [str(i + 1) for i in range(count)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
