"""A report on a swatch: one HTML page with a verdict, the numbers behind it, five plots, and what is absent.

Nothing on the page is fetched, and it has no script; it is light or dark as the reader's screen is.
"""

import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from hapscene.capture.fit.segment import Part
from hapscene.capture.fit.swatch import prepare
from hapscene.capture.io.recording import WORDS, SurfaceRecording
from hapscene.capture.report.numbers import FELT_DB, HeldOut, Judgement, judge
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
from hapscene.files import refusing, write_whole
from hapscene.surface.swatch import TOOL_FIELDS, Swatch

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["POLICY", "document", "figure", "report", "write_report"]

CENTROID: Final = 0.13
"""Relative difference of spectral centroids that is felt [1]: the least of 13 to 38 % (Israr et al. 2006)."""

MODULATION_RATIO: Final = 1.6
"""Largest ratio of amplitude modulations [1]: that of halves of one second, of which chance alone is 1.3 to 1.5."""

DISTANCE_RATIO: Final = 1.1
"""Largest ratio of the spectral distance to the best order's, or to the recording's own floor [1]."""

MARKS: Final = {"good": "✓ good", "alike": "≈ as the halves", "short": "✗ short", "": ""}
"""What each verdict shows: no difference is felt; one is, as between the recording's own halves; a larger one is."""

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content security policy: a text that is not escaped can neither run nor fetch anything."""

NEEDS_RECORDING: Final = "Needs the recording, which was not given: hapscene capture report SWATCH RECORDING"


class Row(NamedTuple):
    """A row of the table: a measure, its value, what is required of it, and a key of `MARKS`."""

    measure: str
    value: str
    required: str
    verdict: str = ""


def write_report(
    swatch: Swatch, path: str | os.PathLike[str], recording: SurfaceRecording | None = None, source: str = ""
) -> None:
    """Write the report on `swatch` to `path`, whole or not at all.

    Args:
        swatch: what is reported on.
        path: the HTML file.
        recording: the recording that it was fitted to, or another one of the same surface; the swatch is judged by it.
        source: the recording's name on the page.

    Raises:
        CaptureError: the recording is unusable, or the file cannot be written.
    """
    write_whole(Path(path), report(swatch, recording, source).encode(errors="backslashreplace"), CaptureError)


def report(swatch: Swatch, recording: SurfaceRecording | None = None, source: str = "") -> str:
    """The page that `write_report` writes.

    Raises:
        CaptureError: the recording is unusable.
    """
    part, judgement, missing = None, None, NEEDS_RECORDING
    if recording is not None:
        with refusing(CaptureError, source or None):
            part = prepare(recording)
        try:
            judgement = judge(swatch, *part)
        except CaptureError as error:  # no texture, or no sliding: the rest of the page stands
            missing = f"Cannot be judged: {error}"
    made, texture, taps = [] if judgement is None else rows(judgement), swatch.texture, swatch.taps
    values: dict[str, object] = {}
    if texture is not None:
        half = np.array([0.5 * texture.force_max_N]), np.array([0.5 * texture.speed_max_m_s])
        values["model_count"] = int(np.count_nonzero(texture.variance_m2_s4))
        values["rms_m_s2"] = float(np.sqrt(texture.power(*half)[0]))
        values["rms_max_m_s2"] = float(np.sqrt(texture.model_power_m2_s4.max()))
    origin = [(what, getattr(swatch, what)) for what in TOOL_FIELDS if getattr(swatch, what)]
    origin += [("provenance", swatch.provenance or "not stated"), ("licence", swatch.licence or "not stated")]
    return _environment().get_template("swatch.html.jinja").render(
        title=f"{swatch.name}: swatch report",
        policy=POLICY,
        style="",
        swatch=swatch,
        verdict=_verdict_line(judgement, made, missing),
        tap=None if taps is None else taps.at(float(taps.approach_m_s[-1])),
        rows=made,
        marks=MARKS,
        plots=_plots(swatch, part, judgement, missing),
        absent=_absent(swatch),
        origin=[*origin, ("recording", _described(recording, source))],
        **values,
    )  # fmt: skip


def document(title: str, body: Iterable[str], style: str = "", policy: str = POLICY) -> str:
    """A page in the style of reports: its title, which is escaped, its parts of HTML, and further CSS."""
    page = _environment().get_template("document.html.jinja")
    return page.render(title=title, body="\n".join(body), style=style, policy=policy)


def figure(plot: Plot) -> str:
    """A plot as HTML, with its title and caption."""
    return _environment().get_template("figure.html.jinja").render(plot=plot)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader

    loader = PackageLoader("hapscene.capture.report.page")
    return Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)


def rows(judgement: Judgement) -> list[Row]:
    """How good the texture is, measure by measure."""
    held, error = judgement.held_out, judgement.spectrogram_error
    return [
        *([] if held is None else _held_out_rows(held, float(judgement.search.distance_dB.min()))),
        _bands_row("bands in which the swatch is felt to differ from the recording", judgement.band_dB, held),
        Row(
            "spectrogram error", f"{100 * error:.0f} %", "66 % for other noise of the same spectrum, 100 % for silence"
        ),
    ]


def _held_out_rows(held: HeldOut, best_dB: float) -> list[Row]:
    allowed = DISTANCE_RATIO * max(best_dB, held.floor_dB)
    no_band = not np.any(np.abs(held.band_dB) > FELT_DB)
    centroid, halves_centroid = held.centroid_ratio - 1.0, held.halves_centroid_ratio - 1.0
    modulation, spread, _ = zip(*held.lively, strict=True)
    return [
        Row(
            "spectrum on the held-out half (log-spectral distance)",
            f"{held.distance_dB:.2f} dB",
            f"at most {allowed:.2f} dB: {DISTANCE_RATIO:g} times the distance of the halves ({held.floor_dB:.2f} dB) "
            f"or that of the best order ({best_dB:.2f} dB)",
            _verdict(no_band and held.distance_dB <= allowed, held.distance_dB <= allowed),
        ),
        Row(
            "level on the held-out half",
            f"{signed(held.level_dB, 2)} dB",
            f"felt from {FELT_DB:g} dB; the fitted half itself differs by {signed(held.halves_dB, 1)} dB",
            _verdict(abs(held.level_dB) <= FELT_DB, abs(held.level_dB) <= abs(held.halves_dB)),
        ),
        Row(
            "spectral centroid on the held-out half",
            f"{signed(100 * centroid, 1)} %",
            f"felt from {100 * CENTROID:g} %; the fitted half itself differs by {signed(100 * halves_centroid, 0)} %",
            _verdict(abs(centroid) <= CENTROID, abs(centroid) <= abs(halves_centroid)),
        ),
        _bands_row("bands that differ by more than is felt", held.band_dB, held),
        _modulation_row("modulation of the envelope, 2 to 10 Hz", modulation, ""),
        _modulation_row("spread of the level, in windows of 50 ms", spread, " dB"),
        Row("goodness of fit of the spectra (GFC)", f"{held.goodness_of_fit:.3f}", "1 is the same shape"),
    ]


def _bands_row(measure: str, band_dB: np.ndarray, held: HeldOut | None) -> Row:
    """The number of bands whose levels are felt to differ, beside that of the recording's halves."""
    felt = int(np.count_nonzero(np.abs(band_dB) > FELT_DB))
    worst = float(band_dB[np.argmax(np.abs(band_dB))])
    required = f"0: {FELT_DB:g} dB a band; the largest difference is {signed(worst, 1)} dB"
    halves = 0 if held is None else int(np.count_nonzero(np.abs(held.halves_band_dB) > FELT_DB))
    if held is not None:
        required += f"; the fitted half itself differs in {halves}"
    return Row(measure, f"{felt} of {len(band_dB)}", required, _verdict(felt == 0, felt <= halves))


