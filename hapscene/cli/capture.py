"""`hapscene capture`: record a surface, fit a swatch to it, judge the fit."""

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import App, Parameter

from hapscene.cli.console import complain, name_made, note, say, tell, tell_over
from hapscene.cli.options import (
    Count,
    Help,
    InFile,
    InFiles,
    Numbers,
    OutFile,
    OutFolder,
    Pairs,
    Port,
    Positive,
    RecordingOptions,
    SwatchName,
    WorkerOptions,
)
from hapscene.cli.paths import base_name, check_there, new_file
from hapscene.errors import CaptureError, SwatchError, printable
from hapscene.wire.port import BAUD

if TYPE_CHECKING:
    from hapscene.capture.batch import ManifestEntry, Result
    from hapscene.capture.coverage import Wanted
    from hapscene.capture.record import Made
    from hapscene.surface.swatch import Swatch

__all__ = ["app"]

app = App(name="capture", help="Haptography: record a surface, fit a swatch to it, judge the fit.")

Layout = Annotated[Literal["lmt", "cluster", "hatt", "proton"] | None, Help("Layout of a published data set")]


# Fits.


@Parameter(name="*", group="Fit")
@dataclass(frozen=True)
class FitOptions:
    """How a swatch is fitted, and what it keeps of the recording."""

    order: Annotated[int | Literal["auto"], Help("Order of the models; auto chooses it on held-out data")] = "auto"
    tool: Annotated[str, Help("What held the tip, as in 'steel probe'; the swatch keeps it")] = ""
    tip: Annotated[str, Help("What touched the surface, as in '3.2 mm ball'")] = ""

    def given(self) -> dict[str, Any]:
        """The keyword arguments of the fit."""
        texts = {"tool": self.tool, "tip": self.tip}
        return {"order": self.order} | {name: text for name, text in texts.items() if text}


@app.command
def fit(
    recordings: Annotated[list[str], Help("CSV, text, WAV, NPZ, MAT, Parquet or .hsrec files")],
    /,
    *,
    out: Annotated[OutFile, Help("Swatch file to write (default: NAME.swatch, as oak.swatch)")] = None,
    name: Annotated[str | None, Help("Name of the surface (default: as the file that is written)")] = None,
    plot: Annotated[Path | None, Help("Picture of the states of contact over time, .png")] = None,
    layout: Layout = None,
    options: FitOptions = FitOptions(),
    reading: RecordingOptions = RecordingOptions(),
) -> None:
    """Fit a swatch to recordings of a tool on one surface.

    for example:
      hapscene capture fit oak.csv --rate 10000 --units acceleration=g,force=N
      hapscene capture fit stroke.wav taps.wav --name oak -o oak.swatch \\
          --units 'acceleration=98 m/s2'
      hapscene capture fit oak.npz --plot states.png
      hapscene capture fit sensor_data/accel/17 --layout cluster -o denim.swatch
    """
    for path in recordings if layout is None else ():
        check_there(path)
    from hapscene.surface.swatch_file import SUFFIX, save_swatch
    from hapscene.surface.swatch_summary import lines

    out = out or new_file(base_name(recordings[0]) + SUFFIX)
    if out.suffix != SUFFIX:
        raise SwatchError(f"{out}: a swatch's file name must end in {SUFFIX}; `capture batch` fits many into a folder")
    if name is not None and any(sign in name for sign in "/\\"):
        raise SwatchError(f"--name {name!r}: a surface's name has no slash, for files are called by it")
    swatch = _fitted(recordings, name or out.stem, plot, reading.reading() | _layout(layout), options)
    save_swatch(swatch, str(out))
    tell(lines(swatch))
    name_made([out, *([] if plot is None else [plot])])


def _layout(layout: str | None) -> dict[str, Any]:
    return {} if layout is None else {"layout": layout}


