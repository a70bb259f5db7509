"""Report on a swatch: an HTML page with a verdict, the figures behind it, five plots, and what was not measured.

The page loads nothing from the network and has no script.
"""

import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from hapscene.capture.fit.segment import SegmentedRecording
from hapscene.capture.fit.swatch import prepare, verdict
from hapscene.capture.io.recording import WORDS, SurfaceRecording
from hapscene.capture.io.streams import Array
from hapscene.capture.report.numbers import LAGS, WHITE_ORDER, Comparison, HeldOut, compare_with_recording
from hapscene.capture.report.plots import (
    Plot,
    plot_friction,
    plot_models,
    plot_order,
    plot_plane,
    plot_spectra,
    plot_taps,
    signed,
)
from hapscene.errors import CaptureError
from hapscene.io.files import refusing, write_whole
from hapscene.perception import BAND_DB
from hapscene.surface.swatch import TOOL_FIELDS, Swatch

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["write_report"]

MODULATION_RATIO: Final = 1.6
"""Largest accepted ratio of modulation depths [1]. Two halves of a signal of 1 s differ by 1.3 to 1.5 by chance."""

DISTANCE_RATIO: Final = 1.1
"""Largest accepted spectral distance, relative to the distance at the best order or between the two halves [1]."""

MARKS: Final = {"good": "✓ good", "equal": "≈ as the halves", "short": "✗ insufficient", "unsteady": "≈ unsteady hand"}
"""Labels of the grades: imperceptible; perceptible, but no larger than between the halves; larger. The last one is not
perceptible, and does not count in the verdict."""

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content security policy: scripts and network access are forbidden even if a text were not escaped."""

NEEDS_RECORDING: Final = "Needs a recording: hapscene capture report SWATCH RECORDING"


class Row(NamedTuple):
    """A row of the comparison: a measure, its value, the requirement, and a key of `MARKS`."""

    measure: str
    value: str
    required: str
    grade: str


def write_report(
    swatch: Swatch, path: str | os.PathLike[str], recording: SurfaceRecording | None = None, source: str = ""
) -> None:
    """Writes a report on a swatch.

    Args:
        swatch: the swatch.
        path: HTML file to write.
        recording: a recording of the surface, with which the swatch is compared.
        source: name of the recording on the page.

    Raises:
        CaptureError: the recording is invalid, or the file cannot be written.
    """
    write_whole(Path(path), report(swatch, recording, source).encode(errors="backslashreplace"), CaptureError)


def report(swatch: Swatch, recording: SurfaceRecording | None = None, source: str = "") -> str:
    """Content of the page that `write_report` writes.

    Raises:
        CaptureError: the recording is invalid.
    """
    part, comparison, missing = None, None, NEEDS_RECORDING
    if recording is not None:
        with refusing(CaptureError, source or None):
            part = prepare(recording)
        try:
            comparison = compare_with_recording(swatch, *part)
        except CaptureError as error:  # the rest of the page does not need the comparison
            missing = f"No comparison with the recording: {error}."
    made, texture, taps = [] if comparison is None else rows(comparison), swatch.texture, swatch.taps
    values: dict[str, object] = {}
    if texture is not None:
        half = np.array([0.5 * texture.force_max_N]), np.array([0.5 * texture.speed_max_m_s])
        values["model_count"] = int(np.count_nonzero(texture.variance_m2_s4))
        values["rms_m_s2"] = float(np.sqrt(texture.power(*half)[0]))
        values["rms_max_m_s2"] = float(np.sqrt(texture.model_power_m2_s4.max()))
    origin = [(what, getattr(swatch, what)) for what in TOOL_FIELDS if getattr(swatch, what)]
    origin += [("provenance", swatch.provenance or "not stated"), ("licence", swatch.licence or "not stated")]
    return _environment().get_template("report.html.jinja").render(
        policy=POLICY,
        swatch=swatch,
        verdict=_verdict(swatch, comparison, made, "" if missing == NEEDS_RECORDING else missing),
        tap=None if taps is None else taps.at(float(taps.approach_m_s[-1])),
        rows=made,
        marks=MARKS,
        plots=_plots(swatch, part, comparison, missing),
        absent=_absent(swatch),
        origin=[*origin, ("recording", _described(recording, source))],
        **values,
    )  # fmt: skip


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader

    loader = PackageLoader("hapscene.capture.report.page")
    return Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)


def rows(comparison: Comparison) -> list[Row]:
    """Rows of the table that compares the texture with the recording."""
    held = comparison.held_out
    bands = _bands_row("bands in which the swatch differs from the recording", comparison.band_dB, held)
    if held is None:
        return [bands]
    best_dB = float(comparison.search.distance_dB.min())
    allowed = DISTANCE_RATIO * max(best_dB, held.floor_dB)
    near, in_bands = held.distance_dB <= allowed, not np.any(np.abs(held.band_dB) > BAND_DB)
    recorded, played, fitted = held.modulation
    lags, steady = held.correlated
    ratio, halves = (abs(float(np.log(max(x, 1e-9) / max(recorded, 1e-9)))) for x in (played, fitted))
    return [
        Row(
            "log-spectral distance to the second half",
            f"{held.distance_dB:.2f} dB",
            f"at most {allowed:.2f} dB: {DISTANCE_RATIO:g} times the distance of the halves ({held.floor_dB:.2f} dB) "
            f"or that of the best order ({best_dB:.2f} dB)",
            _grade(near and in_bands, near),
        ),
        Row(
            "level relative to the second half",
            f"{signed(held.level_dB, 2)} dB",
            f"at most ±{BAND_DB:g} dB (JND); the halves differ by {signed(held.halves_dB, 1)} dB",
            _grade(abs(held.level_dB) <= BAND_DB, abs(held.level_dB) <= abs(held.halves_dB)),
        ),
        _bands_row("bands that differ from the second half", held.band_dB, held),
        Row(
            "amplitude modulation, 2 to 10 Hz",
            f"{played:.2f}",
            f"{recorded:.2f} in the second half, within a factor of {MODULATION_RATIO:g} or as in the first half "
            f"({fitted:.2f})",
            _grade(ratio <= np.log(MODULATION_RATIO), ratio <= halves),
        ),
        Row(
            f"whiteness: lags of the residual outside the 95 % bounds, order {WHITE_ORDER}",
            f"{lags} of {LAGS}",
            f"at most {steady}, as stationary vibration of this length; more means that the hand does not move "
            "steadily, so that the halves differ. Not felt: does not count",
            "good" if lags <= steady else "unsteady",
        ),
        bands,
    ]


def _bands_row(measure: str, band_dB: Array, held: HeldOut | None) -> Row:
    """Count the bands with a perceptible difference in level, and compare with the difference between the halves."""
    count = int(np.count_nonzero(np.abs(band_dB) > BAND_DB))
    largest = float(band_dB[np.argmax(np.abs(band_dB))])
    required = f"0 bands by more than {BAND_DB:g} dB; the largest difference is {signed(largest, 1)} dB"
    halves = 0 if held is None else int(np.count_nonzero(np.abs(held.halves_band_dB) > BAND_DB))
    if held is not None:
        required += f"; the halves differ in {halves}"
    return Row(measure, f"{count} of {len(band_dB)}", required, _grade(count == 0, count <= halves))


def _grade(good: bool, equal: bool) -> str:
    return "good" if good else "equal" if equal else "short"


def _verdict(swatch: Swatch, comparison: Comparison | None, rows: list[Row], missing: str) -> str:
    """The verdict of the fit, or of the comparison with the recording, in one line."""
    if comparison is None:
        return f"{verdict(swatch)}. {missing}" if missing else verdict(swatch)
    if comparison.held_out is None:
        return f"record more: no comparison on held-out data, because {comparison.reason}"
    short, equal = ([row.measure for row in rows if row.grade == grade] for grade in ("short", "equal"))
    if short:
        return f"record more: insufficient {', '.join(short)}"
    if equal:
        return f"usable: perceptible differences are no larger than between the halves ({', '.join(equal)})"
    return "usable: the model of the first half has no perceptible difference from the second half"


def _plots(swatch: Swatch, part: SegmentedRecording | None, comparison: Comparison | None, missing: str) -> list[Plot]:
    """The five plots; a plot that cannot be drawn states the reason."""
    texture, held = swatch.texture, None if comparison is None else comparison.held_out
    plots = []
    if texture is None:
        plots.append(Plot("Spectra", "Texture: not measured."))
    else:
        plots.append(plot_models(texture) if held is None else plot_spectra(held))
        plots.append(Plot("Order", missing) if comparison is None else plot_order(comparison.search, texture.order))
        plots.append(plot_plane(texture, None if part is None else part[0]))
    if part is not None and part[0].tangential_force_N is not None:
        plots.append(plot_friction(swatch, *part))
    else:
        plots.append(Plot("Friction", NEEDS_RECORDING if part is None else "The tangential force was not recorded."))
    if swatch.taps is None:
        return [*plots, Plot("Taps", "Taps: not measured.")]
    return [*plots, plot_taps(swatch.taps, swatch.intervals)]


def _absent(swatch: Swatch) -> list[tuple[str, str]]:
    """Quantities that were not measured, with the reasons."""
    found = dict(swatch.absent)
    for name in ("texture", "taps"):
        if getattr(swatch, name) is None:
            found.setdefault(name, "the swatch does not state a reason")
    return [(_plain(name), reason) for name, reason in sorted(found.items())]


def _plain(name: str) -> str:
    """Name of a quantity without unit and underscores: "friction_static" becomes "friction static"."""
    for suffix in ("_N_m", "_Ns_m", "_m_s2", "_m_s", "_Hz", "_N"):
        name = name.removesuffix(suffix)
    return name.replace("_", " ").replace(".", ", ")


def _described(recording: SurfaceRecording | None, source: str) -> str:
    if recording is None:
        return "not given"
    seconds = len(recording.acceleration_m_s2) / recording.rate_Hz
    streams = [word for name, word in WORDS.items() if getattr(recording, name) is not None]
    rms = float(np.std(recording.acceleration_m_s2))
    return (
        f"{source + ': ' if source else ''}{seconds:.2f} s at {recording.rate_Hz:g} Hz, acceleration of {rms:.2g} m/s² "
        f"rms, {', '.join(streams) or 'force and speed not recorded (1 N and 0.1 m/s assumed)'}"
    )
