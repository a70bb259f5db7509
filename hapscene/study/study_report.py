"""The report on a study: one page that says what the answers say, with intervals, and what they do not."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.capture.report import document, figure
from hapscene.capture.report_plots import BLUE, MUTED, ORANGE, Plot, drawn
from hapscene.errors import StudyError
from hapscene.files import write_whole
from hapscene.study.discrimination import Estimate
from hapscene.study.plan import Block
from hapscene.study.results_file import load_rows
from hapscene.study.sitting import RESULTS
from hapscene.study.statistics import Analysis, Finding, Row, analyse

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINE_IN: Final = 0.34
"""Height of a line of a plot [in]."""

BINS: Final = 6
"""Bins of levels in which answers to a staircase are shown [count]."""

SIMULATED: Final = "Nobody was asked: the answers are those of simulated people."

SIMULATED_S: Final = "1.000"
"""How long simulated people take for every answer [s]; nobody else does."""

STYLE: Final = """
.verdict { font-weight: 600; } .plots + .table { margin-top: 14px; } .warning { border: 1px solid; padding: 6px 12px; }
@media (max-width: 640px) {
  td.to { min-width: 180px; } thead { display: table-header-group; } tbody tr { display: table-row; }
  thead th, tbody th, tbody td { padding: 6px 10px; border-top: 1px solid var(--line); }
}
"""


def write_report(folder: Path, path: Path) -> None:
    """Writes the report on the study in `folder` to `path`, whole or not at all.

    Args:
        folder: of a study.
        path: the HTML file.

    Raises:
        StudyError: no study's folder, no answer yet, or the file cannot be written.
    """
    write_whole(path, report(folder).encode(errors="backslashreplace"), StudyError)


def report(folder: Path) -> str:
    """The page that `write_report` writes.

    Raises:
        StudyError: no study's folder, no answer yet, or a field that is no number.
    """
    analysis, rows = analyse(folder), load_rows(folder / RESULTS)
    if not rows:
        raise StudyError(f"{folder}: nobody has answered yet")
    plan = analysis.plan
    most, channels = sum(block.most for block in plan.blocks), ", ".join(_channels(rows))
    lead = f"{len(analysis.people)} of {plan.people} people; {len(rows)} answers, {most} of each at most; {channels}."
    body = [f'<header><h1>{escape(plan.title)}</h1><p class="lead">{escape(lead)}</p></header>', "<main>"]
    if all(row["person"].startswith("S") and row["latency_s"] == SIMULATED_S for row in rows):
        body.append(f'<p class="warning">{SIMULATED}</p>')
    for number, block in enumerate(plan.blocks):
        mine = [row for row in rows if row["block"] == block.name]
        body += _block(number, block, analysis, mine)
    try:
        people = _people(analysis, rows)
    except ValueError as fault:
        raise StudyError(f"{folder / RESULTS}: an answer is not what it should be: {fault}") from None
    body += ["<h2>Each person</h2>", people, "<h2>What cannot be said</h2>", _limits(analysis, rows)]
    items = "".join(f"<dt>{escape(name)}</dt><dd>{escape(_said(of))}</dd>" for name, of in plan.stimuli.items())
    body += ["<h2>Stimuli</h2>", f"<dl>{items}</dl>", f'<p class="muted">Plan {plan.sha256}</p>', "</main>"]
    return document(f"{plan.title}: study report", body, STYLE)


def _channels(rows: Sequence[Row]) -> list[str]:
    """What was truly played on: a person may be asked by another channel than the plan's."""
    return sorted({row["channel"] for row in rows})


def _said(stimulus: Any) -> str:
    """What a stimulus is, as far as it says anything."""
    said = {name: value for name, value in stimulus.items() if name != "name" and value not in ("", ()) and value != 0}
    said |= {"life": "yes" if stimulus["life"] else "no", "effects": ", ".join(stimulus["effects"]) or "none"}
    return "; ".join(f"{name} {value}" for name, value in said.items())


