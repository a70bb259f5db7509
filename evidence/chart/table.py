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

COLUMNS: Final = (
    *("question", "lever", "method", "label", "case", "default"),
    *("measure", "value", "unit", "median_us", "p99_us", "noise_us"),
)

MACHINE: Final = "machine"
"""Value of the column `question` in rows about the machine; `lever` is the property, `value` its value."""

LOAD: Final = "load per core"
"""Property of the machine: largest load average per core while times were measured [1]."""

LOAD_MAX: Final = 1.0
"""Load per core above which times are not valid [1]."""


@dataclass(frozen=True)
class Table:
    """The measured points.

    Attributes:
        machine: properties of the machine, versions and date, by name.
        points: points by name of the question.
    """

    machine: dict[str, str]
    points: dict[str, list[Point]]

    @property
    def quiet(self) -> bool:
        """Return whether the load allowed to measure times."""
        return not float(self.machine.get(LOAD, "nan")) > LOAD_MAX

    def write(self, path: Path, questions: Iterable[Question]) -> None:
        """Write the table as CSV, with a row for each measure of each point."""
        units = {(q.name, measure.key): measure.unit for q in questions for measure in q.measures}
        with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(COLUMNS)
            rows.writerows((MACHINE, name, *[""] * 5, value, *[""] * 4) for name, value in self.machine.items())
            for question, points in self.points.items():
                for p in points:
                    setting = (p.lever, p.method, p.label, p.case, "default" if p.default else "")
                    times = [f"{time_us:.6g}" for time_us in (p.median_us, p.p99_us, p.noise_us)]
                    for key, value in p.errors.items():
                        rows.writerow((question, *setting, key, f"{value:.6g}", units.get((question, key), ""), *times))

    @classmethod
    def read(cls, path: Path) -> "Table":
        """Read a table that `write` wrote. Raises HapsceneError: the file is not such a table."""
        machine: dict[str, str] = {}
        errors: dict[tuple[str, ...], dict[str, float]] = {}
        for line, row in enumerate(read_rows(path, COLUMNS, "a chart"), 2):
            question, lever, key, value = row[0], row[1], row[6], row[7]
            try:
                if question == MACHINE:
                    machine[lever] = value if lever != LOAD else str(float(value))
                else:
                    times = (str(float(text)) for text in row[9:])
                    errors.setdefault((*row[:6], *times), {})[key] = float(value)
            except ValueError:
                raise HapsceneError(f"{path}, line {line}: expected numbers as value, load and times") from None
        points: dict[str, list[Point]] = {}
        for (question, *setting, default, median_us, p99_us, noise_us), measured in errors.items():
            lever, method, label, case = setting
            times_us = (float(median_us), float(p99_us), float(noise_us))
            points.setdefault(question, []).append(
                Point(lever, method, label, case, bool(default), *times_us, errors=measured)
            )
        return cls(machine, points)
