"""Line protocol of probes, version 1, as specified in docs/reference/probe-protocol.md, and units of the quantities.

A header line declares the rate and the columns. Each sample is a line: its number modulo 65,536 and integers, which the
scales in the header convert to units. Every line ends with a checksum.
"""

import binascii
import math
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import CaptureError

__all__ = [
    "COLUMN_MAX",
    "UNITS",
    "VERSION",
    "WRAP",
    "Column",
    "Count",
    "Decoder",
    "Header",
    "Run",
    "sample_line",
    "sealed",
]

VERSION: Final = 1
MAGIC: Final = b"#hapscene-probe"

WRAP: Final = 1 << 16
"""Modulus of the sample numbers: the range of a uint16_t."""

LINE_MAX: Final = 512
"""Maximum length of a line [bytes]: a header with 12 columns. Longer data without a line end is invalid."""

COLUMN_MAX: Final = 16
"""Maximum number of columns [count]."""

JUMP_S: Final = 1.0
"""Maximum difference between sample numbers and clock before a restart of the probe is assumed [s]. It must exceed the
system buffer of a port (64 kB, 0.7 s at 921,600 baud), or a busy computer looks like a restart."""

_COLUMN: Final = re.compile(r"([A-Za-z_][A-Za-z0-9_]{0,31}):([!-)+.-9;-~°²µ·]{1,16}):([0-9.eE+-]{1,16})")
_TORN: Final = re.compile(rb"[0-9,*A-Fa-f-]*")

_LENGTH: Final = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_FORCE: Final = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3}
_ANGLE: Final = {"deg": math.pi / 180.0, "°": math.pi / 180.0, "rad": 1.0}

UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "acceleration": {"m/s2": 1.0, "m/s²": 1.0, "m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3, "mm/s2": 1e-3},
    "speed": {"m/s": 1.0, "mm/s": 1e-3},
    "position": _LENGTH,
    "force": _FORCE,
    "tangential_force": _FORCE,
    "friction": {"1": 1.0},
    "depth": _LENGTH,
    "torque": {"Nm": 1.0, "N·m": 1.0, "mNm": 1e-3, "mN·m": 1e-3},
    "grip_force": _FORCE,
    "contact_angle": _ANGLE,
    "direction": _ANGLE,
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},
}
"""Factor to SI units for each unit of each quantity. "friction" is the ratio of tangential to normal force. "depth"
increases into the surface. "position" is along the surface; speed is its derivative, and the sliding direction follows
from its first two axes. "contact_angle" is the angle between the axis of the tool and the surface normal."""


@dataclass(frozen=True)
class Column:
    """A column of the probe; the value in `unit` is the integer in the line × `scale`."""

    name: str
    unit: str
    scale: float


@dataclass(frozen=True)
class Header:
    """Header of a probe."""

    rate_Hz: float
    columns: tuple[Column, ...]


@dataclass
class Count:
    """Statistics of the received lines."""

    received: int = 0
    """received samples"""
    dropped: int = 0
    """lost samples: gaps in the numbers, including damaged lines"""
    torn: int = 0
    """damaged lines of samples"""
    garbage: int = 0
    """lines that do not follow the protocol"""
    restarts: int = 0
    """restarts of the sample numbers"""


@dataclass(frozen=True)
class Run:
    """Consecutive samples: `counts` (k, c) int64 in the scales of the columns; the first is sample `first`."""

    first: int
    counts: NDArray[np.int64]


