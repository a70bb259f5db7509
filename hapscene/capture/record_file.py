"""Records: what a probe sent, in a file that can be read up to its last second whatever ends the writing.

The file (suffix .hsrec) begins with the line `hapscene record 1`. Chunks follow, little-endian:

    kind     4 bytes   HEAD, DATA, TIME or END.
    length   uint32    of the payload [bytes]
    first    uint64    number of the chunk's first sample; 0 in HEAD and END.
    payload            HEAD, END.: JSON; DATA: int32 counts, a row a sample; TIME: float64, as below
    check    uint32    CRC-32 of all the above

A chunk of data is a run of samples without a gap: what lies between two chunks was dropped. The file is only ever
appended to, and put on the disk about each second. A reader stops at a chunk that is torn, if it is the last.

A chunk of time, about each second, says when the computer had the samples before `first`: its monotonic clock [s]. Two
records whose headers say the same `clock` were made beside each other, by one such clock.
"""

import datetime
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
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import CaptureError
from hapscene.files import check_memory, read_bytes, refusing, whole_file
from hapscene.wire.protocol import COLUMN_MAX, Column, Header, Run

SUFFIX: Final = ".hsrec"
FIRST_LINE: Final = b"hapscene record 1\n"

SYNC_S: Final = 1.0
"""Longest time that samples wait before they are on the disk [s]: what a power cut can take. A kill takes less."""

VALUE_MAX: Final = 1 << 28
"""Most values of a record, gaps included [count]: 1.8 hours of four columns at 10 kHz, 2 GiB in memory."""

RUN_MAX: Final = 4096
"""Most samples of a chunk [count]: bounds what is torn at the end."""

PAYLOAD_MAX: Final = 4 * RUN_MAX * COLUMN_MAX
"""Longest payload that is looked for behind a torn chunk [bytes]."""

CLOCK_MAX: Final = 1 << 16
"""Most times of the computer's clock that are read of a record [count]: 18 hours of them."""

JSON_MAX: Final = 65_536
"""Longest header or end [bytes]; those of 16 columns have 2,000."""

_CHUNK: Final = struct.Struct("<4sIQ")
_CHECK: Final = struct.Struct("<I")
_TIME: Final = struct.Struct("<d")


@dataclass(frozen=True)
class Record:
    """The streams of a probe: each (n,) float64 in its unit, NaN where samples were dropped."""

    rate_Hz: float
    streams: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str]
    started: str
    """date and time of the start, ISO 8601"""
    ended: str | None
    """how the recording ended; None where it was cut: killed, power lost, or still running"""
    clock: str = ""
    """records that say the same were made by one clock of a computer, beside each other"""
    clock_s: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    """(k, 2): so many samples, and what the computer's clock read when it had them [s]; never before they were taken"""

    @property
    def missing(self) -> NDArray[np.bool_]:
        """(n,) whether the sample was dropped."""
        return np.isnan(next(iter(self.streams.values())))


class CutWarning(UserWarning):
    """A record ends without the word of its end, as one does whose recording was killed, and one that lost it."""


def taken(path: Path) -> CaptureError:
    """What is said of a file that a recording would replace."""
    return CaptureError(f"{path}: is there already, and a recording is never replaced: take another name")


