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
    "International Symposium on Robotics Research, 2009; Springer Tracts in Advanced Robotics 70, 2011"
)

STYLE: Final = """
h2 { scroll-margin-top: 8px; }
a { color: inherit; }
.text { max-width: 90ch; }
.plots { margin: 12px 0; }
.table { margin: 12px 0; }
tbody tr:first-child > * { border-top: 0; }
td.to { font-size: 13px; color: var(--muted); }
@media (max-width: 640px) {
  tbody tr { display: block; }
  tbody td { display: block; }
  tbody td:empty { display: none; }
  tbody td[data-head]::before { content: attr(data-head) ": "; color: var(--muted); font-weight: 400; }
}
"""

TABLE_ONE: Final = (
    ("the camera", "a stylus with accelerometer, force and position sensor", "hapscene capture record --port PORT", ""),
    ("taking a picture", "to tap, press and stroke a surface", "hapscene capture segment RECORDING", "fig2"),
    (
        "the film, developed",
        "models fitted: texture, tap, friction, stiffness",
        "hapscene capture fit RECORDING",
        "fig4",
    ),
    ("the photograph", "the haptograph", "a .swatch file: hapscene swatch list", "fig5"),
    ("is it sharp?", "real against synthetic", "hapscene capture report SWATCH RECORDING", "fig5"),
    ("the album", "a library of surfaces", "hapscene swatch gallery", ""),
    ("retouching, a collage", "swatches painted onto a scene", "hapscene paint SCENE", ""),
    ("the screen, measured", "the handle, identified", "hapscene handle identify", "fig7"),
    ("looking at it", "touching it through the handle", "hapscene play SCENE", "fig8"),
    ("a live broadcast", "touching from afar", "hapscene teleoperate experiment", "fig8"),
)
"""Photography, haptography, what this project has for it, and which section of the page shows it."""


def page(findings: Mapping[str, Finding], materials: Mapping[str, Material]) -> str:
    """The HTML. Every text is escaped here; only the drawings are taken as they are."""
    compared = [(key, n) for key, finding in findings.items() for n in finding.numbers if n.paper is not None]
    body = [
        "<header><h1>Haptography, reproduced</h1>"
        f'<p class="lead">{escape(PAPER)}: its figures and numbers, as far as data in reach allow. Made by <code>'
        f"hapscene reproduce</code> on {datetime.date.today().isoformat()}.</p>",
        *(f'<p class="text">{escape(text)}</p>' for text in _leads(materials)),
        "</header>",
        '<h2 id="summary">The paper’s numbers, and ours</h2>',
        _table([(n, f'<a href="#{key}">{escape(_short(findings[key]))}</a>: ') for key, n in compared]),
    ]
    for key, finding in findings.items():
        body += [
            f'<h2 id="{key}">{escape(finding.title)}</h2><p class="text">{escape(finding.text)}</p>',
            f'<main class="plots">{"".join(map(figure, finding.plots))}</main>',
            _table([(number, "") for number in finding.numbers]),
        ]
    body += [_table_one(), _assumed(materials), _left_out(materials)]
    return document("Haptography, reproduced", body, STYLE)


