"""The options that say what a recording file does not: its rate, its columns, its units."""

import argparse
from collections.abc import Mapping
from typing import Any

from hapscene.command.word import rate


def add_recording_options(command: argparse.ArgumentParser) -> None:
    """Adds --rate, --columns and --units; they end up as `rate`, `columns` and `units` of the options."""
    group = command.add_argument_group("what a recording's file does not say")
    group.add_argument("--rate", type=rate, metavar="HZ", help="sample rate [Hz]")
    group.add_argument(
        "--columns", type=pairs, default={}, metavar="Q=COLUMN,…",
        help="which column holds which quantity, as in acceleration=accel,speed=v",
    )  # fmt: skip
    group.add_argument(
        "--units", type=pairs, default={}, metavar="Q=UNIT,…",
        help="units of the quantities, as in acceleration=g,force=N,speed=mm/s",
    )  # fmt: skip


def pairs(text: str) -> Mapping[str, str]:
    """Pairs as in "force=N,speed=mm/s"."""
    found: dict[str, str] = {}
    for item in text.split(","):
        key, equals, value = item.partition("=")
        if not (equals and key.strip() and value.strip()):
            raise argparse.ArgumentTypeError(f"{item!r}: expected QUANTITY=VALUE pairs, as in force=N,speed=mm/s")
        if key.strip() in found:
            raise argparse.ArgumentTypeError(f"{key.strip()!r} stands twice")
        found[key.strip()] = value.strip()
    return found


def recording_options(options: argparse.Namespace) -> dict[str, Any]:
    """What `load_surface_recording` takes of them."""
    return {"rate_Hz": options.rate, "columns": options.columns, "units": options.units}