class RecordWriter:
    """Appends to a new record. To be used with `with`; a record that is cut short stays readable."""

    def __init__(self, path: str | os.PathLike[str], header: Header, clock: str = "") -> None:
        """Begins the file; `clock` is as in `Record`.

        Raises:
            CaptureError: another suffix; a file that is there already, for a recording cannot be made again.
        """
        self.path = Path(path)
        if self.path.suffix != SUFFIX:
            raise CaptureError(f"{self.path}: a record's file name must end in {SUFFIX}")
        try:
            self._file: BinaryIO = self.path.open("xb")
        except FileExistsError:
            raise taken(self.path) from None
        except OSError as error:
            raise CaptureError(f"{self.path}: cannot be written: {error.strerror}") from None
        started = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        columns = [asdict(c) for c in header.columns]
        head = {"rate_Hz": header.rate_Hz, "started": started, "columns": columns, "clock": clock}
        self._file.write(FIRST_LINE)
        self._put(b"HEAD", 0, json.dumps(head).encode())
        self.sync()

    def __enter__(self) -> "RecordWriter":
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(OSError):  # a full disk was told already, or is by `sync`
            self._file.close()

    def write(self, run: Run) -> None:
        """Appends samples; they are safe after the next `sync`."""
        for start in range(0, len(run.counts), RUN_MAX):
            part = run.counts[start : start + RUN_MAX]
            self._put(b"DATA", run.first + start, part.astype("<i4").tobytes())

    def write_time(self, count: int, time_s: float) -> None:
        """Notes when the first `count` samples were there, by the computer's monotonic clock [s]."""
        self._put(b"TIME", count, _TIME.pack(time_s))

    def flush(self) -> None:
        """Gives what was written to the system: it is safe from a kill.

        Raises:
            CaptureError: the disk is full or gone.
        """
        with self._writing():
            self._file.flush()

    def sync(self) -> None:
        """Puts what was written on the disk: it is safe from a loss of power.

        Raises:
            CaptureError: the disk is full or gone.
        """
        with self._writing():
            self._file.flush()
            os.fsync(self._file.fileno())

    def end(self, how: str, **facts: float) -> None:
        """Ends the record properly: how it ended, and facts about it."""
        self._put(b"END.", 0, json.dumps({"ended": how, **facts}).encode())
        self.sync()

    def _put(self, kind: bytes, first: int, payload: bytes) -> None:
        body = _CHUNK.pack(kind, len(payload), first) + payload
        with self._writing():
            self._file.write(body + _CHECK.pack(zlib.crc32(body)))

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            said = f"{self.path}: cannot be written on: {error.strerror}; what was recorded before is in it"
            raise CaptureError(said) from None


def load_record(path: str | os.PathLike[str]) -> Record:
    """Reads a record, whole or cut.

    Raises:
        CaptureError: no record, of a later version, too long, or without one whole chunk of samples.
    """
    with refusing(CaptureError):
        data = read_bytes(Path(path), 4 * VALUE_MAX + (1 << 20), "record")
    with refusing(CaptureError, path):
        return parse_record(data)


