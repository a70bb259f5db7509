"""`hapscene capture batch`."""

import argparse
import sys
import time
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.fit_option import add_fit_options, fit_options
from hapscene.command.recording_option import add_recording_options, recording_options
from hapscene.command.word import add_command, whole

if TYPE_CHECKING:
    from hapscene.capture.batch import Result
    from hapscene.capture.batch_manifest import Entry

TERMINAL_S: Final = 0.1
"""Time between two states of the progress line on a terminal [s]."""

LOG_S: Final = 10.0
"""Time between two lines of progress where the output is no terminal [s]."""


def add_batch(commands: Any) -> None:
    command = add_command(
        commands,
        "batch",
        run_batch,
        "fit a swatch to each of many recordings; run it again to go on where it was stopped",
        "hapscene capture batch recordings/ --out swatches --rate 10000 --units acceleration=m/s2,force=N,speed=m/s",
        "hapscene capture batch --list files.csv --out swatches --jobs 4",
        "hapscene capture batch recordings/*.hsrec --out swatches --scheduler tcp://head:8786",
    )
    command.description = (
        f"{command.description}\n\n"
        "The swatches lie below --out as the recordings do below the folder they share, beside manifest.json, which\n"
        "says of each recording what became of it. What was fitted with the same content and settings is skipped.\n"
        "Exit code: 0 all have swatches, 1 some failed (named at the end), 130 stopped by Ctrl-C."
    )
    command.add_argument("recordings", metavar="RECORDING", nargs="*", help="files, and folders of them")
    command.add_argument("-o", "--out", required=True, metavar="DIR", help="folder to write into")
    add_fit_options(command)
    add_batch_options(command)
    add_recording_options(command)


def add_batch_options(command: argparse._ActionsContainer) -> None:
    """Adds --list, --jobs and --scheduler."""
    command.add_argument(
        "--list",
        metavar="CSV",
        help="recordings from a list: a column recording (relative to the list), and where wanted name, rate, columns, "
        "units",
    )
    command.add_argument(
        "--jobs", type=whole("a number of processes", 1), metavar="N", help="processes here (default: one per core)"
    )
    command.add_argument("--scheduler", metavar="ADDRESS", help="fit on a Dask cluster instead: tcp://host:8786")


def run_batch(options: argparse.Namespace) -> int:
    """Fits a swatch to each recording, into the folder `options.out`; the exit code."""
    from hapscene.capture.batch import fit_batch
    from hapscene.capture.batch_input import gather, read_list
    from hapscene.errors import CaptureError
    from hapscene.interrupt import interrupt_noted

    if options.jobs is not None and options.scheduler is not None:
        raise CaptureError("--jobs is for processes here, --scheduler for a cluster: give one of the two")
    items = gather(options.recordings) + ([] if options.list is None else read_list(options.list))
    if not items:
        raise CaptureError("no recordings: name files or folders, or --list files.csv")
    items = list({item.path.absolute(): item for item in items}.values())
    progress = _Progress(len(items))
    with interrupt_noted() as stopped:

        def asked() -> bool:
            if stopped():
                progress.stopping()
            return stopped()

        try:
            result = fit_batch(
                items,
                options.out,
                recording_options(options),
                fit_options(options),
                options.jobs,
                options.scheduler,
                asked,
                progress.show,
            )
        except KeyboardInterrupt:
            progress.end()
            print("hapscene: interrupted; run the same again to go on", file=sys.stderr)
            return 130
        finally:
            progress.end()
    print(f"{len(result.fitted)} fitted, {len(result.skipped)} done before, {len(result.failed)} failed")
    for entry in result.failed:
        print(f"  {entry.reason}")
    for note in result.notes:
        print(f"note: {note}")
    print(f"made:\n  {options.out}: swatches and manifest.json")
    if result.stopped:
        left = len(items) - result.count
        print(f"hapscene: interrupted with {left} recordings left; run the same again to go on", file=sys.stderr)
        return 130
    return 1 if result.failed else 0


class _Progress:
    """One line that tells how far the batch is; plain lines where the output is no terminal."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._live = sys.stdout.isatty()
        self._start_s = time.monotonic()
        self._shown_s = self._start_s
        self._open = False
        self._told = False

    def show(self, result: "Result", entry: "Entry") -> None:
        """Shows the state, if it is time for it."""
        now_s = time.monotonic()
        if now_s - self._shown_s < (TERMINAL_S if self._live else LOG_S):
            return
        self._shown_s = now_s
        worked = len(result.fitted) + len(result.failed)
        line = f"{result.count} of {self._total}, {len(result.failed)} failed"
        if worked:
            left_s = (self._total - result.count) * (now_s - self._start_s) / worked
            line += f", {worked / (now_s - self._start_s):.2g} a second, about {duration(left_s)} left"
        print(f"\r{line}\x1b[K" if self._live else line, end="" if self._live else "\n", flush=True)
        self._open = self._live

    def stopping(self) -> None:
        """Says once that the end is near."""
        if not self._told:
            self._told = True
            self.end()
            print("finishing what is under way; Ctrl-C again leaves it", flush=True)

    def end(self) -> None:
        """Leaves the line."""
        if self._open:
            print(flush=True)
            self._open = False


def duration(seconds: float) -> str:
    """A duration in words: "40 s", "12 min", "3 h 20 min"."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"
