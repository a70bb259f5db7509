"""Readers of recording files: named columns of numbers, and the sample rate and units if the file states them.

`hapscene.capture.io.recording` maps the columns to quantities and converts them to SI units.

| suffix | content |
|---|---|
| `.wav` | channels "1", "2", …; integer samples are scaled to ±1 at full scale; the file states the rate |
| `.npz` | arrays by name, (n, 3) as "name_x", "name_y", "name_z"; optionally `rate_Hz`; no pickled objects |
| `.mat` | variables by name, as in `.npz` (MATLAB up to version 7, read by SciPy) |
| `.hsrec` | record of a probe (`hapscene capture record`), with rate and units |
| other | text: columns separated by commas, semicolons, tabs or spaces, with or without a header line |
"""

import math
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.io.hsrec import TruncatedWarning, load_record
from hapscene.errors import CaptureError, FormatError, warn
from hapscene.io.confined import confined
from hapscene.io.files import check_file_size, check_unpacked, memory_most_B, refusing, unpacked_most_B
from hapscene.io.number_files import TOO_MUCH, numbered, open_npz, read_table

__all__ = ["AXES", "RecordingSource", "check_range", "read_recording_source"]

BYTES_MAX: Final = 1 << 30
"""Largest file, and largest unpacked content, that is read [bytes]: 20 minutes of four columns at 10 kHz."""

VALUE_MAX: Final = 1e30
"""Largest magnitude of any measured number in SI units; larger ones would overflow when they are squared and summed."""

AXES: Final = ("x", "y", "z")

Column = NDArray[np.number]
"""Samples (n,) of any numeric type, as stored in the file; they are converted to float64 on use."""


@dataclass(frozen=True)
class RecordingSource:
    """Content of a file: columns (n,) of equal length by name; sample rate and units if the file states them."""

    columns: Mapping[str, Column]
    rate_Hz: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    scale: float = 1.0
    """factor that is applied to all columns"""
    own_B: int = 0
    """size of the unpacked content of the file [bytes]"""


