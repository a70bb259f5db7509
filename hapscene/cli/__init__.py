"""The command line interface `hapscene`: parses arguments, calls the package, prints results.

Each module declares the commands of one group as functions: the signature of a function defines the options, and its
docstring is the help. cyclopts imports a module only when one of its commands is used, and each function imports what
it needs when it runs, so that `hapscene --help` starts fast.
"""

import gc
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from typing import TYPE_CHECKING, Final

from hapscene import __version__
from hapscene.cli.console import print_error, print_note, ready_streams
from hapscene.errors import HapsceneError
from hapscene.interrupt import interrupted_by_ends, reraise_swallowed_interrupt

if TYPE_CHECKING:
    from cyclopts import App, CycloptsError

__all__ = ["app", "main"]

COMMANDS: Final = {
    "Start": {
        "demo": ("touch:demo", "Simulate touching the demo scene; write forces, plots and audio."),
        "touch": ("touch:touch", "Simulate touching a scene or mesh along a path."),
        "paint": ("paint:paint", "Paint swatches onto a scene or mesh in the browser."),
        "play": ("play:play", "Touch a scene yourself, with a haptic device or the mouse."),
    },
    "Scenes and meshes": {
        "view": ("scenes:view", "Draw a scene, with or without a touch of it, as image or video."),
        "check": ("scenes:check", "Check meshes for defects, and repair them."),
        "convert": ("scenes:convert", "Convert scenes to or from other formats."),
    },
    "Surfaces": {
        "swatch": ("swatch:app", "Swatches: list, search, show, add, get, compare, publish."),
        "capture": ("capture:app", "Haptography: record a surface, fit a swatch, evaluate the fit."),
    },
    "Devices and programs": {
        "device": ("device:app", "Haptic devices and handles: list, try, identify, play a file."),
        "serve": ("play:serve", "Render touch for a game engine or simulator over the network."),
    },
    "Measure": {
        "tune": ("lab:tune", "Simplify a scene as far as a person cannot perceive it."),
        "lab": ("lab:app", "Stability, benchmarks, user studies, effects."),
    },
}
"""The top-level commands, in the groups of the help: module and function, and the one-line summary."""

SYNONYMS: Final = {"convert": ("import", "export"), "play": ("live", "replay")}
"""Words that are no commands, by the command that the error message suggests for them."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: the words after `hapscene`; by default those of this process.

    Returns:
        0 on success; 1 when the command succeeded and its result is negative; 2 on invalid input, with one line on
        stderr; 128 plus the signal number when a signal ended the command, 130 for Ctrl-C.
    """
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in tokens  # accepted at any position: users append it to a command that failed
    with _rare_collection() if arguments is None else nullcontext(), interrupted_by_ends():
        return _guarded([token for token in tokens if token != "--debug"], debug)


@contextmanager
def _rare_collection() -> Iterator[None]:
    """Context in which garbage is collected rarely, and after which it is not collected: the process ends.

    By default a quarter of the time of imports is spent on looking for garbage, which imports do not leave.
    """
    gc.set_threshold(100_000)
    try:
        yield
    finally:
        gc.freeze()  # at exit, Python would look through all objects several times


def _guarded(tokens: list[str], debug: bool) -> int:
    """Run a command; print its error as one line, and return the exit code."""
    ready_streams()
    try:
        with reraise_swallowed_interrupt():
            return _run(tokens)
    except KeyboardInterrupt as interrupt:
        if debug:
            raise
        # CPython re-raises SIGINT at exit if the interrupt came during exec(), which imports use; eval() clears that
        eval("0")
        print_error("interrupted; nothing was written")
        return 128 + int(interrupt.args[0] if interrupt.args else signal.SIGINT)
    except (HapsceneError, OSError, MemoryError) as error:
        if isinstance(error, BrokenPipeError) and error.filename == "standard output":
            return 1  # the reader of the pipe has exited
        if debug:
            raise
        print_error(_sentence(error))
        return 2
    finally:
        with suppress(OSError):
            sys.stdout.flush()


def _run(tokens: list[str]) -> int:
    from cyclopts import CycloptsError

    warnings.showwarning = _show_warning
    try:
        code = app()(tokens)
    except CycloptsError as error:
        print_error(_usage_error(error))
        return 2
    sys.stdout.flush()
    return int(code or 0)


@cache
def app() -> "App":
    """Return the tree of commands. It imports cyclopts here, when Ctrl-C is already handled."""
    from cyclopts import App, Group, Parameter

    from hapscene.cli.console import HelpFormatter

    tree = App(
        name="hapscene",
        help=(
            "Haptic rendering of 3-D scenes, with surface textures fitted to recordings.\n\n"
            "Run `hapscene COMMAND --help` for the options and examples of a command.\n"
            "--version prints the version. --debug prints the traceback of an error."
        ),
        help_format="plaintext",
        help_formatter=HelpFormatter({name: text for group in COMMANDS.values() for name, (_, text) in group.items()}),
        version=f"hapscene {__version__}",
        default_parameter=Parameter(negative=""),
        result_action="return_value",
        exit_on_error=False,
        print_error=False,
        verbose=False,
        suppress_keyboard_interrupt=False,
    )
    for i, (title, commands) in enumerate(COMMANDS.items()):
        group = Group(title, sort_key=i)
        for j, (name, (place, _)) in enumerate(commands.items()):
            tokens = {"synonym": SYNONYMS[name]} if name in SYNONYMS else {}
            tree.command(f"hapscene.cli.{place}", name=name, group=group, sort_key=j, **tokens)
    tree["--help"].show = tree["--version"].show = False
    return tree


def _usage_error(error: "CycloptsError") -> str:
    """The message for invalid arguments, with the command whose help lists the valid ones."""
    from cyclopts import MissingArgumentError
    from cyclopts.exceptions import UnusedCliTokensError

    command = " ".join(("hapscene", *(error.command_chain or ())))
    text = str(error).partition(" Available commands:")[0].rstrip(".")
    if isinstance(error, UnusedCliTokensError):
        text = f"unexpected argument {' '.join(map(repr, error.unused_tokens or ()))}"
    elif isinstance(error, MissingArgumentError) and error.argument is not None and not error.tokens_so_far:
        name = error.argument.name
        text = f"{name} requires a value" if name.startswith("-") else f"missing argument {name}"
    return f"{text}{' See' if text.endswith('?') else '; see'} `{command} --help`"


def _sentence(error: BaseException) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"not enough memory ({error})" if str(error) else "not enough memory"
    return str(error)


def _show_warning(message: Warning | str, category: object, *place: object, **more: object) -> None:
    """Print a warning as one line, without its position in the code."""
    print_note(str(message))
