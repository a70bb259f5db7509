"""The level meter of a recording: what each stream does just now, in one line of the terminal."""

import shutil
import sys
from collections.abc import Sequence
from typing import Final, TextIO

import numpy as np
from numpy.typing import NDArray

from hapscene.wire.protocol import Column, Count

TERMINAL_S: Final = 0.1
"""Time between two states of the line on a terminal [s]."""

LOG_S: Final = 1.0
"""Time between two lines where the output is no terminal [s]."""


class Meter:
    """Shows root mean square and peak about the mean, since the last time it was shown, and what was lost."""

    def __init__(self, columns: Sequence[Column], rate_Hz: float, stream: TextIO | None = None) -> None:
        self._columns = columns
        self._rate_Hz = rate_Hz
        self._stream = sys.stdout if stream is None else stream
        self._live = self._stream.isatty()
        self.period_s = TERMINAL_S if self._live else LOG_S
        self._pieces: list[NDArray[np.int64]] = []
        self._shown_s: float | None = None

    def take(self, counts: NDArray[np.int64]) -> None:
        """Takes samples in, (k, c)."""
        self._pieces.append(counts)

    def show(self, position: int, count: Count, now_s: float) -> None:
        """Shows the state, if it is time for it."""
        if self._shown_s is None:
            self._shown_s = now_s
        if now_s - self._shown_s < self.period_s:
            return
        self._shown_s = now_s
        line = self.line(position, count)
        if self._live:
            width = shutil.get_terminal_size().columns
            self._stream.write(f"\r{line[: width - 1]}\x1b[K")
        else:
            self._stream.write(f"{line}\n")
        self._stream.flush()

    def line(self, position: int, count: Count) -> str:
        """The state in words, since the last time that it was asked for."""
        levels = "  silent"
        if self._pieces:
            values = np.concatenate(self._pieces) * np.array([c.scale for c in self._columns])
            self._pieces = []
            away = values - values.mean(axis=0)
            levels = "".join(
                f"  {column.name} {rms:.3g}/{peak:.3g} {column.unit}"
                for column, rms, peak in zip(
                    self._columns, np.sqrt((away**2).mean(axis=0)), np.abs(away).max(axis=0), strict=True
                )
            )
        lost = f"dropped {count.dropped}, torn {count.torn}, garbage {count.garbage}"
        return f"{position / self._rate_Hz:7.1f} s  {lost}  rms/peak:{levels}"  # the end is cut where it is too long

    def close(self) -> None:
        """Leaves the line, so that what is said next stands below it."""
        if self._live and self._shown_s is not None:
            self._stream.write("\n")
            self._stream.flush()