def _modulation_row(measure: str, values: tuple[float, ...], unit: str) -> Row:
    """The amplitude modulation of the model, beside those of the held-out and of the fitted half."""
    recorded, played, fitted = values
    off, own = (abs(float(np.log(max(x, 1e-9) / max(recorded, 1e-9)))) for x in (played, fitted))
    required = (
        f"{recorded:.2f}{unit} on the held-out half, within a factor of {MODULATION_RATIO:g} or as near as the fitted "
        f"half: {fitted:.2f}{unit}"
    )
    return Row(measure, f"{played:.2f}{unit}", required, _verdict(off <= np.log(MODULATION_RATIO), off <= own))


def _verdict(good: bool, alike: bool) -> str:
    return "good" if good else "alike" if alike else "short"


def _verdict_line(judgement: Judgement | None, rows: list[Row], missing: str) -> str:
    """The verdict in one line."""
    if judgement is None:
        return "Without a recording the swatch is shown and not judged." if missing == NEEDS_RECORDING else missing
    if judgement.held_out is None:
        return f"The texture could not be judged on held-out data: {judgement.why_not}"
    short, alike = ([row.measure for row in rows if row.verdict == verdict] for verdict in ("short", "alike"))
    if short:
        return f"✗ Short of what is required: {', '.join(short)}."
    if alike:
        return f"≈ Felt to differ, but no more than the recording's halves do: {', '.join(alike)}."
    return "✓ Good: a model of the first half differs from the second half by nothing that is felt."