def _fitted(
    paths: Sequence[str], name: str, plot: Path | None, reading: dict[str, Any], options: FitOptions
) -> "Swatch":
    from hapscene import __version__
    from hapscene.capture.recording_file import load_recording
    from hapscene.capture.segment import InteractionState
    from hapscene.capture.segment_plot import WORDS, write_states
    from hapscene.capture.swatch_fit import fit_parts, prepare
    from hapscene.files import refusing
    from hapscene.touch import step

    parts = []
    for path in paths:
        with step(say, f"reading {path}"):
            recording = [load_recording(path, **reading)]
            with refusing(CaptureError, path):
                parts.append(prepare(recording.pop()))  # a long one is as large as what is made of it
        lengths_s = {state: parts[-1][1].seconds(state) for state in InteractionState}
        say(f"  {', '.join(f'{WORDS[state]} {length_s:.1f} s' for state, length_s in lengths_s.items() if length_s)}\n")
    if plot is not None:  # before the fit: it shows why one may fail
        write_states(parts, str(plot), [Path(path).name for path in paths])
    with step(say, "fitting"), refusing(CaptureError, ", ".join(paths)):
        swatch = fit_parts(parts, name, **options.given())
    files = printable(", ".join(Path(path).name for path in paths))
    return replace(swatch, provenance=f"Fitted by hapscene {__version__} to {files}. {swatch.provenance}".strip())


@app.command
def batch(
    *recordings: Annotated[str, Help("Files, and folders of them")],
    out: OutFolder = Path("out/swatches"),
    files: Annotated[
        InFile | None, Parameter(name="--list"), Help("Table of recordings, CSV: recording, name, rate, …")
    ] = None,
    layout: Layout = None,
    options: FitOptions = FitOptions(),
    reading: RecordingOptions = RecordingOptions(),
    workers: WorkerOptions = WorkerOptions(),
) -> int:
    """Fit a swatch to each of many recordings; run the same command again to resume.

    The swatches lie below --out as the recordings do below the folder they share,
    beside manifest.json, which has the outcome of each recording. A recording that
    was fitted with the same content and settings is skipped. Exit codes: 0 all have
    swatches, 1 some failed (listed at the end), 130 stopped by Ctrl-C.

    for example:
      hapscene capture batch recordings/ --rate 10000 --units acceleration=g
      hapscene capture batch --list files.csv --out swatches --jobs 4
      hapscene capture batch recordings/ --scheduler tcp://head:8786
      hapscene capture batch Movement --layout lmt --units acceleration=m/s2
    """
    from hapscene.capture.batch import fit_batch, gather, read_list
    from hapscene.interrupt import interrupt_noted

    for place in recordings if layout is None else ():
        check_there(place, "file or folder")
    items = gather(recordings, layout) + ([] if files is None else read_list(str(files)))
    if not items:
        raise CaptureError("no recordings: name files or folders, or --list files.csv")
    items = list({item.path.absolute(): item for item in items}.values())
    how = (reading.reading() | _layout(layout), options.given(), workers.jobs, workers.scheduler)
    with interrupt_noted() as stopped:
        try:
            result = fit_batch(items, str(out), *how, stopped, _progress(len(items)))
        except KeyboardInterrupt:
            complain("interrupted; run the same command again to resume")
            return 130
    tell(
        [
            f"{len(result.fitted)} fitted, {len(result.skipped)} done before, {len(result.failed)} failed",
            *(f"  {entry.reason}" for entry in result.failed),
            *(f"note: {line}" for line in result.notes),
            "made:",
            f"  {out}: swatches and manifest.json",
        ]
    )
    if result.stopped:
        complain(f"interrupted with {len(items) - result.count} recordings left; run the same command again to resume")
        return 130
    return 1 if result.failed else 0


PROGRESS_S: Final = 5.0
"""Time between two lines of progress [s]."""


def _progress(total: int) -> Any:
    """A function that prints how far a batch is, now and then."""
    start_s = shown_s = time.monotonic()

    def show(result: "Result", entry: "ManifestEntry") -> None:
        nonlocal shown_s
        now_s = time.monotonic()
        if now_s - shown_s >= PROGRESS_S:
            shown_s = now_s
            rate_1_s = (len(result.fitted) + len(result.failed)) / (now_s - start_s)
            tell([f"{result.count} of {total}, {len(result.failed)} failed, {rate_1_s:.2g} a second"])

    return show


