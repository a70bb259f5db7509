"""Records from a probe on a serial port: reads and decodes samples, prints the level, writes a crash-safe file."""

import math
import os
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.io.hsrec import SYNC_S, VALUE_MAX, RecordWriter
from hapscene.errors import CaptureError
from hapscene.io.files import refusing
from hapscene.io.probe_port import BAUD, Port
from hapscene.io.probe_protocol import VERSION, Count, Decoder, Header, Run
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["RecordingResult", "record"]

LEVEL_S: Final = 1.0
"""Interval between two lines with the level [s]."""

SILENCE_S: Final = 5.0
"""Longest wait for the probe's header [s]. Boards that restart when the port is opened need up to 2 s."""

MEASURED_MIN_S: Final = 5.0
"""Shortest recording whose sample rate is measured with the computer's clock [s]. Bytes arrive in bursts of about
10 ms, so the rate of a shorter recording would be inaccurate."""

STOPPED: Final = "stopped"
REACHED: Final = "the duration was reached"
FULL: Final = "the maximum length of a record was reached"


def level_line(header: Header, blocks: Sequence[NDArray[np.int64]], count: Count, position: int) -> str:
    """A line with the time, the lost samples, and RMS and peak of each channel about its mean.

    Args:
        header: header of the probe.
        blocks: counts (n, columns) since the last line.
        count: received and lost samples.
        position: number of samples so far.
    """
    levels = "  no samples"
    if blocks:
        values = np.concatenate(blocks) * np.array([c.scale for c in header.columns])
        deviation = values - values.mean(axis=0)
        rms, peak = np.sqrt((deviation**2).mean(axis=0)), np.abs(deviation).max(axis=0)
        each = zip(header.columns, rms, peak, strict=True)
        levels = "".join(f"  {c.name} {level:.3g}/{top:.3g} {c.unit}" for c, level, top in each)
    lost = f"dropped {count.dropped}, torn {count.torn}, garbage {count.garbage}"
    return f"{position / header.rate_Hz:7.1f} s  {lost}  rms/peak:{levels}"


@dataclass(frozen=True)
class RecordingResult:
    """Result of a recording."""

    path: Path
    rate_Hz: float
    length: int
    """number of samples, dropped samples included"""
    count: Count
    rate_measured_Hz: float | None
    """sample rate by the computer's clock; None for a recording shorter than `MEASURED_MIN_S`"""
    ended: str
    """why the recording ended: `STOPPED`, `REACHED`, `FULL`, or an error"""

    @property
    def complete(self) -> bool:
        """Whether the recording ended as requested."""
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
    *,
    clock: Clock = CLOCK,
) -> RecordingResult:
    """Records from a probe until it is stopped, the duration is reached, or the probe is disconnected.

    Args:
        port: name of the serial port, for example "/dev/ttyUSB0" or "COM3".
        path: .hsrec file to write.
        baud: speed of the port [bit/s].
        duration_s: length of the recording [s]; None: until `stopped` returns True.
        stopped: called about 20 times per second.
        say: called with each line of output for the user.
        clock: clock that measures silence, duration and sample rate.

    Raises:
        CaptureError: the port cannot be opened, sends nothing or speaks another protocol; the file exists already.
    """
    place = Path(path)
    with closing(Port(port, baud)) as opened:
        decoder, runs = _wait_for_header(opened, port, baud, stopped, clock)
        assert decoder.header is not None
        with RecordWriter(place, decoder.header) as writer:
            names = ", ".join(f"{c.name} [{c.unit}]" for c in decoder.header.columns)
            say(f"recording {names} at {decoder.header.rate_Hz:g} Hz into {place}; stop with Ctrl-C")
            result = _record_samples(opened, decoder, runs, writer, duration_s, stopped, say, clock)
    if not result.count.received:
        place.unlink()
        raise CaptureError(f"{port}: the probe sent a header but no samples ({result.ended}); no file was written")
    return result


def _wait_for_header(
    opened: Port, port: str, baud: int, stopped: Callable[[], bool], clock: Clock
) -> tuple[Decoder, list[Run]]:
    """Reads until the probe's header has arrived; returns the decoder and the samples read so far."""
    decoder = Decoder()
    deadline_s = clock.now_s() + SILENCE_S
    while True:
        if stopped():
            raise KeyboardInterrupt
        received = opened.next()
        if isinstance(received, str):
            raise CaptureError(f"{port}: the port closed before the probe sent its header: {received}")
        if isinstance(received, tuple):
            with refusing(CaptureError, port):
                runs = decoder.feed(*received)
            if decoder.header is not None:
                return decoder, runs
        if clock.now_s() > deadline_s:
            line = f"line `#hapscene-probe {VERSION} …`"
            reason = f"no data in {SILENCE_S:g} s; expected a {line}: check the cable and that the probe runs"
            if decoder.byte_count:
                found = f"{decoder.byte_count} bytes in {SILENCE_S:g} s at {baud} baud"
                reason = f"{found}, but no {line}: check --baud and docs/reference/probe-protocol.md"
            raise CaptureError(f"{port}: {reason}")


def _record_samples(
    opened: Port,
    decoder: Decoder,
    runs: list[Run],
    writer: RecordWriter,
    duration_s: float | None,
    stopped: Callable[[], bool],
    say: Callable[[str], None],
    clock: Clock,
) -> RecordingResult:
    """Writes samples and prints their level until the recording ends."""
    header = decoder.header
    assert header is not None
    start_s = synced_s = shown_s = last_s = clock.now_s()
    shown: list[NDArray[np.int64]] = []
    length_max = VALUE_MAX // len(header.columns)
    length = length_max if duration_s is None else min(length_max, round(duration_s * header.rate_Hz))
    overdue_s = start_s + SILENCE_S + (duration_s or math.inf)
    ended = ""
    while True:
        for run in runs:
            counts = run.counts[: max(0, length - run.first)]
            if len(counts):
                writer.write(Run(run.first, counts))
                shown.append(counts)
        now_s = clock.now_s()
        if now_s - synced_s >= SYNC_S:
            writer.sync()
            synced_s = now_s
        if now_s - shown_s >= LEVEL_S:
            say(level_line(header, shown, decoder.count, min(decoder.position, length)))
            shown, shown_s = [], now_s
        if not ended and decoder.position >= length:
            ended = FULL if length == length_max else REACHED
        elif not ended and now_s > overdue_s:
            ended = "the probe sent too few samples in the requested time"
        elif not ended and stopped():
            ended = STOPPED
        if ended:
            break
        received = opened.next()
        runs = []
        if isinstance(received, str):
            ended = f"the probe was disconnected: {received}"
        elif received is not None:
            last_s = received[1]
            try:
                runs = decoder.feed(*received)
            except CaptureError as error:
                ended = str(error)
    count, elapsed_s = decoder.count, last_s - start_s
    writer.end(ended, received=count.received, dropped=count.dropped, torn=count.torn, garbage=count.garbage)
    measured = decoder.position / elapsed_s if elapsed_s >= MEASURED_MIN_S else None
    return RecordingResult(writer.path, header.rate_Hz, min(decoder.position, length), count, measured, ended)
