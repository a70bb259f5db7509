"""`hapscene reproduce`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.console import name_made, say
from hapscene.command.options import add_command, add_out_folder, check_evidence, check_out_folder, check_there


def add_reproduce(commands: Any) -> None:
    command = add_command(commands, "reproduce", _reproduce)
    command.add_argument(
        "--recordings", type=Path, metavar="DIR",
        help="folder of the recordings that the shipped swatches were fitted to; without it they are synthesised",
    )  # fmt: skip
    add_out_folder(command, "out/reproduce")


def _reproduce(options: argparse.Namespace) -> int:
    """Reproduce the haptography paper: its figures and numbers beside ours, on one page.

    for example:
      hapscene reproduce
      hapscene reproduce --recordings ../shared/data/recordings --out out/paper
    """
    check_there(options.recordings, what="folder", prefix="--recordings ")
    check_out_folder(options.out)
    check_evidence("reproduce")
    from hapscene_evidence.paper.reproduction import reproduce

    name_made(reproduce(options.out, options.recordings, say))
    return 0
