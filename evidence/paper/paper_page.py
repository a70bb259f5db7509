"""The page: the paper's numbers beside those found here, the conditions of both, and what is not reproduced."""

import csv
import datetime
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Final

from hapscene.handle.plant import Plant, Sensor

from ..page import Page, shown
from .material import Material
from .result import SETTING, FigureResult, Number

__all__ = ["page_of", "summary", "table_of_numbers"]

PAPER: Final = (
    "K. J. Kuchenbecker, J. Romano and W. McMahan, “Haptography: Capturing and Recreating the Rich Feel of Real "
    "Surfaces”, International Symposium on Robotics Research 2009 (Springer Tracts in Advanced Robotics 70, 2011)"
)

CONDITIONS: Final = (
    (
        "Figs. 4, 5",
        "organza on a stiff substrate, plastic probe, 4.0 cm/s, 1.5 N, n = 120 (Fig. 4, caption); force and speed held "
        "constant, 5000 Hz (Section 3, Texture Modeling)",
        "wood, moved freely by hand; 10 kHz, inferred from the recording's low-pass, resampled to 5000 Hz",
        "nothing for a recording; a synthesised surface is a linear prediction model itself",
    ),
    (
        "Fig. 7",
        "five users, three trials each, three-fingered pinch grip, repeated sweep of 10–200 Hz (Section 4, System "
        "Dynamics); actuator of 6.6 N peak (Section 4, Prototype)",
        "five simulated grips, three trials each, the same sweep and peak force",
        "handle and hands have exactly the form of the fitted model",
    ),
    (
        "Fig. 8",
        "two Omnis, position–position controller, two taps and five drags on unfinished plywood; 100 % is the run "
        "without the voice coil (Section 4, Teleoperation Testing)",
        "the same, simulated, on the swatch of wood; a press between taps and drags",
        "the compensator knows the handle's parameters, and the latency is removed, exactly",
    ),
    (
        "bands",
        "motion to 8–10 Hz, vibration to 1000 Hz (Section 2); handle from 20 to 1000 Hz (Section 4, Our Approach)",
        "force at 1 kHz, acceleration from 20 to 1000 Hz at 10 kHz",
        "nothing",
    ),
    (
        "ratings",
        "people tap on a spring-based wall without and with transients; 7 is a real wooden block (Section 2)",
        "taps on the swatch of wood, rendered by the handle in 12 simulated grips",
        "the rating is computed from the spectral distance; no person is involved",
    ),
)
"""Figure; conditions of the paper, with the place; conditions here; what the simulation knows beyond an experiment."""

TABLE_ONE: Final = (
    ("digital SLR camera", "highly sensorized handheld tool", "hapscene capture record"),
    ("interchangeable lenses", "interchangeable tool tips", "hapscene capture fit"),
    ("framing a shot and focusing the camera", "exploring an object’s surface", "hapscene capture record"),
    ("planar distribution of light intensities", "stream of positions, forces, and accelerations", ""),
    ("optics and the human eye", "haptics and the human hand", ""),
    ("LCD monitor", "uniquely actuated handheld tool", "hapscene device identify"),
    ("viewing the digital image", "freely exploring the digital model", "hapscene play"),
    ("spatial resolution and focus", "high frequency accelerations", "hapscene capture report"),
)
"""The rows of the paper's Table 1 (photography, haptography), and the command that corresponds to each."""

NOT_REPRODUCED: Final = (
    ("Figs. 1, 3, 6", "diagrams and a photograph without measurements"),
    ("Figs. 2, 4, 5", "plastic, foam and organza; positions, taps and presses: not recorded"),
    ("Fig. 7", "real handle and hands: not available; the parameter values stand in the picture only"),
    ("Fig. 8", "real teleoperation, its phase lag and underactuation"),
    (
        "Section 1",
        "changes of a surface over time: `hapscene swatch compare` compares two swatches, no series is recorded; "
        "insights for the hands of robots",
    ),
    (
        "Section 2",
        "touch by the fingertip, which the paper leaves out, too; motion of the object; torques (stored, not fitted); "
        "ratings by people; a public online database (`hapscene swatch publish` writes it)",
    ),
    (
        "Section 3",
        "models of contact angle, hand configuration and grip force; of transitions between contact states, only taps, "
        "leaving and breakaway are fitted; a physical model of tapping",
    ),
    (
        "Sections 3, 4, Prior Work",
        "methods of other authors: automatic probes, sums of cosines, look-up tables, bump maps, driven styli",
    ),
    (
        "Section 4",
        "comparison with the original by people, who found surfaces harder; perceptual test of mapping three axes "
        "to one (DFT321 is used)",
    ),
)
"""Parts of the paper that are not reproduced."""