def _block(number: int, block: Block, analysis: Analysis, rows: Sequence[Row]) -> list[str]:
    title = f"<h2>{escape(block.name)}: {escape(block.question)}</h2>"
    if not rows:
        return [title, "<p>Nobody has answered this yet.</p>"]
    found = [one for one in analysis.findings if one.block == block.name]
    plots = {"rating": _rating_plots, "staircase": _staircase_plots}.get(block.kind, _choice_plots)
    figures = "".join(figure(plot) for plot in plots(f"block{number}", block, found, rows))
    return [title, _verdicts(found), f'<div class="plots">{figures}</div>', _table(found)]


def decisive(found: Iterable[Finding]) -> list[Finding]:
    """The one finding on each comparison whose verdict is told, with its method: the last one, which says most.

    It is d′, of ABX by differences (the same answers are a larger d′ then, so that less is called equal); of ratings
    the mixed model, where one could be fitted.
    """
    return list({(one.block, one.what): one for one in found if one.verdict}.values())


def _verdicts(found: Iterable[Finding]) -> str:
    lines = [f'<p><span class="verdict">{escape(one.what)}</span>: {escape(one.verdict)} '
             f'<span class="muted">({escape(one.method)})</span></p>' for one in decisive(found)]  # fmt: skip
    return "".join(lines)


def _table(found: Iterable[Finding]) -> str:
    """The findings of all people together."""
    cells = [
        (one.what, f"{one.quantity} {shown(one.estimate, one.unit)}", f"{one.method}; {one.answers} answers")
        for one in found
        if not one.person
    ]
    lines = "".join(
        f'<tr><th>{escape(what)}</th><td class="value">{escape(value)}</td><td class="to">{escape(how)}</td></tr>'
        for what, value, how in cells
    )
    head = "<thead><tr><th>of</th><th>found (95 %)</th><th>how</th></tr></thead>"
    return _scrolled("What was found", f"{head}<tbody>{lines}</tbody>") if cells else ""


def _scrolled(name: str, table: str) -> str:
    """A table that can be scrolled by keys where it is wider than the page."""
    return f'<div class="table" tabindex="0" role="group" aria-label="{name}"><table>{table}</table></div>'


def shown(estimate: Estimate, unit: str = "") -> str:
    """A number with its interval, as 1.2 dB (0.9 to 1.6); an end that is not bounded is said as such."""

    def number(value: float) -> str:
        return f"{value:.3g}".replace("-", "−")

    said = number(estimate.value) if math.isfinite(estimate.value) else "beyond all bounds"
    said += f" {unit}" if unit else ""
    low, high = math.isfinite(estimate.low), math.isfinite(estimate.high)
    if low and high:
        return f"{said} ({number(estimate.low)} to {number(estimate.high)})"
    if low or high:
        return f"{said} ({'at least' if low else 'at most'} {number(estimate.low if low else estimate.high)})"
    return f"{said} (no interval)"


# Plots, a block's each.


def _intervals(name: str, found: Sequence[Finding], label: str, zero: float | None, people: Any = None) -> str:
    """Numbers with their intervals, one below the other; beside each, pale, those of the people."""
    bounds = [v for f in found for v in (f.estimate.low, f.estimate.high, f.estimate.value) if math.isfinite(v)]
    bounds += [] if zero is None else [zero]
    room = 0.12 * (max(bounds) - min(bounds)) or 0.5
    edges = min(bounds) - room, max(bounds) + room

    def draw(axes: "Axes") -> None:
        for place, one in enumerate(found):
            e = one.estimate
            axes.plot(np.clip([e.low, e.high], *edges), [place, place], color=BLUE, linewidth=2.5)
            for end, edge, mark in zip((e.low, e.high), edges, "<>", strict=True):
                axes.plot([edge] * math.isinf(end), [place] * math.isinf(end), mark, color=BLUE)  # not bounded there
            if math.isfinite(e.value):
                axes.plot([e.value], [place], "o", color=BLUE, markersize=7)
            own = [] if people is None else people(one)
            axes.plot(own, np.full(len(own), place + 0.28), "|", color=MUTED, markersize=7)
        if zero is not None:
            axes.axvline(zero, color=ORANGE, linewidth=1.2, linestyle="--")
        axes.set_yticks(range(len(found)), [_cut(one.what) for one in found])
        axes.set_ylim(len(found) - 0.4, -0.6)
        axes.set_xlabel(label)

    return drawn(name, draw, 0.9 + LINE_IN * max(len(found), 2))


