"""Terminal output of the commands: progress, results, notes, warnings and errors."""

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TextIO

from hapscene.errors import Codes, printable

if TYPE_CHECKING:
    from cyclopts.help import HelpEntry, HelpPanel

__all__ = [
    "HelpFormatter",
    "format_size",
    "print_error",
    "print_files",
    "print_in_place",
    "print_lines",
    "print_note",
    "print_progress",
    "print_warning",
    "ready_streams",
    "table",
]

_line_open = False
_notes: list[str] = []


def print_progress(text: str) -> None:
    """Print progress text and flush it. Text without a line end leaves the line open for the next call."""
    global _line_open
    line = text.removesuffix("\n")
    sys.stdout.write(printable(line) + text[len(line) :])
    sys.stdout.flush()
    _line_open = not text.endswith("\n")
    if not _line_open:
        while _notes:
            print_note(_notes.pop(0))


def print_note(text: str) -> None:
    """Print a note to stderr; it waits until an open progress line has ended."""
    if _line_open:
        _notes.append(text)
        return
    print_error(f"note: {text}")


def print_error(text: str) -> None:
    """Print an error as one line to stderr."""
    print(f"hapscene: {' '.join(text.split())}", file=sys.stderr)


def print_warning(text: str) -> None:
    """Print a warning to stderr: the command has a result, but probably not the intended one."""
    print_error(f"warning: {text}")


def print_lines(lines: Iterable[str]) -> None:
    """Print lines of a result; line ends and control characters inside a line are escaped."""
    print("\n".join(map(printable, lines)), flush=True)


def print_in_place(line: str) -> None:
    """Print a line that replaces the previous one on the terminal."""
    sys.stdout.write(Codes("\r"))
    sys.stdout.write(printable(line))
    sys.stdout.write(Codes("\x1b[K"))
    sys.stdout.flush()


def print_files(made: Sequence[Path]) -> None:
    """Print the files that a command wrote, with their sizes."""
    print_lines(["made:", *(f"  {file}  ({format_size(file.stat().st_size)})" for file in made)])


def format_size(size_B: float) -> str:
    """Format a file size with three digits: "684 B", "12.3 kB", "65.5 MB"."""
    for unit in ("B", "kB", "MB"):
        if size_B < 999.5:
            return f"{size_B:.3g} {unit}"
        size_B /= 1000.0
    return f"{size_B:.3g} GB"


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Format rows as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


# Standard output and standard error.


def ready_streams() -> None:
    """Prepare standard output and standard error for the whole process.

    Closed streams are redirected to the null device, the encoding becomes UTF-8, and control characters are escaped,
    except in `Codes`.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:  # closed: open() takes the lowest free number, which is this one
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    for name, place in (("stdout", "standard output"), ("stderr", None)):
        stream = getattr(sys, name)
        if stream is None:
            stream = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123 - open until the process ends
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")
        if not isinstance(stream, _Printable):
            setattr(sys, name, _Printable(stream, place))


RESET: Final = "\x1b[0m"
"""The reset sequence that colorama, imported by numba, writes when the process ends."""


class _Printable:
    """A standard stream that escapes control characters."""

    def __init__(self, stream: TextIO, place: str | None) -> None:
        self._stream = stream
        self._place = place

    def write(self, text: str) -> int:
        plain = isinstance(text, Codes) or text == RESET
        self._try(self._stream.write, text if plain else printable(text, lines=True))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        self._try(self._stream.flush)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _try(self, do: Callable[..., object], *arguments: str) -> None:
        """Write; on failure raise once for standard output, and redirect the stream to the null device."""
        try:
            do(*arguments)
        except OSError as error:
            with suppress(OSError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)
            if self._place is not None:
                raise OSError(error.errno, error.strerror, self._place) from None


# Plain-text help pages: two columns, wrapped to the width of the terminal.


LABEL_MAX: Final = 22
"""Longest label printed on the same line as its text [characters]."""

WIDTH_MAX: Final = 100
"""Longest line of wrapped text [characters]."""

METAVARS: Final = {"STR": "NAME", "PATH": "FILE", "INT": "COUNT", "FLOAT": "NUMBER"}
"""Placeholder of a value in the help, by the placeholder that cyclopts derives from the type."""

HIDDEN_DEFAULTS: Final = (None, "", '""', "()", "False")
"""Defaults that are not printed."""


class HelpFormatter:
    """Formatter of help pages for cyclopts, without boxes and colours.

    Args:
        summaries: summaries of the commands whose modules are not imported when the list is printed.
    """

    def __init__(self, summaries: Mapping[str, str]) -> None:
        self._summaries = summaries

    def render_usage(self, console: object, options: object, usage: object) -> None:
        """Print the usage line."""
        print(f"usage: {str(usage).strip()}\n")

    def render_description(self, console: object, options: object, description: object) -> None:
        """Print the docstring of a command: the wrapped summary, then details and examples with their line breaks."""
        summary, gap, more = _plain(description).partition("\n\n")
        print(textwrap.fill(summary, _width()) + gap + more.rstrip() + "\n")

    def __call__(self, console: object, options: object, panel: "HelpPanel") -> None:
        """Print a group of commands or of options."""
        if not panel.entries:
            return
        print("Options:" if panel.title == "Parameters" else f"{panel.title}:")
        rows = [self._row(entry) for entry in panel.entries]
        width = LABEL_MAX if panel.format == "parameter" else max(len(label) for label, _ in rows)
        for label, text in rows:
            indent = " " * (width + 4)
            first = f"  {label:<{width}}  "
            if len(label) > width:
                print(f"  {label}")
                first = indent
            print(textwrap.fill(text, _width(), initial_indent=first, subsequent_indent=indent) or first.rstrip())
        print()

    def _row(self, entry: "HelpEntry") -> tuple[str, str]:
        """The label of a command or option, and its text."""
        label = ", ".join(entry.display_labels_with_metavar)
        label = re.sub(r"\b[A-Z]+\b", lambda word: METAVARS.get(word[0], word[0]), label)
        return label, _description(entry) or self._summaries.get(label, "")


def _description(entry: "HelpEntry") -> str:
    """The description of an option, with its choices and default."""
    text = " ".join(_plain(entry.description).split()).removesuffix(".")
    if entry.choices and len(entry.choices) > 1:
        text += f"; one of {', '.join(entry.choices)}"
    if entry.default not in HIDDEN_DEFAULTS:
        text += f" (default: {re.sub(r'[()]|,(?= )|[.]0(?=[,)]|$)', '', str(entry.default))})"
    return text


def _plain(text: object) -> str:
    """The plain text inside an object that cyclopts has wrapped for rich."""
    return getattr(getattr(text, "primary_renderable", text), "plain", "")


def _width() -> int:
    return min(shutil.get_terminal_size().columns, WIDTH_MAX)