def checksum(body: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE: polynomial 0x1021, initial value 0xFFFF; for b"123456789" it is 0x29B1."""
    return binascii.crc_hqx(body, 0xFFFF)


def sealed(body: bytes) -> bytes:
    """Return the line for a body: the body, an asterisk, its checksum in four hexadecimal digits, a line feed."""
    return b"%s*%04X\n" % (body, checksum(body))


def sample_line(number: int, counts: Iterable[int]) -> bytes:
    """Return the line of a sample."""
    return sealed(",".join(map(str, (number % WRAP, *counts))).encode())


def read_header(line: bytes) -> Header | None:
    """Parse a header line without its line end; return None if it is not a header, or damaged.

    Raises:
        CaptureError: an intact header of another version, or an invalid one.
    """
    body, _, crc = line.rpartition(b"*")
    if not body.startswith(MAGIC + b" ") or not _matches(body, crc):
        return None
    tokens = body.decode("utf-8", "replace").split()
    if tokens[1] != str(VERSION):
        raise CaptureError(
            f"the probe uses protocol version {tokens[1][:20]}, expected version {VERSION}: update its firmware or "
            "hapscene"
        )
    fields = dict(word.partition("=")[::2] for word in tokens[2:])
    rate_Hz = _number(fields.get("rate", ""))
    if not 1.0 <= rate_Hz <= 1e6:
        raise CaptureError(f"invalid header of the probe: expected rate=HZ from 1 to 1e6, found {tokens[2:]}")
    return Header(rate_Hz, _columns(fields.get("columns", "")))


def _number(text: str) -> float:
    """Parse a number; NaN if invalid."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _columns(text: str) -> tuple[Column, ...]:
    columns = []
    for part in text.split(","):
        match = _COLUMN.fullmatch(part)
        scale = _number(match[3]) if match else math.nan
        if match is None or not math.isfinite(scale) or scale == 0.0:
            raise CaptureError(
                f"invalid header of the probe: expected NAME:UNIT:SCALE, such as force:N:0.001, found {part!r}"
            )
        columns.append(Column(match[1], match[2], scale))
    if len({c.name for c in columns}) < len(columns) or len(columns) > COLUMN_MAX:
        raise CaptureError(f"invalid header of the probe: expected up to {COLUMN_MAX} distinct columns, found {text!r}")
    return tuple(columns)


def _matches(body: bytes, crc: bytes) -> bool:
    return crc in (b"%04X" % checksum(body), b"%04x" % checksum(body))


@dataclass
class Decoder:
    """Converts received data, in chunks of any size, to runs of samples with their position in time."""

    header: Header | None = None
    count: Count = field(default_factory=Count)
    position: int = 0
    """index of the next sample, counted from the first received one, including lost samples"""
    byte_count: int = 0
    """number of received bytes"""

    _rest: bytes = b""
    _number: int = -1
    _t_s: float = 0.0

    def feed(self, data: bytes, t_s: float) -> list[Run]:
        """Process data that arrived at time `t_s` of a monotonic clock [s]; return the complete samples.

        Raises:
            CaptureError: an invalid header, or one that differs from the first.
        """
        self.byte_count += len(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LINE_MAX:
            self._rest = b""
            self._count_invalid(b"?")
        runs: list[tuple[int, list[list[int]]]] = []
        for line in lines:
            line = line.removesuffix(b"\r")
            if line.startswith(b"#"):
                self._head(line)
                continue
            row = self._sample(line)
            if row is None:
                continue
            step = self._step(row[0], t_s)
            self.position += step
            if step > 1 or not runs:
                runs.append((self.position - 1, []))
            runs[-1][1].append(row[1:])
            self._number, self._t_s = row[0], t_s
        return [Run(first, np.array(rows, dtype=np.int64)) for first, rows in runs]

    def _head(self, line: bytes) -> None:
        """Store the first header; a probe repeats it, and repetitions must be equal."""
        header = read_header(line)
        if header is None:
            self._count_invalid(line)
        elif self.header is None:
            self.header = header
        elif header != self.header:
            raise CaptureError("the header of the probe changed during the recording: another rate or other columns")

    def _sample(self, line: bytes) -> list[int] | None:
        """Parse the line of a sample: its number and counts. None for other lines, which are counted."""
        if self.header is None or not line:
            return None  # before the header: the end of a line, or boot messages
        body, _, crc = line.rpartition(b"*")
        with suppress(ValueError):
            row = [int(part) for part in body.split(b",")] if _matches(body, crc) else []
            fits = len(row) == 1 + len(self.header.columns) and 0 <= row[0] < WRAP
            if fits and all(-(1 << 31) < value < 1 << 31 for value in row):
                return row
        self._count_invalid(line)
        return None

    def _step(self, number: int, t_s: float) -> int:
        """Return the distance from the previous sample by its number, and by the clock if the number is ambiguous."""
        assert self.header is not None
        self.count.received += 1
        if self._number < 0:
            return 1
        rate_Hz = self.header.rate_Hz
        by_clock = (t_s - self._t_s) * rate_Hz
        step = (number - self._number - 1) % WRAP + 1
        step += WRAP * max(0, round((by_clock - step) / WRAP))
        if step > by_clock + JUMP_S * rate_Hz:
            self.count.restarts += 1
            step = max(1, round(by_clock))
        self.count.dropped += step - 1
        return step

    def _count_invalid(self, line: bytes) -> None:
        if self.header is None:
            return
        torn = bool(_TORN.fullmatch(line)) or line.startswith(b"#")
        self.count.torn += torn
        self.count.garbage += not torn
