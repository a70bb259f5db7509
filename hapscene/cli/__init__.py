"""The command line: reads the arguments, calls the package that does the work, prints the result.

Each module declares one group of commands by functions, whose signatures and docstrings are the options and the help.
`cyclopts` imports a module when its command is used, and each function imports what it needs when it runs.
"""

import signal
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from hapscene import __version__
from hapscene.cli.console import complain, note, note_little_memory, ready_streams
from hapscene.errors import HapsceneError
from hapscene.interrupt import interrupted_by_ends, reraise_swallowed_interrupt

if TYPE_CHECKING:
    from cyclopts import App, CycloptsError

__all__ = ["app", "main"]

COMMANDS: Final = {
    "Start": {
        "demo": ("touch:demo", "Touch the shipped scene, and write what was felt."),
        "touch": ("touch:touch", "Touch a scene or a mesh along a path, and write what was felt."),
        "paint": ("paint:paint", "Paint swatches onto a scene or a mesh in the browser."),
        "play": ("play:play", "Feel a scene in real time, with a device or in the browser."),
    },
    "Scenes and meshes": {
        "view": ("scenes:view", "Draw a scene, and a touch of it, as a picture or a film."),
        "check": ("scenes:check", "Examine meshes, and repair them."),
        "convert": ("scenes:convert", "Convert scenes and swatches to or from other formats."),
    },
    "Surfaces": {
        "swatch": ("swatch:app", "Swatches: list, search, show, add, get, compare, publish."),
        "capture": ("capture:app", "Haptography: record a surface, fit a swatch to it, judge the fit."),
    },
    "Devices and programs": {
        "device": ("device:app", "Haptic devices and handles: list, try, identify, play a file."),
        "serve": ("play:serve", "Render touch for a game engine or simulator, over a network."),
    },
    "Measure": {
        "tune": ("lab:tune", "Render no more of a scene than a person can tell."),
        "lab": ("lab:app", "Effects, stability, benchmarks, charts, studies, teleoperation."),
    },
}
"""The commands by the groups in which the help lists them: module and function, and one line."""

SYNONYMS: Final = {"convert": ("import", "export"), "play": ("live", "replay")}
"""Words for which an unknown command's error suggests a command; groups name their own."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return the exit code.

    Args:
        arguments: the words after `hapscene`; by default those of this process.

    Returns:
        0 done, 1 done with a negative verdict, 2 bad input (one line on stderr), 128 and the signal's number where a
        signal ended it: 130 for Ctrl-C.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words  # allowed anywhere: it is typed when something went wrong
    with interrupted_by_ends():
        return _guarded([word for word in words if word != "--debug"], debug)


def _guarded(words: list[str], debug: bool) -> int:
    """The exit code of a command; an error becomes one line."""
    ready_streams()
    try:
        with reraise_swallowed_interrupt():
            return _run(words)
    except KeyboardInterrupt as interrupt:
        if debug:
            raise
        eval("0")  # otherwise Python ends by SIGINT where it came while a text was executed, as imports do
        complain("interrupted; nothing was written")
        return 128 + int(interrupt.args[0] if interrupt.args else signal.SIGINT)
    except (HapsceneError, OSError, MemoryError) as error:
        if isinstance(error, BrokenPipeError) and error.filename == "standard output":
            return 1  # the reader of the pipe has gone
        if debug:
            raise
        complain(_sentence(error))
        return 2
    finally:
        with suppress(OSError):
            sys.stdout.flush()


def _run(words: list[str]) -> int:
    from cyclopts import CycloptsError

    warnings.showwarning = _show_warning
    note_little_memory()
    try:
        code = app()(words)
    except CycloptsError as error:
        complain(_usage_error(error))
        return 2
    sys.stdout.flush()
    return int(code or 0)


@cache
def app() -> "App":
    """The tree of commands. Modules are imported here and not above, once Ctrl-C is handled."""
    from cyclopts import App, Group, Parameter

    from hapscene.cli.help import HelpFormatter

    tree = App(
        name="hapscene",
        help=(
            "Touch a 3-D scene through a tool, and feel what its surfaces are made of.\n\n"
            "`hapscene COMMAND --help` has examples. --debug shows the traceback of an error;\n"
            "--version prints the version."
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
            words = {"synonym": SYNONYMS[name]} if name in SYNONYMS else {}
            tree.command(f"hapscene.cli.{place}", name=name, group=group, sort_key=j, **words)
    tree["--help"].show = tree["--version"].show = False
    return tree


def _usage_error(error: "CycloptsError") -> str:
    """What is wrong with the arguments, and where to read on."""
    command = " ".join(("hapscene", *(error.command_chain or ())))
    text = str(error).partition(" Available commands:")[0].rstrip(".")
    return f"{text}{' See' if text.endswith('?') else '; see'} `{command} --help`"


def _sentence(error: BaseException) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"not enough memory ({error})" if str(error) else "not enough memory"
    return str(error)


def _show_warning(message: Warning | str, category: Any, *place: Any, **more: Any) -> None:
    """A warning in one line, without its place in the code."""
    note(str(message))
