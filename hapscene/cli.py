"""The command line: reads the words, calls the room that does the work, prints what it gives. Thin."""

import argparse
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from typing import Any

from hapscene import __version__
from hapscene.command.bench import add_bench
from hapscene.command.capture import add_capture
from hapscene.command.check import add_check
from hapscene.command.export import add_export, add_import
from hapscene.command.handle import add_handle
from hapscene.command.paint import add_paint
from hapscene.command.plugins import add_plugins
from hapscene.command.stability import add_stability
from hapscene.command.swatch import add_swatch
from hapscene.command.teleoperate import add_teleoperate
from hapscene.command.touch import add_demo, add_touch
from hapscene.command.view import add_view
from hapscene.errors import HapsceneError
from hapscene.interrupt import interrupted_by_ends


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return the exit code.

    Returns:
        0 done, 2 bad input (one line on stderr), 128 and the signal's number where one ended it: 130 for Ctrl-C.
    """
    _speak_utf8()
    options = _parser().parse_args(arguments)
    warnings.showwarning = _show_warning
    with interrupted_by_ends():
        return _run(options)


def _run(options: argparse.Namespace) -> int:
    try:
        code: int = options.command(options)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt as interrupt:
        if options.debug:
            raise
        print("hapscene: interrupted; nothing was written", file=sys.stderr)
        return 128 + int(interrupt.args[0] if interrupt.args else signal.SIGINT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader left: say no more
        return 1
    except (HapsceneError, OSError, MemoryError) as error:
        if options.debug:
            raise
        print(f"hapscene: {_sentence(error)}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="hapscene",
        description="Haptic rendering with a 3-D scene.",
        epilog="hapscene COMMAND --help says more.",
    )
    parser.add_argument("--version", action="version", version=f"hapscene {__version__}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    first = (add_touch, add_demo, add_view, add_paint, add_check, add_export, add_import, add_plugins)
    for add in (*first, add_bench, add_capture, add_handle, add_stability, add_swatch, add_teleoperate):
        add(commands)
    return parser


def _sentence(error: BaseException) -> str:
    """The error in one line."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"not enough memory ({error})" if str(error) else "not enough memory"
    return " ".join(str(error).split())


def _show_warning(message: Warning | str, category: Any, *place: Any, **more: Any) -> None:
    """A warning in one line, without the place in our code."""
    print(f"hapscene: note: {' '.join(str(message).split())}", file=sys.stderr)


def _speak_utf8() -> None:
    """Units and dashes must not fail on a terminal or pipe of another encoding."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")


if __name__ == "__main__":
    sys.exit(main())
