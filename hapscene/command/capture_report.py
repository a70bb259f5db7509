"""`hapscene capture report`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.recording_option import add_recording_options, recording_options
from hapscene.command.word import add_command, name_made


def add_capture_report(commands: Any) -> None:
    command = add_command(
        commands,
        "report",
        _report,
        "one page on how good a swatch is and why: plots, figures, what is absent",
        "hapscene capture report oak.swatch oak.csv --rate 10000 --units acceleration=m/s2,force=N -o oak.html",
        "hapscene capture report wood -o wood.html",
    )
    command.add_argument("swatch", metavar="SWATCH", help="a .swatch file, or the name of a shipped swatch")
    command.add_argument(
        "recording", metavar="RECORDING", nargs="?", help="what it was fitted to, or another recording of that surface"
    )
    command.add_argument("-o", "--out", metavar="PAGE", required=True, help="the HTML file to write")
    add_recording_options(command)


def _report(options: argparse.Namespace) -> int:
    from hapscene.capture.recording_file import load_surface_recording
    from hapscene.capture.report import write_report
    from hapscene.surface.swatch_file import load_swatch

    swatch = load_swatch(options.swatch)
    recording = None
    if options.recording is not None:
        recording = load_surface_recording(options.recording, **recording_options(options))
    source = "" if options.recording is None else Path(options.recording).name
    write_report(swatch, options.out, recording, source)
    name_made([Path(options.out)])
    return 0
