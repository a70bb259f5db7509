"""The sheet that a benchmark fills: one row per figure, kept as CSV, from which charts and page are made."""

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
"""What is told of a distribution: nearest ranks, so that every number was measured in some tick."""


@dataclass(frozen=True)
class Figure:
    """One measured number, or a word about the machine."""

    case: str
    name: str
    value: float | str
    unit: str


class Sheet:
    """Figures by case and name, in the order they were measured."""

    def __init__(self) -> None:
        self._figures: dict[tuple[str, str], Figure] = {}

    def add(self, case: str, name: str, value: float | str, unit: str = "") -> None:
        """Note a figure; one of the same case and name is replaced."""
        kept = value if isinstance(value, str) else float(value)
        self._figures[case, name] = Figure(case, name, kept, unit)

    def add_spread(self, case: str, name: str, values: ArrayLike, unit: str, scale: float = 1.0) -> None:
        """Note the `QUANTILES` of values (n,), each times `scale`, as "name median" and so on."""
        for quantile, value in spread(values).items():
            self.add(case, f"{name} {quantile}", scale * value, unit)

    def __iter__(self) -> Iterator[Figure]:
        return iter(self._figures.values())

    def __contains__(self, key: tuple[str, str]) -> bool:
        return key in self._figures

    def number(self, case: str, name: str) -> float:
        """The figure of that case and name.

        Raises:
            HapsceneError: it was not measured.
        """
        if (case, name) not in self._figures:
            raise HapsceneError(f"the benchmark has no figure {name!r} of {case!r}: was it made by an older version?")
        return float(self._figures[case, name].value)

    def text(self, case: str, name: str) -> str:
        """The word of that case and name, empty where there is none."""
        figure = self._figures.get((case, name))
        return "" if figure is None else str(figure.value)

    def cases(self, prefix: str) -> list[str]:
        """Cases whose name starts so, in order."""
        return list(dict.fromkeys(figure.case for figure in self if figure.case.startswith(prefix)))

    def write(self, path: Path) -> None:
        """Write as CSV."""
        with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            for figure in self:
                value = figure.value if isinstance(figure.value, str) else f"{figure.value:.6g}"
                table.writerow((figure.case, figure.name, value, figure.unit))

    @classmethod
    def read(cls, path: Path) -> "Sheet":
        """Read what `write` wrote.

        Raises:
            HapsceneError: the file is no such table.
        """
        sheet = cls()
        for case, name, value, unit in read_rows(path, COLUMNS, "figures"):
            try:
                sheet.add(case, name, float(value), unit)
            except ValueError:
                sheet.add(case, name, value, unit)
        return sheet


def read_rows(path: Path, columns: Sequence[str], what: str) -> list[list[str]]:
    """The rows of a CSV table that has just these columns.

    Raises:
        HapsceneError: the file is no table of `what`.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
    except (UnicodeDecodeError, csv.Error):
        rows = []
    if not rows or rows[0] != list(columns) or any(len(row) != len(columns) for row in rows):
        raise HapsceneError(f"{path}: no table of {what}; expected the columns {', '.join(columns)}")
    return rows[1:]


def spread(values: ArrayLike) -> dict[str, float]:
    """The `QUANTILES` of values (n,) by name.

    Raises:
        HapsceneError: there are none.
    """
    ordered = np.sort(np.asarray(values, np.float64))
    if not len(ordered):
        raise HapsceneError("a benchmark measured nothing: the tool touched no body")
    rank = {name: max(int(np.ceil(q * len(ordered))) - 1, 0) for name, q in QUANTILES.items()}
    return {name: float(ordered[i]) for name, i in rank.items()}
