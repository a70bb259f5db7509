"""What the commands share: how a command is declared, kinds of arguments, and naming what was made."""

import argparse
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar

_Number = TypeVar("_Number", int, float)


def add_command(commands: Any, name: str, function: Any, summary: str, *examples: str) -> argparse.ArgumentParser:
    """A sub-command whose help ends with examples."""
    command: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog="for example:\n" + "\n".join(f"  {example}" for example in examples),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(command=function)
    # also after the command's name, where it is typed when something went wrong
    command.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    return command


UNIT_HELP: Final = "of the mesh, where its file carries none: m, mm, in, …"


def add_mesh_options(command: Any, two_sided: bool = True) -> None:
    """How a mesh on the command line is taken up."""
    command.add_argument("--unit", help=UNIT_HELP)
    command.add_argument("--swatch", help="of the whole mesh: a name, or a .swatch file")
    if two_sided:
        command.add_argument("--two-sided", action="store_true", help="feel the mesh's inner side as well")


def folder(text: str) -> str:
    """A folder to write into: its name may not be empty."""
    if not text.strip():
        raise argparse.ArgumentTypeError("a folder needs a name")
    return text


def whole(what: str, low: int | None = None, high: int | None = None) -> Callable[[str], int]:
    """A kind of argument: a whole number within bounds, where there are any.

    Args:
        what: it is, for who typed something else: "a port".
        low, high: the least and the largest.
    """
    return _kind(f"{what} is a whole number", int, low, high, None)


def number(
    told: str, low: float | None = None, high: float | None = None, above: float | None = None
) -> Callable[[str], float]:
    """A kind of argument: a finite number within bounds, where there are any.

    Args:
        told: what it is, for who typed something else: "a rate is a number of Hz".
        low, high: the least and the largest.
        above: what it must exceed.
    """
    return _kind(told, float, low, high, above)


def _kind(
    told: str, read: Callable[[str], _Number], low: float | None, high: float | None, above: float | None
) -> Callable[[str], _Number]:
    if low is not None and high is not None:
        told += f" from {low:.10g} to {high:.10g}"
    else:
        bounds = {"{:.10g} or more": low, "above {:.10g}": above, "at most {:.10g}": high}
        said = [text.format(bound) for text, bound in bounds.items() if bound is not None]
        told += f", {' and '.join(said)}" if said else ""
    least, most = -math.inf if low is None else low, math.inf if high is None else high
    more_than = -math.inf if above is None else above

    def value_of(text: str) -> _Number:
        with suppress(ValueError):
            value = read(text)
            if least <= value <= most and more_than < value < math.inf:
                return value
        raise argparse.ArgumentTypeError(f"{told}, not {text[:40]!r}")

    return value_of


baud = whole("a port's speed in bits a second", 1)
port = whole("a port", 0, 65535)
seed = whole("a seed", 0)
force = number("a force is a number of N")
rate = number("a rate is a number of Hz", above=0.0)
seconds = number("a duration is a number of seconds", above=0.0)


def name_made(made: list[Path]) -> None:
    """End a command by naming the files it made."""
    print("made:")
    for file in made:
        print(f"  {file}  ({file.stat().st_size / 1e3:,.0f} kB)")


# The options that say what a recording file does not: its rate, its columns, its units.


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
    """What `load_recording` takes of them."""
    return {"rate_Hz": options.rate, "columns": options.columns, "units": options.units}
