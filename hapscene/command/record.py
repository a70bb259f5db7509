"""`hapscene capture record`, `coverage` and `join`."""

import argparse
import math
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import complain, name_made, note, say, tell
from hapscene.command.options import (
    add_command,
    add_out_file,
    add_recording_options,
    baud,
    check_there,
    new_file,
    port,
    rates,
    recording_options,
    seconds,
    whole,
)
from hapscene.errors import CaptureError, printable
from hapscene.wire.port import BAUD

if TYPE_CHECKING:
    from hapscene.capture.record.coverage import Wanted
    from hapscene.capture.record.recorder import Made


# `hapscene capture record`.


RATE_TOLERANCE: Final = 0.02
"""How far the samples that come may be off the announced rate before it is told [1]."""


def add_record(commands: Any) -> None:
    command = add_command(commands, "record", _record)
    command.add_argument("--port", required=True, help="of the probe: /dev/ttyUSB0, COM3, …")
    command.add_argument("--baud", type=baud, default=BAUD, help=f"speed of the port (default {BAUD})")
    command.add_argument("--seconds", type=seconds, metavar="N", help="how much to record (default: until Ctrl-C)")
    told = "the file to write: .hsrec (crash-safe), or .npz at the end; none is replaced (default recording.hsrec)"
    add_out_file(command, "FILE", told)
    live = "show on a page which forces and speeds the fit still lacks, and end when there are enough"
    command.add_argument("--live", action="store_true", help=live)
    command.add_argument("--page-port", type=port, default=0, metavar="N", help="of that page (default: any)")
    add_coverage_options(command)


def _record(options: argparse.Namespace) -> int:
    """Record from an accelerometer or force probe on a serial port (docs/probe-protocol.md).

    for example:
      hapscene capture record --port /dev/ttyUSB0
      hapscene capture record --port COM3 --baud 2000000 --seconds 10 -o stroke.npz
      hapscene capture record --port /dev/ttyUSB0 --live --force-range 0.5:2   # guided by a page
    """
    from hapscene.capture.io.hsrec import SUFFIX
    from hapscene.capture.record.coverage_page import CoverageProcess
    from hapscene.capture.record.recorder import record
    from hapscene.interrupt import interrupt_noted

    options.out = options.out or f"recording{SUFFIX}"
    place = Path(options.out).with_suffix(SUFFIX)
    was_there = place.exists()
    with ExitStack() as stack:
        noted, live = stack.enter_context(interrupt_noted()), None
        if options.live:
            live = stack.enter_context(CoverageProcess(_wanted(options), options.page_port))
            _say_line(f"the page: {live.url}")

        def stopped() -> bool:
            return noted() or (live is not None and live.done)

        watch = () if live is None else (live,)
        try:
            made = record(options.port, options.out, options.baud, options.seconds, stopped, _say_line, watch=watch)
        except KeyboardInterrupt:
            if was_there or not place.exists():
                raise
            complain(f"interrupted; what was recorded until then is in {place}")
            return 130
    _say_line(str(made))
    _note_rate(made)
    tell((live and live.lines) or [])
    name_made([made.path])
    return 0 if made.well else 1


def _note_rate(made: "Made") -> None:
    """Notes a wrong rate and restarts of the probe."""
    if made.rate_measured_Hz is not None and abs(made.rate_measured_Hz / made.rate_Hz - 1.0) > RATE_TOLERANCE:
        note(f"the probe announced {made.rate_Hz:g} Hz; by this computer's clock it is {made.rate_measured_Hz:.4g} Hz")
    if made.count.restarts:
        note(f"the probe restarted {made.count.restarts} times")


def _say_line(line: str) -> None:
    say(f"{line}\n")


# `hapscene capture coverage`.


def add_coverage(commands: Any) -> None:
    command = add_command(commands, "coverage", _coverage)
    command.add_argument("recording", metavar="RECORDING", help="CSV, text, WAV, NPZ, MAT or .hsrec")
    add_coverage_options(command)
    add_recording_options(command)


