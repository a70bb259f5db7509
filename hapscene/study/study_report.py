"""The report on a study: one HTML page with verdicts, estimates and intervals, and what the answers do not show."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.errors import StudyError
from hapscene.files import write_whole
from hapscene.study.discrimination import Estimate
from hapscene.study.results_file import load_rows
from hapscene.study.sitting import RESULTS
from hapscene.study.statistics import Analysis, Finding, Row, analyse
from hapscene.view.chart import inline_svg, new_chart
from hapscene.view.palette import INK, OKABE_ITO

PLOTTED: Final = {"rating": "rating", "2ifc": "d′", "staircase": "threshold"}
"""The quantity that the plot of a block shows, by the block's kind."""

PAGE: Final = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}: study report</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; }}
table {{ border-collapse: collapse; }}
th, td {{ text-align: left; padding: 4px 12px 4px 0; border-top: 1px solid; vertical-align: top; }}
div.table {{ overflow-x: auto; }}
svg {{ width: 100%; max-width: 36em; height: auto; }}
</style>
</head>
<body>
<main>
<h1>{title}</h1>
{body}
</main>
</body>
</html>
"""


def write_report(folder: Path, path: Path) -> None:
    """Write the report on the study in `folder` to `path`, an HTML file, whole or not at all.

    Raises:
        StudyError: not a study's folder, no answer yet, or the file cannot be written.
    """
    write_whole(path, report(folder).encode(errors="backslashreplace"), StudyError)


def report(folder: Path) -> str:
    """The page that `write_report` writes.

    Raises:
        StudyError: not a study's folder, no answer yet, or answers that do not fit its plan.
    """
    analysis, rows = analyse(folder), load_rows(folder / RESULTS)
    if not rows:
        raise StudyError(f"{folder}: nobody has answered yet")
    plan = analysis.plan
    most = sum(block.most for block in plan.blocks)
    channels = ", ".join(sorted({row["channel"] for row in rows}))
    lead = f"{len(analysis.people)} of {plan.people} people; {len(rows)} answers, {most} of each at most; {channels}."
    body = [_paragraph(lead), _list(_verdicts(analysis.findings))]
    for number, block in enumerate(plan.blocks):
        found = [one for one in analysis.findings if one.block == block.name]
        body.append(f"<h2>{escape(f'{block.name}: {block.question}')}</h2>")
        body.append(_plot(number, found, PLOTTED[block.kind]) if found else _paragraph("Nobody has answered this yet."))
        cells = [
            (one.what, f"{one.quantity} {shown(one.estimate, one.unit)}", f"{one.method}; {one.answers} answers")
            for one in found
            if not one.person
        ]
        body.append(_table(block.name, ("of", "found (95 %)", "how"), cells))
    body += ["<h2>Each person</h2>", _people(analysis, rows, most)]
    body += ["<h2>What the answers do not show</h2>", _list(_limits(analysis, rows, most))]
    told = [
        (name, "; ".join(f"{k} {v}" for k, v in of.items() if k != "name" and v)) for name, of in plan.stimuli.items()
    ]
    body += ["<h2>Stimuli</h2>", _table("Stimuli", ("name", "parameters"), told), _paragraph(f"Plan {plan.sha256}")]
    return PAGE.format(title=escape(plan.title), body="\n".join(filter(None, body)))


def _verdicts(found: Iterable[Finding]) -> list[str]:
    return [f"{one.block}, {one.what}: {one.verdict} ({one.method})" for one in found if one.verdict]


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def _list(lines: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>" if lines else ""


def _table(name: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table that can be scrolled by keys where it is wider than the page."""
    if not rows:
        return ""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    table = f"<table><thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table>"
    return f'<div class="table" tabindex="0" role="group" aria-label="{escape(name)}">{table}</div>'


def shown(estimate: Estimate, unit: str = "") -> str:
    """A number with its interval, as 1.2 dB (0.9 to 1.6)."""

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


def _plot(number: int, found: Sequence[Finding], quantity: str) -> str:
    """Estimates of one quantity with their intervals, one below the other; those of single persons are grey."""
    rows = [one for one in found if one.quantity == quantity]
    ends = [v for one in rows for v in (one.estimate.value, one.estimate.low, one.estimate.high) if math.isfinite(v)]
    room = 0.12 * (max(ends) - min(ends)) or 0.5 if ends else 0.5
    edges = (min(ends) - room, max(ends) + room) if ends else (0.0, 1.0)
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
    told = "; ".join(f"{one.person} {one.what} {shown(one.estimate, one.unit)}".strip() for one in rows)
    return drawing.replace("<svg", f'<svg role="img" aria-label="{escape(told)}"', 1)


def _people(analysis: Analysis, rows: Sequence[Row], most: int) -> str:
    lines = []
    for person in analysis.people:
        mine = [row for row in rows if row["person"] == person]
        judged = [row["correct"] == "1" for row in mine if row["correct"] in ("0", "1")]
        latency_s = float(np.median([float(row["latency_s"]) for row in mine]))
        replays = f"{sum(float(row['replays']) for row in mine):.0f}"
        right = f"{100 * np.mean(judged):.0f} %" if judged else "–"
        lines.append((person, f"{len(mine)} of {most}", right, f"{latency_s:.1f} s", replays))
    return _table("Each person", ("person", "answers", "right", "median time", "replays"), lines)


def _limits(analysis: Analysis, rows: Sequence[Row], most: int) -> list[str]:
    """What a reader might conclude from the page, and must not."""
    plan, people = analysis.plan, len(analysis.people)
    said = ["A difference that was not found may exist: equality is only claimed where a block has a margin."]
    if people < 2:
        said.append("One person was asked: nothing is said of others.")
    elif people < plan.people:
        said.append(f"{people} of {plan.people} people were asked: orders are not balanced yet.")
    if short := sorted(p for p, n in Counter(row["person"] for row in rows).items() if n < most):
        said.append(f"Not finished: {', '.join(short)}; what they answered so far is counted.")
    if (tests := len(_verdicts(analysis.findings))) > 1:
        said.append(f"{tests} comparisons are listed, each at 95 % by itself: of twenty, one is found by chance.")
    channels = {row["channel"] for row in rows}
    if len(channels) > 1:
        said.append(f"Answers by {' and '.join(sorted(channels))} are counted together.")
    if "headphones" in channels:
        said.append("This was heard, not felt: the skin discriminates other differences than the ear.")
    return said
