"""`hapscene capture`: record a surface, fit a swatch, evaluate the fit."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import App, Parameter

from hapscene.cli.console import print_error, print_files, print_lines, print_note, print_progress
from hapscene.cli.inputs import base_name, check_there, new_file
from hapscene.cli.options import (
    Help,
    InFile,
    InFiles,
    OutFile,
    OutFolder,
    Positive,
    RecordingOptions,
    SwatchName,
    WorkerOptions,
)
from hapscene.errors import CaptureError, SwatchError, printable
from hapscene.io.probe_port import BAUD

if TYPE_CHECKING:
    from hapscene.capture.batch import BatchResult
    from hapscene.capture.fit.swatch import FitOptions
    from hapscene.capture.recorder import RecordingResult
    from hapscene.surface.swatch import Swatch

__all__ = ["app"]

app = App(name="capture", synonym="fit", help="Haptography: record a surface, fit a swatch, evaluate the fit.")


# Fits.


@Parameter(name="*", group="Fit")
@dataclass(frozen=True)
class TextureOptions:
    """Options of a fit, and metadata of the swatch."""

    order: Annotated[int | Literal["auto"], Help("AR order; auto selects it on held-out data")] = "auto"
    tool: Annotated[str, Help("Tool of the recording, as in 'steel probe', stored in the swatch")] = ""
    tip: Annotated[str, Help("Tip of the tool, as in '3.2 mm ball', stored in the swatch")] = ""

    def fitting(self, name: str = "unnamed") -> "FitOptions":
        """The options of a fit for a swatch called `name`."""
        from hapscene.capture.fit.swatch import FitOptions

        return FitOptions(name, self.order, tool=self.tool, tip=self.tip)


@app.command
def fit(
    recordings: Annotated[list[str], Help("CSV, text, WAV, NPZ, MAT or .hsrec files")],
    /,
    *,
    out: Annotated[OutFile, Help("Swatch file to write (default: NAME.swatch, as oak.swatch)")] = None,
    name: Annotated[str | None, Help("Name of the swatch (default: name of the written file)")] = None,
    options: TextureOptions = TextureOptions(),
    reading: RecordingOptions = RecordingOptions(),
) -> None:
    """Fit a swatch to recordings of a tool that touches one surface.

    A recording needs acceleration; force and speed make the texture depend on them.
    Sliding, taps and pressing are found in the recording.

    examples:
      hapscene capture fit oak.csv --rate 10000 --units acceleration=g,force=N
      hapscene capture fit stroke.wav taps.wav --name oak -o oak.swatch \\
          --units 'acceleration=98 m/s2'
    """
    for path in recordings:
        check_there(path)
    from hapscene.capture.fit.swatch import verdict
    from hapscene.surface.swatch_file import SUFFIX, save_swatch
    from hapscene.surface.swatch_summary import lines

    out = out or new_file(base_name(recordings[0]) + SUFFIX)
    if out.suffix != SUFFIX:
        raise SwatchError(
            f"{out}: expected a swatch file name that ends with {SUFFIX}; `capture batch` fits many into a folder"
        )
    if name is not None and any(sign in name for sign in "/\\"):
        raise SwatchError(f"--name {name!r} contains a slash; expected a name that can be part of a file name")
    swatch = _fitted(recordings, name or out.stem, reading, options)
    save_swatch(swatch, str(out))
    print_lines([verdict(swatch), *lines(swatch)])
    print_files([out])


def _fitted(paths: Sequence[str], name: str, reading: RecordingOptions, options: TextureOptions) -> "Swatch":
    from hapscene import __version__
    from hapscene.capture.fit.segment import InteractionState
    from hapscene.capture.fit.swatch import fit_recordings, prepare
    from hapscene.capture.io.recording import load_recording
    from hapscene.io.files import refusing
    from hapscene.touch import step

    parts = []
    for path in paths:
        with step(print_progress, f"reading {path}"):
            recording = [load_recording(path, **reading.reading())]
            with refusing(CaptureError, path):
                parts.append(prepare(recording.pop()))  # pop: free the recording, which may be large
        lengths_s = {state: parts[-1][1].seconds(state) for state in InteractionState}
        print_progress(
            f"  {', '.join(f'{state.word} {length_s:.1f} s' for state, length_s in lengths_s.items() if length_s)}\n"
        )
    with step(print_progress, "fitting"), refusing(CaptureError, ", ".join(paths)):
        swatch = fit_recordings(parts, options.fitting(name))
    files = printable(", ".join(Path(path).name for path in paths))
    given = {name: value for name, value in reading.reading().items() if value}
    options_text = f" {READ_WITH}{json.dumps(given)}." if given else ""
    fitted = f"Fitted by hapscene {__version__} to {files}.{options_text} {swatch.provenance}"
    return replace(swatch, provenance=fitted.strip())


READ_WITH: Final = "Read with "
"""Start of the options of `load_recording` in the provenance of a swatch, as JSON."""


def _remembered(provenance: str, file: str) -> dict[str, Any]:
    """The options of `load_recording` with which a fit read `file`; empty if it read another file."""
    fitted, _, text = provenance.partition(READ_WITH)
    try:
        stored = json.JSONDecoder().raw_decode(text)[0] if file in fitted else {}
        names = {"columns", "units"} & stored.keys()
        pairs = {name: {key: str(value) for key, value in dict(stored[name]).items()} for name in names}
        return pairs | ({"rate_Hz": float(stored["rate_Hz"])} if "rate_Hz" in stored else {})
    except (ValueError, TypeError, AttributeError):
        return {}  # not the text of a fit


@app.command
def batch(
    *recordings: Annotated[str, Help("Recordings, or folders of recordings")],
    out: OutFolder = Path("out/swatches"),
    options: TextureOptions = TextureOptions(),
    reading: RecordingOptions = RecordingOptions(),
    workers: WorkerOptions = WorkerOptions(),
) -> int:
    """Fit a swatch to each of many recordings; run the same command again to resume.

    The folders below --out mirror those of the recordings. journal.jsonl lists the
    completed fits; a recording with unchanged content and options is skipped. Exit
    codes: 0 success; 1 some fits failed, listed at the end; 130 Ctrl-C.

    examples:
      hapscene capture batch recordings/ --rate 10000 --units acceleration=g
      hapscene capture batch oak.csv pine.csv --rate 5000 --out swatches --jobs 4
      hapscene capture batch recordings/ --scheduler tcp://head:8786
    """
    from hapscene.capture.batch import find_recordings, fit_batch

    for place in recordings:
        check_there(place, "file or folder")
    items = find_recordings(recordings)
    if not items:
        raise CaptureError("no recordings found; expected files, or folders with recordings")
    how = (reading.reading(), options.fitting(), workers.jobs, workers.scheduler)
    try:
        result = fit_batch(items, str(out), *how, _progress(len(items)))
    except KeyboardInterrupt:
        print_error("interrupted; run the same command again to resume")
        return 130
    print_lines(
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
"""Interval between lines of progress [s]."""


def _progress(total: int) -> "Callable[[BatchResult], None]":
    """Return a function that prints the progress of a batch every `PROGRESS_S`."""
    start_s = shown_s = time.monotonic()

    def show(result: "BatchResult") -> None:
        nonlocal shown_s
        now_s = time.monotonic()
        if now_s - shown_s >= PROGRESS_S:
            shown_s = now_s
            rate_1_s = (len(result.fitted) + len(result.failed)) / (now_s - start_s)
            print_lines([f"{result.count} of {total}, {len(result.failed)} failed, {rate_1_s:.2g} per second"])

    return show


@app.command
def report(
    swatch: SwatchName,
    recording: Annotated[InFile | None, Help("Recording of the same surface to compare with")] = None,
    /,
    *,
    out: Annotated[OutFile, Help("HTML page to write (default: NAME.html, as oak.html)")] = None,
    reading: RecordingOptions = RecordingOptions(),
) -> None:
    """Write a report on the quality of a swatch: verdict, plots, figures, missing measurements.

    A recording that the swatch was fitted to is read with the options of the fit.

    examples:
      hapscene capture report wood                             # to wood.html
      hapscene capture report oak.swatch oak.csv
    """
    out = out or new_file(f"{base_name(swatch)}.html")
    from hapscene.capture.io.recording import load_recording
    from hapscene.capture.report.page import write_report
    from hapscene.swatches.library import load_swatch

    fitted = load_swatch(swatch)
    loaded = None
    if recording is not None:
        given = {name: value for name, value in reading.reading().items() if value}
        loaded = load_recording(recording, **_remembered(fitted.provenance, recording.name) | given)
    write_report(fitted, str(out), loaded, "" if recording is None else recording.name)
    print_files([out])


# Recordings.


RATE_TOLERANCE: Final = 0.02
"""Relative difference between announced and measured sample rate above which a note is printed [1]."""


@app.command
def record(
    *,
    port: Annotated[str, Help("Serial port of the probe, as in /dev/ttyUSB0 or COM3")],
    out: Annotated[OutFile, Help("New file, .hsrec, which survives a crash")] = Path("recording.hsrec"),
    seconds: Annotated[Positive | None, Help("Duration [s] (default: until Ctrl-C)")] = None,
    baud: Annotated[int, Help("Baud rate of the port [bit/s]")] = BAUD,
) -> int:
    """Record from an accelerometer or force probe on a serial port.

    docs/reference/probe-protocol.md specifies the protocol of a probe. Exit code 1
    means that the recording ended early: the probe was disconnected.

    examples:
      hapscene capture record --port /dev/ttyUSB0
      hapscene capture record --port COM3 --baud 2000000 --seconds 9 -o oak.hsrec
    """
    from hapscene.capture.recorder import record as run
    from hapscene.interrupt import interrupt_noted

    assert out is not None
    was_there = out.exists()
    with interrupt_noted() as stopped:
        try:
            made = run(port, str(out), baud, seconds, stopped, _print_line)
        except KeyboardInterrupt:
            if was_there or not out.exists():
                raise
            print_error(f"interrupted; the samples recorded so far are in {out}")
            return 130
    _print_line(str(made))
    _note_rate(made)
    print_files([made.path])
    return 0 if made.complete else 1


def _note_rate(made: "RecordingResult") -> None:
    """Print a note if the sample rate of the probe is wrong or the probe has restarted."""
    if made.rate_measured_Hz is not None and abs(made.rate_measured_Hz / made.rate_Hz - 1.0) > RATE_TOLERANCE:
        measured = f"measured with the clock of this computer: {made.rate_measured_Hz:.4g} Hz"
        print_note(f"{made.path.name}: sample rate announced by the probe: {made.rate_Hz:g} Hz; {measured}")
    if made.count.restarts:
        print_note(f"{made.path.name}: the probe restarted {made.count.restarts} times")


def _print_line(line: str) -> None:
    print_progress(f"{line}\n")


@app.command
def join(
    recordings: Annotated[InFiles, Help("CSV, text, WAV, NPZ, MAT or .hsrec files, two or more")],
    /,
    *,
    out: Annotated[OutFile, Help("NPZ file to write (default: joined.npz)")] = None,
    rate: Annotated[Positive | None, Help("Sample rate of files that do not store one [Hz]")] = None,
) -> None:
    """Align recordings of one event from different devices in time, and join them into one file.

    Offset and drift of the clocks are estimated by cross-correlation of a channel
    that the files share, or of all their streams. If the correlation has no clear
    peak, the command fails and writes nothing.

    examples:
      hapscene capture join handle.csv plate.wav -o oak.npz --rate 1000
      hapscene capture join recording-1.hsrec recording-2.hsrec -o oak.npz
      hapscene capture fit oak.npz --units 'acceleration=98 m/s2'
    """
    from hapscene.capture.time_alignment import join as run

    out = out or new_file("joined.npz")
    made = run(recordings, str(out), rate_Hz=rate)
    print_lines([f"{printable(file.name)}: {known}" for file, known in made.offsets.items()])
    shared = f"{made.duration_s:.3f} s at {made.rate_Hz:g} Hz, on the clock of {printable(made.leader.name)}"
    print_lines([f"{shared}: {', '.join(made.names)}"])
    for file, known in made.offsets.items():
        if not known.common:
            print_note(f"{file.name}: no common channel; filter delays of the sensors are part of the estimated offset")
    print_files([made.path])