def parse_record(data: bytes) -> Record:
    """The record of a file's content; as `load_record`, but its errors do not name the file.

    Raises:
        FormatError: as there.
    """
    if not data.startswith(FIRST_LINE):
        later = data.startswith(FIRST_LINE.split(b"1")[0])
        raise CaptureError("a record of a later version: update hapscene" if later else "not a record of a probe")
    kind, _, payload = next(_chunks(data), (b"", 0, memoryview(b"")))
    if kind != b"HEAD":
        raise CaptureError("cut before its header was whole: nothing can be read")
    head = _json(payload)
    rate_Hz, columns = _head(head)
    length, ended = 0, None
    clock_s: list[tuple[float, float]] = []
    for kind, first, payload in _chunks(data):
        if kind == b"DATA" and len(payload) % (4 * len(columns)) == 0:
            length = max(length, first + len(payload) // (4 * len(columns)))
        elif kind == b"END.":
            ended = str(_json(payload).get("ended"))
        elif kind == b"TIME" and len(payload) == _TIME.size and len(clock_s) < CLOCK_MAX:
            time_s = float(_TIME.unpack(payload)[0])
            clock_s += [(first, time_s)] if math.isfinite(time_s) and first <= VALUE_MAX else []
    if not length:
        raise CaptureError("holds no samples")
    if length * len(columns) > VALUE_MAX:
        raise CaptureError(f"{length} samples of {len(columns)} columns are more than {VALUE_MAX} values")
    needed_B = len(data) + 8 * length * len(columns)
    check_memory(needed_B, len(data), f"{length:,} samples, dropped ones among them,", "record it anew")
    streams = {column.name: np.full(length, np.nan) for column in columns}
    for kind, first, payload in _chunks(data):  # gone through twice rather than kept: there may be millions
        if kind == b"DATA" and len(payload) % (4 * len(columns)) == 0:
            rows = np.frombuffer(payload, dtype="<i4").reshape(-1, len(columns))
            for stream, counts in zip(streams.values(), rows.T, strict=True):
                stream[first : first + len(rows)] = counts
    for column in columns:
        streams[column.name] *= column.scale
    told = str(head.get("started")), ended, str(head.get("clock", ""))
    return Record(rate_Hz, streams, {c.name: c.unit for c in columns}, *told, np.array(clock_s).reshape(-1, 2))


def save_npz(record: Record, path: Path, provenance: str = "") -> None:
    """Writes the streams as NumPy arrays of their names, with `rate_Hz` and `units` ("name=unit"), without pickle."""
    units = np.array([f"{name}={unit}" for name, unit in record.units.items()])
    arrays: dict[str, Any] = {**record.streams, "rate_Hz": record.rate_Hz, "units": units}
    if provenance:
        arrays["provenance"] = np.array(provenance)
    try:
        with whole_file(path) as part:
            np.savez_compressed(part, **arrays)
    except OSError as error:
        raise CaptureError(f"{path}: cannot be written: {error.strerror}") from None


def _chunks(data: bytes) -> Iterator[tuple[bytes, int, memoryview]]:
    """Kind, first sample and payload of each chunk, up to the first that is torn.

    Raises:
        CaptureError: another one follows that: not the end is missing, but something within.
    """
    at = len(FIRST_LINE)
    while (chunk := _chunk(data, at)) is not None:
        yield chunk
        at += _CHUNK.size + len(chunk[2]) + _CHECK.size
    kinds = re.compile(rb"DATA|TIME|END\.").finditer(data, at + 1)
    if any(_chunk(data, found.start(), PAYLOAD_MAX) is not None for found in islice(kinds, 1000)):
        raise CaptureError(f"damaged at byte {at:,}: samples are lost there, and others follow")


def _chunk(data: bytes, at: int, most_B: int = 1 << 32) -> tuple[bytes, int, memoryview] | None:
    """Kind, first sample and payload of the chunk that begins there; None if it is torn, or longer than that."""
    if at + _CHUNK.size + _CHECK.size > len(data):
        return None
    kind, length, first = _CHUNK.unpack_from(data, at)
    end, view = at + _CHUNK.size + length, memoryview(data)
    if length > most_B or end + _CHECK.size > len(data):
        return None
    whole = zlib.crc32(view[at:end]) == _CHECK.unpack_from(data, end)[0]
    return (kind, first, view[at + _CHUNK.size : end]) if whole else None


def _json(payload: memoryview) -> dict[str, Any]:
    try:
        content = json.loads(bytes(payload[:JSON_MAX]))
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise CaptureError("a record whose header or end is not as hapscene writes it")
    return content


def _head(head: Mapping[str, Any]) -> tuple[float, list[Column]]:
    """Rate and columns, checked: the file may be anybody's."""
    try:
        rate_Hz = float(head["rate_Hz"])
        columns = [Column(str(c["name"]), str(c["unit"]), float(c["scale"])) for c in head["columns"]]
    except (KeyError, TypeError, ValueError, OverflowError):
        raise CaptureError("a record whose header lacks its rate or columns") from None
    fits = 0.0 < rate_Hz < math.inf and all(math.isfinite(c.scale) for c in columns)
    if not fits or not 1 <= len({c.name for c in columns}) == len(columns) <= COLUMN_MAX:
        raise CaptureError("a record whose header has an impossible rate, scale or list of columns")
    return rate_Hz, columns
