"""Recording from a probe on a serial port: the port is drained, decoded, shown, and written crash-safe."""

import math
import os
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol, TextIO

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.record_file import SUFFIX, SYNC_S, VALUE_MAX, RecordWriter, load_record, save_npz, taken
from hapscene.errors import CaptureError, Codes
from hapscene.files import refusing
from hapscene.wire.port import BAUD, Port
from hapscene.wire.protocol import VERSION, Column, Count, Decoder, Header, Run

# The level meter of a recording: what each stream does just now, in one line of the terminal.


TERMINAL_S: Final = 0.1
"""Time between two states of the line on a terminal [s]."""

LOG_S: Final = 1.0
"""Time between two lines where the output is no terminal [s]."""


class Meter:
    """Shows root mean square and peak about the mean, since the last time it was shown, and what was lost."""

    def __init__(self, columns: Sequence[Column], rate_Hz: float, stream: TextIO | None = None) -> None:
        self._columns = columns
        self._rate_Hz = rate_Hz
        self._stream = sys.stdout if stream is None else stream
        self._live = self._stream.isatty()
        self.period_s = TERMINAL_S if self._live else LOG_S
        self._pieces: list[NDArray[np.int64]] = []
        self._shown_s: float | None = None

    def take(self, counts: NDArray[np.int64]) -> None:
        """Takes samples in, (k, c)."""
        self._pieces.append(counts)

    def show(self, position: int, count: Count, now_s: float) -> None:
        """Shows the state, if it is time for it."""
        if self._shown_s is None:
            self._shown_s = now_s
        if now_s - self._shown_s < self.period_s:
            return
        self._shown_s = now_s
        line, width = self.line(position, count), shutil.get_terminal_size().columns
        for sign in (Codes("\r"), line[: width - 1], Codes("\x1b[K")) if self._live else (f"{line}\n",):
            self._stream.write(sign)
        self._stream.flush()

    def line(self, position: int, count: Count) -> str:
        """The state in words, since the last time that it was asked for."""
        levels = "  silent"
        if self._pieces:
            values = np.concatenate(self._pieces) * np.array([c.scale for c in self._columns])
            self._pieces = []
            away = values - values.mean(axis=0)
            each = zip(self._columns, np.sqrt((away**2).mean(axis=0)), np.abs(away).max(axis=0), strict=True)
            levels = "".join(f"  {column.name} {rms:.3g}/{peak:.3g} {column.unit}" for column, rms, peak in each)
        lost = f"dropped {count.dropped}, torn {count.torn}, garbage {count.garbage}"
        return f"{position / self._rate_Hz:7.1f} s  {lost}  rms/peak:{levels}"  # the end is cut where it is too long

    def close(self) -> None:
        """Leaves the line, so that what is said next stands below it."""
        if self._live and self._shown_s is not None:
            self._stream.write("\n")
            self._stream.flush()


TELL_S: Final = 0.05
"""Time between two words to who watches a recording [s]."""


class Watcher(Protocol):
    """Looks on while a recording is made, from its thread: whoever takes long here has the probe wait."""

    def begin(self, header: Header) -> None:
        """What will come; called once, before all else."""

    def take(self, run: Run) -> None:
        """Samples, as they are written."""

    def tell(self, count: Count, position: int) -> None:
        """How it stands, every `TELL_S` or so: what became of the lines, and the sample after the last one."""

    def end(self, why: str) -> None:
        """It has ended; `why` is empty where an error ended it. Called once, after all else."""


SILENCE_S: Final = 5.0
"""How long a port may give no header [s]. Boards that restart when the port is opened take up to 2 s."""

MEASURED_MIN_S: Final = 5.0
"""Shortest recording whose rate is held against the computer's clock [s]: bytes come in lumps of some 10 ms."""

_Stopped = Callable[[], bool]

STOPPED: Final = "stopped"
REACHED: Final = "the duration was reached"
FULL: Final = "the longest record was reached"