@app.command
def report(
    swatch: SwatchName,
    recording: Annotated[InFile | None, Help("What it was fitted to, or another recording of that surface")] = None,
    /,
    *,
    out: Annotated[OutFile, Help("Page to write (default: NAME.html, as oak.html)")] = None,
    reading: RecordingOptions = RecordingOptions(),
) -> None:
    """Write one page on how good a swatch is and why: plots, figures, what is absent.

    for example:
      hapscene capture report wood                             # to wood.html
      hapscene capture report oak.swatch oak.csv --rate 10000 \\
          --units acceleration=m/s2,force=N
    """
    out = out or new_file(f"{base_name(swatch)}.html")
    from hapscene.capture.recording_file import load_recording
    from hapscene.capture.report import write_report
    from hapscene.surface.library import load_swatch

    fitted = load_swatch(swatch)
    loaded = None if recording is None else load_recording(recording, **reading.reading())
    write_report(fitted, str(out), loaded, "" if recording is None else recording.name)
    name_made([out])


# Recordings.


RATE_TOLERANCE: Final = 0.02
"""Difference between the announced and the measured sample rate from which a note is printed [1]."""


@Parameter(name="*", group="Coverage: what a fit needs of a recording")
@dataclass(frozen=True)
class CoverageOptions:
    """The ranges that a recording should cover."""

    force_range: Annotated[tuple[float, float], Help("Least and largest force [N]")] = (0.3, 3.0)
    speed_range: Annotated[tuple[float, float], Help("Least and largest speed [mm/s]")] = (20.0, 300.0)
    taps: Annotated[Count, Help("Number of taps")] = 3

    def wanted(self) -> "Wanted":
        """The ranges in SI units."""
        from hapscene.capture.coverage import Wanted

        low, high = self.speed_range
        return Wanted(self.force_range, (1e-3 * low, 1e-3 * high), self.taps)


@app.command
def record(
    *,
    port: Annotated[list[str], Help("Serial port of a probe; may be given several times")],
    out: Annotated[OutFile, Help("New file, .hsrec (crash-safe) or .npz; several probes: NAME-1, NAME-2, …")] = Path(
        "recording.hsrec"
    ),
    seconds: Annotated[Positive | None, Help("Length [s] (default: until Ctrl-C)")] = None,
    baud: Annotated[int, Help("Speed of the port [bit/s]")] = BAUD,
    live: Annotated[bool, Help("Show on a page what the fit still lacks, and end when more would not help")] = False,
    page_port: Annotated[Port, Help("Port of that page; 0 for any free one")] = 0,
    coverage: CoverageOptions = CoverageOptions(),
) -> int:
    """Record from an accelerometer or force probe on a serial port, or from several.

    docs/probe-protocol.md describes what a probe sends.

    for example:
      hapscene capture record --port /dev/ttyUSB0
      hapscene capture record --port COM3 --baud 2000000 --seconds 10 -o stroke.npz
      hapscene capture record --port /dev/ttyUSB0 --live --force-range 0.5 2
      hapscene capture record --port /dev/ttyUSB0 --port /dev/ttyUSB1
      python -m hapscene.capture.record_simulator      # a simulated probe
    """
    assert out is not None
    if len(port) == 1:
        return _record_one(port[0], out, seconds, baud, coverage if live else None, page_port)
    if live:
        raise CaptureError("--live is for one probe: leave it out, or name one --port")
    return _record_many(port, out, seconds, baud)


def _record_one(
    port: str, out: Path, seconds: float | None, baud: int, coverage: CoverageOptions | None, page_port: int
) -> int:
    from hapscene.capture.coverage_server import CoverageProcess
    from hapscene.capture.record import record as run
    from hapscene.capture.record_file import SUFFIX
    from hapscene.interrupt import interrupt_noted

    place = out.with_suffix(SUFFIX)
    was_there = place.exists()
    with ExitStack() as stack:
        noted, live = stack.enter_context(interrupt_noted()), None
        if coverage is not None:
            live = stack.enter_context(CoverageProcess(coverage.wanted(), page_port))
            _say_line(f"the page: {live.url}")

        def stopped() -> bool:
            return noted() or (live is not None and live.done)

        try:
            made = run(port, str(out), baud, seconds, stopped, _say_line, watch=() if live is None else (live,))
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
    """Print notes about the probe itself."""
    if made.rate_measured_Hz is not None and abs(made.rate_measured_Hz / made.rate_Hz - 1.0) > RATE_TOLERANCE:
        clock = f"by this computer's clock it is {made.rate_measured_Hz:.4g} Hz"
        note(f"{made.path.name}: the probe announced {made.rate_Hz:g} Hz; {clock}")
    if made.count.restarts:
        note(f"{made.path.name}: the probe restarted {made.count.restarts} times")