def summary(results: Mapping[str, FigureResult], materials: Mapping[str, Material]) -> Page:
    """Return the page without the sections of the figures."""
    page = Page("The haptography paper, reproduced")
    page.text(
        f"{PAPER}. Each number of the paper has its place in it. Made on {datetime.date.today().isoformat()} by "
        "`hapscene lab reproduce --recordings FOLDER`; the gallery names the sources of the recordings."
    )
    missing = [material.name for material in materials.values() if not material.recorded]
    if missing:
        page.text(
            f"No recordings of {', '.join(missing)} were given: the figures of these surfaces show what the shipped "
            "swatches synthesise. `hapscene lab reproduce --recordings DIR` uses recordings."
        )
    page.heading("Numbers of the paper", key="summary")
    _add_numbers(
        page, [(r.title.split(":")[0], n) for r in results.values() for n in r.numbers if n.note != SETTING and n.paper]
    )
    page.heading("Conditions", key="conditions")
    page.table(("", "paper", "here", "what the simulation knows and an experiment does not"), CONDITIONS)
    if "interpolation" in results:
        found = results["interpolation"]
        page.heading(found.title, key="interpolation")
        page.text(found.text)
        _add_numbers(page, [("", number) for number in found.numbers])
    page.heading("Not reproduced", key="not-reproduced")
    page.table(("place", "not reproduced"), NOT_REPRODUCED)
    return page


def page_of(results: Mapping[str, FigureResult], materials: Mapping[str, Material]) -> Page:
    """Return the whole page."""
    page = summary(results, materials)
    for key, result in results.items():
        if key == "interpolation":  # part of the summary
            continue
        page.heading(result.title, key=key)
        page.text(result.text)
        for plot in result.plots:
            page.drawing(plot.svg, plot.title, plot.caption)
        _add_numbers(page, [("", number) for number in result.numbers])
    page.heading("Table 1 of the paper, and the commands", key="table1")
    page.table(("photography", "haptography", "hapscene"), TABLE_ONE)
    page.heading("Assumed values", key="assumed")
    page.table(("quantity", "assumed"), list(_assumed().items()))
    return page


def table_of_numbers(results: Mapping[str, FigureResult]) -> str:
    """Return all numbers as CSV, unrounded; `paper` is empty where the paper states none."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("figure", "quantity", "unit", "paper", "place", "here", "note"))
    for key, result in results.items():
        for n in result.numbers:
            writer.writerow((key, n.quantity, n.unit, n.paper, n.place, n.value, n.note))
    return text.getvalue()


def _add_numbers(page: Page, rows: Sequence[tuple[str, Number]]) -> None:
    """Add numbers as a table, each with the figure that it belongs to."""
    cells: list[tuple[str, ...]] = []
    compared, noted = any(n.paper is not None for _, n in rows), any(n.note for _, n in rows)
    for figure, n in rows:
        unit = "" if n.unit == "1" else f" {n.unit}"
        here, paper = (("" if v is None else f"{shown(v)}{unit}".replace("-", "−")) for v in (n.value, n.paper))
        quantity = f"{figure}: {n.quantity}" if figure else n.quantity
        stated = (f"{paper} ({n.place})" if paper else "",) if compared else ()
        cells.append((quantity, *stated, here, n.note)[: None if noted else -1])
    head: tuple[str, ...] = ("quantity", "paper (place)", "here", "what the simulation knows; other differences")
    if not compared:
        head = ("quantity", "here", "note")[: None if noted else -1]
    page.table(head, cells)


def _assumed() -> dict[str, str]:
    plant, sensor = Plant(), Sensor()
    values = ", ".join(f"{f.name} {getattr(plant, f.name):g}" for f in fields(plant) if f.name != "force_limit_N")
    noise = f"noise {sensor.noise_m_s2_rtHz:.2g} m/s²/√Hz"
    return {
        "handle": f"{values}; the paper's text does not state its values",
        "accelerometer of the handle": f"one pole at {sensor.bandwidth_Hz:g} Hz, {noise}",
        "hands": "from 150 N/m and 3 N·s/m to 2000 N/m and 10 N·s/m, ±10 % between trials",
        "taps of the wood": "waveform and size after Okamura et al. 2001",
        "recordings": "wood, paper, leather: rate and unit, inferred; epoxy: unit 1 g, 1 N, 0.1 m/s",
    }