@dataclass(frozen=True)
class Made:
    """What a recording made."""

    path: Path
    rate_Hz: float
    length: int
    """samples, gaps included"""
    count: Count
    rate_measured_Hz: float | None
    """samples over the computer's clock; None below `MEASURED_MIN_S`, where it says little"""
    ended: str
    """`STOPPED`, `REACHED`, `FULL`, or what went wrong"""

    @property
    def well(self) -> bool:
        """Whether it ended as it was asked to."""
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
    clock: str = "",
) -> Made:
    """Records from a probe until it is stopped, the duration is reached, or the probe goes away.

    Args:
        port: name of the serial port, as "/dev/ttyUSB0" or "COM3".
        path: .hsrec; or .npz: then the record stands beside it as .hsrec while it is made, and becomes it at the end.
        baud: speed of the port [bit/s].
        duration_s: how much to record; None: until `stopped`.
        stopped: asked about 20 times a second.
        say: called with each line for the user.
        silence_s: how long to wait for the probe's header.
        watch: who looks on.
        clock: noted in the record; those of sources that are recorded beside each other have the same.

    Raises:
        CaptureError: a port that cannot be opened, is silent or speaks another protocol; a file that is there already.
    """
    target = Path(path)
    if target.suffix not in (SUFFIX, ".npz"):
        raise CaptureError(f"{target}: records are written as {SUFFIX} or .npz")
    place = target.with_suffix(SUFFIX)
    for file in {target, place}:
        if file.exists():
            raise taken(file)
    with closing(Port(port, baud)) as opened:
        decoder, runs = _wait_for_header(opened, port, baud, silence_s, stopped)
        assert decoder.header is not None
        with RecordWriter(place, decoder.header, clock) as writer:
            names = ", ".join(f"{c.name} [{c.unit}]" for c in decoder.header.columns)
            say(f"recording {names} at {decoder.header.rate_Hz:g} Hz into {place}; Ctrl-C ends it")
            made = _follow(opened, decoder, runs, writer, duration_s, stopped, watch)
    if not made.count.received:
        place.unlink()
        raise CaptureError(f"{port}: the probe announced itself but sent no samples ({made.ended}): nothing was kept")
    if target != place:
        save_npz(load_record(place), target)
        place.unlink()
    return replace(made, path=target)


def _wait_for_header(
    opened: Port, port: str, baud: int, silence_s: float, stopped: _Stopped
) -> tuple[Decoder, list[Run]]:
    """Reads until the probe has announced itself; gives the runs that came with it too."""
    decoder = Decoder()
    deadline_s = time.monotonic() + silence_s
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
        if time.monotonic() > deadline_s:
            line, came = f"line `#hapscene-probe {VERSION} …`", f"{decoder.byte_count} bytes in {silence_s:g} s"
            said = f"silent for {silence_s:g} s: expected a {line}; check the cable and that the probe runs"
            if decoder.byte_count:
                said = f"{came} at {baud} baud, but no {line}: check --baud and docs/probe-protocol.md"
            raise CaptureError(f"{port}: {said}")


def _follow(
    opened: Port,
    decoder: Decoder,
    runs: list[Run],
    writer: RecordWriter,
    duration_s: float | None,
    stopped: _Stopped,
    watch: Sequence[Watcher],
) -> Made:
    """Writes and shows samples until something ends it."""
    header = decoder.header
    assert header is not None
    meter, soonest = Meter(header.columns, header.rate_Hz), _Soonest(header.rate_Hz)
    begun_s = synced_s = told_s = last_s = time.monotonic()
    full = VALUE_MAX // len(header.columns)
    wanted = full if duration_s is None else min(full, round(duration_s * header.rate_Hz))
    overdue_s = begun_s + SILENCE_S + (duration_s or math.inf)
    ended = ""
    for watcher in watch:
        watcher.begin(header)
    try:
        while True:
            _keep(runs, wanted, writer, meter, watch)
            now_s = time.monotonic()
            if now_s - synced_s >= SYNC_S:
                soonest.note(writer)
                writer.sync()
                synced_s = now_s
            meter.show(min(decoder.position, wanted), decoder.count, now_s)
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
                soonest.take(decoder.position, last_s)
    finally:
        meter.close()
        for watcher in watch:
            watcher.end(ended)
    soonest.note(writer)
    count, elapsed_s = decoder.count, last_s - begun_s
    writer.end(ended, received=count.received, dropped=count.dropped, torn=count.torn, garbage=count.garbage)
    measured = decoder.position / elapsed_s if elapsed_s >= MEASURED_MIN_S else None
    return Made(writer.path, header.rate_Hz, min(decoder.position, wanted), count, measured, ended)


class _Soonest:
    """Of the pieces since it was last noted the one that came soonest after its samples were taken."""

    def __init__(self, rate_Hz: float) -> None:
        self._rate_Hz, self._best, self._late_s = rate_Hz, (0, 0.0), math.inf

    def take(self, position: int, time_s: float) -> None:
        late_s = time_s - position / self._rate_Hz
        if late_s < self._late_s:
            self._best, self._late_s = (position, time_s), late_s

    def note(self, writer: RecordWriter) -> None:
        if self._late_s < math.inf:
            writer.write_time(*self._best)
        self._late_s = math.inf


def _keep(runs: list[Run], wanted: int, writer: RecordWriter, meter: Meter, watch: Sequence[Watcher]) -> None:
    """Writes and shows what is within the wanted length."""
    for run in runs:
        counts = run.counts[: max(0, wanted - run.first)]
        if len(counts):
            kept = Run(run.first, counts)
            writer.write(kept)
            meter.take(counts)
            for watcher in watch:
                watcher.take(kept)


def _end(position: int, wanted: int, full: int, overdue: bool, stopped: bool) -> str:
    """Why the recording ends now; empty where it goes on."""
    if position >= wanted:
        return FULL if wanted == full else REACHED
    if overdue:
        return "the probe sent too few samples in the time that was asked for"
    return STOPPED if stopped else ""
