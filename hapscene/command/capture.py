"""`hapscene capture`: the group of commands of haptography; here those that fit, and judge a fit."""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from hapscene.command.console import complain, name_made, say, tell, tell_over
from hapscene.command.options import (
    add_command,
    add_group,
    add_out_file,
    add_out_folder,
    add_recording_options,
    add_workers,
    base_name,
    check_swatch,
    check_there,
    new_file,
    recording_options,
    whole,
)
from hapscene.command.record import add_coverage, add_join, add_record
from hapscene.constants import ORDER_MAX
from hapscene.errors import CaptureError, SwatchError, printable

if TYPE_CHECKING:
    from hapscene.capture.batch import BatchResult
    from hapscene.capture.fit.swatch import FitOptions
    from hapscene.surface.swatch import Swatch


def add_capture(commands: Any) -> None:
    """Declare the group and its commands."""
    summary = "haptography: record a surface, fit a swatch to it, judge the fit"
    parts = (add_fit, add_record, add_coverage, add_join, add_batch, add_report)
    add_group(commands, "capture", summary, *parts)


# `hapscene capture fit`.


def add_fit(commands: Any) -> None:
    command = add_command(commands, "fit", _fit)
    command.add_argument(
        "recordings", metavar="RECORDING", nargs="*",
        help="CSV, text, WAV, NPZ, MAT or .hsrec; several are pooled into one swatch, unless -o is a folder",
    )  # fmt: skip
    command.add_argument("--name", help="what the surface is called (default: as the file that is written)")
    add_out_file(
        command,
        "SWATCH",
        "the .swatch file to write; or a folder, as in swatches/, for a swatch of each recording "
        f"(default NAME.swatch, as oak.swatch; of folders, {BATCH_OUT})",
    )
    add_fit_options(command)
    command.add_argument("--plot", metavar="PNG", help="draw what the tool does when, and write it here")
    add_batch_options(command.add_argument_group("for a swatch of each recording (as `hapscene capture batch`)"))
    add_recording_options(command)


def _fit(options: argparse.Namespace) -> int:
    r"""Fit a swatch to recordings of a tool on one surface; or, into a folder, a swatch to each recording.

    for example:
      hapscene capture fit oak.csv --rate 10000 --units acceleration=m/s2,speed=mm/s,force=N   # as oak.swatch
      hapscene capture fit oak.csv --name oak -o oak.swatch --rate 10000 \
          --columns acceleration=accel,speed=v --units acceleration=m/s2,speed=mm/s,force=N
      hapscene capture fit stroke.wav taps.wav --name oak -o oak.swatch --units 'acceleration=98 m/s2'
      hapscene capture fit oak.npz --plot states.png
      hapscene capture fit recordings/*.csv -o swatches/ --scheduler tcp://head:8786
      hapscene capture fit sensor_data/accel/17_*.csv --name denim -o denim.swatch   # a published data set
    """
    return _batch(options) if _is_batch(options) else _fit_one(options)


def _is_batch(options: argparse.Namespace) -> bool:
    """Whether each recording is to have a swatch of its own; refuses options that do not fit together."""
    from hapscene.surface.swatch_file import SUFFIX

    for_each = [name for name in ("list", "jobs", "scheduler") if getattr(options, name) is not None]
    folders = [path for path in options.recordings if Path(path).is_dir()]
    if options.out is None:
        if for_each or folders:
            options.out = f"{BATCH_OUT}/"
        elif options.recordings:
            check_there(options.recordings[0], CaptureError)
            options.out = new_file(base_name(options.recordings[0]) + SUFFIX, "-o")
        else:
            raise CaptureError("no recordings: name one or more files")
    out = Path(options.out)
    if out.suffix == SUFFIX and not out.is_dir():
        if for_each:
            raise CaptureError(
                f"--{for_each[0]} is for a swatch of each recording: with it, -o names a folder, as in -o swatches/, "
                f"not {options.out}"
            )
        if folders:
            raise CaptureError(
                f"{folders[0]}: a folder: for a swatch of each recording in it name a folder, as in -o swatches/; "
                f"to pool its recordings into {options.out}, name its files"
            )
        if not options.recordings:
            raise CaptureError("no recordings: name one or more files")
        for path in options.recordings:
            check_there(path, CaptureError)
        if options.name is not None and any(sign in options.name for sign in "/\\"):
            raise SwatchError(f"--name {options.name!r}: a surface's name has no slash, for files are called by it")
        return False
    if not (for_each or out.is_dir() or options.out.endswith(("/", os.sep))):
        raise SwatchError(
            f"{options.out}: a swatch's file name must end in {SUFFIX}; a folder, for a swatch of each recording, "
            f"is named with a slash: -o {options.out}/"
        )
    for name in ("name", "plot"):
        if getattr(options, name) is not None:
            raise CaptureError(
                f"--{name} is for one swatch: leave it out, or name a file, as in -o oak{SUFFIX}; here each recording "
                f"has a swatch of its own in {options.out}"
            )
    return True


