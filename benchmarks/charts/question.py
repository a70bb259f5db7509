"""What a question of the chart is: settings of methods, each of which becomes a point of time against error."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple


class Setting(NamedTuple):
    """A method at one of its settings."""

    method: str
    """one line of the picture"""
    label: str
    """of the point, short: "order 40", "÷16" """
    arguments: Mapping[str, Any]
    """of the question's `error` and `time`, such as JSON holds"""


@dataclass(frozen=True)
class Measure:
    """A quantity that a question's errors are told in, one panel of its picture.

    Attributes:
        key: what `error` calls it.
        name, unit: for people.
        jnd: how much of it is just noticed, in that unit; None where nobody knows. What lies below is not needed.
        source: of that number.
        limit: what is said of that number: "just felt", or what else it is the limit of.
        log: drawn on a logarithmic axis.
        more_is_better: as of a stiffness that is kept; else less is, as of an error.
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
    """A setting as it was measured, or as another one's is cited.

    Attributes:
        method, label: of the setting.
        median_us, p99_us: time of whatever `Question.per` says [µs]; NaN where it has none.
        errors: by `Measure.key`.
        source: where a cited point is from; empty for what was measured here.
    """

    method: str
    label: str
    median_us: float
    p99_us: float
    errors: Mapping[str, float]
    source: str = ""


def no_time(**_: Any) -> tuple[float, float]:
    """The time of what has none of its own."""
    return float("nan"), float("nan")


@dataclass(frozen=True)
class Question:
    """One picture: error against time, over the settings of some methods.

    Attributes:
        name: one word or two, of its files: "mesh", "texture-order".
        title: the question itself, as "How coarse may a mesh be?"
        measures: what is told of a setting; a panel each.
        settings: those to measure, given whether in short, and the scene's file (None for what the question takes
            itself).
        error: the `measures` of a setting's arguments, by key, against a truth that the method did not make. Called in
            other processes, side by side.
        time: median and p99 of its time [µs], called with nothing beside it.
        advice: a sentence or two that says what to choose and when not to, of the points.
        conditions: a sentence: what was touched, how, against which truth.
        per: what the time is of.
        cited: others' figures on the same paths.
        needs: what else must be there, as `recordings`: why the question is left out, or empty.
        growth: its picture is of cost against work: each measure is a cost that `error` tells beside `work`, called
            with nothing beside it, and how it grows is fitted. It has no front.
        quantiles: what the two numbers of `time` are.
        against: key of the measure that errors are told against in the place of time, where it is not time that is
            saved; its own panel is against time.
        subject: what a point is of, as a body: points of different ones do not compete, each has a front of its own.
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
    cited: tuple[Point, ...] = field(default=())
    needs: Callable[[], str] = field(default=lambda: "")
    growth: bool = False
    quantiles: tuple[str, str] = ("median", "p99")
    against: str = ""
    subject: Callable[[Point], str] = field(default=lambda point: "")


def front(points: Sequence[Point], measure: Measure, against: str = "") -> list[Point]:
    """The Pareto front: points that no other one beats in both time and error, by time. Cited ones are not in it.

    With `against`, that measure stands in the place of time.
    """
    sign = -1.0 if measure.more_is_better else 1.0
    told = [
        p for p in points if not p.source and measure.key in p.errors and cost_of(p, against) == cost_of(p, against)
    ]
    best, kept = float("inf"), []
    for point in sorted(told, key=lambda p: (cost_of(p, against), sign * p.errors[measure.key])):
        if sign * point.errors[measure.key] < best:
            best = sign * point.errors[measure.key]
            kept.append(point)
    return kept


def cost_of(point: Point, against: str = "") -> float:
    """What an error is told against: the median time [µs], or a measure; NaN where it is not known."""
    return point.errors.get(against, float("nan")) if against else point.median_us


def fronts(question: Question, points: Sequence[Point], measure: Measure) -> list[list[Point]]:
    """The front of each subject of a question."""
    subjects = dict.fromkeys(question.subject(p) for p in points)
    against = against_of(question, measure)
    return [front([p for p in points if question.subject(p) == of], measure, against) for of in subjects]


def against_of(question: Question, measure: Measure) -> str:
    """Key of the measure that a panel is drawn against; empty for time."""
    return "" if question.against == measure.key else question.against
