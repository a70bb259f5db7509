"""A format of its own, a recorded path of the tool: read from CSV, checked, and put on the renderer's ticks."""

import csv
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import REACH_MAX_M
from hapscene.errors import PathError
from hapscene.files import check_file_size, refusing

COLUMNS: Final = ("t", "x", "y", "z")
"""Columns that a path must have: time [s], position of the tool in the world [m]."""

BYTES_MAX: Final = 1 << 30
"""Largest CSV that is read [B]: hours at 1 kHz."""

DURATION_MAX_S: Final = 3600.0
"""Longest path [s]. A longer one is most often in milliseconds, and its recording would not fit in memory."""

GAP_MAX_S: Final = 10.0
"""Longest time between two rows [s]. What the hand did in a longer one, no interpolation can tell."""

GRID_TOLERANCE_S: Final = 1e-9
"""A row this near to its tick is on it [s]: then the very numbers of the file are played."""


def load_path(path: str | Path, tick_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a path of the tool and put it on the renderer's ticks.

    The file is CSV with a header that names at least t, x, y, z, in any order. Rows that lie on the ticks
    already are taken as they are. Others are interpolated by monotone cubics (PCHIP, Fritsch & Carlson 1980),
    which never overshoot: a tool that rested on a surface is not pushed through it between two rows.

    Args:
        path: the CSV file.
        tick_s: period of a tick [s].

    Returns:
        t_s (n,): times of the ticks on the file's own clock [s]; p_WT (n, 3): the tool [m].

    Raises:
        PathError: the file is missing or no such CSV; it has fewer than two rows, a missing column, a cell
            that is no finite number, time that does not increase, or values beyond the limits above.
    """
    path = Path(path)
    lines, table = _read(path)
    _check(path, lines, table)
    t_s, p_WT = table[:, 0], table[:, 1:]
    tick = np.rint((t_s - t_s[0]) / tick_s)
    off_s = np.abs(t_s - t_s[0] - tick * tick_s)
    if off_s.max() <= GRID_TOLERANCE_S and np.array_equal(tick, np.arange(len(tick))):
        return t_s.copy(), p_WT.copy()
    from scipy.interpolate import PchipInterpolator

    count = int(np.floor((t_s[-1] - t_s[0] + GRID_TOLERANCE_S) / tick_s)) + 1
    if count < 2:
        raise PathError(f"{path}: lasts {t_s[-1] - t_s[0]:.3g} s; expected more than one tick of {tick_s:g} s")
    grid_s = t_s[0] + np.arange(count) * tick_s
    values = PchipInterpolator(t_s, p_WT)(np.clip(grid_s, t_s[0], t_s[-1]))
    return grid_s, np.ascontiguousarray(values)


def _read(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Line numbers (n,) and the columns t, x, y, z (n, 4) of the file."""
    with refusing(PathError):
        check_file_size(path, BYTES_MAX, "recorded path (CSV with the header t,x,y,z)")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            places = _places(path, next(reader, None))
            lines, rows = [], []
            for row in reader:
                if row:  # an empty line says nothing
                    rows.append(_numbers(path, reader.line_num, row, places))
                    lines.append(reader.line_num)
    except OSError as error:
        raise PathError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise PathError(f"{path}: is not CSV text ({error}); expected the header t,x,y,z") from None
    if len(rows) < 2:
        raise PathError(f"{path}: holds {len(rows)} rows; expected at least 2, under the header t,x,y,z")
    return np.array(lines), np.array(rows)


def _places(path: Path, header: list[str] | None) -> list[int]:
    """Where t, x, y, z stand in a row."""
    if not header:
        raise PathError(f"{path}: is empty; expected CSV with the header t,x,y,z in s and m")
    names = [name.strip() for name in header]
    for name in COLUMNS:
        if names.count(name) != 1:
            what = "twice" if name in names else f"not among the columns {', '.join(names)[:200]}"
            raise PathError(f"{path}, line 1: column {name!r} is {what}; expected the header t,x,y,z in s and m")
    return [names.index(name) for name in COLUMNS]


def _numbers(path: Path, line: int, row: list[str], places: list[int]) -> list[float]:
    """The four numbers of one row."""
    numbers = []
    for name, place in zip(COLUMNS, places, strict=True):
        try:
            numbers.append(float(row[place]))
        except IndexError:
            raise PathError(f"{path}, line {line}: has {len(row)} cells; expected {max(places) + 1} or more") from None
        except ValueError:
            raise PathError(f"{path}, line {line}: {name} is {row[place][:40]!r}; expected a number") from None
    return numbers


def _check(path: Path, lines: NDArray[np.int64], table: NDArray[np.float64]) -> None:
    """Refuse what cannot be played, naming the first line that is wrong."""
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        cell = table[row, column]
        raise PathError(f"{path}, line {lines[row]}: {COLUMNS[column]} is {cell}; expected a finite number")
    far = np.argwhere(np.abs(table[:, 1:]) > REACH_MAX_M)
    if len(far):
        row, column = far[0]
        place = f"{path}, line {lines[row]}: {COLUMNS[column + 1]} is {table[row, column + 1]:g} m"
        raise PathError(f"{place}; expected at most {REACH_MAX_M:g} m (is the path in mm?)")
    step_s = np.diff(table[:, 0])
    wrong = np.flatnonzero((step_s <= 0) | (step_s > GAP_MAX_S))
    if len(wrong):
        row = wrong[0] + 1
        before_s, now_s = table[row - 1 : row + 1, 0]
        expected = "time that increases" if now_s <= before_s else f"at most {GAP_MAX_S:g} s between rows"
        raise PathError(f"{path}, line {lines[row]}: t is {now_s:g} s after {before_s:g} s; expected {expected}")
    duration_s = table[-1, 0] - table[0, 0]
    if duration_s > DURATION_MAX_S:
        raise PathError(f"{path}: lasts {duration_s:g} s; expected at most {DURATION_MAX_S:g} s (is t in ms?)")
