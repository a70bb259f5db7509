"""The picture of a question: error against time, with the Pareto front and the perceptible limit."""

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.view.chart import new_chart, save_both
from hapscene.view.palette import EDGE, INK, OKABE_ITO, SHADE

from .question import Measure, Point, Question, cost_key, cost_of, fronts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

COLOURS: Final = (*(OKABE_ITO[name] for name in ("blue", "vermilion", "green", "orange", "purple", "sky")), EDGE)
MARKERS: Final = "osD^vPX*<>"
"""Markers of the methods, so that they can be distinguished without colour."""

NAMED_MAX: Final = 12
"""Largest number of points of a panel for which all are labelled; otherwise only the front is [count]."""

BARS_MAX: Final = 30
"""Largest number of points of a panel for which p99 is drawn as well [count]."""

JOINED_MAX: Final = 8
"""Largest number of points of a method that are joined by a line [count]."""

FLOOR: Final = 1 / 3
"""Position of an error of zero on a logarithmic axis, relative to the smallest error above zero [1]."""


def write_picture(question: Question, points: Sequence[Point], path: Path) -> list[Path]:
    """Draw all panels of a question side by side with the recommendation below, as PNG for light and dark pages."""
    panels = panels_of(question, points)
    width_in = 4.9 * min(len(panels), 3)
    rows = -(-len(panels) // 3)
    size = {"font.size": 9.5, "axes.titlesize": 10}
    with new_chart(width_in + 2.6, 4.3 * rows + 0.7, question.title, size) as figure:
        axes = figure.subplots(rows, min(len(panels), 3), squeeze=False).ravel()
        for ax, measure in zip(axes, panels, strict=False):
            _draw(ax, question, points, measure)
        for ax in axes[len(panels) :]:
            ax.set_axis_off()
        known = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        if known:
            figure.legend(known.values(), known.keys(), loc="outside right upper")
        advice = textwrap.fill(question.advice(points), int(14 * (width_in + 2.0)))
        figure.supxlabel(advice, x=0.01, ha="left", fontsize=10)
        return save_both(figure, path)


def panels_of(question: Question, points: Sequence[Point]) -> list[Measure]:
    """Return the measures that at least one point has."""
    return [m for m in question.measures if any(_is_number(p.errors.get(m.key)) for p in points)]


def _is_number(value: float | None) -> bool:
    return value is not None and value == value


def _draw(ax: "Axes", question: Question, points: Sequence[Point], measure: Measure) -> None:
    ax.set_title(textwrap.fill(measure.name, 52))
    ax.set_ylabel(f"[{measure.unit}]" if measure.unit else "")
    against = cost_key(question, measure)
    known = [p for p in points if _is_number(p.errors.get(measure.key)) and _is_number(cost_of(p, against))]
    least = min([v for p in known if (v := p.errors[measure.key]) > 0.0] + ([measure.jnd] if measure.jnd else []))
    floor = FLOOR * least if measure.log else -math.inf
    at = {id(p): (cost_of(p, against), max(p.errors[measure.key], floor)) for p in known}
    for which, method in enumerate(dict.fromkeys(p.method for p in points)):
        of = [p for p in known if p.method == method]
        look: dict[str, Any] = {"color": COLOURS[which % len(COLOURS)], "linewidth": 0.8}
        marker = MARKERS[which % len(MARKERS)]
        if not of:
            continue
        x, y = zip(*(at[id(p)] for p in of), strict=True)
        ax.plot(x, y, marker, **look, markersize=6, zorder=3, label=method)
        if len(of) <= JOINED_MAX:
            ax.plot(x, y, **look, alpha=0.5)
        if not against and len(known) <= BARS_MAX:
            ax.hlines(y, x, [p.p99_us for p in of], colors=look["color"], linewidth=0.8, alpha=0.6)
    if measure.log:
        ax.set_yscale("log")
        _plain(ax.yaxis)
    ax.set_xscale("log")
    _plain(ax.xaxis)
    time = f"time per {question.per} [µs]: median, line to p99"
    ax.set_xlabel(next((f"{m.name} [{m.unit}]" for m in question.measures if m.key == against), time))
    best = fronts(question, points, measure)
    for k, each in enumerate(best):
        x, y = zip(*(at[id(p)] for p in each), strict=True) if each else ((), ())
        label = "" if k else "Pareto front"
        ax.plot(x, y, label=label, color=EDGE, linewidth=5, alpha=0.35, drawstyle="steps-post", zorder=1)
    if measure.jnd is not None:
        _draw_threshold(ax, measure, measure.jnd)
    on_front = {id(p) for each in best for p in each}
    _name_points(ax, [(p.label, *at[id(p)]) for p in known if id(p) in on_front or len(known) <= NAMED_MAX])


def _name_points(ax: "Axes", named: Sequence[tuple[str, float, float]]) -> None:
    """Draw labels beside points; a label that would overlap another one is omitted."""
    taken: list[tuple[float, float, float]] = []
    for label, x, y in named:
        at_x, at_y = ax.transData.transform((x, y)) * 72 / ax.figure.dpi
        width = 4.5 * len(label) + 4
        if all(abs(at_y - y_) > 9 or at_x > x_ + w or x_ > at_x + width for x_, y_, w in taken):
            taken.append((at_x, at_y, width))
            ax.annotate(label, (x, y), (5, 4), textcoords="offset points", fontsize=7.5)


def _plain(axis: "Axis") -> None:
    """Label a logarithmic axis with plain decimal numbers: 0.5, not 5 × 10⁻¹."""

    def minor(value: float, _: float) -> str:
        low, high = axis.get_view_interval()
        digits = "123456789" if high < 3 * low else "25" if high < 30 * low else ""
        return decimal(value, 0) if f"{value:e}"[0] in digits else ""

    def decimal(value: float, _: float) -> str:
        return f"{value:,.0f}" if value >= 1e4 else f"{value:g}"

    axis.set_major_formatter(decimal)
    axis.set_minor_formatter(minor)


def _draw_threshold(ax: "Axes", measure: Measure, jnd: float) -> None:
    """Draw the line of the perceptible limit, and shade the part of the panel beyond it."""
    low, high = ax.get_ylim()
    if measure.log:
        low, high = min(low, jnd / 2), max(high, jnd * 2)
    else:
        low, high = min(low, 0.0), max(high, jnd * 1.1)
    ax.set_ylim(low, high)
    ends = (jnd, high) if measure.more_is_better else (low, jnd)
    ax.axhspan(*ends, color=SHADE, zorder=0)
    ax.axhline(jnd, color=INK, linewidth=1, linestyle="--", zorder=1)
    label = f"{measure.limit}: {jnd:g} {measure.unit}" + (f" ({measure.source})" if measure.source else "")
    up = measure.more_is_better
    for words, x, above, style in ((label, 1.0, not up, "normal"), ("not needed", 0.0, up, "italic")):
        ax.annotate(
            words, (x, jnd), (-3 if x else 4, 3 if above else -4), textcoords="offset points",
            xycoords=ax.get_yaxis_transform(), ha="right" if x else "left", va="bottom" if above else "top",
            fontsize=7.5, fontstyle=style,
        )  # fmt: skip
