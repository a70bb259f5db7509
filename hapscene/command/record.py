"""`hapscene capture record`, `coverage` and `join`: recordings made, looked at, and made one.

Apart from `capture`, which adds them to its group: that fits and judges, and knows no port, page or clock.
"""

import argparse
import math
import shutil
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import complain, name_made, note, say, tell, tell_over
from hapscene.command.options import (
    add_command,
    add_out_file,
    add_recording_options,
    baud,
    check_there,
    new_file,
    number,
    pairs,
    port,
    recording_options,
    seconds,
    whole,
)
from hapscene.errors import CaptureError, printable
from hapscene.wire.port import BAUD

if TYPE_CHECKING:
    from hapscene.capture.coverage import Wanted
    from hapscene.capture.record import Made


# `hapscene capture record`.


RATE_TOLERANCE: Final = 0.02
"""How far the samples that come may be off the announced rate before it is told [1]."""


def add_record(commands: Any) -> None:
    command = add_command(commands, "record", _record)
    command.add_argument(
        "--port", required=True, action="append",
        help="of the probe: /dev/ttyUSB0, COM3, …; given more than once: of several, recorded side by side",
    )  # fmt: skip
    command.add_argument("--baud", type=baud, default=BAUD, help=f"speed of the port (default {BAUD})")
    command.add_argument("--seconds", type=seconds, metavar="N", help="how much to record (default: until Ctrl-C)")
    told = (
        "the file to write: .hsrec (crash-safe), or .npz at the end; none is replaced (default recording.hsrec); of "
        "several probes recording-1.hsrec, recording-2.hsrec, …"
    )
    add_out_file(command, "FILE", told)
    add_coverage_options(command, "show on a page what the fit still lacks, and end when more would not help")


def _record(options: argparse.Namespace) -> int:
    """Record from an accelerometer or force probe on a serial port, or from several (docs/probe-protocol.md).

    for example:
      hapscene capture record --port /dev/ttyUSB0
      hapscene capture record --port COM3 --baud 2000000 --seconds 10 -o stroke.npz
      hapscene capture record --port /dev/ttyUSB0 --live --force-range 0.5:2   # guided by a page
      hapscene capture record --port /dev/ttyUSB0 --port /dev/ttyUSB1   # as recording-1.hsrec and recording-2.hsrec
      python -m hapscene.capture.record_simulator   # a probe to try it with, without hardware
    """
    from hapscene.capture.coverage_server import CoverageProcess
    from hapscene.capture.record import record
    from hapscene.capture.record_file import SUFFIX
    from hapscene.interrupt import interrupt_noted

    options.out = options.out or f"recording{SUFFIX}"
    if len(options.port) > 1:
        if options.live:
            raise CaptureError("--live is for one probe: leave it out, or name one --port")
        return _record_many(options)
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
            made = record(options.port[0], options.out, options.baud, options.seconds, stopped, _say_line, watch=watch)
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


def _note_rate(made: "Made", which: str = "the probe") -> None:
    """Notes what a user should know of the probe itself."""
    if made.rate_measured_Hz is not None and abs(made.rate_measured_Hz / made.rate_Hz - 1.0) > RATE_TOLERANCE:
        note(f"{which} announced {made.rate_Hz:g} Hz; by this computer's clock it is {made.rate_measured_Hz:.4g} Hz")
    if made.count.restarts:
        note(f"{which} began anew {made.count.restarts} times")


def _record_many(options: argparse.Namespace) -> int:
    from hapscene.capture.record_many import record_many
    from hapscene.interrupt import interrupt_noted

    live, line_open = sys.stdout.isatty(), False

    def show(line: str) -> None:
        nonlocal line_open
        line_open = live
        tell_over(line[: shutil.get_terminal_size().columns - 1]) if live else tell([line])

    def say_below(line: str) -> None:
        nonlocal line_open
        _say_line(f"{chr(10) * line_open}{line}")
        line_open = False

    with interrupt_noted() as stopped:
        results = record_many(
            options.port, options.out, options.baud, options.seconds, stopped=stopped, say=say_below, show=show
        )
    made = [result for result in results if not isinstance(result, str)]
    for each in made:
        _note_rate(each, each.path.name)
    if made:
        name_made([each.path for each in made])
    return 0 if len(made) == len(results) and all(each.well for each in made) else 1


def _say_line(line: str) -> None:
    say(f"{line}\n")


# `hapscene capture coverage`.


def add_coverage(commands: Any) -> None:
    command = add_command(commands, "coverage", _coverage)
    command.add_argument("recording", metavar="RECORDING", help="CSV, text, WAV, NPZ, MAT or .hsrec")
    add_coverage_options(command, "play it back on the page of `capture record --live`")
    add_recording_options(command)


def add_coverage_options(command: argparse.ArgumentParser, live: str) -> None:
    """Adds --live, --page-port, and what is wanted of a recording."""
    command.add_argument("--live", action="store_true", help=live)
    command.add_argument("--page-port", type=port, default=0, metavar="N", help="of that page (default: any)")
    command.add_argument("--force-range", type=_range, metavar="N:N", help="forces wanted (default 0.3:3)")
    command.add_argument("--speed-range", type=_range, metavar="MM/S:MM/S", help="speeds wanted (default 20:300)")
    command.add_argument("--taps", type=whole("a number of taps", 0), default=3, help="taps wanted (default 3)")
    command.add_argument(
        "--full-scale", type=pairs, default={}, metavar="Q=VALUE,…",
        help="what sensors reach, in m/s², N and m/s, as acceleration=78,force=10; without, flat tops tell",
    )  # fmt: skip


