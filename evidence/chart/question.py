"""A question of the chart: one or more levers, each with a default and other settings of known cost and error."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

__all__ = ["Measure", "Point", "Question", "Setting", "merge_identical"]


class Setting(NamedTuple):
    """A lever at one of its settings, in one case.

    The settings of a method are listed from fine to coarse.
    """

    lever: str
    """What is set, such as "mesh of toad"; one row of the table."""
    method: str
    """Name of the method, such as "shaded"."""
    label: str
    """Label of the setting, such as "order 40" or "÷16"; empty for a method without settings."""
    arguments: Mapping[str, Any]
    """Arguments of the question's `error` and `time`."""
    case: str = ""
    """Condition such as a device. Cases of a setting cost the same time; the largest error counts."""
    default: bool = False
    """Whether hapscene uses this setting unless another one is chosen."""


@dataclass(frozen=True)
class Measure:
    """A kind of error.

    Attributes:
        key: its key in the result of `Question.error`.
        name, unit: as shown.
        limit: just-noticeable difference or another limit in that unit; None if the value is not judged.
        source: source of the limit.
        excess: judge the value minus the smallest value of the lever. For references that have an error themselves,
            such as recordings.
    """

    key: str
    name: str
    unit: str
    limit: float | None = None
    source: str = ""
    excess: bool = False


@dataclass(frozen=True)
class Point:
    """A measured setting.

    Attributes:
        lever, method, label, case, default: of the setting.
        median_us, p99_us: time per millisecond of touch [µs].
        noise_us: difference of the medians of repeated measurements [µs].
        errors: values by `Measure.key`; "memory" is the memory [MB].
    """

    lever: str
    method: str
    label: str
    case: str
    default: bool
    median_us: float
    p99_us: float
    noise_us: float
    errors: Mapping[str, float]


@dataclass(frozen=True)
class Question:
    """A question: time, memory and error for the settings of one or more levers.

    Attributes:
        name: name on the command line: "mesh", "force-rate".
        title: heading, such as "Mesh resolution".
        measures: kinds of error.
        settings: returns the settings to measure; called with the scene file, or None for the default subject.
        error: returns the values of a setting by `Measure.key`, against a reference that is independent of the
            methods.
        time: returns median and p99 of a setting's time per millisecond of touch [µs].
        conditions: subject, path and reference of the measurement.
        program: returns the bytes of the arrays that a setting runs with; settings with equal bytes are measured once.
        caveat: returns where a setting must not be used; computed from its points and all points of its lever.
    """

    name: str
    title: str
    measures: tuple[Measure, ...]
    settings: Callable[[str | None], Sequence[Setting]]
    error: Callable[..., Mapping[str, float]]
    time: Callable[..., tuple[float, float]]
    conditions: str
    program: Callable[..., bytes] | None = None
    caveat: Callable[[Sequence[Point], Sequence[Point]], str] | None = None


def merge_identical(question: Question, settings: Sequence[Setting]) -> list[Setting]:
    """Return the settings, with those of a method merged that run the same program.

    Orders 120, 40, 20 and 6 of a texture of order 6 become one setting, "order 6 and finer".
    """
    merged: dict[tuple[str, str, str, object], Setting] = {}
    for one in settings:
        program = one.label if question.program is None else question.program(**one.arguments)
        key = (one.lever, one.method, one.case, program)
        if key in merged:
            one = one._replace(label=f"{one.label} and finer", default=merged[key].default or one.default)
        merged[key] = one
    return list(merged.values())
