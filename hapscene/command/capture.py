"""`hapscene capture`: the group of commands of haptography."""

from typing import Any

from hapscene.command.capture_batch import add_batch
from hapscene.command.capture_fit import add_capture_fit
from hapscene.command.capture_record import add_record
from hapscene.command.capture_report import add_capture_report


def add_capture(commands: Any) -> None:
    """Declare the group and its commands."""
    group = commands.add_parser(
        "capture",
        help="haptography: record a surface, fit a swatch to it, judge the fit",
        description="From a recording of a tool on a surface to a swatch, and how good it is.",
        epilog="hapscene capture COMMAND --help says more.",
    )
    words = group.add_subparsers(required=True, metavar="COMMAND")
    for add in (add_capture_fit, add_record, add_batch, add_capture_report):
        add(words)
