"""The command line: reads the words, calls the room that does the work, prints what it gives. Thin."""

import argparse
import shutil
import signal
import sys
import textwrap
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NoReturn

from hapscene import __version__
from hapscene.command.console import complain, note, note_little_memory, ready_streams
from hapscene.errors import HapsceneError, printable
from hapscene.interrupt import insisting, interrupted_by_ends

Add = Callable[[Any], object]


def commands() -> tuple[Sequence[Add], Sequence[Add]]:
    """What adds each command: those that one starts with, in that order, and the others.

    They are imported once Ctrl-C is seen to: it takes most of the time until a command begins.
    """
    from hapscene.command.bench import add_bench
    from hapscene.command.capture import add_capture
    from hapscene.command.chart import add_chart
    from hapscene.command.check import add_check
    from hapscene.command.devices import add_devices
    from hapscene.command.export import add_export, add_import
    from hapscene.command.handle import add_handle
    from hapscene.command.paint import add_paint
    from hapscene.command.play import add_play, add_replay
    from hapscene.command.plugins import add_plugins
    from hapscene.command.reproduce import add_reproduce
    from hapscene.command.serve import add_serve
    from hapscene.command.stability import add_stability
    from hapscene.command.study import add_study
    from hapscene.command.swatch import add_swatch
    from hapscene.command.teleoperate import add_teleoperate
    from hapscene.command.touch import add_demo, add_touch
    from hapscene.command.tune import add_tune
    from hapscene.command.view import add_view
    from hapscene.command.warmup import add_warmup

    first = (add_demo, add_touch, add_paint, add_capture, add_swatch)
    further = (
        add_view,
        add_check,
        add_export,
        add_import,
        add_study,
        add_handle,
        add_stability,
        add_teleoperate,
        add_serve,
    )
    last = (add_replay, add_devices, add_plugins, add_warmup, add_bench, add_chart, add_reproduce)
    return first, (add_play, add_tune, *further, *last)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return the exit code.

    Returns:
        0 done, 2 bad input (one line on stderr), 128 and the signal's number where one ended it: 130 for Ctrl-C.
    """
    with interrupted_by_ends():
        return _told(arguments, argparse.Namespace(debug=False))


def _told(arguments: Sequence[str] | None, options: argparse.Namespace) -> int:
    """The exit code of a command; whatever ends it is told in one line."""
    ready_streams()
    try:
        with insisting():
            return _run(arguments, options)
    except KeyboardInterrupt as interrupt:
        if options.debug:
            raise
        eval("0")  # else Python ends by SIGINT where it came while a text was executed, as imports do
        complain("interrupted; nothing was written")
        return 128 + int(interrupt.args[0] if interrupt.args else signal.SIGINT)
    except (HapsceneError, OSError, MemoryError) as error:
        if isinstance(error, BrokenPipeError) and error.filename == "standard output":
            return 1  # the reader left: say no more
        if options.debug:
            raise
        complain(_sentence(error))
        return 2
    finally:
        with suppress(OSError):
            sys.stdout.flush()


def _run(arguments: Sequence[str] | None, options: argparse.Namespace) -> int:
    try:
        _parser().parse_args(arguments, options)
    except SystemExit:  # of help, which is printed
        sys.stdout.flush()
        raise
    warnings.showwarning = _show_warning
    note_little_memory()
    code: int = options.command(options)
    sys.stdout.flush()
    return code


class _Parser(argparse.ArgumentParser):
    """Says in one line what is wrong with the words, and which was meant."""

    def error(self, message: str) -> NoReturn:
        see = " See" if message.endswith("?") else "; see"
        self.exit(2, f"hapscene: {printable(message)}{see} `{self.prog} --help`\n")

    def _print_message(self, message: str, file: Any = None) -> None:
        """As its own, but what cannot be written is heard."""
        (file or sys.stderr).write(message or "")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As its own, but what it does not know is refused here, where its options are known."""
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            option = next((word for word in unknown if word.startswith("-")), None)
            if option is None:
                self.error(f"{unknown[0]!r} is one word too many")
            self.error(f"no option {option}{_meant(option.split('=')[0], self._option_string_actions)}")
        return known, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        if isinstance(action, argparse._SubParsersAction):
            group = self.prog.removeprefix("hapscene").strip()
            raise argparse.ArgumentError(None, f"no command {f'{group} {value}'.strip()!r}{_meant(value, known)}")
        raise argparse.ArgumentError(action, f"no {value!r}; there are: {', '.join(known)}{_meant(value, known)}")


def _meant(word: str, known: Iterable[str]) -> str:
    from hapscene.command.options import nearest

    near = nearest(word, known)
    return f"; did you mean {near}?" if near else ""


def _parser() -> argparse.ArgumentParser:
    from hapscene.command.options import print_help

    parser = _Parser(
        prog="hapscene",
        usage=argparse.SUPPRESS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="hapscene COMMAND --help says more, with examples.",
    )
    parser.add_argument("--version", action="version", version=f"hapscene {__version__}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    parser.set_defaults(command=lambda options: print_help(parser))
    known = parser.add_subparsers(prog="hapscene", metavar="COMMAND", help=argparse.SUPPRESS)
    first, further = commands()
    for add in (*first, *further):
        add(known)
    parser.description = _listed(known.choices, len(first))
    return parser


def _listed(known: Mapping[str, argparse.ArgumentParser], first: int) -> str:
    """What the commands do, those to start with first."""
    width = max(shutil.get_terminal_size().columns - 2, 40)
    lines = [
        textwrap.fill(str(command.description), width, initial_indent=f"  {name:<13}", subsequent_indent=" " * 15)
        for name, command in known.items()
    ]
    about = "Touch a 3-D scene through a tool, and feel what its surfaces are made of."
    return "\n".join([about, "", "start with:", *lines[:first], "", "then:", *lines[first:]])


def _sentence(error: BaseException) -> str:
    """What the error says."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"not enough memory ({error})" if str(error) else "not enough memory"
    return str(error)


def _show_warning(message: Warning | str, category: Any, *place: Any, **more: Any) -> None:
    """A warning in one line, without the place in our code."""
    note(str(message))


if __name__ == "__main__":
    sys.exit(main())
