"""The report on a study: one HTML page with verdicts and estimates with intervals."""

import math
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.errors import StudyError
from hapscene.io.files import write_whole
from hapscene.study.session import RESULTS, load_rows
from hapscene.study.statistics import Analysis, Estimate, Finding, Row, analyse
from hapscene.view.chart import inline_svg, new_chart
from hapscene.view.palette import INK, OKABE_ITO

__all__ = ["write_report"]

PLOTTED: Final = {"rating": "rating", "2ifc": "d′", "staircase": "threshold"}
"""Quantity that the plot of a block shows, by the kind of the block."""

PAGE: Final = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}: study report</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; }}
th, td {{ text-align: left; padding: 4px 12px 4px 0; border-top: 1px solid; vertical-align: top; }}
div.table {{ overflow-x: auto; }}
pre {{ white-space: pre-wrap; }}
svg {{ width: 100%; max-width: 36em; height: auto; }}
</style>
<main>
<h1>{title}</h1>
{body}
</main>
</html>
"""


def write_report(folder: Path, path: Path) -> None:
    """Write the report on the study in `folder` to the HTML file `path`.

    Raises:
        StudyError: the folder does not belong to a study, has no answers, or the file cannot be written.
    """
    write_whole(path, report(folder).encode(errors="backslashreplace"), StudyError)


def report(folder: Path) -> str:
    """The HTML page that `write_report` writes, with the same errors."""
    analysis, rows = analyse(folder), load_rows(folder / RESULTS)
    if not rows:
        raise StudyError(f"{folder}: the study has no answers yet")
    plan = analysis.plan
    most = plan.trial_count
    channels = ", ".join(sorted({row["channel"] for row in rows}))
    lead = (
        f"{len(analysis.people)} of {plan.people} participants; {len(rows)} answers, up to {most} each; output: "
        f"{channels}."
    )
    body = [_paragraph(lead), _list(_verdicts(analysis.findings))]
    for number, block in enumerate(plan.blocks):
        found = [one for one in analysis.findings if one.block == block.name]
        body.append(f"<h2>{escape(f'{block.name}: {block.question}')}</h2>")
        body.append(_plot(number, found, PLOTTED[block.kind]) if found else _paragraph("No answers yet."))
        cells = [
            (
                one.what,
                f"{one.quantity} {format_estimate(one.estimate, one.unit)}",
                f"{one.method}; {one.answers} answers",
            )
            for one in found
            if not one.person
        ]
        body.append(_table(block.name, ("stimuli", "estimate (95 %)", "method"), cells))
    body += ["<h2>Participants</h2>", _people(analysis, rows, most)]
    body += [f"<h2>Plan {plan.sha256}</h2>", f"<pre>{escape(plan.content.decode(errors='replace'))}</pre>"]
    return PAGE.format(title=escape(plan.title), body="\n".join(filter(None, body)))


def _verdicts(found: Iterable[Finding]) -> list[str]:
    return [f"{one.block}, {one.what}: {one.verdict} ({one.method})" for one in found if one.verdict]


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def _list(lines: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>" if lines else ""


def _table(name: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table that can be scrolled by keyboard if it is wider than the page."""
    if not rows:
        return ""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    table = f"<table><thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table>"
    return f'<div class="table" tabindex="0" role="group" aria-label="{escape(name)}">{table}</div>'


def format_estimate(estimate: Estimate, unit: str = "") -> str:
    """Format an estimate with its interval, as in 1.2 dB (0.9 to 1.6)."""
    value, low, high = (f"{x:.3g}".replace("-", "−").replace("inf", "∞") for x in vars(estimate).values())
    return f"{value}{f' {unit}' if unit else ''} ({low} to {high})"


def _plot(number: int, found: Sequence[Finding], quantity: str) -> str:
    """Plot estimates of one quantity with their intervals; those of single participants are grey."""
    rows = [one for one in found if one.quantity == quantity]
    edges = _axis_limits([one.estimate for one in rows])
    with new_chart(6.0, 0.9 + 0.28 * len(rows)) as figure:
        axes = figure.subplots()
        for place, one in enumerate(rows):
            colour = "#707070" if one.person else OKABE_ITO["blue"]
            axes.plot(np.clip([one.estimate.low, one.estimate.high], *edges), [place, place], color=colour)
            axes.plot(np.clip([one.estimate.value], *edges), [place], "o", color=colour)
        if quantity == "d′":
            axes.axvline(0.0, color=INK, linewidth=1.0, linestyle="--")
        axes.set_yticks(range(len(rows)), [f"{one.person}  {one.what}".strip() for one in rows])
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlabel(f"{quantity} [{rows[0].unit}]" if rows[0].unit else quantity)
        drawing = inline_svg(figure, f"block{number}")
    label = "; ".join(f"{one.person} {one.what} {format_estimate(one.estimate, one.unit)}".strip() for one in rows)
    return drawing.replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1)


def _axis_limits(estimates: Sequence[Estimate]) -> tuple[float, float]:
    """Limits of an axis that contains all finite values, with a margin of 12 %."""
    values = [v for one in estimates for v in (one.value, one.low, one.high) if math.isfinite(v)]
    if not values:
        return 0.0, 1.0
    margin = 0.12 * (max(values) - min(values)) or 0.5
    return min(values) - margin, max(values) + margin


def _people(analysis: Analysis, rows: Sequence[Row], most: int) -> str:
    lines = []
    for person in analysis.people:
        mine = [row for row in rows if row["person"] == person]
        latency_s = float(np.median([float(row["latency_s"]) for row in mine]))
        lines.append((person, f"{len(mine)} of {most}", f"{latency_s:.1f} s"))
    return _table("Participants", ("participant", "answers", "median latency"), lines)