def _plots(swatch: Swatch, part: Part | None, judgement: Judgement | None, missing: str) -> list[Plot]:
    """The five plots; one that cannot be drawn gives the reason."""
    texture, held = swatch.texture, None if judgement is None else judgement.held_out
    plots = []
    if texture is None:
        plots.append(Plot("Spectra", "The swatch has no texture: sliding is silent."))
    else:
        plots.append(plot_models(texture) if held is None else plot_spectra(held))
        plots.append(Plot("Order", missing) if judgement is None else plot_order(judgement.search, texture.order))
        plots.append(plot_plane(texture, None if part is None else part[0]))
    if part is not None and part[0].tangential_force_N is not None:
        plots.append(plot_friction(swatch, *part))
    else:
        plots.append(Plot("Friction", NEEDS_RECORDING if part is None else "The recording has no tangential force."))
    if swatch.taps is None:
        return [*plots, Plot("Taps", "The swatch has no taps: a touch is silent.")]
    return [*plots, plot_taps(swatch.taps, swatch.intervals)]


def _absent(swatch: Swatch) -> list[tuple[str, str]]:
    """What the swatch does not have, and the reason as far as it is known."""
    found = dict(swatch.absent)
    if swatch.texture is None:
        found.setdefault("texture", "the swatch has none: sliding is silent")
    if swatch.taps is None:
        found.setdefault("taps", "the swatch has none: a touch is silent")
    if swatch.friction_static == 0.0 and not any("friction" in name for name in found):
        found["friction"] = "the coefficients are 0: the tool glides"
    return [(_plain(name), reason) for name, reason in sorted(found.items())]


def _plain(name: str) -> str:
    """The name of a quantity as words: "friction_static" is "friction static"."""
    for suffix in ("_N_m", "_Ns_m", "_m_s2", "_m_s", "_Hz", "_N"):
        name = name.removesuffix(suffix)
    return name.replace("_", " ").replace(".", ", ")


def _described(recording: SurfaceRecording | None, source: str) -> str:
    if recording is None:
        return "none given"
    seconds = len(recording.acceleration_m_s2) / recording.rate_Hz
    streams = [word for name, word in WORDS.items() if getattr(recording, name) is not None]
    rms = float(np.std(recording.acceleration_m_s2))
    return (
        f"{source + ': ' if source else ''}{seconds:.2f} s at {recording.rate_Hz:g} Hz, "
        f"acceleration of {rms:.2g} m/s² rms, {', '.join(streams) or 'no force and no speed: 1 N and 0.1 m/s assumed'}"
    )
