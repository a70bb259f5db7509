"""`hapscene capture`: record a surface, fit a swatch to it, judge the fit."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import App, Parameter

from hapscene.cli.console import complain, name_made, note, say, tell
from hapscene.cli.options import (
    Help,
    InFile,
    InFiles,
    Numbers,
    OutFile,
    OutFolder,
    Positive,
    RecordingOptions,
    SwatchName,
    WorkerOptions,
)
from hapscene.cli.paths import base_name, check_there, new_file
from hapscene.errors import CaptureError, SwatchError, printable
from hapscene.io.wire.port import BAUD

if TYPE_CHECKING:
    from hapscene.capture.batch import BatchResult
    from hapscene.capture.fit.swatch import FitOptions
    from hapscene.capture.record.recorder import RecordingResult
    from hapscene.surface.swatch import Swatch

__all__ = ["app"]

app = App(name="capture", synonym="fit", help="Haptography: record a surface, fit a swatch to it, judge the fit.")


# Fits.


@Parameter(name="*", group="Fit")
@dataclass(frozen=True)
class TextureOptions:
    """How a swatch is fitted, and what it keeps of the recording."""

    order: Annotated[int | Literal["auto"], Help("Order of the models; auto chooses it on held-out data")] = "auto"
    tool: Annotated[str, Help("What held the tip, as in 'steel probe'; the swatch keeps it")] = ""
    tip: Annotated[str, Help("What touched the surface, as in '3.2 mm ball'")] = ""

    def fitting(self, name: str = "unnamed") -> "FitOptions":
        """The options of the fit of a swatch of that name."""
        from hapscene.capture.fit.swatch import FitOptions

        return FitOptions(name, self.order, tool=self.tool, tip=self.tip)


@app.command
def fit(
    recordings: Annotated[list[str], Help("CSV, text, WAV, NPZ, MAT, Parquet or .hsrec files")],
    /,
    *,
    out: Annotated[OutFile, Help("Swatch file to write (default: NAME.swatch, as oak.swatch)")] = None,
    name: Annotated[str | None, Help("Name of the surface (default: as the file that is written)")] = None,
    plot: Annotated[Path | None, Help("Picture of the states of contact over time, .png")] = None,
    options: TextureOptions = TextureOptions(),
    reading: RecordingOptions = RecordingOptions(),
) -> None:
    """Fit a swatch to recordings of a tool on one surface.

    for example:
      hapscene capture fit oak.csv --rate 10000 --units acceleration=g,force=N
      hapscene capture fit stroke.wav taps.wav --name oak -o oak.swatch \\
          --units 'acceleration=98 m/s2'
      hapscene capture fit oak.npz --plot states.png
    """
    for path in recordings:
        check_there(path)
    from hapscene.capture.fit.verdict import verdict
    from hapscene.surface.swatch_file import SUFFIX, save_swatch
    from hapscene.surface.swatch_summary import lines

    out = out or new_file(base_name(recordings[0]) + SUFFIX)
    if out.suffix != SUFFIX:
        raise SwatchError(f"{out}: a swatch's file name must end in {SUFFIX}; `capture batch` fits many into a folder")
    if name is not None and any(sign in name for sign in "/\\"):
        raise SwatchError(f"--name {name!r}: a surface's name has no slash, for files are called by it")
    swatch = _fitted(recordings, name or out.stem, plot, reading.reading(), options)
    save_swatch(swatch, str(out))
    tell([verdict(swatch), *lines(swatch)])
    name_made([out, *([] if plot is None else [plot])])


def _fitted(
    paths: Sequence[str], name: str, plot: Path | None, reading: dict[str, Any], options: TextureOptions
) -> "Swatch":
    from hapscene import __version__
    from hapscene.capture.fit.segment import InteractionState
    from hapscene.capture.fit.swatch import fit_recordings, prepare
    from hapscene.capture.io.recording import load_recording
    from hapscene.capture.report.states import WORDS, write_states
    from hapscene.io.files import refusing
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
        swatch = fit_recordings(parts, options.fitting(name))
    files = printable(", ".join(Path(path).name for path in paths))
    return replace(swatch, provenance=f"Fitted by hapscene {__version__} to {files}. {swatch.provenance}".strip())


@app.command
def batch(
    *recordings: Annotated[str, Help("Files, and folders of them")],
    out: OutFolder = Path("out/swatches"),
    options: TextureOptions = TextureOptions(),
    reading: RecordingOptions = RecordingOptions(),
    workers: WorkerOptions = WorkerOptions(),
) -> int:
    """Fit a swatch to each of many recordings; run the same command again to resume.

    The swatches lie below --out as the recordings do below the folder they share,
    beside journal.jsonl, which lists what was fitted. A recording that
    was fitted with the same content and settings is skipped. Exit codes: 0 all have
    swatches, 1 some failed (listed at the end), 130 stopped by Ctrl-C.

    for example:
      hapscene capture batch recordings/ --rate 10000 --units acceleration=g
      hapscene capture batch oak.csv pine.csv --rate 5000 --out swatches --jobs 4
      hapscene capture batch recordings/ --scheduler tcp://head:8786
    """
    from hapscene.capture.batch import find_recordings, fit_batch

    for place in recordings:
        check_there(place, "file or folder")
    items = find_recordings(recordings)
    if not items:
        raise CaptureError("no recordings given: name at least one file or folder")
    how = (reading.reading(), options.fitting(), workers.jobs, workers.scheduler)
    try:
        result = fit_batch(items, str(out), *how, _progress(len(items)))
    except KeyboardInterrupt:
        complain("interrupted; run the same command again to resume")
        return 130
    tell(
        [
            f"{len(result.fitted)} fitted, {len(result.skipped)} skipped, {len(result.failed)} failed",
            *(f"  {reason}" for reason in result.failed),
            *(f"note: {line}" for line in result.notes),
            "made:",
            f"  {out}: swatches and journal.jsonl",
        ]
    )
    return 1 if result.failed else 0


PROGRESS_S: Final = 5.0
"""Time between two lines of progress [s]."""


def _progress(total: int) -> Any:
    """A function that prints how far a batch is, now and then."""
    start_s = shown_s = time.monotonic()

    def show(result: "BatchResult") -> None:
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
    from hapscene.capture.io.recording import load_recording
    from hapscene.capture.report.page import write_report
    from hapscene.swatches.library import load_swatch

    fitted = load_swatch(swatch)
    loaded = None if recording is None else load_recording(recording, **reading.reading())
    write_report(fitted, str(out), loaded, "" if recording is None else recording.name)
    name_made([out])


# Recordings.


RATE_TOLERANCE: Final = 0.02
"""Difference between the announced and the measured sample rate from which a note is printed [1]."""


@app.command
def record(
    *,
    port: Annotated[str, Help("Serial port of the probe, as /dev/ttyUSB0 or COM3")],
    out: Annotated[OutFile, Help("New file, .hsrec (crash-safe) or .npz")] = Path("recording.hsrec"),
    seconds: Annotated[Positive | None, Help("Length [s] (default: until Ctrl-C)")] = None,
    baud: Annotated[int, Help("Speed of the port [bit/s]")] = BAUD,
) -> int:
    """Record from an accelerometer or force probe on a serial port.

    docs/probe-protocol.md describes what a probe sends.

    for example:
      hapscene capture record --port /dev/ttyUSB0
      hapscene capture record --port COM3 --baud 2000000 --seconds 10 -o stroke.npz
    """
    from hapscene.capture.io.hsrec import SUFFIX
    from hapscene.capture.record.recorder import record as run
    from hapscene.interrupt import interrupt_noted

    assert out is not None
    place = out.with_suffix(SUFFIX)
    was_there = place.exists()
    with interrupt_noted() as stopped:
        try:
            made = run(port, str(out), baud, seconds, stopped, _say_line)
        except KeyboardInterrupt:
            if was_there or not place.exists():
                raise
            complain(f"interrupted; {place} holds the samples recorded until then")
            return 130
    _say_line(str(made))
    _note_rate(made)
    name_made([made.path])
    return 0 if made.complete else 1


def _note_rate(made: "RecordingResult") -> None:
    """Prints notes about the probe: a sample rate that differs from the announced one, restarts."""
    if made.rate_measured_Hz is not None and abs(made.rate_measured_Hz / made.rate_Hz - 1.0) > RATE_TOLERANCE:
        clock = f"by this computer's clock it is {made.rate_measured_Hz:.4g} Hz"
        note(f"{made.path.name}: the probe announced {made.rate_Hz:g} Hz; {clock}")
    if made.count.restarts:
        note(f"{made.path.name}: the probe restarted {made.count.restarts} times")


def _say_line(line: str) -> None:
    say(f"{line}\n")


@app.command
def join(
    recordings: Annotated[InFiles, Help("CSV, text, WAV, NPZ, MAT, Parquet or .hsrec files, two or more")],
    /,
    *,
    out: Annotated[OutFile, Help("NPZ file to write (default: joined.npz)")] = None,
    rate: Annotated[Numbers, Help("Sample rates of files that do not say theirs [Hz]: one for all, or one each")] = (),
) -> None:
    """Join recordings of one event, made by different devices, into one file with one clock.

    Offset and drift of the clocks are found by cross-correlation of the channel
    that the files have in common, else of all their streams. Without a clear peak
    nothing is written.

    for example:
      hapscene capture join handle.csv plate.wav -o oak.npz --rate 1000
      hapscene capture join recording-1.hsrec recording-2.hsrec -o oak.npz
      hapscene capture fit oak.npz --units 'acceleration=98 m/s2'
    """
    from hapscene.capture.record.time_alignment import join as run

    out = out or new_file("joined.npz")
    made = run(recordings, str(out), rates_Hz=rate)
    tell([f"{printable(file.name)}: {known}" for file, known in made.offsets.items()])
    shared = f"{made.duration_s:.3f} s at {made.rate_Hz:g} Hz, by the clock of {printable(made.leader.name)}"
    tell([f"{shared}: {', '.join(made.names)}"])
    for file, known in made.offsets.items():
        if not known.common:
            note(f"{file.name}: no common channel; the delay of a sensor's filter counts as offset")
    name_made([made.path])