def _fit_one(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from hapscene import __version__
    from hapscene.capture.fit.segment import InteractionState
    from hapscene.capture.fit.swatch import fit_parts, prepare, recorded_ranges
    from hapscene.capture.io.recording import load_recording
    from hapscene.capture.report.states import WORDS, write_states
    from hapscene.files import refusing
    from hapscene.surface.swatch_file import save_swatch
    from hapscene.touch import step

    parts = []
    for path in options.recordings:
        with step(say, f"reading {path}"):
            recording = [load_recording(path, **recording_options(options))]
            with refusing(CaptureError, path):
                parts.append(prepare(recording.pop()))  # a long one is as large as what is made of it
        lengths_s = {state: parts[-1][1].seconds(state) for state in InteractionState}
        say(f"  {', '.join(f'{WORDS[state]} {length_s:.1f} s' for state, length_s in lengths_s.items() if length_s)}\n")
    made = []
    if options.plot is not None:  # before the fit: it shows why one may fail
        write_states(parts, options.plot, [Path(path).name for path in options.recordings])
        made.append(Path(options.plot))
    with step(say, "fitting"), refusing(CaptureError, ", ".join(options.recordings)):
        swatch = fit_parts(parts, fit_options(options, options.name or Path(options.out).stem))
    files = printable(", ".join(Path(path).name for path in options.recordings))
    provenance = f"Fitted by hapscene {__version__} to {files}. {swatch.provenance}".strip()
    swatch = replace(swatch, provenance=provenance)
    save_swatch(swatch, options.out)
    tell(_told(swatch, recorded_ranges(parts)))
    name_made([Path(options.out), *made])
    return 0


def _told(swatch: "Swatch", ranges: str) -> list[str]:
    """The main numbers of a swatch with their 95 % intervals, and what is absent and why, a line each."""
    from hapscene.capture.fit.taps import SPEED_RATIO
    from hapscene.surface.swatch import TOOL_FIELDS
    from hapscene.surface.swatch_summary import MORE, sounding

    lines = [f"{swatch.name}:"]
    lines += [f"  {what}: {getattr(swatch, what)}" for what in TOOL_FIELDS if getattr(swatch, what)]
    texture, taps = swatch.texture, swatch.taps
    if texture is not None:
        count = sounding(texture)
        lines.append(
            f"  texture: order {texture.order}, {count} model{'s' if count != 1 else ''} at {texture.rate_Hz:g} Hz, "
            f"up to {texture.force_max_N:.2f} N and {1e3 * texture.speed_max_m_s:.0f} mm/s"
        )
        if texture.life is not None:
            spread = _interval(swatch.intervals.get("texture.life.log_spread"), ".2f")
            rates = ((texture.life.decay_1_s, "ms"), (texture.life.decay_1_m, "mm"))
            after = [f"{1e3 / rate:.3g} {unit}" for of, unit in rates for rate in of if rate > 0.0]
            said = f"  life: its gain spreads by {texture.life.log_spread:.2f} {spread} (1 is 8.7 dB), forgotten after "
            lines.append(said + ", ".join(after))
    if swatch.friction_dynamic > 0.0:
        lines.append(f"  friction: dynamic {_with_interval(swatch, 'friction_dynamic', '.3f')}")
        lines.append(f"            static {_with_interval(swatch, 'friction_static', '.3f')}")
    if "stiffness_N_m" in swatch.intervals:
        lines.append(f"  stiffness: {_with_interval(swatch, 'stiffness_N_m', '.0f')} N/m")
    if "damping_Ns_m" in swatch.intervals:
        lines.append(f"  damping: {_with_interval(swatch, 'damping_Ns_m', '.3g')} N·s/m")
    lines += [f"  {name}: {_with_interval(swatch, name, '.3g')}" for name in MORE if name in swatch.intervals]
    if swatch.leaving is not None:
        lines.append(f"  leaving: sounds at {len(swatch.leaving.approach_m_s)} speeds")
    for i, speed in enumerate(() if taps is None else taps.approach_m_s):
        assert taps is not None
        frequency, decay = swatch.intervals.get(f"taps.frequency_Hz[{i}]"), swatch.intervals.get(f"taps.decay_1_s[{i}]")
        lines.append(
            f"  tap at {1e3 * speed:.0f} mm/s: {taps.amplitude_m_s2[i]:.3g} m/s², {taps.frequency_Hz[i]:.1f} "
            f"{_interval(frequency, '.1f')} Hz, decay {taps.decay_1_s[i]:.0f} {_interval(decay, '.0f')} 1/s"
        )
    if taps is not None:
        lines.append(f"  (taps at speeds within {100 * (SPEED_RATIO - 1):.0f} % count as one)")
    if ranges:
        lines.append(f"  recorded with {ranges}")
    if swatch.intervals:
        lines.append("  in brackets: 95 % intervals")
    lines += [f"  absent: {name}: {reason}" for name, reason in swatch.absent.items()]
    return lines


def _with_interval(swatch: "Swatch", name: str, form: str) -> str:
    return f"{getattr(swatch, name):{form}} {_interval(swatch.intervals.get(name), form)}".rstrip()


def _interval(pair: tuple[float, float] | None, form: str) -> str:
    return "" if pair is None else f"[{pair[0]:{form}}, {pair[1]:{form}}]"


# The options that say how a texture is fitted: the order of its models, how they blend.


BATCH_OUT: Final = "out/swatches"
"""Where a swatch of each recording goes unless it is said."""

DOMAINS: Final = ("auto", "plain", "warped")  # as in capture.order_search
INTERPOLATIONS: Final = ("lsf", "reflection", "direct", "hatt")  # as in surface.blend, which is heavy to import


def add_fit_options(command: argparse.ArgumentParser) -> None:
    """Adds --order, --domain, --interpolation, --tool and --tip."""
    command.add_argument(
        "--order", type=_order, default="auto", metavar="N",
        help="of the texture's models (default: auto, held-out data)",
    )  # fmt: skip
    command.add_argument(
        "--domain", choices=DOMAINS, default="auto",
        help="frequency axis of the models: plain, or warped, finer where more is felt (default: auto, the better one "
        "on held-out data)",
    )  # fmt: skip
    command.add_argument(
        "--interpolation", choices=INTERPOLATIONS, default="lsf", help="how the texture blends its models (default lsf)"
    )
    command.add_argument("--tool", default="", help="what held the tip, as in 'steel probe'; a swatch keeps it")
    command.add_argument("--tip", default="", help="what touched the surface, as in '3.2 mm ball'")


def fit_options(options: argparse.Namespace, name: str = "unnamed") -> "FitOptions":
    """How a swatch of that name is fitted."""
    from hapscene.capture.fit.swatch import FitOptions

    return FitOptions(
        name,
        options.order,
        interpolation=options.interpolation,
        domain=options.domain,
        tool=options.tool,
        tip=options.tip,
    )


def _order(text: str) -> int | Literal["auto"]:
    if text == "auto":
        return "auto"
    return whole('an order is "auto", or', 1, ORDER_MAX)(text)


# `hapscene capture batch`.


TERMINAL_S: Final = 0.1
"""Time between two states of the progress line on a terminal [s]."""

LOG_S: Final = 10.0
"""Time between two lines of progress where the output is no terminal [s]."""


def add_batch(commands: Any) -> None:
    command = add_command(commands, "batch", _batch)
    command.add_argument("recordings", metavar="RECORDING", nargs="*", help="files, and folders of them")
    add_out_folder(command, BATCH_OUT)
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
    add_workers(command)


def _batch(options: argparse.Namespace) -> int:
    """Fit a swatch to each of many recordings; run the same again to continue after an interruption.

    The swatches lie below --out as the recordings do below the folder they share, beside journal.jsonl, which
    lists what was fitted. What was fitted with the same content and settings is skipped.
    Exit code: 0 all have swatches, 1 some failed (named at the end), 130 stopped by Ctrl-C.

    for example:
      hapscene capture batch recordings/ --rate 10000 --units acceleration=m/s2,force=N,speed=m/s
      hapscene capture batch --list files.csv --out swatches --jobs 4
      hapscene capture batch recordings/*.hsrec --out swatches --scheduler tcp://head:8786
    """
    from hapscene.capture.batch import find_recordings, fit_batch, read_list

    if options.jobs is not None and options.scheduler is not None:
        raise CaptureError("--jobs is for processes here, --scheduler for a cluster: give one of the two")
    for place in options.recordings:
        check_there(place, CaptureError, "file or folder")
    check_there(options.list, CaptureError)
    items = find_recordings(options.recordings)
    items += [] if options.list is None else read_list(options.list)
    if not items:
        raise CaptureError("no recordings: name files or folders, or --list files.csv")
    items = list({item.path.absolute(): item for item in items}.values())
    progress = _Progress(len(items))
    try:
        how = (recording_options(options), fit_options(options), options.jobs, options.scheduler)
        result = fit_batch(items, options.out, *how, progress.show)
    except KeyboardInterrupt:
        progress.end()
        complain("interrupted; run the same again to continue")
        return 130
    finally:
        progress.end()
    tell(
        [
            f"{len(result.fitted)} fitted, {len(result.skipped)} skipped, {len(result.failed)} failed",
            *(f"  {reason}" for reason in result.failed),
            *(f"note: {line}" for line in result.notes),
            "made:",
            f"  {options.out}: swatches and journal.jsonl",
        ]
    )
    return 1 if result.failed else 0


class _Progress:
    """One line that tells how far the batch is; plain lines where the output is no terminal."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._live = sys.stdout.isatty()
        self._start_s = time.monotonic()
        self._shown_s = self._start_s
        self._open = False

    def show(self, result: "BatchResult") -> None:
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
        tell_over(line) if self._live else tell([line])
        self._open = self._live

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


# `hapscene capture report`.


def add_report(commands: Any) -> None:
    command = add_command(commands, "report", _report)
    command.add_argument("swatch", metavar="SWATCH", help="a .swatch file, or the name of a shipped swatch")
    command.add_argument(
        "recording", metavar="RECORDING", nargs="?", help="what it was fitted to, or another recording of that surface"
    )
    add_out_file(command, "PAGE", "the HTML file to write (default NAME.html, as oak.html)")
    add_recording_options(command)


def _report(options: argparse.Namespace) -> int:
    """One page on how good a swatch is and why: plots, figures, what is absent.

    for example:
      hapscene capture report oak.swatch oak.csv --rate 10000 --units acceleration=m/s2,force=N -o oak.html
      hapscene capture report wood                                     # as wood.html
    """
    check_swatch(options.swatch)
    check_there(options.recording, CaptureError)
    options.out = options.out or new_file(f"{base_name(options.swatch)}.html", "-o")
    from hapscene.capture.io.recording import load_recording
    from hapscene.capture.report.page import write_report
    from hapscene.swatches.library import load_swatch

    swatch = load_swatch(options.swatch)
    recording, source = None, ""
    if options.recording is not None:
        recording = load_recording(options.recording, **recording_options(options))
        source = Path(options.recording).name
    write_report(swatch, options.out, recording, source)
    name_made([Path(options.out)])
    return 0
