"""What a question of the chart is: settings of methods, each of which becomes a point of time against error."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

__all__ = ["Measure", "Point", "Question", "Setting", "cost_key", "cost_of", "front", "fronts"]


class Setting(NamedTuple):
    """A method at one of its settings."""

    method: str
    """One line of the picture."""
    label: str
    """Short name of the point: "order 40", "÷16"."""
    arguments: Mapping[str, Any]
    """Arguments of the question's `error` and `time`, of types that JSON holds."""


@dataclass(frozen=True)
class Measure:
    """A quantity that errors are measured in; one panel of the picture.

    Attributes:
        key: its key in what `error` returns.
        name, unit: as shown.
        jnd: just-noticeable difference in that unit; None where it is not known. Smaller errors cannot be felt.
        source: source of the just-noticeable difference.
        limit: name of that number: "just felt", or what else it is the limit of.
        log: whether the axis is logarithmic.
        more_is_better: whether more is better, as of a stiffness that is kept.
    """

    key: str
    name: str
    unit: str
    jnd: float | None = None
    source: str = ""
    log: bool = True
    more_is_better: bool = False
    limit: str = "just felt"


@dataclass(frozen=True)
class Point:
    """A setting as it was measured.

    Attributes:
        method, label: of the setting.
        median_us, p99_us: time per `Question.per` [µs].
        errors: by `Measure.key`.
    """

    method: str
    label: str
    median_us: float
    p99_us: float
    errors: Mapping[str, float]


@dataclass(frozen=True)
class Question:
    """One picture: error against time, over the settings of some methods.

    Attributes:
        name: file name: "mesh", "force-rate".
        title: the question itself: "How coarse may a mesh be?"
        measures: quantities that are measured; a panel each.
        settings: the settings to measure, given whether in short, and the scene's file (None for the question's own
            subject).
        error: errors of a setting's arguments, by `Measure.key`, against a truth that no method under test made. Called
            in several processes at once.
        time: median and p99 of a setting's time [µs], called with nothing beside it.
        advice: a sentence or two that say what to choose and when not to, computed from the points.
        conditions: what was touched, how, against which truth.
        per: what the time is of.
        against: key of the measure that stands in the place of time, where it is not time that is saved.
        subject: what a point is of, as a body: points of different subjects do not compete.
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
    """The Pareto front: points that no other one beats in both cost and error, by cost."""
    sign = -1.0 if measure.more_is_better else 1.0
    known = [p for p in points if measure.key in p.errors and cost_of(p, against) == cost_of(p, against)]
    best, kept = float("inf"), []
    for point in sorted(known, key=lambda p: (cost_of(p, against), sign * p.errors[measure.key])):
        if sign * point.errors[measure.key] < best:
            best = sign * point.errors[measure.key]
            kept.append(point)
    return kept


def cost_of(point: Point, against: str = "") -> float:
    """The median time [µs], or the measure that stands in its place; NaN where it is not known."""
    return point.errors.get(against, float("nan")) if against else point.median_us


def fronts(question: Question, points: Sequence[Point], measure: Measure) -> list[list[Point]]:
    """The front of each subject of a question."""
    subjects = dict.fromkeys(question.subject(p) for p in points)
    against = cost_key(question, measure)
    return [front([p for p in points if question.subject(p) == of], measure, against) for of in subjects]


def cost_key(question: Question, measure: Measure) -> str:
    """Key of the measure that a panel is drawn against; empty for time."""
    return "" if question.against == measure.key else question.against
