"""`hapscene capture`: the group of commands of haptography."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

_COMMANDS: Final = (
    ("capture_fit", "add_capture_fit"),
    ("capture_record", "add_record"),
    ("capture_batch", "add_batch"),
    ("capture_report", "add_capture_report"),
)


def add_capture(commands: Any) -> None:
    group = commands.add_parser(
        "capture",
        help="haptography: record a surface, fit a swatch to it, judge the fit",
        description="From a recording of a tool on a surface to a swatch, and how good it is.",
    )
    words = group.add_subparsers(required=True, metavar="COMMAND")
    for module, function in _COMMANDS:
        if find_spec(f"hapscene.command.{module}") is not None:
            getattr(import_module(f"hapscene.command.{module}"), function)(words)
