"""Probe records (.hsrec): a crash-safe file format for recordings.

The file begins with the line `hapscene record 1`. Chunks follow, little-endian:

    kind     4 bytes   HEAD, DATA or END. (files of earlier versions also contain TIME, which is skipped)
    length   uint32    length of the payload [bytes]
    first    uint64    number of the chunk's first sample; 0 in HEAD and END.
    payload            HEAD, END.: JSON; DATA: int32 counts, one row per sample
    check    uint32    CRC-32 of all the fields above

A DATA chunk holds consecutive samples. Samples between two chunks were dropped. The writer only appends, and syncs the
file to the disk about once per second, so a crash or a loss of power costs at most the last second. The reader accepts
an incomplete chunk at the end of the file.
"""

import json
import math
import os
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import CaptureError
from hapscene.io.files import check_memory, read_bytes, refusing, whole_file
from hapscene.io.probe_protocol import COLUMN_MAX, Column, Header, Run

__all__ = [
    "SUFFIX",
    "SYNC_S",
    "VALUE_MAX",
    "Record",
    "RecordWriter",
    "TruncatedWarning",
    "load_record",
    "save_npz",
]

SUFFIX: Final = ".hsrec"
FIRST_LINE: Final = b"hapscene record 1\n"

SYNC_S: Final = 1.0
"""Longest time between two syncs to the disk [s]. A loss of power can cost this much, a killed process less."""

VALUE_MAX: Final = 1 << 28
"""Largest number of values of a record, dropped samples included: 1.8 hours of four columns at 10 kHz, 2 GiB."""

RUN_MAX: Final = 4096
"""Largest number of samples in a chunk; limits the loss at the end of a truncated file."""

PAYLOAD_MAX: Final = 4 * RUN_MAX * COLUMN_MAX
"""Longest payload that the reader looks for after a damaged chunk [bytes]."""

JSON_MAX: Final = 65_536
"""Longest HEAD or END. payload [bytes]; a record of 16 columns needs 2,000."""

_CHUNK: Final = struct.Struct("<4sIQ")
_CHECK: Final = struct.Struct("<I")


@dataclass(frozen=True)
class Record:
    """Streams at a constant sample rate, (n,) float64 each, in their units; dropped samples are NaN."""

    rate_Hz: float
    streams: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str] = field(default_factory=dict)
    ended: str | None = None
    """why the recording ended; None for a truncated record (process killed, power lost) or one still being written"""

    @property
    def duration_s(self) -> float:
        return len(next(iter(self.streams.values()))) / self.rate_Hz

    @property
    def missing(self) -> NDArray[np.bool_]:
        """(n,) True for each dropped sample."""
        return np.isnan(next(iter(self.streams.values())))


class TruncatedWarning(UserWarning):
    """A record has no end chunk: the recording process was killed, or the end of the file was lost."""


class RecordWriter:
    """Writes a new record by appending chunks. Use it in a `with` statement."""

    def __init__(self, path: str | os.PathLike[str], header: Header) -> None:
        """Creates the file and writes its header.

        Raises:
            CaptureError: the suffix is not .hsrec, or the file exists already.
        """
        self.path = Path(path)
        if self.path.suffix != SUFFIX:
            raise CaptureError(f"{self.path}: invalid suffix of a record; expected {SUFFIX}")
        try:
            self._file = self.path.open("xb", buffering=0)  # a killed process loses nothing
        except FileExistsError:
            raise CaptureError(
                f"{self.path}: the file exists already and recordings are never overwritten: choose another name"
            ) from None
        except OSError as error:
            raise CaptureError(f"{self.path}: cannot be written: {error.strerror}") from None
        head = {"rate_Hz": header.rate_Hz, "columns": [asdict(c) for c in header.columns]}
        self._write(FIRST_LINE)
        self._put(b"HEAD", 0, json.dumps(head).encode())
        self.sync()

    def __enter__(self) -> "RecordWriter":
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(OSError):  # a full disk was reported by `sync`
            self._file.close()

    def write(self, run: Run) -> None:
        """Appends samples; the next `sync` puts them on the disk."""
        for start in range(0, len(run.counts), RUN_MAX):
            part = run.counts[start : start + RUN_MAX]
            self._put(b"DATA", run.first + start, part.astype("<i4").tobytes())

    def sync(self) -> None:
        """Puts all chunks on the disk, so that a loss of power does not lose them."""
        with self._writing():
            os.fsync(self._file.fileno())

    def end(self, how: str, **facts: float) -> None:
        """Appends the end chunk: why the recording ended, and its sample counts."""
        self._put(b"END.", 0, json.dumps({"ended": how, **facts}).encode())
        self.sync()

    def _put(self, kind: bytes, first: int, payload: bytes) -> None:
        body = _CHUNK.pack(kind, len(payload), first) + payload
        self._write(body + _CHECK.pack(zlib.crc32(body)))

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        with self._writing():
            while left:  # on a disk that becomes full, a part is written
                left = left[self._file.write(left) :]

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            kept = "the samples recorded before are in the file"
            raise CaptureError(f"{self.path}: cannot be written: {error.strerror}; {kept}") from None


