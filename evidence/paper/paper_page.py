"""The page: every figure with its numbers, the paper's beside ours, Table 1, what is assumed, what is left out."""

import csv
import datetime
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Final

from hapscene.handle.plant import Plant
from hapscene.handle.sensor import Sensor

from ..page import Page, shown
from .finding import PUBLISHED, REMEMBERED, Finding, Number
from .material import Material

__all__ = ["TABLE_ONE", "page_of", "table_of_numbers"]

PAPER: Final = (
    "Kuchenbecker, Romano & McMahan, “Haptography: Capturing and Recreating the Rich Feel of Real Surfaces”, 14th "
    "International Symposium on Robotics Research, 2009 (Springer Tracts in Advanced Robotics 70, 2011)"
)

NUMBERS_OPEN: Final = 14
"""Longest table of numbers that is not folded [rows]."""

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
"""Photography, haptography, the command of this project, and the section of the page that shows it."""


def page_of(findings: Mapping[str, Finding], materials: Mapping[str, Material]) -> Page:
    """The page."""
    page = Page("Haptography, reproduced")
    page.text(f"{PAPER}: its figures and numbers, as far as the data at hand allow.")
    for text in _leads(materials):
        page.text(text)
    page.heading("The paper’s numbers, and ours", key="summary")
    compared = [
        (f"{finding.title.split(':')[0]}: ", number)
        for finding in findings.values()
        for number in finding.numbers
        if number.paper is not None
    ]
    _add_numbers(page, compared)
    for key, finding in findings.items():
        page.heading(finding.title, key=key)
        page.text(finding.text)
        for plot in finding.plots:
            page.drawing(plot.svg, plot.title, plot.caption)
        _add_numbers(page, [("", number) for number in finding.numbers])
    page.heading("Table 1: haptography beside photography", key="table1")
    page.text(f"That the paper sets the two beside each other is {REMEMBERED}; the lines are ours.")
    page.table(("photography", "haptography", "here", "shown in"), TABLE_ONE)
    page.heading("What is assumed", key="assumed")
    page.table(("what", "as"), list(_assumed(materials).items()))
    page.heading("What is left out, and why", key="left-out")
    page.table(("what", "why"), list(_left_out(materials).items()))
    return page


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


def _add_numbers(page: Page, rows: Sequence[tuple[str, Number]]) -> None:
    """Add numbers as a table, folded where it is long; each with the text before it."""
    cells = []
    for before, n in rows:
        unit = "" if n.unit == "1" else f" {n.unit}"
        ours, paper = (("" if v is None else f"{shown(v)}{unit}".replace("-", "−")) for v in (n.ours, n.paper))
        cells.append((before + n.what, ours, f"{paper} ({n.known})" if paper else "", n.why))
    fold = f"{len(rows)} numbers" if len(rows) > NUMBERS_OPEN else ""
    page.table(("number", "ours", "the paper", "why they differ, what it depends on"), cells, fold)


def _assumed(materials: Mapping[str, Material]) -> dict[str, str]:
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
    return items


def _left_out(materials: Mapping[str, Material]) -> dict[str, str]:
    items = {
        "Figs. 1, 3 and 6": f"pictures and diagrams ({REMEMBERED}): nothing is measured in them",
        "position, taps and presses": "of Fig. 2: the recordings in reach hold speed and drags",
        "a real handle": "its parameters and the hands of real users: none was at hand",
        "ratings of people": "none were taken; those of the simulated raters are no evidence about people",
    }
    if not any(material.real for material in materials.values()):
        items["real surfaces"] = "no recordings were given: --recordings DIR"
    return items