def add_coverage_options(command: argparse.ArgumentParser) -> None:
    """Adds the options for what is wanted of a recording."""
    command.add_argument("--force-range", type=_range, metavar="N:N", help="forces wanted (default 0.3:3)")
    command.add_argument("--speed-range", type=_range, metavar="MM/S:MM/S", help="speeds wanted (default 20:300)")
    command.add_argument("--taps", type=whole("a number of taps", 0), default=3, help="taps wanted (default 3)")


def _range(text: str) -> tuple[float, float]:
    low, colon, high = text.partition(":")
    with suppress(ValueError):
        if colon and 0.0 < float(low) < float(high) < math.inf:
            return float(low), float(high)
    raise argparse.ArgumentTypeError(f"{text[:40]!r}: expected LOW:HIGH, both above 0, as in 0.5:2")


def _wanted(options: argparse.Namespace) -> "Wanted":
    from hapscene.capture.record.coverage import FORCE_N, SPEED_M_S, Wanted

    low, high = options.speed_range or (1e3 * SPEED_M_S[0], 1e3 * SPEED_M_S[1])
    return Wanted(options.force_range or FORCE_N, (1e-3 * low, 1e-3 * high), options.taps)


def _coverage(options: argparse.Namespace) -> int:
    """Print what a recording holds over force and speed, and what a fit still lacks.

    for example:
      hapscene capture coverage stroke.hsrec
      hapscene capture coverage oak.csv --rate 10000 --units acceleration=m/s2,speed=mm/s,force=N --force-range 0.5:2
    """
    check_there(options.recording, CaptureError)
    from hapscene.capture.io.recording import load_recording
    from hapscene.capture.record.coverage import Coverage
    from hapscene.capture.record.coverage_page import blocks_of, table

    recording = load_recording(options.recording, **recording_options(options))
    rows = {"acceleration": recording.acceleration_m_s2, "force": recording.force_N, "speed": recording.speed_m_s}
    rows["tangential_force"] = recording.tangential_force_N
    streams = {name: row for name, row in rows.items() if row is not None}
    coverage = Coverage(recording.rate_Hz, tuple(streams), _wanted(options))
    for first, block in blocks_of(streams, recording.rate_Hz):
        coverage.feed(first, block)
    tell(table(coverage))
    return 0


# `hapscene capture join`.


def add_join(commands: Any) -> None:
    command = add_command(commands, "join", _join)
    command.add_argument(
        "recordings", metavar="RECORDING", nargs="+", help="CSV, text, WAV, NPZ, MAT or .hsrec, two or more"
    )
    add_out_file(command, "FILE", "the .npz file to write (default joined.npz)")
    command.add_argument(
        "--rate", dest="rates", type=rates, default=(), metavar="HZ,…",
        help="sample rates [Hz] of the files that do not state theirs: one for all, or one each",
    )  # fmt: skip


def _join(options: argparse.Namespace) -> int:
    """Join recordings of one event, made by different devices, into one file with one clock.

    Offset and drift of the clocks are found by cross-correlation of the channel that the files have in common, else of
    all their streams; where it has no clear peak, nothing is written.

    for example:
      hapscene capture join handle.csv plate.wav -o oak.npz --rate 1000
      hapscene capture join handle.hsrec plate.hsrec -o oak.npz
      hapscene capture fit oak.npz --columns force=Fz --units 'acceleration=98 m/s2,force=N'
    """
    from hapscene.capture.record.time_alignment import join

    for path in options.recordings:
        check_there(path, CaptureError)
    options.out = options.out or new_file("joined.npz", "-o")
    made = join(options.recordings, options.out, rates_Hz=options.rates)
    lines = [f"{printable(path.name)}: {known}" for path, known in made.offsets.items()]
    shared = f"{made.duration_s:.3f} s at {made.rate_Hz:g} Hz, by the clock of {printable(made.leader.name)}"
    tell([*lines, f"{shared}: {', '.join(made.names)}"])
    for path, known in made.offsets.items():
        if not known.common:
            note(f"{path.name}: no common channel; the delay of a sensor's filter counts as offset")
    name_made([made.path])
    return 0
