"""`hapscene teleoperate follower | leader`."""

import argparse
import json
from pathlib import Path
from typing import Any, Final

from hapscene.command.options import (
    HOST,
    add_command,
    add_group,
    check_swatch,
    number,
    port,
    seconds,
    seed,
    whole,
)
from hapscene.constants import DEFAULT_GRIP
from hapscene.errors import HapsceneError

PORT: Final = 47600
"""Where a follower listens unless told otherwise; in the range that nobody has registered."""

SCHEMES: Final = ("wave", "position")  # as in teleoperation.port, which is heavy to import


def add_teleoperate(commands: Any) -> None:
    summary = "a follower touches a surface, a leader with the haptography handle feels it; all simulated"
    add_group(commands, "teleoperate", summary, _add_follower, _add_leader)


def _add_follower(parts: Any) -> None:
    command = add_command(parts, "follower", _follower)
    command.add_argument("--host", default=HOST, help=f"address to listen at (default {HOST}: this machine alone)")
    command.add_argument("--port", type=port, default=PORT, help=f"UDP port, 0 for any that is free (default {PORT})")
    command.add_argument("--allow", metavar="HOST", help="the one address that may lead; needed with another --host")
    command.add_argument("--swatch", default="wood", help="what is touched: a name, or a .swatch file (default wood)")
    _add_session_options(command)


def _follower(options: argparse.Namespace) -> int:
    """The end that touches, as a process: waits for a leader, ends with it.

    for example:
      hapscene teleoperate follower --swatch wood
      hapscene teleoperate follower --port 47600 --loss 0.1 --delay 50 --jitter 10 --reorder 0.1
    """
    if options.allow is None and options.host != HOST:
        raise HapsceneError(f"--host {options.host} can be reached from elsewhere: say by --allow who may lead")
    check_swatch(options.swatch)
    from hapscene.teleoperation.udp_session import run_follower

    allowed = options.allow or HOST
    return _tell(run_follower((options.host, options.port), allowed, options.swatch, **_session(options)), options)


def _add_leader(parts: Any) -> None:
    command = add_command(parts, "leader", _leader)
    command.add_argument(
        "--peer", type=_address, default=(HOST, PORT), metavar="HOST:PORT", help=f"the follower (default {HOST}:{PORT})"
    )
    command.add_argument("--grip", default=DEFAULT_GRIP, metavar="NAME", help=f"of the hand (default {DEFAULT_GRIP})")
    command.add_argument("--compensator", default="adaptive", metavar="NAME", help="of the handle (default adaptive)")
    _add_session_options(command)


def _leader(options: argparse.Namespace) -> int:
    """The end that is held, as a process: a simulated hand feels what the follower touches.

    for example:
      hapscene teleoperate leader --peer 127.0.0.1:47600 --duration 10
    """
    from hapscene.teleoperation.udp_session import run_leader

    return _tell(run_leader(options.peer, options.grip, options.compensator, **_session(options)), options)


def _add_session_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--scheme", choices=SCHEMES, default="wave", help="as at the other end (default wave)")
    command.add_argument("--duration", type=seconds, metavar="S", help="seconds; else until Ctrl-C or the peer ends")
    command.add_argument("--summary", metavar="FILE", help="write how it went as JSON, too")
    command.add_argument("--seed", type=seed, default=0, help="of what is drawn at random (default 0)")
    delay, share = number("a delay is a number of ms", 0.0), number("a share is a number", 0.0, 1.0)
    line = command.add_argument_group("to make the line from here worse than it is")
    line.add_argument("--delay", type=delay, default=0.0, metavar="MS", help="delay")
    line.add_argument("--jitter", type=delay, default=0.0, metavar="MS", help="mean of a random delay on top of it")
    line.add_argument("--loss", type=share, default=0.0, metavar="SHARE", help="share that is lost, 0 to 1")
    line.add_argument("--reorder", type=share, default=0.0, metavar="SHARE", help="share that is overtaken, 0 to 1")


def _session(options: argparse.Namespace) -> dict[str, Any]:
    """What both ends are started with."""
    from hapscene.teleoperation.endpoint import Coupling
    from hapscene.teleoperation.link import Impairment

    duration_s = float("inf") if options.duration is None else options.duration
    return {
        "coupling": Coupling(options.scheme),
        "impairment": Impairment(options.delay * 1e-3, options.jitter * 1e-3, options.loss, options.reorder),
        "duration_s": duration_s,
        "seed": options.seed,
    }


def _tell(summary: dict[str, Any], options: argparse.Namespace) -> int:
    """Print how a session went, and write it where that was asked for."""
    from hapscene.files import write_whole

    text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
    print(text)
    if options.summary is not None:
        write_whole(Path(options.summary), (text + "\n").encode(), HapsceneError)
    return 0


def _address(text: str) -> tuple[str, int]:
    host, _, number_of = text.rpartition(":")
    if not host:
        raise argparse.ArgumentTypeError(f"{text!r}: expected HOST:PORT, as {HOST}:{PORT}")
    return host, whole("a port to send to", 1, 65535)(number_of)
