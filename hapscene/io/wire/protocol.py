"""The line protocol of probes, version 1: what docs/probe-protocol.md says, read and written.

A header names the rate and the columns; then comes a line a sample: its number, which wraps at 65,536, and whole
numbers that the header's scales turn into units. Every line ends with a checksum.
"""

import binascii
import math
import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import CaptureError

__all__ = [
    "COLUMN_MAX",
    "LINE_MAX",
    "VERSION",
    "WRAP",
    "Column",
    "Count",
    "Decoder",
    "Header",
    "Run",
    "checksum",
    "header_line",
    "read_header",
    "sample_line",
    "sealed",
]

VERSION: Final = 1
MAGIC: Final = b"#hapscene-probe"

WRAP: Final = 1 << 16
"""Sample numbers count modulo this: a probe's uint16_t, which overflows by itself."""

LINE_MAX: Final = 512
"""Longest line [bytes]: a header of 12 columns. More without an end of line is garbage."""

COLUMN_MAX: Final = 16
"""Most columns of a probe [count]."""

JUMP_S: Final = 1.0
"""How far the sample numbers may disagree with the clock before they are taken to start anew [s]. Must exceed what
the system buffers of a port (64 kB, 0.7 s at 921,600 baud), or a busy computer looks like a probe that restarts."""

_COLUMN: Final = re.compile(r"([A-Za-z_][A-Za-z0-9_]{0,31}):([!-)+.-9;-~°²µ·]{1,16}):([0-9.eE+-]{1,16})")
_TORN: Final = re.compile(rb"[0-9,*A-Fa-f-]*")


@dataclass(frozen=True)
class Column:
    """A stream of the probe: value in `unit` = the whole number in the line × `scale`."""

    name: str
    unit: str
    scale: float


@dataclass(frozen=True)
class Header:
    """What a probe announces."""

    rate_Hz: float
    columns: tuple[Column, ...]


@dataclass
class Count:
    """What became of the lines."""

    received: int = 0
    """samples taken"""
    dropped: int = 0
    """samples that never came whole: the gaps in the numbers, torn lines among them"""
    torn: int = 0
    """lines of a sample that were cut, joined or changed"""
    garbage: int = 0
    """lines that are none of the protocol"""
    restarts: int = 0
    """times that the probe began to count anew"""


@dataclass(frozen=True)
class Run:
    """Samples without a gap: `counts` (k, c) int64 in the columns' scales, the first of them sample `first`."""

    first: int
    counts: NDArray[np.int64]


def checksum(body: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected; of b"123456789" it is 0x29B1."""
    return binascii.crc_hqx(body, 0xFFFF)


def sealed(body: bytes) -> bytes:
    """The line: `body`, a star, its checksum in four hexadecimal digits, end of line."""
    return b"%s*%04X\n" % (body, checksum(body))


def header_line(header: Header) -> bytes:
    """The header's line."""
    columns = ",".join(f"{c.name}:{c.unit}:{c.scale!r}" for c in header.columns)
    return sealed(f"{MAGIC.decode()} {VERSION} rate={header.rate_Hz:.12g} columns={columns}".encode())


def sample_line(number: int, counts: Iterable[int]) -> bytes:
    """The line of sample `number`."""
    return sealed(",".join(map(str, (number % WRAP, *counts))).encode())


def read_header(line: bytes) -> Header | None:
    """The header in a line without its end; None where the line is none, or damaged.

    Raises:
        CaptureError: a whole header, of another version or against the protocol.
    """
    body, _, crc = line.rpartition(b"*")
    if not body.startswith(MAGIC + b" ") or not _matches(body, crc):
        return None
    words = body.decode("utf-8", "replace").split()
    if words[1] != str(VERSION):
        raise CaptureError(
            f"the probe speaks version {words[1][:20]} of the protocol, read here is {VERSION}: "
            "use firmware and hapscene that fit"
        )
    fields = dict(word.partition("=")[::2] for word in words[2:])
    rate_Hz = _number(fields.get("rate", ""))
    if not 1.0 <= rate_Hz <= 1e6:
        raise CaptureError(f"the probe's header must say rate=HZ, 1 to 1e6; it is {words[2:]}")
    return Header(rate_Hz, _columns(fields.get("columns", "")))


def _number(text: str) -> float:
    """The number that a text says, NaN where it says none."""
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
                f"the probe's header must say columns=NAME:UNIT:SCALE,…, as acceleration:m/s2:0.001; it has {part!r}"
            )
        columns.append(Column(match[1], match[2], scale))
    if len({c.name for c in columns}) < len(columns) or len(columns) > COLUMN_MAX:
        raise CaptureError(f"the probe's header must name at most {COLUMN_MAX} columns, each once: {text!r}")
    return tuple(columns)


def _matches(body: bytes, crc: bytes) -> bool:
    return crc in (b"%04X" % checksum(body), b"%04x" % checksum(body))


@dataclass
class Decoder:
    """Turns what a port gives, in pieces of any size, into runs of samples at their place in time."""

    header: Header | None = None
    count: Count = field(default_factory=Count)
    position: int = 0
    """the sample after the last one, counted from the first that was taken; gaps count"""
    byte_count: int = 0
    """bytes taken in, of whatever kind"""

    _rest: bytes = b""
    _number: int = -1
    _t_s: float = 0.0

    def feed(self, data: bytes, t_s: float) -> list[Run]:
        """Takes in what came at time `t_s` [s] of any steady clock; gives the samples that are whole now.

        Raises:
            CaptureError: a header of another version, against the protocol, or unlike the first one.
        """
        self.byte_count += len(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LINE_MAX:
            self._rest = b""
            self._spoilt(b"?")
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
        """The first header is taken; later ones, which a probe repeats, must say the same."""
        header = read_header(line)
        if header is None:
            self._spoilt(line)
        elif self.header is None:
            self.header = header
        elif header != self.header:
            raise CaptureError("the probe announced another rate or other columns than at the start")

    def _sample(self, line: bytes) -> list[int] | None:
        """Number and counts of a sample's line; None for any other line, which is counted."""
        if self.header is None or not line:
            return None  # what comes before the header cannot be understood: the tail of a line, a boot message
        body, _, crc = line.rpartition(b"*")
        with suppress(ValueError):
            row = [int(part) for part in body.split(b",")] if _matches(body, crc) else []
            fits = len(row) == 1 + len(self.header.columns) and 0 <= row[0] < WRAP
            if fits and all(-(1 << 31) < value < 1 << 31 for value in row):
                return row
        self._spoilt(line)
        return None

    def _step(self, number: int, t_s: float) -> int:
        """How many samples this one is after the last: by its number, and by the clock where that is ambiguous."""
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

    def _spoilt(self, line: bytes) -> None:
        if self.header is None:
            return
        torn = bool(_TORN.fullmatch(line)) or line.startswith(b"#")
        self.count.torn += torn
        self.count.garbage += not torn
