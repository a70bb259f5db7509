"""The page: every figure with its numbers, the paper's beside ours, Table 1, what is assumed, what is left out."""

import csv
import datetime
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from html import escape
from typing import Final

from hapscene.capture.report import document, figure
from hapscene.handle.plant import Plant
from hapscene.handle.sensor import Sensor
from hapscene_benchmarks.markdown import shown

from .finding import PUBLISHED, REMEMBERED, Finding, Number
from .material import Material

PAPER: Final = (
    "Kuchenbecker, Romano & McMahan, “Haptography: Capturing and Recreating the Rich Feel of Real Surfaces”, 14th "
    "International Symposium on Robotics Research, 2009 (Springer Tracts in Advanced Robotics 70, 2011)"
)

STYLE: Final = """
a { color: inherit; } summary { cursor: pointer; }
.text { max-width: 90ch; } .plots, .table { margin: 12px 0; }
tbody tr:first-child > * { border-top: 0; } td b { white-space: nowrap; }
td.to { font-size: 13px; color: var(--muted); }
@media (max-width: 640px) {
  tbody tr, tbody td { display: block; } tbody td:empty { display: none; }
  tbody td[data-head]::before { content: attr(data-head) ": "; color: var(--muted); font-weight: 400; }
}
"""

OPEN_MAX: Final = 14
"""Longest table that is open from the start [rows]."""

TABLE_ONE: Final = (
    ("the camera", "a stylus with accelerometer and force sensor", "hapscene capture record", "fig2"),
    ("the film developed", "models fitted: texture, tap, friction, stiffness", "hapscene capture fit", "fig4"),
    ("the photograph", "the haptograph, a .swatch file", "hapscene swatch show", "fig5"),
    ("is it sharp?", "real against synthetic", "hapscene capture report", "fig5"),
    ("the album", "a library of surfaces", "hapscene swatch publish", ""),
    ("retouching, a collage", "swatches painted onto a scene", "hapscene paint", ""),
    ("the screen, measured", "the handle, identified", "hapscene device identify", "fig7"),
    ("looking at it", "touching it through the handle", "hapscene play", "taps"),
    ("a live broadcast", "touching from afar", "hapscene lab teleoperate leader", "fig8"),
)
"""Photography, haptography, the command that this project has for it, and which section of the page shows it."""


def page(findings: Mapping[str, Finding], materials: Mapping[str, Material]) -> str:
    """The HTML. Every text is escaped here; only the drawings are taken as they are."""
    compared = [
        (n, f'<a href="#{key}">{escape(finding.title.split(":")[0])}</a>: ')
        for key, finding in findings.items()
        for n in finding.numbers
        if n.paper is not None
    ]
    lead = f"{PAPER}: its figures and numbers, as far as data in reach allow."
    body = [f'<header><h1>Haptography, reproduced</h1><p class="lead">{escape(lead)}</p>']
    body += [f'<p class="text">{escape(text)}</p>' for text in _leads(materials)]
    body += ['</header><h2 id="summary">The paper’s numbers, and ours</h2>', _numbers(compared)]
    for key, finding in findings.items():
        body += [f'<h2 id="{key}">{escape(finding.title)}</h2><p class="text">{escape(finding.text)}</p>']
        body += [f'<div class="plots">{"".join(map(figure, finding.plots))}</div>']
        body += [_numbers([(number, "") for number in finding.numbers])]
    return document("Haptography, reproduced", [*body, _table_one(), _assumed(materials), _left_out(materials)], STYLE)


