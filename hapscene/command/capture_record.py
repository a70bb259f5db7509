"""`hapscene capture record`."""

import argparse
import sys
from pathlib import Path
from typing import Any

from hapscene.command.word import add_command, baud, seconds
from hapscene.wire.port import BAUD

RATE_TOLERANCE = 0.02
"""How far the samples that come may be off the announced rate before it is told [1]."""


def add_record(commands: Any) -> None:
    command = add_command(
        commands,
        "record",
        _record,
        "record from an accelerometer or force probe on a serial port (docs/probe-protocol.md)",
        "hapscene capture record --port /dev/ttyUSB0 -o tap.hsrec",
        "hapscene capture record --port COM3 --baud 2000000 --seconds 10 -o stroke.npz",
        "python -m hapscene.capture.record_simulator   # a probe to try it with, without hardware",
    )
    command.add_argument("--port", required=True, help="of the probe: /dev/ttyUSB0, COM3, …")
    command.add_argument("--baud", type=baud, default=BAUD, help=f"speed of the port (default {BAUD})")
    command.add_argument("--seconds", type=seconds, metavar="N", help="how much to record (default: until Ctrl-C)")
    command.add_argument(
        "-o", "--out", required=True, metavar="FILE", help="the file to write: .hsrec (crash-safe), or .npz at the end"
    )


def _record(options: argparse.Namespace) -> int:
    from hapscene.capture.record import REACHED, STOPPED, record
    from hapscene.capture.record_file import SUFFIX
    from hapscene.interrupt import interrupt_noted

    place = Path(options.out).with_suffix(SUFFIX)
    was_there = place.exists()
    with interrupt_noted() as stopped:
        try:
            made = record(options.port, options.out, options.baud, options.seconds, stopped, _say)
        except KeyboardInterrupt:
            if was_there or not place.exists():
                raise
            print(f"hapscene: interrupted; what was recorded until then is in {place}", file=sys.stderr)
            return 130
    count = made.count
    lost = f"dropped {count.dropped} ({100 * count.dropped / made.length:.2g} %)"
    _say(f"{made.length / made.rate_Hz:.3f} s; {lost}, torn {count.torn}, garbage {count.garbage}: {made.ended}")
    if made.rate_measured_Hz is not None and abs(made.rate_measured_Hz / made.rate_Hz - 1.0) > RATE_TOLERANCE:
        _note(f"the probe announced {made.rate_Hz:g} Hz; by this computer's clock it is {made.rate_measured_Hz:.4g} Hz")
    if count.restarts:
        _note(f"the probe began anew {count.restarts} times")
    _say(f"made:\n  {made.path}  ({made.path.stat().st_size / 1e3:,.0f} kB)")
    return 0 if made.ended in (STOPPED, REACHED) else 1


def _say(line: str) -> None:
    print(line, flush=True)


def _note(line: str) -> None:
    print(f"hapscene: note: {line}", file=sys.stderr)
