"""The table of a chart as CSV: every point of every question, and the machine."""

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hapscene.errors import HapsceneError
from hapscene.io.files import whole_file

from ..bench.sheet import read_rows
from .question import Point, Question

COLUMNS: Final = ("question", "method", "label", "measure", "value", "unit", "median_us", "p99_us", "source")

MACHINE: Final = "machine"
"""Value of the column `question` in rows about the machine; `method` is the property, `value` its value."""


@dataclass(frozen=True)
class Table:
    """The measured points.

    Attributes:
        machine: properties of the machine, versions and date, by name.
        points: points by name of the question.
    """

    machine: dict[str, str]
    points: dict[str, list[Point]]

    def write(self, path: Path, questions: Iterable[Question]) -> None:
        """Write the table as CSV, with a row for each measure of each point."""
        units = {(q.name, measure.key): measure.unit for q in questions for measure in q.measures}
        with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(COLUMNS)
            rows.writerows((MACHINE, name, "", "", value, "", "", "", "") for name, value in self.machine.items())
            for question, points in self.points.items():
                for p in points:
                    times = [f"{time_us:.6g}" for time_us in (p.median_us, p.p99_us)]
                    for key, value in p.errors.items():
                        unit = units.get((question, key), "")
                        rows.writerow((question, p.method, p.label, key, f"{value:.6g}", unit, *times, ""))

    @classmethod
    def read(cls, path: Path) -> "Table":
        """Read a table that `write` wrote.

        Raises:
            HapsceneError: the file is not such a table.
        """
        rows = read_rows(path, COLUMNS, "a chart")
        machine: dict[str, str] = {}
        errors: dict[tuple[str, ...], dict[str, float]] = {}
        for line, (question, method, label, key, value, _, median_us, p99_us, source) in enumerate(rows, 2):
            if question == MACHINE:
                machine[method] = value
                continue
            try:
                of = (question, method, label, str(float(median_us)), str(float(p99_us)))
                number = float(value)
            except ValueError:
                raise HapsceneError(f"{path}, line {line}: expected numbers as value, median_us and p99_us") from None
            if not source:  # tables of earlier versions also hold points of other renderers
                errors.setdefault(of, {})[key] = number
        points: dict[str, list[Point]] = {}
        for (question, method, label, median_us, p99_us), measured in errors.items():
            point = Point(method, label, float(median_us), float(p99_us), measured)
            points.setdefault(question, []).append(point)
        return cls(machine, points)
