"""Recording from a probe on a serial port: the port is drained, decoded, displayed, and written crash-safe."""

import math
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol, TextIO

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.io.hsrec import SUFFIX, SYNC_S, VALUE_MAX, RecordWriter, load_record, save_npz, taken
from hapscene.errors import CaptureError, Codes
from hapscene.files import refusing
from hapscene.wall_clock import CLOCK, Clock
from hapscene.wire.port import BAUD, Port
from hapscene.wire.protocol import VERSION, Count, Decoder, Header, Run

__all__ = ["FULL", "REACHED", "SILENCE_S", "STOPPED", "TELL_S", "Made", "Meter", "Watcher", "record"]

TERMINAL_S: Final = 0.1
"""Time between two updates of the level meter on a terminal [s]."""

LOG_S: Final = 1.0
"""Time between two lines of the level meter where the output is no terminal [s]."""

TELL_S: Final = 0.05
"""Time between two calls of `Watcher.tell` [s]."""

SILENCE_S: Final = 5.0
"""How long a port may give no header [s]. Boards that restart when the port is opened take up to 2 s."""

MEASURED_MIN_S: Final = 5.0
"""Shortest recording whose rate is measured by the computer's clock [s]: bytes come in lumps of some 10 ms."""

STOPPED: Final = "stopped"
REACHED: Final = "the duration was reached"
FULL: Final = "the longest record was reached"


class Watcher(Protocol):
    """Follows a recording from its thread; the recording waits for every call."""

    def begin(self, header: Header) -> None:
        """Called once, before all other calls."""

    def take(self, run: Run) -> None:
        """Called with samples as they are written."""

    def tell(self, count: Count, position: int) -> None:
        """Called about every `TELL_S`: line counts, and the number of the sample after the last one."""

    def end(self, why: str) -> None:
        """Called once, after all other calls; `why` is empty where an error ended the recording."""


class Meter:
    """Level meter of a recording, a `Watcher`: RMS and peak about the mean, and losses, in one line of the terminal."""

    def __init__(self, stream: TextIO | None = None, clock: Clock = CLOCK) -> None:
        self._stream = sys.stdout if stream is None else stream
        self._clock = clock
        self._live = self._stream.isatty()
        self._period_s = TERMINAL_S if self._live else LOG_S
        self._shown_s = clock.now_s()
        self._line_open = False
        self._blocks: list[NDArray[np.int64]] = []

    def begin(self, header: Header) -> None:
        self._header = header

    def take(self, run: Run) -> None:
        self._blocks.append(run.counts)

    def tell(self, count: Count, position: int) -> None:
        now_s = self._clock.now_s()
        if now_s - self._shown_s < self._period_s:
            return
        self._shown_s, self._line_open = now_s, self._live
        line, width = self.line(count, position), shutil.get_terminal_size().columns
        for text in (Codes("\r"), line[: width - 1], Codes("\x1b[K")) if self._live else (f"{line}\n",):
            self._stream.write(text)
        self._stream.flush()

    def line(self, count: Count, position: int) -> str:
        """The state in words, since the last call."""
        levels = "  silent"
        if self._blocks:
            values = np.concatenate(self._blocks) * np.array([c.scale for c in self._header.columns])
            self._blocks = []
            away = values - values.mean(axis=0)
            each = zip(self._header.columns, np.sqrt((away**2).mean(axis=0)), np.abs(away).max(axis=0), strict=True)
            levels = "".join(f"  {column.name} {rms:.3g}/{peak:.3g} {column.unit}" for column, rms, peak in each)
        lost = f"dropped {count.dropped}, torn {count.torn}, garbage {count.garbage}"
        return f"{position / self._header.rate_Hz:7.1f} s  {lost}  rms/peak:{levels}"

    def end(self, why: str) -> None:
        if self._line_open:
            self._stream.write("\n")
            self._stream.flush()


@dataclass(frozen=True)
class Made:
    """Result of a recording."""

    path: Path
    rate_Hz: float
    length: int
    """samples, gaps included"""
    count: Count
    rate_measured_Hz: float | None
    """samples by the computer's clock; None below `MEASURED_MIN_S`"""
    ended: str
    """`STOPPED`, `REACHED`, `FULL`, or what went wrong"""

    @property
    def well(self) -> bool:
        """Whether it ended as requested."""
        return self.ended in (STOPPED, REACHED)

    def __str__(self) -> str:
        count, share = self.count, 100 * self.count.dropped / self.length
        lost = f"dropped {count.dropped} ({share:.2g} %), torn {count.torn}, garbage {count.garbage}"
        return f"{self.length / self.rate_Hz:.3f} s; {lost}: {self.ended}"


