"""The sheet of a benchmark: one row per figure, stored as CSV; charts and page are made from it."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hapscene.errors import HapsceneError
from hapscene.io.files import whole_file

COLUMNS: Final = ("case", "figure", "value", "unit")

QUANTILES: Final = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
"""Quantiles that describe a distribution. They are nearest ranks, so that each value occurred in a tick."""


@dataclass(frozen=True)
class Figure:
    """A measured number, or a property of the machine."""

    case: str
    name: str
    value: float | str
    unit: str


class Sheet:
    """Figures by case and name, in the order of measurement."""

    def __init__(self) -> None:
        self._figures: dict[tuple[str, str], Figure] = {}

    def add(self, case: str, name: str, value: float | str, unit: str = "") -> None:
        """Add a figure; it replaces one with the same case and name."""
        kept = value if isinstance(value, str) else float(value)
        self._figures[case, name] = Figure(case, name, kept, unit)

    def add_spread(self, case: str, name: str, values: ArrayLike, unit: str, scale: float = 1.0) -> None:
        """Add the `QUANTILES` of values (n,), multiplied by `scale`, as "name median" and so on."""
        for quantile, value in spread(values).items():
            self.add(case, f"{name} {quantile}", scale * value, unit)

    def __iter__(self) -> Iterator[Figure]:
        return iter(self._figures.values())

    def __contains__(self, key: tuple[str, str]) -> bool:
        return key in self._figures

    def number(self, case: str, name: str) -> float:
        """Return the figure of that case and name. Raises HapsceneError: the figure was not measured."""
        if (case, name) not in self._figures:
            raise HapsceneError(
                f"no figure {name!r} of {case!r} in the table, which may be of an older version: measure again"
            )
        return float(self._figures[case, name].value)

    def cases(self, prefix: str) -> list[str]:
        """Return the cases whose names start with `prefix`, in order."""
        return list(dict.fromkeys(figure.case for figure in self if figure.case.startswith(prefix)))

    def write(self, path: Path) -> None:
        """Write the sheet as CSV."""
        with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            for figure in self:
                value = figure.value if isinstance(figure.value, str) else f"{figure.value:.6g}"
                table.writerow((figure.case, figure.name, value, figure.unit))

    @classmethod
    def read(cls, path: Path) -> "Sheet":
        """Read a sheet that `write` wrote. Raises HapsceneError: the file is not such a table."""
        sheet = cls()
        for case, name, value, unit in read_rows(path, COLUMNS, "figures"):
            try:
                sheet.add(case, name, float(value), unit)
            except ValueError:
                sheet.add(case, name, value, unit)
        return sheet


def read_rows(path: Path, columns: Sequence[str], what: str) -> list[list[str]]:
    """Return the rows of a CSV table with exactly these columns.

    Raises:
        HapsceneError: the file is not a table of `what`.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
    except (UnicodeDecodeError, csv.Error):
        rows = []
    if not rows or rows[0] != list(columns) or any(len(row) != len(columns) for row in rows):
        raise HapsceneError(f"{path}: not a table of {what}; expected the columns {', '.join(columns)}")
    return rows[1:]


def spread(values: ArrayLike) -> dict[str, float]:
    """Return the `QUANTILES` of values (n,) by name. Raises HapsceneError: no values."""
    ordered = np.sort(np.asarray(values, np.float64))
    if not len(ordered):
        raise HapsceneError("no tick to measure: the tool touched no body")
    rank = {name: max(int(np.ceil(q * len(ordered))) - 1, 0) for name, q in QUANTILES.items()}
    return {name: float(ordered[i]) for name, i in rank.items()}