def table_of_numbers(findings: Mapping[str, Finding]) -> str:
    """All numbers as CSV, unrounded; `paper` is empty where the paper's is not known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("figure", "quantity", "unit", "paper", "paper_known", "ours", "why"))
    for key, finding in findings.items():
        for n in finding.numbers:
            writer.writerow((key, n.what, n.unit, "" if n.paper is None else n.paper, n.known, n.ours, n.why))
    return text.getvalue()


def _leads(materials: Mapping[str, Material]) -> list[str]:
    told = [
        f"Of the paper its abstract was at hand, not its text. So each of its numbers says how it is known: "
        f"“{PUBLISHED}” where published text was checked, “{REMEMBERED}” where it was not."
    ]
    made = [material.name for material in materials.values() if not material.real]
    if made:
        files = "hapscene reproduce --recordings DIR"
        told.append(
            f"Not from recordings: {', '.join(made)}. What Figs. 2, 4, 5 and the orders show of these was synthesised "
            "from the shipped swatches: it shows the method, and nothing of a surface that the swatch does not "
            f"already hold. With the recordings in a folder, {files} draws them from real surfaces."
        )
    return told


def _short(finding: Finding) -> str:
    return finding.title.split(":")[0]


def _value(number: Number, value: float) -> str:
    unit = "" if number.unit == "1" else f" {number.unit}"
    return f"{shown(value)}{unit}".replace("-", "−")


def _table(rows: Iterable[tuple[Number, str]]) -> str:
    """Numbers in a table; what stands before each is taken as it is."""
    lines = []
    for n, before in rows:
        paper = "" if n.paper is None else f"{_value(n, n.paper)} ({n.known})"
        lines.append(
            f'<tr><th>{before}{escape(n.what)}</th><td class="value" data-head="ours">{escape(_value(n, n.ours))}</td>'
            f'<td data-head="the paper">{escape(paper)}</td><td class="to">{escape(n.why)}</td></tr>'
        )
    return _framed(("number", "ours", "the paper", "why they differ, what it hangs on"), lines)


def _framed(head: Sequence[str], lines: Iterable[str]) -> str:
    named = "".join(f"<th>{escape(word)}</th>" for word in head)
    return f'<div class="table"><table><thead><tr>{named}</tr></thead><tbody>{"".join(lines)}</tbody></table></div>'


def _table_one() -> str:
    lines = [
        f'<tr><th>{escape(photography)}</th><td data-head="haptography">{escape(haptography)}</td>'
        f'<td data-head="here"><code>{escape(here)}</code></td><td class="to">{_link(key)}</td></tr>'
        for photography, haptography, here, key in TABLE_ONE
    ]
    head = ("photography", "haptography", "here", "shown")
    return (
        '<h2 id="table1">Table 1: haptography beside photography</h2><p class="text">The paper sets the two beside '
        f"each other ({REMEMBERED}: the lines are ours), and each has its command here.</p>{_framed(head, lines)}"
    )


def _link(key: str) -> str:
    return f'<a href="#{key}">Fig. {key.removeprefix("fig")}, above</a>' if key else ""


def _assumed(materials: Mapping[str, Material]) -> str:
    plant, sensor = Plant(), Sensor()
    values = ", ".join(f"{f.name} {getattr(plant, f.name):g}" for f in fields(plant) if f.name != "force_limit_N")
    items = [
        ("the handle", f"{values}: the published ones were not to be had"),
        ("the actuator", f"{plant.force_limit_N:g} N peak ({PUBLISHED})"),
        ("its accelerometer", f"one pole at {sensor.bandwidth_Hz:g} Hz, noise {sensor.noise_m_s2_rtHz:g} m/s²/√Hz"),
        ("users", "stiffness and damping of the hand from 150 N/m and 3 N·s/m to 2000 N/m and 10 N·s/m, ±10 % a trial"),
        ("teleoperation", "both Omnis, the hand and the line are simulated; the plate’s taps have an assumed form"),
        ("raters", "what a rating is, as told in its section"),
    ]
    if any(material.real for material in materials.values()):
        said = (
            "wood, paper, leather: a rate of 10 kHz is inferred from their low-pass, m/s² from their level. Epoxy: 1 = "
            "1 g, force and speed assumed"
        )
        items.insert(0, ("the recordings", said))
    return _listed("assumed", "What is assumed", items)


def _left_out(materials: Mapping[str, Material]) -> str:
    items = [
        ("Figs. 1, 3 and 6", f"pictures of apparatus and diagrams ({REMEMBERED}): nothing is measured in them"),
        ("position, taps and presses", "of Fig. 2: the recordings in reach hold speed and drags"),
        ("a real handle", "its parameters and the hands of real users: nobody here has one"),
        ("ratings of people", "none were taken; those of the simulated raters are no evidence about people"),
    ]
    if not any(material.real for material in materials.values()):
        items.insert(0, ("real surfaces", "no recordings were given: --recordings DIR"))
    return _listed("left-out", "What is left out, and why", items)


def _listed(key: str, title: str, items: Iterable[tuple[str, str]]) -> str:
    listed = "".join(f"<dt>{escape(what)}</dt><dd>{escape(text)}</dd>" for what, text in items)
    return f'<h2 id="{key}">{title}</h2><dl>{listed}</dl>'
