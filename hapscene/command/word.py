"""What the commands share: how a command is declared, kinds of arguments, and naming what was made."""

import argparse
from pathlib import Path
from typing import Any


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


def folder(text: str) -> str:
    """A folder to write into: its name may not be empty."""
    if not text.strip():
        raise argparse.ArgumentTypeError("a folder needs a name")
    return text


def seed(text: str) -> int:
    """A seed: a whole number, 0 or more."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError("a seed is a whole number, 0 or more")
    return value


def rate(text: str) -> float:
    """A rate in Hz, above 0."""
    rate_Hz = float(text)
    if not 0.0 < rate_Hz < float("inf"):
        raise argparse.ArgumentTypeError("a rate is a number of Hz, above 0")
    return rate_Hz


def name_made(made: list[Path]) -> None:
    """End a command by naming the files it made."""
    print("made:")
    for file in made:
        print(f"  {file}  ({file.stat().st_size / 1e3:,.0f} kB)")
