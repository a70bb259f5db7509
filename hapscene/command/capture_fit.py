"""`hapscene capture fit`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapscene.command.capture_batch import add_batch_options, run_batch
from hapscene.command.fit_option import add_fit_options, fit_options
from hapscene.command.recording_option import add_recording_options, recording_options
from hapscene.command.word import add_command, name_made

if TYPE_CHECKING:
    from hapscene.surface.swatch import Swatch


def add_capture_fit(commands: Any) -> None:
    command = add_command(
        commands,
        "fit",
        _fit,
        "fit a swatch to recordings of a tool on one surface; or, into a folder, a swatch to each recording",
        "hapscene capture fit oak.csv --name oak -o oak.swatch --rate 10000 \\",
        "    --columns acceleration=accel,speed=v --units acceleration=m/s2,speed=mm/s,force=N",
        "hapscene capture fit stroke.wav taps.wav --name oak -o oak.swatch --units 'acceleration=98 m/s2'",
        "hapscene capture fit oak.npz --name oak -o oak.swatch --plot states.png",
        "hapscene capture fit recordings/*.csv -o swatches/ --scheduler tcp://head:8786",
    )
    command.add_argument(
        "recordings", metavar="RECORDING", nargs="*",
        help="CSV, text, WAV, NPZ, MAT or .hsrec; several are pooled into one swatch, unless -o is a folder",
    )  # fmt: skip
    command.add_argument("--name", help="what the surface is called (default: as the file that is written)")
    command.add_argument(
        "-o", "--out", metavar="SWATCH", required=True,
        help="the .swatch file to write; or a folder, as in swatches/, for a swatch of each recording",
    )  # fmt: skip
    add_fit_options(command)
    command.add_argument("--plot", metavar="PNG", help="draw what the tool does when, and write it here")
    add_batch_options(command.add_argument_group("for a swatch of each recording (as `hapscene capture batch`)"))
    add_recording_options(command)


def _fit(options: argparse.Namespace) -> int:
    if _is_batch(options):
        return run_batch(options)
    return _fit_one(options)


def _is_batch(options: argparse.Namespace) -> bool:
    """Whether each recording is to have a swatch of its own; refuses options that do not fit together."""
    import os

    from hapscene.errors import CaptureError, SwatchError
    from hapscene.surface.swatch_file import SUFFIX

    out = Path(options.out)
    for_each = [name for name in ("list", "jobs", "scheduler") if getattr(options, name) is not None]
    if out.suffix == SUFFIX and not out.is_dir():
        if for_each:
            raise CaptureError(
                f"--{for_each[0]} is for a swatch of each recording: with it, -o names a folder, as in -o swatches/, "
                f"not {options.out}"
            )
        folders = [path for path in options.recordings if Path(path).is_dir()]
        if folders:
            raise CaptureError(
                f"{folders[0]}: a folder: for a swatch of each recording in it name a folder, as in -o swatches/; "
                f"to pool its recordings into {options.out}, name its files"
            )
        if not options.recordings:
            raise CaptureError("no recordings: name one or more files")
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
    from hapscene.capture.recording_file import load_surface_recording
    from hapscene.capture.segment import State
    from hapscene.capture.segment_plot import WORDS, write_states
    from hapscene.capture.swatch_fit import fit_parts, prepare
    from hapscene.errors import CaptureError
    from hapscene.surface.swatch_file import save_swatch
    from hapscene.touch import speak

    parts = []
    for path in options.recordings:
        speak(f"reading {path}\n")
        recording = load_surface_recording(path, **recording_options(options))
        try:
            part = prepare(recording)
        except CaptureError as error:
            raise CaptureError(f"{path}: {error}") from None
        parts.append(part)
        held = (f"{WORDS[state]} {part[1].seconds(state):.1f} s" for state in State if part[1].seconds(state))
        speak(f"  {', '.join(held)}\n")
    made = []
    if options.plot is not None:  # before the fit: it shows why one may fail
        write_states(parts, options.plot, [Path(path).name for path in options.recordings])
        made.append(Path(options.plot))
    speak("fitting\n")
    swatch = fit_parts(parts, options.name or Path(options.out).stem, **fit_options(options))
    files = ", ".join(Path(path).name for path in options.recordings)
    provenance = f"Fitted by hapscene {__version__} to {files}. {swatch.provenance}".strip()
    swatch = replace(swatch, provenance=provenance)
    save_swatch(swatch, options.out)
    print("\n".join(summary(swatch)))
    name_made([Path(options.out), *made])
    return 0


def summary(swatch: "Swatch") -> list[str]:
    """The main numbers of a swatch with their 95 % intervals, and what is absent and why, a line each."""
    from hapscene.capture.tap_fit import SPEED_RATIO
    from hapscene.surface.portrait import sounding

    lines = [f"{swatch.name}:"]
    texture, taps = swatch.texture, swatch.taps
    if texture is not None:
        count = sounding(texture)
        lines.append(
            f"  texture: order {texture.order}, {count} model{'s' if count != 1 else ''} at {texture.rate_Hz:g} Hz, "
            f"up to {texture.force_max_N:.2f} N and {1e3 * texture.speed_max_m_s:.0f} mm/s"
        )
    if swatch.friction_dynamic > 0.0:
        lines.append(f"  friction: dynamic {_number(swatch, 'friction_dynamic', '.3f')}")
        lines.append(f"            static {_number(swatch, 'friction_static', '.3f')}")
    if "stiffness_N_m" in swatch.intervals:
        lines.append(f"  stiffness: {_number(swatch, 'stiffness_N_m', '.0f')} N/m")
    for i, speed in enumerate(() if taps is None else taps.approach_m_s):
        assert taps is not None
        frequency, decay = swatch.intervals.get(f"taps.frequency_Hz[{i}]"), swatch.intervals.get(f"taps.decay_1_s[{i}]")
        lines.append(
            f"  tap at {1e3 * speed:.0f} mm/s: {taps.amplitude_m_s2[i]:.3g} m/s², {taps.frequency_Hz[i]:.1f} "
            f"{_interval(frequency, '.1f')} Hz, decay {taps.decay_1_s[i]:.0f} {_interval(decay, '.0f')} 1/s"
        )
    if taps is not None:
        lines.append(f"  (taps at speeds within {100 * (SPEED_RATIO - 1):.0f} % count as one)")
    if swatch.intervals:
        lines.append("  in brackets: 95 % intervals")
    lines += [f"  absent: {name}: {reason}" for name, reason in swatch.absent.items()]
    return lines


def _number(swatch: "Swatch", name: str, form: str) -> str:
    return f"{getattr(swatch, name):{form}} {_interval(swatch.intervals.get(name), form)}".rstrip()


def _interval(pair: tuple[float, float] | None, form: str) -> str:
    return "" if pair is None else f"[{pair[0]:{form}}, {pair[1]:{form}}]"
