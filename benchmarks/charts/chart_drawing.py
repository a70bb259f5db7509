"""The picture of a question: error against time, with its front and what is felt; or cost against work."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.view.chart import inline_svg, new_chart, save_both
from hapscene.view.palette import EDGE, INK, OKABE_ITO, SHADE

from .exponent import fit_exponent
from .question import Measure, Point, Question, against_of, cost_of, fronts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

COLOURS: Final = (*(OKABE_ITO[name] for name in ("blue", "vermilion", "green", "orange", "purple", "sky")), EDGE)
MARKERS: Final = "osD^vPX*<>"
"""Of the methods in turn: told apart without colour as well."""

NAMED_MAX: Final = 12
"""Points of a panel up to which each is named in the picture [count]; of more, those of the front alone."""

BARS_MAX: Final = 30
"""Points of a panel up to which the second of their times is drawn as well [count]."""

JOINED_MAX: Final = 8
"""Points of a method up to which they are joined, in the order of its settings [count]: more are no one line."""

FLOOR: Final = 1 / 3
"""Where an error of zero is drawn on a logarithmic axis, in the least error that is none [1]."""


def write_picture(question: Question, points: Sequence[Point], path: Path) -> list[Path]:
    """Draw all panels of a question beside each other, what to choose beneath, as PNG on light and on dark ground."""
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
        if known and not question.growth:
            figure.legend(known.values(), known.keys(), loc="outside right upper")
        advice = textwrap.fill(question.advice(points), int(14 * (width_in + 2.0)))
        figure.supxlabel(advice, x=0.01, ha="left", fontsize=10)
        return save_both(figure, path)


def drawings(question: Question, points: Sequence[Point]) -> list[tuple[Measure, str]]:
    """Each panel by itself, as an SVG element of the page. The k-th point of the list is the group `NAME-KEY-k`."""
    made = []
    for measure in panels_of(question, points):
        with new_chart(5.0, 4.1, style={"font.size": 9}) as figure:
            ax = figure.subplots()
            _draw(ax, question, points, measure)
            if not question.growth and ax.get_legend_handles_labels()[0]:
                figure.legend(loc="outside lower left", ncols=2, fontsize=8)
            made.append((measure, inline_svg(figure, f"{question.name}-{measure.key}")))
    return made


def panels_of(question: Question, points: Sequence[Point]) -> list[Measure]:
    """The measures that were told of some point."""
    return [m for m in question.measures if any(_is_number(p.errors.get(m.key)) for p in points)]


def _is_number(value: float | None) -> bool:
    return value is not None and value == value


def _draw(ax: "Axes", question: Question, points: Sequence[Point], measure: Measure) -> None:
    ax.set_title(textwrap.fill(measure.name, 52))
    ax.set_ylabel(f"[{measure.unit}]" if measure.unit else "")
    if measure.log:
        ax.set_yscale("log")
        _plain(ax.yaxis)
    told = [(k, p) for k, p in enumerate(points) if _is_number(p.errors.get(measure.key))]
    if question.growth:
        _draw_growth(ax, question, told, measure)
        return
    value = {k: p.errors[measure.key] for k, p in told}
    if measure.log:
        least = min([v for v in value.values() if v > 0.0] + ([measure.jnd] if measure.jnd else []), default=1.0)
        value = {k: max(v, FLOOR * least) for k, v in value.items()}
    against = against_of(question, measure)
    timed = any(_is_number(cost_of(p, against)) for _, p in told)
    bars = timed and not against and len(told) <= BARS_MAX
    labels = list(dict.fromkeys(p.label for _, p in told))
    methods = list(dict.fromkeys(p.method for p in points))
    best = [p for each in fronts(question, points, measure) for p in each]
    named: list[tuple[str, float, float]] = []
    for k, p in told:
        x = cost_of(p, against) if timed else float(labels.index(p.label))
        which = methods.index(p.method)
        colour, marker = COLOURS[which % len(COLOURS)], MARKERS[which % len(MARKERS)]
        if bars and p.p99_us == p.p99_us:
            ax.plot([x, p.p99_us], [value[k]] * 2, color=colour, linewidth=0.8, alpha=0.6)
            ax.plot(p.p99_us, value[k], color=colour, marker="|", markersize=5, alpha=0.6)
        (line,) = ax.plot(x, value[k], color=colour, marker=marker, markersize=6, linestyle="", zorder=3)
        if p.source:
            line.set_markerfacecolor("none")
        line.set_gid(f"{question.name}-{measure.key}-{k}")
        if timed and (p in best or (len(told) <= NAMED_MAX and not p.source)):
            named.append((p.label, x, value[k]))
    for which, method in enumerate(methods):
        of = [(k, p) for k, p in told if p.method == method]
        if of:
            colour, marker = COLOURS[which % len(COLOURS)], MARKERS[which % len(MARKERS)]
            fill = "none" if of[0][1].source else colour
            said = f"{method} (cited)" if of[0][1].source else method
            ax.plot([], [], color=colour, marker=marker, markerfacecolor=fill, linestyle="", label=said)
            if timed and len(of) <= JOINED_MAX:
                ax.plot(
                    [cost_of(p, against) for _, p in of],
                    [value[k] for k, _ in of],
                    color=colour,
                    linewidth=0.8,
                    alpha=0.5,
                )
    for source in dict.fromkeys(p.source for _, p in told if p.source):
        ax.plot([], [], linestyle="", label=textwrap.fill(f"cited: {source}", 40))
    if timed:
        ax.set_xscale("log")
        _plain(ax.xaxis)
        name = f"time a {question.per} [µs]: {question.quantiles[0]}"
        name += f", and to {question.quantiles[1]}" if bars else ""
        ax.set_xlabel(next((f"{m.name} [{m.unit}]" for m in question.measures if m.key == against), name))
        told_once: str | None = "Pareto front"
        for each in fronts(question, points, measure):
            if len(each) > 1:
                x_of = [cost_of(p, against) for p in each]
                at = [value[points.index(p)] for p in each]
                front: dict[str, Any] = {
                    "color": EDGE,
                    "linewidth": 5,
                    "alpha": 0.35,
                    "drawstyle": "steps-post",
                    "zorder": 1,
                }
                ax.plot(x_of, at, label=told_once, **front)
                told_once = None
    else:
        ax.set_xticks(range(len(labels)), labels, rotation=30, ha="right")
    if measure.jnd is not None:
        _draw_threshold(ax, measure, measure.jnd)
    _name_points(ax, named)


def _name_points(ax: "Axes", named: Sequence[tuple[str, float, float]]) -> None:
    """Labels beside points, left out where they would lie on one that is there."""
    taken: list[tuple[float, float, float]] = []
    for label, x, y in named:
        at_x, at_y = ax.transData.transform((x, y)) * 72 / ax.figure.dpi
        width = 4.5 * len(label) + 4
        if all(abs(at_y - y_) > 9 or at_x > x_ + w or x_ > at_x + width for x_, y_, w in taken):
            taken.append((at_x, at_y, width))
            ax.annotate(label, (x, y), (5, 4), textcoords="offset points", fontsize=7.5)


def _plain(axis: "Axis") -> None:
    """Numbers as they are spoken on a logarithmic axis: 0.5, not 5 × 10⁻¹."""

    def minor(value: float, _: float) -> str:
        low, high = axis.get_view_interval()
        digits = "123456789" if high < 3 * low else "25" if high < 30 * low else ""
        return spoken(value, 0) if f"{value:e}"[0] in digits else ""

    def spoken(value: float, _: float) -> str:
        return f"{value:,.0f}" if value >= 1e4 else f"{value:g}"

    axis.set_major_formatter(spoken)
    axis.set_minor_formatter(minor)


def _draw_threshold(ax: "Axes", measure: Measure, jnd: float) -> None:
    """The line of what is just felt, and the part of the panel that is not needed."""
    low, high = ax.get_ylim()
    if measure.log:
        low, high = min(low, jnd / 2), max(high, jnd * 2)
    else:
        low, high = min(low, 0.0), max(high, jnd * 1.1)
    ax.set_ylim(low, high)
    ends = (jnd, high) if measure.more_is_better else (low, jnd)
    ax.axhspan(*ends, color=SHADE, zorder=0)
    ax.axhline(jnd, color=INK, linewidth=1, linestyle="--", zorder=1)
    told = f"{measure.limit}: {jnd:g} {measure.unit}" + (f" ({measure.source})" if measure.source else "")
    up = measure.more_is_better
    for words, x, above, style in ((told, 1.0, not up, "normal"), ("not needed", 0.0, up, "italic")):
        ax.annotate(
            words, (x, jnd), (-3 if x else 4, 3 if above else -4), textcoords="offset points",
            xycoords=ax.get_yaxis_transform(), ha="right" if x else "left", va="bottom" if above else "top",
            fontsize=7.5, fontstyle=style,
        )  # fmt: skip


def _draw_growth(ax: "Axes", question: Question, told: list[tuple[int, Point]], measure: Measure) -> None:
    """Costs over works, a line for each method, named with its exponent."""
    methods = list(dict.fromkeys(p.method for _, p in told))
    for which, method in enumerate(methods):
        of = [(k, p) for k, p in told if p.method == method]
        colour, marker = COLOURS[which % len(COLOURS)], MARKERS[which % len(MARKERS)]
        for k, p in of:
            (line,) = ax.plot(p.errors["work"], p.errors[measure.key], color=colour, marker=marker, linestyle="")
            line.set_gid(f"{question.name}-{measure.key}-{k}")
        name = method
        work = sorted({p.errors["work"] for _, p in of})
        if len(work) > 1 and all(p.errors[measure.key] > 0.0 for _, p in of):
            found = fit_exponent([p.errors["work"] for _, p in of], [p.errors[measure.key] for _, p in of])
            ax.plot(work, [found.scale * n**found.slope for n in work], color=colour, linewidth=1.4)
            name = f"{method}: {found.words()}"
        ax.plot([], [], color=colour, marker=marker, label=name)
    ax.set(xscale="log", xlabel="n: how many")
    _plain(ax.xaxis)
    ax.legend(loc="upper left", fontsize=8)
    if measure.log:
        low, high = ax.get_ylim()
        low, high = min(low, high / 3), max(high, 3 * low)  # what stays the same looks it
        ax.set_ylim(low, high * (high / low) ** (0.09 * len(methods) + 0.05))