def table_of_numbers(findings: Mapping[str, Finding]) -> str:
    """All numbers as CSV, unrounded; `paper` is empty where the paper's is not known here."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("figure", "quantity", "unit", "paper", "paper_known", "ours", "why"))
    for key, finding in findings.items():
        for n in finding.numbers:
            writer.writerow((key, n.what, n.unit, n.paper, n.known, n.ours, n.why))
    return text.getvalue()


def _leads(materials: Mapping[str, Material]) -> list[str]:
    told = [
        f"Of the paper its abstract was at hand, not its text. Each of its numbers says how it is known: “{PUBLISHED}” "
        f"where published text was checked, “{REMEMBERED}” where it was not; where none stands, it is not known here. "
        f"Made by “hapscene lab reproduce” on {datetime.date.today().isoformat()}."
    ]
    made = [material.name for material in materials.values() if not material.real]
    if made:
        told.append(
            f"Not from recordings: {', '.join(made)}. Of these, Figs. 2, 4, 5 and the orders show what the shipped "
            "swatches synthesise: the method, and nothing of a surface that a swatch does not already hold. With the "
            "recordings in a folder, “hapscene lab reproduce --recordings DIR” draws them from real surfaces."
        )
    return told


def _numbers(rows: Sequence[tuple[Number, str]]) -> str:
    """Numbers in a table, one to be opened where it is long; what stands before each is taken as it is."""
    cells = []
    for n, before in rows:
        unit = "" if n.unit == "1" else f" {n.unit}"
        ours, paper = (("" if v is None else f"{shown(v)}{unit}".replace("-", "−")) for v in (n.ours, n.paper))
        known = f"{paper} ({n.known})" if paper else ""
        cells.append((before + escape(n.what), f"<b>{escape(ours)}</b>", escape(known), escape(n.why)))
    table = _table(("number", "ours", "the paper", "why they differ, what it hangs on"), cells)
    return table if len(rows) <= OPEN_MAX else f"<details><summary>{len(rows)} numbers</summary>{table}</details>"


def _table(head: tuple[str, str, str, str], rows: Iterable[tuple[str, str, str, str]]) -> str:
    """A table of HTML; on a narrow page what heads the columns stands before each cell."""
    lines = "".join(
        f'<tr><th>{first}</th><td data-head="{head[1]}">{second}</td><td data-head="{head[2]}">{third}</td>'
        f'<td class="to">{last}</td></tr>'
        for first, second, third, last in rows
    )
    named = "".join(f"<th>{word}</th>" for word in head)
    return f'<div class="table"><table><thead><tr>{named}</tr></thead><tbody>{lines}</tbody></table></div>'


def _table_one() -> str:
    rows = [
        (one, two, f"<code>{here}</code>", f'<a href="#{key}">shown above</a>' if key else "")
        for one, two, here, key in TABLE_ONE
    ]
    said = f"That the paper sets the two beside each other is {REMEMBERED}; the lines are ours."
    table = _table(("photography", "haptography", "here", ""), rows)
    return f'<h2 id="table1">Table 1: haptography beside photography</h2><p class="text">{escape(said)}</p>{table}'


def _assumed(materials: Mapping[str, Material]) -> str:
    plant, sensor = Plant(), Sensor()
    values = ", ".join(f"{f.name} {getattr(plant, f.name):g}" for f in fields(plant) if f.name != "force_limit_N")
    items = {
        "the handle": f"{values}: the published values were not to be had",
        "the actuator": f"{plant.force_limit_N:g} N peak ({PUBLISHED})",
        "its accelerometer": f"one pole at {sensor.bandwidth_Hz:g} Hz, noise {sensor.noise_m_s2_rtHz:.2g} m/s²/√Hz",
        "users": "hands from 150 N/m and 3 N·s/m to 2000 N/m and 10 N·s/m, ±10 % a trial",
        "teleoperation": "both Omnis, the hand and the line are simulated; the taps of the plate have an assumed form",
        "raters": "what a rating is, as told in its section",
    }
    if any(material.real for material in materials.values()):
        said = "wood, paper, leather: 10 kHz inferred from their low-pass, m/s² from their level; epoxy: 1 = 1 g"
        items["the recordings"] = f"{said}, its force and speed"
    return _listed("assumed", "What is assumed", items)


def _left_out(materials: Mapping[str, Material]) -> str:
    items = {
        "Figs. 1, 3 and 6": f"pictures and diagrams ({REMEMBERED}): nothing is measured in them",
        "position, taps and presses": "of Fig. 2: the recordings in reach hold speed and drags",
        "a real handle": "its parameters and the hands of real users: none was at hand",
        "ratings of people": "none were taken; those of the simulated raters are no evidence about people",
    }
    if not any(material.real for material in materials.values()):
        items["real surfaces"] = "no recordings were given: --recordings DIR"
    return _listed("left-out", "What is left out, and why", items)


def _listed(key: str, title: str, items: Mapping[str, str]) -> str:
    listed = "".join(f"<dt>{escape(what)}</dt><dd>{escape(text)}</dd>" for what, text in items.items())
    return f'<h2 id="{key}">{title}</h2><dl>{listed}</dl>'
