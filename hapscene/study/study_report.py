"""The report on a study: one HTML page with verdicts and estimates with intervals."""

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final

import numpy as np
from jinja2 import Environment, PackageLoader

from hapscene.errors import StudyError
from hapscene.io.files import write_whole
from hapscene.study.session import RESULTS, load_rows
from hapscene.study.statistics import Estimate, Finding, analyse
from hapscene.view.chart import inline_svg, new_chart
from hapscene.view.palette import INK, OKABE_ITO

__all__ = ["write_report"]

PLOTTED: Final = {"rating": "rating", "2ifc": "d′", "staircase": "threshold"}
"""Quantity that the plot of a block shows, by the kind of the block."""


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
    blocks = []
    for number, block in enumerate(analysis.plan.blocks):
        found = [one for one in analysis.findings if one.block == block.name]
        cells = [
            (
                one.what,
                f"{one.quantity} {format_estimate(one.estimate, one.unit)}",
                f"{one.method}; {one.answers} answers",
            )
            for one in found
            if not one.person
        ]
        blocks.append((block, _plot(number, found, PLOTTED[block.kind]) if found else "", cells))
    loader = PackageLoader("hapscene.study.study_report")
    pages = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    return pages.get_template("study_report.html.jinja").render(
        plan=analysis.plan,
        content=analysis.plan.content.decode(errors="replace"),
        verdicts=[one for one in analysis.findings if one.verdict],
        blocks=blocks,
        people=analysis.people,
        answer_count=len(rows),
        channels=", ".join(sorted({row["channel"] for row in rows})),
    )


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