def load_record(path: str | os.PathLike[str]) -> Record:
    """Reads a record, also a truncated one.

    Raises:
        CaptureError: the file is not a record, is of a later version, is too long, or contains no complete chunk of
            samples.
    """
    with refusing(CaptureError):
        data = read_bytes(Path(path), 4 * VALUE_MAX + (1 << 20), "record")
    with refusing(CaptureError, path):
        return _parsed(data)


def _parsed(data: bytes) -> Record:
    if not data.startswith(FIRST_LINE):
        later = data.startswith(FIRST_LINE.split(b"1")[0])
        raise CaptureError("record of a later version: update hapscene" if later else "not a probe record")
    kind, _, payload = next(_chunks(data), (b"", 0, memoryview(b"")))
    if kind != b"HEAD":
        raise CaptureError("truncated within its header: no samples can be read")
    rate_Hz, columns = _head(_json(payload))
    row_B, length, ended = 4 * len(columns), 0, None
    for kind, first, payload in _chunks(data):
        if kind == b"DATA" and len(payload) % row_B == 0:
            length = max(length, first + len(payload) // row_B)
        elif kind == b"END.":
            ended = str(_json(payload).get("ended"))
    if not length:
        raise CaptureError("the record contains no samples")
    if length * len(columns) > VALUE_MAX:
        raise CaptureError(f"{length} samples of {len(columns)} columns exceed the limit of {VALUE_MAX} values")
    needed_B = len(data) + 8 * length * len(columns)
    check_memory(needed_B, len(data), f"a record of {length:,} samples, dropped ones included,", "record it again")
    streams = {column.name: np.full(length, np.nan) for column in columns}
    for kind, first, payload in _chunks(data):  # read twice, because a list of millions of chunks needs much memory
        if kind == b"DATA" and len(payload) % row_B == 0:
            rows = np.frombuffer(payload, dtype="<i4").reshape(-1, len(columns))
            for stream, counts in zip(streams.values(), rows.T, strict=True):
                stream[first : first + len(rows)] = counts
    for column in columns:
        streams[column.name] *= column.scale
    return Record(rate_Hz, streams, {c.name: c.unit for c in columns}, ended)


def save_npz(record: Record, path: Path, provenance: str = "") -> None:
    """Writes the streams as NumPy arrays by name, with `rate_Hz` and `units` ("name=unit"), without pickle."""
    units = [f"{name}={unit}" for name, unit in record.units.items()]
    arrays = {**record.streams, "rate_Hz": np.array(record.rate_Hz), "units": np.array(units)}
    if provenance:
        arrays["provenance"] = np.array(provenance)
    try:
        with whole_file(path) as part:
            np.savez_compressed(part, **arrays)  # type: ignore[arg-type]
    except OSError as error:
        raise CaptureError(f"{path}: cannot be written: {error.strerror}") from None


def _chunks(data: bytes) -> Iterator[tuple[bytes, int, memoryview]]:
    """Yields kind, first sample and payload of each chunk, up to the first damaged one.

    Raises:
        CaptureError: valid chunks follow the damaged one: samples are lost within the file and not only at its end.
    """
    at = len(FIRST_LINE)
    while (chunk := _chunk(data, at)) is not None:
        yield chunk
        at += _CHUNK.size + len(chunk[2]) + _CHECK.size
    kinds = re.compile(rb"DATA|TIME|END\.").finditer(data, at + 1)
    if any(_chunk(data, found.start(), PAYLOAD_MAX) is not None for found in islice(kinds, 1000)):
        raise CaptureError(f"damaged at byte {at:,}: samples are lost within the file, not only at its end")


def _chunk(data: bytes, at: int, most_B: int = 1 << 32) -> tuple[bytes, int, memoryview] | None:
    """Kind, first sample and payload of the chunk at a byte; None if it is damaged or longer than `most_B`."""
    if at + _CHUNK.size + _CHECK.size > len(data):
        return None
    kind, length, first = _CHUNK.unpack_from(data, at)
    end, view = at + _CHUNK.size + length, memoryview(data)
    if length > most_B or end + _CHECK.size > len(data):
        return None
    whole = zlib.crc32(view[at:end]) == _CHECK.unpack_from(data, end)[0]
    return (kind, first, view[at + _CHUNK.size : end]) if whole else None


def _json(payload: memoryview) -> dict[str, object]:
    try:
        content = json.loads(bytes(payload[:JSON_MAX]))
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise CaptureError("the header or end chunk is not valid JSON")
    return content


def _head(head: Mapping[str, object]) -> tuple[float, list[Column]]:
    """Sample rate and columns of the header, checked, since the file may come from another program."""
    try:
        rate_Hz = float(head["rate_Hz"])  # type: ignore[arg-type]
        listed = list(head["columns"])  # type: ignore[call-overload]
        columns = [Column(str(c["name"]), str(c["unit"]), float(c["scale"])) for c in listed]
    except (KeyError, TypeError, ValueError, OverflowError):
        raise CaptureError("the header lacks the sample rate or the columns") from None
    fits = 0.0 < rate_Hz < math.inf and all(math.isfinite(c.scale) for c in columns)
    if not fits or not 1 <= len({c.name for c in columns}) == len(columns) <= COLUMN_MAX:
        raise CaptureError("the header has an invalid sample rate, scale or list of columns")
    return rate_Hz, columns
