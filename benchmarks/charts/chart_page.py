"""The page of a chart: one HTML file that holds every picture, drawn light or dark as the reader has it.

Nothing is fetched. A few lines of script tell of the point that is pointed at, or reached with the keyboard; without
them each point still has its title.
"""

import base64
import hashlib
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Final

from ..markdown import shown
from .chart_drawing import drawings
from .chart_table import Table
from .exponent import exponents
from .question import Measure, Point, Question, fronts

SCRIPT: Final = """
for (const part of document.querySelectorAll("section")) {
  const told = part.querySelector("output");
  const show = (event) => {
    const point = event.target.closest("[data-point]");
    if (!point) return;
    for (const other of part.querySelectorAll(".here")) other.classList.remove("here");
    for (const same of part.querySelectorAll(`[data-point="${point.dataset.point}"]`)) same.classList.add("here");
    told.textContent = point.dataset.told;
  };
  for (const kind of ["pointerover", "focusin", "click"]) part.addEventListener(kind, show);
}
"""

STYLE: Final = """
nav { display: flex; flex-wrap: wrap; gap: 6px 14px; margin: 16px 0; }
a { color: inherit; }
section { margin-top: 44px; } section h2 { margin-top: 0; }
.advice { font-size: 17px; margin: 12px 0; max-width: 95ch; }
output { display: block; min-height: 3em; margin: 8px 2px; overflow-wrap: anywhere; }
[data-point] { cursor: pointer; }
g.here path, g.here use { stroke: currentColor !important; stroke-width: 2.5 !important; }
g[data-point]:focus { outline: none; }
tr.here { background: var(--line); }
td.value { font-weight: 400; } .felt { font-weight: 600 !important; } .unfelt { color: var(--muted); }
figure svg { max-width: 760px; }
.plots { grid-template-columns: repeat(auto-fill, minmax(min(100%, 440px), 1fr)); }
summary { cursor: pointer; margin: 10px 0; }
@media (max-width: 640px) { thead { display: table-header-group; } tbody tr { display: table-row; }
  tbody th, tbody td { border-top: 1px solid var(--line); padding: 6px 8px; } }
"""
"""What differs from the report's page."""


def write_page(table: Table, questions: Sequence[Question], title: str) -> str:
    """The HTML of a chart: a section for each question that the table has points of."""
    asked = [q for q in questions if table.points.get(q.name)]
    links = "".join(f'<a href="#{q.name}">{escape(q.title)}</a>' for q in asked)
    about = "; ".join(f"{name} {value}" for name, value in table.machine.items())
    style = files("hapscene.capture").joinpath("report.css").read_text(encoding="utf-8") + STYLE
    script = base64.b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{script}'"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f"<header><h1>{escape(title)}</h1>"
        '<p class="lead">What each approximation costs and what it buys. Every point is a method at one setting; those '
        "on the front are beaten in both by no other. What lies in the shaded part cannot be felt, so it is not needed."
        f'</p><p class="muted">{escape(about)}</p></header>\n<nav>{links}</nav>\n'
        + "\n".join(_section(q, table.points[q.name]) for q in asked)
        + f"\n<script>{SCRIPT}</script>\n</body>\n</html>\n"
    )


def _section(question: Question, points: Sequence[Point]) -> str:
    figures = [_figure(question, points, measure, svg) for measure, svg in drawings(question, points)]
    measures = [measure for measure in question.measures if any(measure.key in p.errors for p in points)]
    if question.growth:
        tables = _table(question, points, list(range(len(points))), measures)
        tables = _exponents(points, measures) + f"<details><summary>All points</summary>{tables}</details>"
    else:
        best = [points.index(p) for m in measures for each in fronts(question, points, m) for p in each]
        best = sorted(set(best), key=lambda k: points[k].median_us) or list(range(len(points)))
        rest = _table(question, points, list(range(len(points))), measures)
        tables = f"<h3>The front</h3>{_table(question, points, best, measures)}"
        tables += f"<details><summary>All points</summary>{rest}</details>" if len(best) < len(points) else ""
    return (
        f'<section id="{question.name}"><h2>{escape(question.title)}</h2>\n'
        f'<p class="muted">{escape(question.conditions)}</p>\n<div class="plots">{"".join(figures)}</div>\n'
        "<output>Point at a point, or reach it with the Tab key, to read it.</output>\n"
        f'<p class="advice">{escape(question.advice(points))}</p>\n{tables}</section>'
    )