def _range(text: str) -> tuple[float, float]:
    low, colon, high = text.partition(":")
    with suppress(ValueError):
        if colon and 0.0 < float(low) < float(high) < math.inf:
            return float(low), float(high)
    raise argparse.ArgumentTypeError(f"{text[:40]!r}: expected LOW:HIGH, both above 0, as in 0.5:2")


def _wanted(options: argparse.Namespace) -> "Wanted":
    from hapscene.capture.coverage import FORCE_N, SPEED_M_S, Wanted

    low, high = options.speed_range or (1e3 * SPEED_M_S[0], 1e3 * SPEED_M_S[1])
    full_scale = {}
    for quantity, text in options.full_scale.items():
        try:
            full_scale[quantity] = float(text)
        except ValueError:
            raise CaptureError(f"--full-scale {quantity}={text[:40]}: expected a number") from None
    return Wanted(options.force_range or FORCE_N, (1e-3 * low, 1e-3 * high), options.taps, full_scale)


def _coverage(options: argparse.Namespace) -> int:
    """Tell what a recording holds over force and speed, and what more would help a fit.

    for example:
      hapscene capture coverage stroke.hsrec
      hapscene capture coverage oak.csv --rate 10000 --units acceleration=m/s2,speed=mm/s,force=N --force-range 0.5:2
      hapscene capture coverage stroke.hsrec --live     # played back on the page
    """
    check_there(options.recording, CaptureError)
    from hapscene.capture.coverage_server import BEAT_S, CoveragePage, LiveCoverage, blocks_of, table
    from hapscene.capture.recording_file import load_recording
    from hapscene.interrupt import interrupt_noted

    wanted = _wanted(options)
    recording = load_recording(options.recording, **recording_options(options))
    rows = {"acceleration": recording.acceleration_m_s2, "force": recording.force_N, "speed": recording.speed_m_s}
    rows["tangential_force"] = recording.tangential_force_N
    streams = {name: row for name, row in rows.items() if row is not None}
    live = LiveCoverage(wanted)
    live.start(recording.rate_Hz, tuple(streams))
    assert live.coverage is not None
    with ExitStack() as stack:
        noted, page = stack.enter_context(interrupt_noted()), None
        if options.live:
            page = stack.enter_context(CoveragePage(live, port=options.page_port))
            _say_line(f"the page: {page.url}   (played once it is open; ends when it is closed, or by Ctrl-C)")
            while not (noted() or page.seen.wait(BEAT_S)):
                pass
        begun_s = time.monotonic()
        for first, block in blocks_of(streams, recording.rate_Hz):
            if noted() or live.stopped.is_set():
                break
            live.feed(first, block)
            if options.live:
                live.publish()
                time.sleep(max(0.0, begun_s + first / recording.rate_Hz + BEAT_S - time.monotonic()))
        live.end("the recording is over")
        live.publish()
        while page is not None and page.is_open and not noted():
            time.sleep(BEAT_S)
    tell(table(live.coverage))
    return 0


# `hapscene capture join`.


def add_join(commands: Any) -> None:
    command = add_command(commands, "join", _join)
    command.add_argument(
        "recordings", metavar="RECORDING", nargs="+", help="CSV, text, WAV, NPZ, MAT or .hsrec, two or more"
    )
    add_out_file(command, "FILE", "the .npz file to write (default joined.npz)")
    command.add_argument(
        "--within", type=number("milliseconds are", 0.1, 1000.0), metavar="MS",
        help="how well the clocks must be known, the 95 %% interval to either side (default 5)",
    )  # fmt: skip
    add_recording_options(command, several=True)


def _join(options: argparse.Namespace) -> int:
    """Join recordings of one event, made by different devices, into one file with one clock.

    Offset and drift of the clocks are found by taps that both felt, else by how their envelopes rise and fall
    together, and told with their 95 % interval; where they are not certain, nothing is written. Records made side by
    side (`hapscene capture record --port … --port …`) know each other by the computer's clock, to some 20 ms.

    for example:
      hapscene capture join handle.csv plate.wav -o oak.npz --rate 1000 --columns force=Fz --units force=N
      hapscene capture join recording-1.hsrec recording-2.hsrec -o oak.npz
      hapscene capture fit oak.npz --units 'acceleration=98 m/s2'
    """
    from hapscene.capture.clock_offset import WITHIN_S
    from hapscene.capture.recording_join import join

    for path in options.recordings:
        check_there(path, CaptureError)
    options.out = options.out or new_file("joined.npz", "-o")
    within_s = WITHIN_S if options.within is None else 1e-3 * options.within
    made = join(
        options.recordings,
        options.out,
        rates_Hz=options.rates,
        columns=options.columns,
        units=options.units,
        within_s=within_s,
    )
    lines = [f"{printable(path.name)}: {known}" for path, known in made.offsets.items()]
    shared = f"{made.duration_s:.3f} s at {made.rate_Hz:g} Hz, by the clock of {printable(made.leader.name)}"
    tell([*lines, f"{shared}: {', '.join(made.names)}"])
    for path, known in made.offsets.items():
        if known.by == "envelopes":
            note(f"{path.name}: of unlike quantities; what a sensor's filter delays counts as offset")
        if known.by == "clock":
            note(
                f"{path.name} tells no offset by itself: the computer's clock knows it to {1e3 * known.interval_s:g} ms"
            )
    name_made([made.path])
    return 0