def record(
    port: str,
    path: str | os.PathLike[str],
    baud: int = BAUD,
    duration_s: float | None = None,
    stopped: Callable[[], bool] = lambda: False,
    say: Callable[[str], None] = lambda line: None,
    silence_s: float = SILENCE_S,
    *,
    watch: Sequence[Watcher] = (),
    clock: Clock = CLOCK,
) -> Made:
    """Records from a probe until it is stopped, the duration is reached, or the probe goes away.

    Args:
        port: name of the serial port, as "/dev/ttyUSB0" or "COM3".
        path: .hsrec; or .npz: then a .hsrec of the same name is written first, and converted at the end.
        baud: speed of the port [bit/s].
        duration_s: how much to record; None: until `stopped`.
        stopped: called about 20 times a second.
        say: called with each line for the user.
        silence_s: how long to wait for the probe's header.
        watch: watchers, beside the level meter.
        clock: measures silence, duration and rate.

    Raises:
        CaptureError: a port that cannot be opened, is silent or speaks another protocol; a file that exists already.
    """
    target = Path(path)
    if target.suffix not in (SUFFIX, ".npz"):
        raise CaptureError(f"{target}: records are written as {SUFFIX} or .npz")
    place = target.with_suffix(SUFFIX)
    for file in {target, place}:
        if file.exists():
            raise taken(file)
    with closing(Port(port, baud)) as opened:
        decoder, runs = _wait_for_header(opened, port, baud, silence_s, stopped, clock)
        assert decoder.header is not None
        with RecordWriter(place, decoder.header) as writer:
            names = ", ".join(f"{c.name} [{c.unit}]" for c in decoder.header.columns)
            say(f"recording {names} at {decoder.header.rate_Hz:g} Hz into {place}; Ctrl-C ends it")
            made = _follow(opened, decoder, runs, writer, duration_s, stopped, (Meter(clock=clock), *watch), clock)
    if not made.count.received:
        place.unlink()
        raise CaptureError(f"{port}: the probe announced itself but sent no samples ({made.ended}): nothing was kept")
    if target != place:
        save_npz(load_record(place), target)
        place.unlink()
    return replace(made, path=target)


def _wait_for_header(
    opened: Port, port: str, baud: int, silence_s: float, stopped: Callable[[], bool], clock: Clock
) -> tuple[Decoder, list[Run]]:
    """Reads until the probe has announced itself; returns the first runs too."""
    decoder = Decoder()
    deadline_s = clock.now_s() + silence_s
    while True:
        if stopped():
            raise KeyboardInterrupt
        piece = opened.next()
        if isinstance(piece, str):
            raise CaptureError(f"{port}: the port closed before a probe announced itself: {piece}")
        if isinstance(piece, tuple):
            with refusing(CaptureError, port):
                runs = decoder.feed(*piece)
            if decoder.header is not None:
                return decoder, runs
        if clock.now_s() > deadline_s:
            line = f"line `#hapscene-probe {VERSION} …`"
            reason = f"silent for {silence_s:g} s: expected a {line}; check the cable and that the probe runs"
            if decoder.byte_count:
                came = f"{decoder.byte_count} bytes in {silence_s:g} s at {baud} baud"
                reason = f"{came}, but no {line}: check --baud and docs/probe-protocol.md"
            raise CaptureError(f"{port}: {reason}")


def _follow(
    opened: Port,
    decoder: Decoder,
    runs: list[Run],
    writer: RecordWriter,
    duration_s: float | None,
    stopped: Callable[[], bool],
    watch: Sequence[Watcher],
    clock: Clock,
) -> Made:
    """Writes samples and informs the watchers until something ends it."""
    header = decoder.header
    assert header is not None
    begun_s = synced_s = told_s = last_s = clock.now_s()
    full = VALUE_MAX // len(header.columns)
    wanted = full if duration_s is None else min(full, round(duration_s * header.rate_Hz))
    overdue_s = begun_s + SILENCE_S + (duration_s or math.inf)
    ended = ""
    for watcher in watch:
        watcher.begin(header)
    try:
        while True:
            _keep(runs, wanted, writer, watch)
            now_s = clock.now_s()
            if now_s - synced_s >= SYNC_S:
                writer.sync()
                synced_s = now_s
            if now_s - told_s >= TELL_S:
                writer.flush()
                for watcher in watch:
                    watcher.tell(decoder.count, min(decoder.position, wanted))
                told_s = now_s
            ended = ended or _end(decoder.position, wanted, full, now_s > overdue_s, stopped())
            if ended:
                break
            piece = opened.next()
            runs = []
            if isinstance(piece, str):
                ended = f"the probe went away: {piece}"
            elif piece is not None:
                last_s = piece[1]
                try:
                    runs = decoder.feed(*piece)
                except CaptureError as error:
                    ended = str(error)
    finally:
        for watcher in watch:
            watcher.end(ended)
    count, elapsed_s = decoder.count, last_s - begun_s
    writer.end(ended, received=count.received, dropped=count.dropped, torn=count.torn, garbage=count.garbage)
    measured = decoder.position / elapsed_s if elapsed_s >= MEASURED_MIN_S else None
    return Made(writer.path, header.rate_Hz, min(decoder.position, wanted), count, measured, ended)


def _keep(runs: list[Run], wanted: int, writer: RecordWriter, watch: Sequence[Watcher]) -> None:
    """Writes the samples within the wanted length."""
    for run in runs:
        counts = run.counts[: max(0, wanted - run.first)]
        if len(counts):
            kept = Run(run.first, counts)
            writer.write(kept)
            for watcher in watch:
                watcher.take(kept)


def _end(position: int, wanted: int, full: int, overdue: bool, stopped: bool) -> str:
    """Why the recording ends now; empty where it goes on."""
    if position >= wanted:
        return FULL if wanted == full else REACHED
    if overdue:
        return "the probe sent too few samples in the requested time"
    return STOPPED if stopped else ""