def _cut(name: str) -> str:
    """A name as it fits beside a plot."""
    parts = name.split(" − ")
    return "\n− ".join(part if len(part) < 19 else part[:17] + "…" for part in parts)


def _rating_plots(name: str, block: Block, found: Sequence[Finding], rows: Sequence[Row]) -> list[Plot]:
    means = [one for one in found if one.quantity == "rating"]
    modelled = [one for one in found if one.quantity == "difference of ratings" and one.method == "mixed model"]
    own = defaultdict(lambda: defaultdict(list))  # type: ignore[var-annotated]
    for row in rows:
        own[row["stimulus_1"]][row["person"]].append(float(row["rating"]))

    def of_people(one: Finding) -> list[float]:
        return [float(np.mean(ratings)) for ratings in own[one.what].values()]

    caption = "Means of the people's means, with 95 % intervals; small marks are people."
    said = "; ".join(f"{one.what} {shown(one.estimate)}" for one in means)
    plots = [Plot("Ratings", caption, _intervals(f"{name}r", means, "rating", None, of_people), said)]
    if modelled:
        said = "; ".join(f"{one.what} {shown(one.estimate)}" for one in modelled)
        svg = _intervals(f"{name}d", modelled, "points of the scale", 0.0)
        plots.append(Plot("Differences", "By a linear mixed model over people; dashed: none.", svg, said))
    return plots


def _choice_plots(name: str, block: Block, found: Sequence[Finding], rows: Sequence[Row]) -> list[Plot]:
    plots = []
    right = [one for one in found if one.quantity == "right" and not one.person]
    said = "; ".join(f"{one.what} {shown(one.estimate)}" for one in right)
    svg = _intervals(f"{name}p", right, "share of right answers", 0.5)
    plots.append(Plot("Right answers", "All answers together, exact 95 % intervals; dashed: guessing.", svg, said))
    together = [one for one in found if one.quantity == "d′" and not one.person]
    methods = list(dict.fromkeys(one.method for one in together))
    for k, method in enumerate(methods):
        shown_here = [one for one in together if one.method == method]
        rule = method.rpartition(", ")[2]
        own = {
            one.what: [f.estimate.value for f in found if f.person and f.what == one.what and f.method.endswith(rule)]
            for one in shown_here
        }

        def of_people(one: Finding, own: dict[str, list[float]] = own) -> list[float]:
            return [value for value in own[one.what] if math.isfinite(value)]

        said = "; ".join(f"{one.what} {shown(one.estimate)}" for one in shown_here)
        svg = _intervals(f"{name}d{k}", shown_here, "d′", 0.0, of_people)
        caption = f"{method}, 95 % intervals; small marks are people; dashed: not told apart."
        plots.append(Plot(f"d′, {rule}", caption[0].upper() + caption[1:], svg, said))
    return plots


