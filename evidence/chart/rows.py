"""The table of the chart: each lever with its default, its cheapest setting below the limit of error, and the savings.

All texts are computed from the measured points. A saving is claimed only if it exceeds the noise.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Final

import numpy as np

from hapscene.errors import HapsceneError

from .question import Point, Question

__all__ = ["CHOSEN", "HEAD", "Row", "all_choices", "rows_of", "sentences"]

CHOSEN: Final = "cheapest setting under 1 JND"

HEAD: Final = ("lever", "default", CHOSEN, "saves per ms of touch, and memory", "error", "when not")
"""Titles of the columns."""

NOISE_SHARE: Final = 0.03
"""Smallest relative difference of two times that counts [1], as in `hapscene lab bench --against`."""

MEMORY_LEAST_MB: Final = 0.1
"""Smallest difference of memory that counts [MB]. Memory is counted, not measured: it has no noise."""


@dataclass(frozen=True)
class Choice:
    """A setting of a lever, over all cases.

    Attributes:
        method, label: of the setting.
        median_us: median over the cases of the time per millisecond of touch [µs].
        memory_MB: memory; NaN if the question does not measure it.
        error: largest error over cases and measures, divided by its limit [JND].
        worst: name of the measure with that error.
        eligible: whether this setting and all finer ones of its method have errors of at most 1 JND. A coarse setting
            that passes although a finer one fails passes by chance.
    """

    method: str
    label: str
    median_us: float
    memory_MB: float
    error: float
    worst: str
    eligible: bool

    @property
    def name(self) -> str:
        return ", ".join(filter(None, (self.method, self.label)))


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        lever: what is set.
        default, chosen: the default, and the setting that the table names.
        noise_us: difference of two times that repetition alone produces [µs].
        caveat: where the chosen setting must not be used.
        failure: the next coarser setting, or another method, whose error exceeds the limit.
    """

    lever: str
    default: Choice
    chosen: Choice
    noise_us: float
    caveat: str
    failure: str

    @property
    def saved_us(self) -> float:
        return self.default.median_us - self.chosen.median_us

    @property
    def saved_MB(self) -> float:
        return self.default.memory_MB - self.chosen.memory_MB

    @property
    def saves_time(self) -> bool:
        return self.saved_us > self.noise_us

    @property
    def saves_memory(self) -> bool:
        return self.saved_MB > MEMORY_LEAST_MB

    def cells(self) -> tuple[str, ...]:
        """Return the texts of the row, one for each column of `HEAD`."""
        time = f"none (noise {self.noise_us:.2g} µs)"
        if self.saves_time:
            time = f"{self.saved_us:.2g} of {self.default.median_us:.2g} µs"
        elif -self.saved_us > self.noise_us:
            time = f"costs {-self.saved_us:.2g} µs more"
        if self.saves_memory:
            time += f", {self.saved_MB:.2g} of {self.default.memory_MB:.2g} MB"
        chosen = "default" if self.chosen == self.default else self.chosen.name
        if not self.chosen.eligible:
            chosen = "none"
        return (
            self.lever,
            self.default.name,
            chosen,
            time,
            _text(self.chosen.error),
            "; ".join(filter(None, (self.caveat, self.failure))) or "–",
        )


def rows_of(question: Question, points: Sequence[Point]) -> list[Row]:
    """Return a row for each lever of a question.

    Raises:
        HapsceneError: a lever has no default, or a setting has no error.
    """
    rows = []
    for lever, choices in all_choices(question, points).items():
        own = [p for p in points if p.lever == lever]
        names = {(p.method, p.label) for p in own if p.default}
        defaults = [c for c in choices if (c.method, c.label) in names]
        if len(defaults) != 1:
            raise HapsceneError(f"{question.name}: {lever} has {len(defaults)} default settings; expected 1")
        noise_us = _noise(choices, own) * defaults[0].median_us
        chosen = _chosen(choices, defaults[0], noise_us)
        if chosen.eligible and defaults[0].eligible:
            trial = Row(lever, defaults[0], chosen, noise_us, "", "")
            chosen = chosen if trial.saves_time or trial.saves_memory else defaults[0]
        failure = _first_failure(choices, chosen) if chosen.eligible else ""
        caveat = ""
        if question.caveat is not None:
            caveat = question.caveat([p for p in own if (p.method, p.label) == (chosen.method, chosen.label)], own)
        rows.append(Row(lever, defaults[0], chosen, noise_us, caveat, failure))
    return rows


def all_choices(question: Question, points: Sequence[Point]) -> dict[str, list[Choice]]:
    """Return the settings of each lever of a question, from fine to coarse in each method."""
    levers = dict.fromkeys(p.lever for p in points)
    return {lever: _choices(question, [p for p in points if p.lever == lever]) for lever in levers}


