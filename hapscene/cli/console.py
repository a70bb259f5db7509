"""What a command says while it works: what is being done and for how long, notes, and what was made."""

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from hapscene.errors import Codes, printable
from hapscene.memory import memory_limit_B

__all__ = [
    "caution",
    "complain",
    "name_made",
    "note",
    "note_little_memory",
    "ready_streams",
    "say",
    "size_words",
    "table",
    "tell",
    "tell_over",
]

_line_open = False
_notes: list[str] = []


def say(text: str) -> None:
    """Print progress at once, also through a pipe. A text without a line end leaves its line open for the next one."""
    global _line_open
    line = text.removesuffix("\n")
    sys.stdout.write(printable(line) + text[len(line) :])
    sys.stdout.flush()
    _line_open = not text.endswith("\n")
    if not _line_open:
        while _notes:
            note(_notes.pop(0))


def note(text: str) -> None:
    """A line to standard error beside the result; after the line that is open."""
    if _line_open:
        _notes.append(text)
        return
    complain(f"note: {text}")


def complain(text: str) -> None:
    """What is wrong, in one line to standard error."""
    print(f"hapscene: {' '.join(text.split())}", file=sys.stderr)


def caution(text: str) -> None:
    """A warning to standard error: the result is there, but may not be what was meant."""
    complain(f"warning: {text}")


def tell(lines: Iterable[str]) -> None:
    """A result in lines, each one line whatever the names in it are."""
    print("\n".join(map(printable, lines)), flush=True)


def tell_over(line: str) -> None:
    """A line of a terminal that is told over and over, each in the place of the last."""
    sys.stdout.write(Codes("\r"))
    sys.stdout.write(printable(line))
    sys.stdout.write(Codes("\x1b[K"))
    sys.stdout.flush()


def name_made(made: Sequence[Path]) -> None:
    """End a command by naming the files it made."""
    tell(["made:", *(f"  {file}  ({size_words(file.stat().st_size)})" for file in made)])


def size_words(size_B: float) -> str:
    """A file's size in three digits: "684 B", "12.3 kB", "65.5 MB"."""
    for unit in ("B", "kB", "MB"):
        if size_B < 999.5:
            return f"{size_B:.3g} {unit}"
        size_B /= 1000.0
    return f"{size_B:.3g} GB"


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table whose columns have even widths."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


LITTLE_B: Final = 512 << 20
"""Memory from which nothing is said [bytes]. A touch of a small scene takes 220 MB that the system cannot take back;
its first one, when functions are compiled, up to 500 MB."""


def note_little_memory() -> None:
    """Say it where this process may take little memory: who ends it for more says no word."""
    limit_B = memory_limit_B()
    if limit_B < LITTLE_B:
        note(
            f"this process may take {limit_B / 2**20:.0f} MiB of memory; a touch of a small scene takes 256 MiB, its "
            f"first one up to {LITTLE_B >> 20} MiB: with less it may stand still or be ended without a word"
        )


# The streams that all this is written to.


def ready_streams() -> None:
    """Make standard output and error fit for whatever is printed, for as long as the process lives.

    They are there (closed ones lead nowhere, and no file that is opened takes their place), in UTF-8, and what a
    terminal would obey is shown by its number; but for `Codes`.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest number that is free: this one
    for name, place in (("stdout", "standard output"), ("stderr", None)):
        stream: Any = getattr(sys, name)
        if stream is None:
            stream = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123 - until the process ends
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")
        if not isinstance(stream, _Printable):
            setattr(sys, name, _Printable(stream, place))


RESET: Final = "\x1b[0m"
"""What colorama, which numba imports, writes to a terminal at the end: no colours from here on."""


class _Printable:
    """A standard stream to which text is written as it may be shown."""

    def __init__(self, stream: Any, place: str | None) -> None:
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
        """What cannot be written is said once, where it can be; then, and when the process ends, it goes nowhere."""
        try:
            do(*arguments)
        except OSError as error:
            with suppress(OSError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)
            if self._place is not None:
                raise OSError(error.errno, error.strerror, self._place) from None