def _record_many(ports: Sequence[str], out: Path, seconds: float | None, baud: int) -> int:
    from hapscene.capture.record_many import record_many
    from hapscene.interrupt import interrupt_noted

    def show(line: str) -> None:
        tell_over(line[: get_terminal_size().columns - 1]) if sys.stdout.isatty() else tell([line])

    with interrupt_noted() as stopped:
        results = record_many(ports, str(out), baud, seconds, stopped=stopped, say=_say_line, show=show)
    made = [result for result in results if not isinstance(result, str)]
    for each in made:
        _note_rate(each)
    if made:
        name_made([each.path for each in made])
    return 0 if len(made) == len(results) and all(each.well for each in made) else 1


def _say_line(line: str) -> None:
    say(f"{line}\n")


@app.command
def coverage(
    recording: Annotated[InFile, Help("CSV, text, WAV, NPZ, MAT, Parquet or .hsrec file")],
    /,
    *,
    wanted: CoverageOptions = CoverageOptions(),
    reading: RecordingOptions = RecordingOptions(),
) -> None:
    """Print what a recording covers of force and speed, and what more would help a fit.

    for example:
      hapscene capture coverage stroke.hsrec
      hapscene capture coverage oak.csv --rate 10000 --force-range 0.5 2 \\
          --units acceleration=m/s2,speed=mm/s,force=N
    """
    from hapscene.capture.coverage_server import LiveCoverage, blocks_of, table
    from hapscene.capture.recording_file import load_recording

    live = LiveCoverage(wanted.wanted())
    read = load_recording(recording, **reading.reading())
    rows = {"acceleration": read.acceleration_m_s2, "force": read.force_N, "speed": read.speed_m_s}
    rows["tangential_force"] = read.tangential_force_N
    streams = {name: row for name, row in rows.items() if row is not None}
    live.start(read.rate_Hz, tuple(streams))
    assert live.coverage is not None
    for first, block in blocks_of(streams, read.rate_Hz):
        live.feed(first, block)
    live.end("the recording is over")
    tell(table(live.coverage))


@app.command
def join(
    recordings: Annotated[InFiles, Help("CSV, text, WAV, NPZ, MAT, Parquet or .hsrec files, two or more")],
    /,
    *,
    out: Annotated[OutFile, Help("NPZ file to write (default: joined.npz)")] = None,
    rate: Annotated[Numbers, Help("Sample rates of files that do not say theirs [Hz]: one for all, or one each")] = (),
    columns: Annotated[Pairs, Help("Column of each quantity, as in acceleration=accel,speed=v")] = None,
    units: Annotated[Pairs, Help("Unit of each quantity, as in acceleration=g,force=N")] = None,
) -> None:
    """Join recordings of one event, made by different devices, into one file with one clock.

    Offset and drift of the clocks are found by taps that both detect, else by their
    envelopes, and printed with their 95 % interval; where they are uncertain,
    nothing is written.

    for example:
      hapscene capture join handle.csv plate.wav -o oak.npz --rate 1000
      hapscene capture join recording-1.hsrec recording-2.hsrec -o oak.npz
      hapscene capture fit oak.npz --units 'acceleration=98 m/s2'
    """
    from hapscene.capture.recording_join import join as run

    out = out or new_file("joined.npz")
    made = run(recordings, str(out), rates_Hz=rate, columns=columns or {}, units=units or {})
    tell([f"{printable(file.name)}: {known}" for file, known in made.offsets.items()])
    shared = f"{made.duration_s:.3f} s at {made.rate_Hz:g} Hz, by the clock of {printable(made.leader.name)}"
    tell([f"{shared}: {', '.join(made.names)}"])
    for file, known in made.offsets.items():
        if known.by == "envelopes":
            note(f"{file.name}: of different quantities; the delay of a sensor's filter counts as offset")
        if known.by == "clock":
            note(f"{file.name}: offset by the computer's clock alone, to {1e3 * known.interval_s:g} ms")
    name_made([made.path])