def _staircase_plots(name: str, block: Block, found: Sequence[Finding], rows: Sequence[Row]) -> list[Plot]:
    from matplotlib.ticker import LogLocator

    own, together = [one for one in found if one.person], [one for one in found if not one.person]
    unit = own[0].unit if own else ""
    label = f"distance in {block.parameter} from {block.reference:g}" + (f" [{unit}]" if unit else "")
    levels, right = np.array([[float(row["level"]), row["correct"] == "1"] for row in rows]).T

    def curve(axes: "Axes") -> None:
        edges = np.unique(np.quantile(levels, np.linspace(0.0, 1.0, BINS + 1)))
        places = np.clip(np.searchsorted(edges, levels, side="right") - 1, 0, max(len(edges) - 2, 0))
        for place in np.unique(places):
            here = places == place
            size = 3.0 + 1.2 * math.sqrt(np.count_nonzero(here))
            axes.plot([levels[here].mean()], [right[here].mean()], "o", color=MUTED, markersize=min(size, 14.0))
        x = (np.linspace if block.linear else np.geomspace)(levels.min(), levels.max(), 200)
        for one in own:
            axes.plot(x, 1.0 - 0.5 * np.exp(-((x / one.estimate.value) ** SLOPE)), color=BLUE, alpha=0.25, linewidth=1)
        for one in together:
            axes.plot(x, 1.0 - 0.5 * np.exp(-((x / one.estimate.value) ** SLOPE)), color=BLUE, linewidth=2.5)
            ends = [float(np.clip(v, x[0], x[-1])) for v in (one.estimate.low, one.estimate.high)]
            axes.axvspan(*ends, color=BLUE, alpha=0.12, linewidth=0)
        axes.axhline(0.5, color=ORANGE, linewidth=1.2, linestyle="--")
        if not block.linear:
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(lambda x, place: f"{x:g}")
            axes.xaxis.set_minor_formatter(lambda x, place: "")
        axes.set_xlabel(label)
        axes.set_ylabel("share right")
        axes.set_ylim(0.3, 1.03)

    said = "; ".join(f"threshold {shown(one.estimate, unit)}" for one in together or own)
    caption = (
        "Points: all answers by level. Curves: Weibull functions through each person's threshold, drawn with a slope "
        f"of {SLOPE:g}; thick, with its 95 % interval: people together. Dashed: guessing."
    )
    plots = [Plot("Psychometric function", caption, drawn(f"{name}c", curve), said)]
    people = [replace(one, what=one.person or "together") for one in (*own, *together)]
    said = "; ".join(f"{one.what} {shown(one.estimate, unit)}" for one in people)
    svg = _intervals(f"{name}t", people, label, None)
    return [*plots, Plot("Thresholds", "Where 82 % are right, 95 % intervals.", svg, said)]


SLOPE: Final = 3.5
"""Of the curves that are drawn [1] (Watson & Pelli 1983); thresholds are estimated over several."""


# What is told of each person, and of what the answers do not say.


def _people(analysis: Analysis, rows: Sequence[Row]) -> str:
    most = sum(block.most for block in analysis.plan.blocks)
    lines = []
    for person in analysis.people:
        mine = [row for row in rows if row["person"] == person]
        judged = [row["correct"] == "1" for row in mine if row["correct"] in ("0", "1")]
        latency_s = float(np.median([float(row["latency_s"]) for row in mine]))
        replays = sum(int(row["replays"]) for row in mine)
        right = f"{100 * np.mean(judged):.0f} %" if judged else "–"
        cells = (f"{len(mine)} of {most}", right, f"{latency_s:.1f} s", str(replays))
        lines.append(f"<tr><th>{escape(person)}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    head = "<th>person</th><th>answers</th><th>right</th><th>median time</th><th>replays</th>"
    return _scrolled("Each person", f"<thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody>")


def _limits(analysis: Analysis, rows: Sequence[Row]) -> str:
    """What a reader might take from the page, and must not."""
    plan, people = analysis.plan, len(analysis.people)
    said = ["A difference that was not found may be there: equality is only claimed where a block has a margin."]
    if people < 2:
        said.append("One person was asked: nothing is said of others.")
    elif people < plan.people:
        said.append(f"{people} of {plan.people} people were asked: orders are not balanced yet.")
    most = sum(block.most for block in plan.blocks if not block.stop_within)
    short = [p for p, n in Counter(row["person"] for row in rows).items() if n < most]
    if short:
        said.append(f"Not at the end: {', '.join(sorted(short))}; what they answered so far is counted.")
    tests = len(decisive(analysis.findings))
    if tests > 1:
        said.append(f"{tests} comparisons stand here, each at 95 % by itself: of twenty, one is found by chance.")
    if any(block.kind == "abx" for block in plan.blocks):
        said.append("d′ of ABX depends on how people decide, which answers alone do not tell: both ways are given.")
    channels = _channels(rows)
    if len(channels) > 1:
        said.append(f"Answers by {' and '.join(channels)} are counted together.")
    if "headphones" in channels:
        said.append("This was heard, not felt: the skin tells other differences apart than the ear.")
    if "device" in channels:
        said.append("People moved as they liked: force and speed were not those of the plan.")
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in said) + "</ul>"