def check_range(name: str, column: Column, scale: float = 1.0, most: float = VALUE_MAX) -> None:
    """Check that no scaled number of a column is infinite or larger than `most`; NaN marks a missing sample.

    Raises:
        CaptureError: a number is infinite or too large; the message has its column and row (1: first row of data).
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
    """Reads a recording file in the format that its suffix names.

    Raises:
        CaptureError: the file is missing, too large, not in the format of its suffix, or contains no numbers.
    """
    with refusing(CaptureError):
        check_file_size(file, BYTES_MAX, "recording")
    if file.suffix.lower() == ".hsrec":
        return _record(file)  # checks its content, and names the file in its errors
    with refusing(CaptureError, file):
        return _source(file)


def _source(file: Path) -> RecordingSource:
    readers = {".wav": _wav, ".npz": _npz, ".mat": _mat}
    reader = readers.get(file.suffix.lower(), _text)
    try:
        source = reader(file)
    except OSError as error:
        raise CaptureError(f"cannot be read: {error.strerror or error}") from None
    lengths = {name: len(column) for name, column in source.columns.items()}
    if not lengths or min(lengths.values()) == 0:
        raise CaptureError("the file contains no columns of numbers")
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in lengths.items())
        raise CaptureError(f"the columns have different lengths ({listed}); expected equal lengths")
    if source.rate_Hz is not None and not 0.0 < source.rate_Hz < float("inf"):
        raise CaptureError(f"invalid sample rate {source.rate_Hz:g} Hz in the file; expected a finite number above 0")
    return source


def _text(file: Path) -> RecordingSource:
    return RecordingSource(read_table(file), own_B=file.stat().st_size)


def _wav(file: Path) -> RecordingSource:
    _check_wav(file)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # chunks that SciPy does not support
            rate, data = scipy.io.wavfile.read(file)
        data = data.reshape(len(data), -1)
    except OSError:
        raise
    except Exception as error:  # SciPy raises many types on a damaged header; only ValueError has a useful text
        reason = str(error)[:200] if isinstance(error, ValueError) else "its header is damaged"
        raise CaptureError(f"the WAV file cannot be read: {reason}") from None
    if data.dtype == np.uint8:
        data = (data ^ 128).view(np.int8)  # unsigned, 128 is zero
    scale = 1.0 if data.dtype.kind == "f" else 1.0 / (float(np.iinfo(data.dtype).max) + 1.0)
    columns = dict(zip(numbered(data.shape[1]), data.T, strict=True))
    return RecordingSource(columns, float(rate), scale=scale, own_B=file.stat().st_size)


def _check_wav(file: Path) -> None:
    """Rejects a truncated file, which SciPy would read as a shorter one, and a file with too many chunks."""
    with file.open("rb") as f:
        if f.read(12)[:4] != b"RIFF":
            return  # SciPy raises its own error
        for _ in range(_CHUNK_MAX):
            name, size_B = f.read(4), int.from_bytes(f.read(4), "little")
            left_B = os.fstat(f.fileno()).st_size - f.tell()
            if name == b"data" and size_B > left_B and size_B != _UNKNOWN_B:
                raise CaptureError(
                    f"the WAV file is truncated: its header states {size_B:,} bytes of samples, {left_B:,} are present"
                )
            if name == b"data" or left_B <= size_B:
                return
            f.seek(size_B + size_B % 2, os.SEEK_CUR)
    raise CaptureError(f"the WAV file cannot be read: more than {_CHUNK_MAX} chunks precede its samples")


_CHUNK_MAX: Final = 1000
_UNKNOWN_B: Final = 0xFFFFFFFF  # length field of a file that was written to a pipe


def _npz(file: Path) -> RecordingSource:
    try:
        with open_npz(file, BYTES_MAX, TOO_MUCH) as archive:
            headers = {name: archive.header(name) for name in archive.names}
            if any(dtype.hasobject for _, dtype in headers.values()):
                raise CaptureError("the file contains pickled objects, which are not read for safety")
            wanted = [name for name, (_, dtype) in headers.items() if dtype.kind in _NUMBERS or name == "units"]
            return _named({name: archive.read(name) for name in wanted})
    except FormatError as error:
        raise CaptureError(f"the NPZ file cannot be read: {error}") from None


def _mat(file: Path) -> RecordingSource:
    """Reads the file in a separate process with limited memory."""
    most_B = unpacked_most_B(file.stat().st_size, BYTES_MAX)
    limits = {"memory_B": memory_most_B(most_B), "output_B": most_B}
    with file.open("rb") as f:
        read = confined(read_mat, f, BYTES_MAX, by="SciPy's reader of MATLAB files", imports=("scipy.io",), **limits)
    return _named(read.arrays)


_MAT_B: Final = {"double": 8, "single": 4, "logical": 1, "char": 4} | {
    f"{sign}int{8 * size}": size for sign in ("", "u") for size in (1, 2, 4, 8)
}
"""Size of one number of each MATLAB class [bytes]."""


def read_mat(file: Any, most_B: int) -> dict[str, NDArray[np.generic]]:
    """Numeric variables of a MATLAB file, and its `units`.

    Runs in a confined process, because SciPy may crash on a damaged file.

    Raises:
        FormatError: the file is of version 7.3, or its content is larger than its size allows.
    """
    try:
        held = scipy.io.whosmat(file)
    except NotImplementedError:
        raise FormatError("MATLAB 7.3 files are not supported: save the file with -v7") from None
    wanted = [each for each in held if each[2] in _MAT_B and (each[2] != "char" or each[0] == "units")]
    unpacked_B = sum(_MAT_B[kind] * math.prod(max(length, 0) for length in shape) for _, shape, kind in wanted)
    check_unpacked(os.fstat(file.fileno()).st_size, unpacked_B, most_B, TOO_MUCH)
    names = [name for name, _, _ in wanted]
    content = scipy.io.loadmat(file, variable_names=names) if names else {}
    return {name: content[name] for name in names if content[name].dtype.kind in f"{_NUMBERS}U"}


def _record(file: Path) -> RecordingSource:
    record = load_record(file)
    if record.ended is None:
        count = len(record.missing)
        warn(f"{file}: the record has no end chunk and may be truncated; {count:,} samples were read", TruncatedWarning)
    return RecordingSource(record.streams, record.rate_Hz, record.units, own_B=file.stat().st_size)


_NUMBERS: Final = "fiu"
"""Kinds of the NumPy types that are real numbers."""


def _named(arrays: Mapping[str, NDArray[Any]]) -> RecordingSource:
    """Columns from named arrays: three columns are a vector; arrays of other shapes are ignored."""
    columns: dict[str, Column] = {}
    for name, rows in arrays.items():
        if rows.dtype.kind not in _NUMBERS or rows.size <= 1:
            continue
        if rows.ndim == 2 and rows.shape[0] in (1, 3) and rows.shape[1] > 3:
            rows = rows.T
        if rows.ndim == 2 and rows.shape[1] == 1:
            rows = rows[:, 0]
        if rows.ndim == 1:
            columns[name] = rows
        elif rows.ndim == 2 and rows.shape[1] == 3:
            columns |= {f"{name}_{axis}": part for axis, part in zip(AXES, rows.T, strict=True)}
    rate, own_B = arrays.get("rate_Hz"), sum(array.nbytes for array in arrays.values())
    if rate is not None and (rate.dtype.kind not in _NUMBERS or rate.size != 1):
        raise CaptureError("rate_Hz in the file must be a single number")
    rate_Hz = None if rate is None else float(rate.reshape(-1)[0])
    return RecordingSource(columns, rate_Hz, _units(arrays.get("units")), own_B=own_B)


def _units(value: NDArray[np.generic] | None) -> dict[str, str]:
    """Units as `hapscene capture record` writes them to an NPZ file: a list of "name=unit"."""
    if value is None or value.dtype.kind != "U":
        return {}
    pairs = (str(text).partition("=") for text in value.reshape(-1)[:1000])
    return {name: unit.strip() for name, equals, unit in pairs if equals}  # MATLAB pads shorter texts with spaces
