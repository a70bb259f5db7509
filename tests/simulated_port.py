"""A serial port without hardware: a pseudo-terminal, and the command-line options of a simulated board."""

import argparse
import math
import os


def simulator_parser(module: str, description: str | None, rate_Hz: float) -> argparse.ArgumentParser:
    """The command-line options of a simulated board that `python -m module` starts: --rate, --seconds, --seed."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    parser.add_argument("--rate", type=float, default=rate_Hz, metavar="HZ", help="samples per second (%(default)g)")
    parser.add_argument("--seconds", type=float, default=math.inf, help="run time (default: until Ctrl-C)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random numbers (default 0)")
    return parser


def simulated_port(parser: argparse.ArgumentParser) -> int:
    """Open a pseudo-terminal and print its name; return the board's end, which does not block."""
    if not hasattr(os, "openpty"):
        parser.error("a simulated port needs pseudo-terminals: Linux or macOS")
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    print(os.ttyname(theirs), flush=True)
    return ours
