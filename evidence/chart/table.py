"""The table of a chart, as CSV: every point of every question, and the machine that measured them."""

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
"""What stands in the place of a question where a row tells of the machine: its `method` is what, its `value` how."""


@dataclass(frozen=True)
class Table:
    """What was measured.

    Attributes:
        machine: what is told of the machine, of the versions and of the date, by name.
        points: of each question by its name.
    """

    machine: dict[str, str]
    points: dict[str, list[Point]]

    def write(self, path: Path, questions: Iterable[Question]) -> None:
        """Write as CSV, a row for each measure of each point."""
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
        """Read what `write` wrote.

        Raises:
            HapsceneError: the file is no such table.
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
                raise HapsceneError(f"{path}: line {line}: value, median_us and p99_us are numbers") from None
            if not source:  # tables of earlier versions cite other renderers' points
                errors.setdefault(of, {})[key] = number
        points: dict[str, list[Point]] = {}
        for (question, method, label, median_us, p99_us), told in errors.items():
            point = Point(method, label, float(median_us), float(p99_us), told)
            points.setdefault(question, []).append(point)
        return cls(machine, points)
