"""A report on a swatch: one page that says how good it is, why, and what it does not hold."""

import os
from pathlib import Path

import numpy as np

from hapscene.capture.recording_file import SurfaceRecording
from hapscene.capture.report_figure import Plot
from hapscene.capture.report_judgement import Judgement, judge
from hapscene.capture.report_page import page
from hapscene.capture.report_plot import (
    plot_bands,
    plot_distribution,
    plot_order,
    plot_spectra,
    plot_spectrograms,
    plot_whiteness,
)
from hapscene.capture.report_surface import plot_friction, plot_models, plot_plane, plot_taps, plot_transients
from hapscene.capture.report_word import absences, facts, rows
from hapscene.capture.swatch_fit import Part, prepare
from hapscene.errors import CaptureError
from hapscene.output import whole_file
from hapscene.surface.swatch import Swatch

NEEDS_RECORDING = "Needs the recording, which was not given: hapscene capture report SWATCH RECORDING"


def write_report(
    swatch: Swatch, path: str | os.PathLike[str], recording: SurfaceRecording | None = None, source: str = ""
) -> None:
    """Writes the report on `swatch` to `path`, whole or not at all.

    Args:
        swatch: what is reported on.
        path: the HTML file.
        recording: the recording that it was fitted to, or another of the same surface: then the swatch is judged by it.
        source: what the recording is called on the page.

    Raises:
        CaptureError: the recording is unusable, or the file cannot be written.
    """
    text = report(swatch, recording, source)
    try:
        with whole_file(Path(path)) as part:
            part.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise CaptureError(f"{Path(path)}: cannot be written: {error.strerror or error}") from None


def report(swatch: Swatch, recording: SurfaceRecording | None = None, source: str = "") -> str:
    """The page that `write_report` writes.

    Raises:
        CaptureError: the recording is unusable.
    """
    part, judgement, missing = None, None, NEEDS_RECORDING
    if recording is not None:
        try:
            part = prepare(recording)
        except CaptureError as error:
            raise CaptureError(f"{source}: {error}" if source else str(error)) from None
        try:
            judgement = judge(swatch, *part)
        except CaptureError as error:  # no texture, or no sliding: the rest of the page stands
            missing = f"Cannot be judged: {error}"
    about = [
        ("provenance", swatch.provenance or "not said"),
        ("licence", swatch.licence or "not said"),
        ("recording", _described(recording, source)),
    ]
    return page(
        swatch,
        _lead(judgement, missing),
        facts(swatch),
        [] if judgement is None else rows(judgement),
        _plots(swatch, part, judgement, missing),
        absences(swatch),
        about,
    )


def _plots(swatch: Swatch, part: Part | None, judgement: Judgement | None, missing: str) -> list[Plot]:
    """All plots; those that cannot be drawn say what is missing."""
    plots = []
    texture = swatch.texture
    if texture is None:
        plots.append(Plot("Spectra", "The swatch has no texture: sliding is silent."))
    elif judgement is None or judgement.held_out is None:
        plots.append(plot_models(texture))
    held = None if judgement is None else judgement.held_out
    why_not = missing if judgement is None else f"Cannot be judged on held-out data: {judgement.why_not}"
    if held is not None:
        plots.append(plot_spectra(held))
    plots.append(plot_spectrograms(judgement) if judgement is not None else Plot("Spectrograms", missing))
    if judgement is not None and texture is not None:
        plots.append(plot_order(judgement.search, texture))
    else:
        plots.append(Plot("Order", missing))
    if judgement is not None and texture is not None and held is not None:
        plots += [plot_bands(held), plot_whiteness(held)]
        plots.append(plot_distribution(held, judgement.excitation, texture))
    else:
        plots.append(Plot("Level, band by band", why_not))
        plots += [Plot("Residual: is it white?", why_not), Plot("Residual: how is it distributed?", why_not)]
    if texture is not None:
        plots.append(plot_plane(texture, None if part is None else part[0]))
    if part is not None and part[0].tangential_force_N is not None:
        plots.append(plot_friction(swatch, *part))
    else:
        reason = NEEDS_RECORDING if part is None else "The recording holds no tangential force and no friction."
        plots.append(Plot("Friction", reason))
    return plots + _tap_plots(swatch)


def _tap_plots(swatch: Swatch) -> list[Plot]:
    if swatch.taps is None:
        return [Plot("Taps", "The swatch has no taps: a touch is silent.")]
    plots = [plot_taps(swatch.taps, swatch.intervals)]
    return plots if swatch.taps.wave_m_s2 is None else [*plots, plot_transients(swatch.taps)]


def _lead(judgement: Judgement | None, missing: str) -> str:
    """The verdict in a sentence or two."""
    if judgement is None:
        return "Without a recording the swatch is shown and not judged." if missing == NEEDS_RECORDING else missing
    held = judgement.held_out
    if held is None:
        return f"The texture could not be judged on held-out data: {judgement.why_not}"
    short = [row.measure.split(" (")[0] for row in rows(judgement) if row.verdict == "short"]
    text = "Judged by the recording: a model of the first half is held against the second, which it has not seen. "
    if not short:
        return text + "Spectrum, level and centroid are as near as such a recording allows."
    return text + f"Short of what is asked: {', '.join(short)}."


def _described(recording: SurfaceRecording | None, source: str) -> str:
    if recording is None:
        return "none given"
    seconds = len(recording.acceleration_m_s2) / recording.rate_Hz
    held = [
        word
        for word, stream in (
            ("normal force", recording.force_N),
            ("speed", recording.speed_m_s),
            ("tangential force", recording.tangential_force_N),
        )
        if stream is not None
    ]
    rms = float(np.std(recording.acceleration_m_s2))
    return (
        f"{source + ': ' if source else ''}{seconds:.2f} s at {recording.rate_Hz:g} Hz, "
        f"acceleration of {rms:.2g} m/s² rms, {', '.join(held) or 'no force and no speed: 1 N and 0.1 m/s assumed'}"
    )
