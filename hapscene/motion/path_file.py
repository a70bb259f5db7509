"""Recorded paths of the tool: read from CSV, checked, and resampled to the renderer's ticks."""

from pathlib import Path
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.constants import REACH_MAX_M
from hapscene.errors import PathError
from hapscene.io.files import check_file_size, check_memory, refusing
from hapscene.io.number_files import read_table

__all__ = ["TICKS_PER_ROW_MAX", "TICK_FREE", "load_path"]

COLUMNS: Final = ("t", "x", "y", "z")
"""Required columns: time [s], and position of the tool in the world [m]."""

BYTES_MAX: Final = 1 << 30
"""Size limit of a CSV file [bytes]: hours at 1 kHz."""

DURATION_MAX_S: Final = 3600.0
"""Longest path [s]. A longer one is usually in milliseconds, and its recording would not fit into memory."""

GAP_MAX_S: Final = 10.0
"""Longest time between two rows [s]. Interpolation over a longer gap is meaningless."""

TICK_FREE: Final = 200_000
"""Ticks that a path may last with any number of rows [count]: 200 s at 1 kHz. A recording has 700 bytes per tick."""

TICKS_PER_ROW_MAX: Final = 100
"""Most ticks for each row of a longer path [1]: ten rows a second. Memory is allocated for each tick, so a file of a
few rows must not exhaust it."""

_ROW_B: Final = 32
"""Size of a row in memory [bytes]."""

_BETWEEN_B: Final = 180
"""Memory of the interpolation for each row [bytes]."""

GRID_TOLERANCE_S: Final = 1e-9
"""Tolerance within which rows count as on the ticks [s]. The file's numbers are then used unchanged."""


def load_path(path: str | Path, tick_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a path of the tool and resample it to the renderer's ticks.

    The file is CSV with a header that contains at least t, x, y, z, in any order. Rows that are on the ticks are used
    unchanged. Other rows are interpolated by monotone cubics (PCHIP, Fritsch & Carlson 1980), which do not overshoot: a
    tool at rest on a surface is not pushed through it between two rows.

    Args:
        path: the CSV file.
        tick_s: period of a tick [s].

    Returns:
        t_s (n,): times of the ticks, on the clock of the file [s]; p_WT (n, 3): tool positions [m].

    Raises:
        PathError: the file does not exist or is not such a CSV; it has fewer than two rows, lacks a column, contains a
            cell that is not a finite number, a time that does not increase, or a value out of range.
    """
    path = Path(path)
    table = _read(path)
    _check(path, table)
    t_s, p_WT = table[:, 0], table[:, 1:]
    tick = np.rint((t_s - t_s[0]) / tick_s)
    off_s = np.abs(t_s - t_s[0] - tick * tick_s)
    if off_s.max() <= GRID_TOLERANCE_S and np.array_equal(tick, np.arange(len(tick))):
        return t_s.copy(), p_WT.copy()
    del tick, off_s
    count = int(np.floor((t_s[-1] - t_s[0] + GRID_TOLERANCE_S) / tick_s)) + 1
    if count < 2:
        raise PathError(f"{path}: lasts {t_s[-1] - t_s[0]:.3g} s; expected more than one tick of {tick_s:g} s")
    most = TICK_FREE + TICKS_PER_ROW_MAX * len(table)
    if count > most:
        most_s = f"{most * tick_s:,.0f} s ({TICK_FREE * tick_s:g} s, and {TICKS_PER_ROW_MAX * tick_s:g} s a row)"
        raise PathError(
            f"{path}: lasts {count * tick_s:,.0f} s; expected at most {most_s} for {len(table):,} rows: record it at a "
            "higher rate"
        )
    with refusing(PathError, path):
        needed_B = (_ROW_B + _BETWEEN_B) * len(table) + _ROW_B * count
        check_memory(needed_B, path.stat().st_size, "its ticks", "divide it into shorter paths")
    grid_s = t_s[0] + np.arange(count) * tick_s
    clipped_s = np.clip(grid_s, t_s[0], t_s[-1])
    values = np.empty((count, 3))
    for axis in range(3):
        values[:, axis] = scipy.interpolate.PchipInterpolator(t_s, p_WT[:, axis])(clipped_s)
    return grid_s, values


def _read(path: Path) -> NDArray[np.float64]:
    """The columns t, x, y, z (n, 4) of the file."""
    with refusing(PathError):
        check_file_size(path, BYTES_MAX, "recorded path (CSV with the header t,x,y,z)")
    with refusing(PathError, path):
        try:
            table = np.column_stack(list(read_table(path, COLUMNS).values()))
        except OSError as error:
            raise PathError(f"cannot be read: {error.strerror}") from None
        if len(table) < 2:
            raise PathError("1 row; expected at least 2 below the header t,x,y,z")
    return table


def _check(path: Path, table: NDArray[np.float64]) -> None:
    """Check the values of a path. The error names the first invalid row below the header."""
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        cell = table[row, column]
        raise PathError(f"{path}, row {row + 1}: {COLUMNS[column]} is {cell}; expected a finite number")
    far = np.argwhere((table[:, 1:] > REACH_MAX_M) | (table[:, 1:] < -REACH_MAX_M))
    if len(far):
        row, column = far[0]
        place = f"{path}, row {row + 1}: {COLUMNS[column + 1]} is {table[row, column + 1]:g} m"
        raise PathError(f"{place}; expected at most {REACH_MAX_M:g} m (is the path in mm?)")
    step_s = np.diff(table[:, 0])
    wrong = np.flatnonzero((step_s <= 0) | (step_s > GAP_MAX_S))
    if len(wrong):
        row = wrong[0] + 1
        before_s, now_s = table[row - 1 : row + 1, 0]
        expected = "time that increases" if now_s <= before_s else f"at most {GAP_MAX_S:g} s between rows"
        raise PathError(f"{path}, row {row + 1}: t is {now_s:g} s after {before_s:g} s; expected {expected}")
    duration_s = table[-1, 0] - table[0, 0]
    if duration_s > DURATION_MAX_S:
        raise PathError(f"{path}: lasts {duration_s:g} s; expected at most {DURATION_MAX_S:g} s (is t in ms?)")