def _figure(question: Question, points: Sequence[Point], measure: Measure, svg: str) -> str:
    """A panel, its points made to be pointed at."""
    start = f"{question.name}-{measure.key}-"

    def told(found: re.Match[str]) -> str:
        k = int(found[1])
        said = escape(words(question, points[k]))
        return f'<g id="{found[0][7:-2]}" data-point="{k}" data-told="{said}" tabindex="0"><title>{said}</title>'

    drawing = re.sub(rf'<g id="{re.escape(start)}(\d+)">', told, svg)
    name = f"{question.title} {measure.name}"
    return "<figure>" + drawing.replace("<svg", f'<svg role="img" aria-label="{escape(name)}"', 1) + "</figure>\n"


def words(question: Question, point: Point) -> str:
    """A point as it is told: its setting and its figures."""
    said = [f"{point.method}, {point.label}"]
    if point.median_us == point.median_us:
        late = f", {question.quantiles[1]} {shown(point.p99_us)} µs" if point.p99_us == point.p99_us else ""
        said.append(f"{question.quantiles[0]} {shown(point.median_us)} µs a {question.per}{late}")
    told = [(m, point.errors[m.key]) for m in question.measures if m.key in point.errors]
    said += [f"{measure.name}: {shown(value)} {measure.unit}".strip() for measure, value in told]
    return "; ".join(said) + (f" (cited: {point.source})" if point.source else "")


def _table(question: Question, points: Sequence[Point], which: Sequence[int], measures: Sequence[Measure]) -> str:
    """Points as rows; what can be felt stands out."""
    timed = any(points[k].median_us == points[k].median_us for k in which)
    head = ["method", "setting", *([f"time a {question.per} [µs], {' / '.join(question.quantiles)}"] if timed else [])]
    head += ["how many"] if question.growth else []
    head += [f"{m.name} [{m.unit}]" if m.unit else m.name for m in measures]
    rows = []
    for k in which:
        p = points[k]
        cells = [f"<th>{escape(p.method)}{' (cited)' if p.source else ''}</th><td>{escape(p.label)}</td>"]
        if timed:
            cells.append(f'<td class="value">{_shown(p.median_us)} / {_shown(p.p99_us)}</td>')
        if question.growth:
            cells.append(f'<td class="value">{p.errors["work"]:,g}</td>')
        for m in measures:
            value = p.errors.get(m.key)
            felt = "" if value is None or m.jnd is None else _felt(m, value)
            cells.append(f'<td class="value {felt}">{_shown(value)}</td>')
        rows.append(f'<tr data-point="{k}" data-told="{escape(words(question, p))}">{"".join(cells)}</tr>')
    titles = "".join(f"<th>{escape(name)}</th>" for name in head)
    return f'<div class="table"><table><thead><tr>{titles}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def _felt(measure: Measure, value: float) -> str:
    assert measure.jnd is not None
    return "felt" if (value < measure.jnd) == measure.more_is_better and value != measure.jnd else "unfelt"


def _shown(value: float | None) -> str:
    return "–" if value is None or value != value else shown(value)


def exponent_rows(points: Sequence[Point], measures: Sequence[Measure]) -> list[tuple[str, str, str]]:
    """How each cost of each method grows: the cost, of what, the exponent."""
    return [(m.name, of, grown.words()) for m in measures for of, grown in exponents(points, m.key).items()]


def _exponents(points: Sequence[Point], measures: Sequence[Measure]) -> str:
    rows = "".join(
        f'<tr><th>{escape(name)}</th><td>{escape(method)}</td><td class="value">{escape(said)}</td></tr>'
        for name, method, said in exponent_rows(points, measures)
    )
    head = "<tr><th>cost</th><th>of</th><th>grows as (95 %)</th></tr>"
    return f'<div class="table"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>'
