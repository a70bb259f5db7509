"""A question of the chart: methods at several settings, each a point of time against error."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

__all__ = ["Measure", "Point", "Question", "Setting", "cost_key", "cost_of", "front", "fronts"]


class Setting(NamedTuple):
    """A method at one of its settings."""

    method: str
    """Name of the method; one line of the picture."""
    label: str
    """Label of the point, such as "order 40" or "÷16"."""
    arguments: Mapping[str, Any]
    """Arguments of the question's `error` and `time`; JSON types."""


@dataclass(frozen=True)
class Measure:
    """A kind of error; one panel of the picture.

    Attributes:
        key: its key in the result of `Question.error`.
        name, unit: as shown.
        jnd: just-noticeable difference in that unit, or None; smaller errors are not perceptible.
        source: source of the just-noticeable difference.
        limit: name of that number in the picture.
        log: whether the axis is logarithmic.
        more_is_better: whether larger values are better, as for a stiffness.
    """

    key: str
    name: str
    unit: str
    jnd: float | None = None
    source: str = ""
    log: bool = True
    more_is_better: bool = False
    limit: str = "just noticeable"


@dataclass(frozen=True)
class Point:
    """A measured setting.

    Attributes:
        method, label: of the setting.
        median_us, p99_us: time per `Question.per` [µs].
        errors: errors by `Measure.key`.
    """

    method: str
    label: str
    median_us: float
    p99_us: float
    errors: Mapping[str, float]


@dataclass(frozen=True)
class Question:
    """A question: error against time for several methods and settings.

    Attributes:
        name: file name: "mesh", "force-rate".
        title: heading, such as "Mesh resolution".
        measures: kinds of error, one panel each.
        settings: returns the settings to measure; called with whether to measure fewer, and with the scene file (None:
            the question's default subject).
        error: returns the errors of a setting by `Measure.key`, against a reference that is independent of the methods.
            Called in several processes at once.
        time: returns median and p99 of a setting's time [µs]; called with no other task running.
        advice: returns a recommendation and its limits, computed from the points.
        conditions: subject, path and reference of the measurement.
        per: what one time refers to.
        against: key of the measure that replaces time as the cost; empty for time.
        subject: returns the subject of a point, such as a body; points of different subjects are not compared.
    """

    name: str
    title: str
    measures: tuple[Measure, ...]
    settings: Callable[[bool, str | None], Sequence[Setting]]
    error: Callable[..., Mapping[str, float]]
    time: Callable[..., tuple[float, float]]
    advice: Callable[[Sequence[Point]], str]
    conditions: str
    per: str = "tick"
    against: str = ""
    subject: Callable[[Point], str] = field(default=lambda point: "")


def front(points: Sequence[Point], measure: Measure, against: str = "") -> list[Point]:
    """Return the Pareto front, sorted by cost: points that no other point beats in both cost and error."""
    sign = -1.0 if measure.more_is_better else 1.0
    known = [p for p in points if measure.key in p.errors and cost_of(p, against) == cost_of(p, against)]
    best, kept = float("inf"), []
    for point in sorted(known, key=lambda p: (cost_of(p, against), sign * p.errors[measure.key])):
        if sign * point.errors[measure.key] < best:
            best = sign * point.errors[measure.key]
            kept.append(point)
    return kept


def cost_of(point: Point, against: str = "") -> float:
    """Return the median time [µs], or the measure that replaces it; NaN if it is unknown."""
    return point.errors.get(against, float("nan")) if against else point.median_us


def fronts(question: Question, points: Sequence[Point], measure: Measure) -> list[list[Point]]:
    """Return the front of each subject of a question."""
    subjects = dict.fromkeys(question.subject(p) for p in points)
    against = cost_key(question, measure)
    return [front([p for p in points if question.subject(p) == of], measure, against) for of in subjects]


def cost_key(question: Question, measure: Measure) -> str:
    """Return the key of the measure on the cost axis of a panel; empty for time."""
    return "" if question.against == measure.key else question.against
