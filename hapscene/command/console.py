"""What a command says while it works: what is being done and for how long, notes, and what was made."""

import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

TICK_S: Final = 1.0
"""Time between two states of the seconds that a terminal shows [s]."""


class _OpenLine:
    """The line that waits for its end: what is being done, and on a terminal for how many seconds already."""

    def __init__(self, start_s: float) -> None:
        self.start_s = start_s
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        if sys.stdout.isatty():
            self._thread = threading.Thread(target=self._count, daemon=True)
            self._thread.start()

    def end(self) -> None:
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _count(self) -> None:
        while not self._ended.wait(TICK_S):
            text = f"{time.monotonic() - self.start_s:.0f} s"
            sys.stdout.write(text + "\b" * len(text))  # what is said next stands in its place
            sys.stdout.flush()


_open: _OpenLine | None = None
_notes: list[str] = []


def say(text: str) -> None:
    """Progress to standard output at once, also through a pipe; on a terminal, a line without end counts seconds."""
    global _open
    start_s = time.monotonic()
    if _open is not None:
        _open.end()
        start_s, _open = _open.start_s, None
    sys.stdout.write(text)
    sys.stdout.flush()
    if text.endswith("\n"):
        while _notes:
            note(_notes.pop(0))
    else:
        _open = _OpenLine(start_s)


def note(text: str) -> None:
    """A line to standard error beside the result; after the line that is open."""
    if _open is not None:
        _notes.append(text)
        return
    print(f"hapscene: note: {text}", file=sys.stderr)


def name_made(made: Sequence[Path]) -> None:
    """End a command by naming the files it made."""
    print("made:")
    for file in made:
        print(f"  {file}  ({size_words(file.stat().st_size)})", flush=True)


def size_words(size_B: float) -> str:
    """A file's size in three digits: "684 B", "12.3 kB", "65.5 MB"."""
    for unit in ("B", "kB", "MB"):
        if size_B < 999.5:
            return f"{size_B:.3g} {unit}"
        size_B /= 1000.0
    return f"{size_B:.3g} GB"