def _choices(question: Question, points: Sequence[Point]) -> list[Choice]:
    """Return the settings of a lever, each over all of its cases."""
    groups: dict[tuple[str, str], list[Point]] = {}
    for p in points:
        groups.setdefault((p.method, p.label), []).append(p)
    values = {
        at: {key: float(np.max([p.errors.get(key, math.nan) for p in group])) for key in group[0].errors}
        for at, group in groups.items()
    }
    judged = [m for m in question.measures if m.limit and any(m.key in each for each in values.values())]
    least = {m.key: min(each.get(m.key, math.inf) for each in values.values()) if m.excess else 0.0 for m in judged}
    choices, failed = [], set[str]()
    for (method, label), group in groups.items():
        parts = {m.name: (values[method, label].get(m.key, math.nan) - least[m.key]) / (m.limit or 1.0) for m in judged}
        if not parts:
            raise HapsceneError(f"{question.name}: {method}, {label} has no error: measure it again")
        worst = max(parts, key=lambda name: math.inf if math.isnan(parts[name]) else parts[name])
        if not parts[worst] <= 1.0:
            failed.add(method)
        time_us = median(p.median_us for p in group)
        memory_MB = values[method, label].get("memory", math.nan)
        choices.append(Choice(method, label, time_us, memory_MB, parts[worst], worst, method not in failed))
    return choices


def _noise(choices: Sequence[Choice], points: Sequence[Point]) -> float:
    """Return the largest relative difference of times that no setting explains [1].

    These are: repetitions of a setting, its cases, and coarser settings of a method that take longer than finer ones.
    """
    found = [NOISE_SHARE, *(p.noise_us / p.median_us for p in points)]
    for c in choices:
        cases = [p.median_us for p in points if (p.method, p.label) == (c.method, c.label)]
        found.append(max(cases) / min(cases) - 1.0)
    for method in dict.fromkeys(c.method for c in choices):
        times = [c.median_us for c in choices if c.method == method]
        found += [later / min(times[: i + 1]) - 1.0 for i, later in enumerate(times)]
    return max(found)


def _chosen(choices: Sequence[Choice], default: Choice, noise_us: float) -> Choice:
    """Return the cheapest eligible setting, or the default if none is eligible.

    Times that differ by less than the noise are equal; then memory decides, then the error.
    """
    fit = [c for c in choices if c.eligible]
    if not fit:
        return default
    least_us = min(c.median_us for c in fit)
    near = [c for c in fit if c.median_us <= least_us + noise_us]
    return min(near, key=lambda c: (c.memory_MB if c.memory_MB == c.memory_MB else 0.0, c.error))


def _first_failure(choices: Sequence[Choice], chosen: Choice) -> str:
    """Return the next coarser setting whose error exceeds 1 JND, or otherwise the other method that misses it least.

    Return an empty text if no setting fails.
    """
    own = [c for c in choices if c.method == chosen.method]
    coarser = [c for c in own[own.index(chosen) + 1 :] if not c.eligible]
    failing = coarser[:1] or sorted((c for c in choices if not c.eligible), key=lambda c: c.error)
    if not failing:
        return ""
    return f"{failing[0].name}: {_text(failing[0].error)} ({failing[0].worst})"


def _except(row: Row) -> str:
    return f"; not for {row.caveat}" if row.caveat else ""


def _text(error: float) -> str:
    return f"{error:.2f}" if error < 10.0 else f"{error:.0f}"


def sentences(rows: Sequence[Row]) -> list[str]:
    """Return what the rows recommend."""
    faster = sorted((row for row in rows if row.saves_time), key=lambda row: -row.saved_us)
    smaller = sorted((row for row in rows if row.saves_memory), key=lambda row: -row.saved_MB)
    kept = [row.lever for row in rows if row.chosen == row.default and row.default.eligible]
    missed = [row for row in rows if not row.chosen.eligible]
    better = [row for row in rows if row.chosen.eligible and not row.default.eligible]
    found = [
        (
            "Save time per ms of touch",
            [f"{r.lever} ({r.chosen.name}: {r.saved_us:.2g} µs{_except(r)})" for r in faster],
        ),
        ("Save memory", [f"{r.lever} ({r.chosen.name}: {r.saved_MB:.2g} MB)" for r in smaller]),
        ("Nothing within 1 JND is measurably cheaper than the default", kept),
        (
            "The default exceeds the limit",
            [f"{r.lever} ({_text(r.default.error)} times; use {r.chosen.name})" for r in better],
        ),
        (
            "No setting is within the limit in every case",
            [f"{r.lever} (default: {_text(r.default.error)}, {r.default.worst})" for r in missed],
        ),
    ]
    return [f"{start}: {', '.join(parts)}." for start, parts in found if parts]
