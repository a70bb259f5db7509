"""A report on a swatch: one page that says how good it is, why, and what it does not hold."""

import os
from collections.abc import Iterable
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from hapscene.capture import metric
from hapscene.capture.io.recording import WORDS, SurfaceRecording
from hapscene.capture.io.streams import Array
from hapscene.capture.report_numbers import FELT_DB, HeldOut, Judgement, judge
from hapscene.capture.report_plots import (
    Plot,
    plot_bands,
    plot_distribution,
    plot_friction,
    plot_life,
    plot_models,
    plot_order,
    plot_plane,
    plot_spectra,
    plot_spectrograms,
    plot_taps,
    plot_transients,
    plot_whiteness,
    signed,
)
from hapscene.capture.segment import Part
from hapscene.capture.swatch_fit import prepare
from hapscene.constants import LEVEL_BOUND_DB
from hapscene.errors import CaptureError
from hapscene.files import refusing, write_whole
from hapscene.surface.swatch import TOOL_FIELDS, Swatch

# The numbers of a report in words: what is in the swatch, how good it is, what is absent.


CENTROID: Final = 0.13
"""How far the spectral centroid may be off until it is felt [1]: the least of 13 to 38 % (Israr et al. 2006)."""

LIVELY: Final = 1.6
"""Factor that the liveliness may be off by [1]: that of halves of one second, whose own chance is 1.3 to 1.5."""

DISTANCE_RATIO: Final = 1.1
"""How much farther off than the best order, or the recording's own floor, the spectrum may be [1]."""


class Fact(NamedTuple):
    """A number at the head of the page: what, how much, and a line on it."""

    label: str
    value: str
    detail: str


MARKS: Final = {"good": "✓ good", "alike": "≈ as the halves", "short": "✗ short", "": ""}
"""What is written for each verdict: no difference is felt; one is, as between the recording's own halves; more is."""


class Row(NamedTuple):
    """A line of the table: what was measured, what it is, what it is held to, what follows (one of `MARKS`)."""

    measure: str
    value: str
    held_to: str
    verdict: str = ""


def facts(swatch: Swatch) -> list[Fact]:
    """The main numbers of a swatch; one that is absent says so."""
    found = [*_texture(swatch), _friction(swatch), _stiffness(swatch), _taps(swatch)]
    if swatch.adhesion_N > 0.0:
        said = f"pull on a tool that leaves, at {1e3 * swatch.adhesion_range_m:.2g} mm"
        found.append(Fact("Adhesion", f"{swatch.adhesion_N:.2g} N", said))
    return found


def absences(swatch: Swatch) -> list[tuple[str, str]]:
    """What the swatch does not have, with the reason as far as it is known."""
    found = dict(swatch.absent)
    if swatch.texture is None:
        found.setdefault("texture", "the swatch has none: sliding is silent")
    if swatch.taps is None:
        found.setdefault("taps", "the swatch has none: a touch is silent")
    if swatch.friction_static == 0.0 and not any("friction" in name for name in found):
        found["friction"] = "the coefficients are 0: the tool glides"
    return [(plain(name), reason) for name, reason in sorted(found.items())]


def rows(judgement: Judgement) -> list[Row]:
    """How good the texture is, measure by measure."""
    held, best = judgement.held_out, float(judgement.search.distance_dB.min())
    similarity = judgement.similarity
    return [
        *([] if held is None else _held_out_rows(held, best)),
        _bands_row("bands in which the swatch is felt to differ from the recording", judgement.band_dB, held),
        Row(
            "likeness as felt, spectral part of ST-SIM",
            f"{similarity.spectral:.3f}",
            f"1 is alike (temporal part {similarity.temporal:.2f}: noise repeats no waveform)",
        ),
        Row(
            "spectrogram error, swatch against recording",
            f"{100 * judgement.spectrogram_error:.0f} %",
            "66 % for other noise of the same spectrum, 100 % for silence",
        ),
    ]


def _held_out_rows(held: HeldOut, best_dB: float) -> list[Row]:
    allowed = DISTANCE_RATIO * max(best_dB, held.floor_dB)
    felt = int(np.count_nonzero(np.abs(held.band_dB) > FELT_DB))
    one, two, own = held.lively
    fitted, other = (metric.spectral_centroid_Hz(d, held.frequency_Hz) for d in (held.fitted, held.held_out))
    return [
        Row(
            "spectrum on the held-out half (log-spectral distance)",
            f"{held.distance_dB:.2f} dB",
            f"at most {allowed:.2f} dB: 1.1 times the recording's floor ({held.floor_dB:.2f} dB) or the best order's "
            f"({best_dB:.2f} dB)",
            _verdict(felt == 0 and held.distance_dB <= allowed, held.distance_dB <= allowed),
        ),
        Row(
            "level on the held-out half",
            f"{signed(held.level_dB, 2)} dB",
            f"felt from {FELT_DB:g} dB; the half that was fitted is itself {signed(held.halves_dB, 1)} dB from the "
            "held-out one",
            _verdict(abs(held.level_dB) <= FELT_DB, abs(held.level_dB) <= abs(held.halves_dB)),
        ),
        Row(
            "spectral centroid on the held-out half",
            f"{signed(100 * (held.centroid_ratio - 1), 1)} %",
            f"felt from {100 * CENTROID:g} %; the half that was fitted is itself "
            f"{signed(100 * (fitted / other - 1), 0)} % from the held-out one",
            _verdict(abs(held.centroid_ratio - 1) <= CENTROID, abs(held.centroid_ratio - 1) <= abs(fitted / other - 1)),
        ),
        _bands_row("bands that differ by more than is felt", held.band_dB, held),
        _lively_row("modulation of the envelope, 2 to 10 Hz", (one.modulation, two.modulation, own.modulation), ""),
        _lively_row("spread of the level, in windows of 50 ms", (one.spread_dB, two.spread_dB, own.spread_dB), " dB"),
        Row("goodness of fit of the spectra (GFC)", f"{held.goodness_of_fit:.3f}", "1 is one shape"),
        Row(
            "residual on the held-out half",
            f"{held.residual_ratio:.4f}",
            "share of the power that the model does not predict; smaller is better",
        ),
    ]


def _bands_row(measure: str, band_dB: Array, held: HeldOut | None) -> Row:
    """In how many bands a level is felt to differ, beside how the halves of the recording do."""
    worst = int(np.argmax(np.abs(band_dB)))
    low, high = metric.BAND_EDGES_HZ[worst], metric.BAND_EDGES_HZ[worst + 1]
    felt = int(np.count_nonzero(np.abs(band_dB) > FELT_DB))
    said = f"none: {FELT_DB:g} dB a band; most at {low:.0f} to {high:.0f} Hz, {signed(band_dB[worst], 1)} dB"
    halves = 0 if held is None else int(np.count_nonzero(np.abs(held.halves_band_dB) > FELT_DB))
    if held is not None:
        said += f"; the half that was fitted itself differs in {halves}"
    return Row(measure, f"{felt} of {len(band_dB)}", said, _verdict(felt == 0, felt <= halves))


def _lively_row(measure: str, values: tuple[float, float, float], unit: str) -> Row:
    """How lively the model is in one measure, beside the held-out half and the one that was fitted."""
    recorded, played, fitted = values
    off, own = (abs(float(np.log(max(x, 1e-9) / max(recorded, 1e-9)))) for x in (played, fitted))
    said = f"{recorded:.2f}{unit} on the held-out half, within a factor of {LIVELY:g} or as near as the half that was"
    verdict = _verdict(off <= np.log(LIVELY), off <= own)
    return Row(measure, f"{played:.2f}{unit}", f"{said} fitted: {fitted:.2f}{unit}", verdict)


def plain(name: str) -> str:
    """The name of a quantity as words: "friction_static" is "friction static"."""
    for suffix in ("_N_m", "_Ns_m", "_m_s2", "_m_s", "_Hz", "_N"):
        name = name.removesuffix(suffix)
    return name.replace("_", " ").replace(".", ", ")


def _verdict(good: bool, alike: bool = False) -> str:
    return "good" if good else "alike" if alike else "short"


def _texture(swatch: Swatch) -> tuple[Fact, Fact]:
    """The texture, and how loud it is."""
    texture = swatch.texture
    if texture is None:
        return Fact("Texture", "none", "sliding is silent"), Fact("Vibration", "0 m/s²", "no texture")
    count = int(np.count_nonzero(texture.variance_m2_s4))
    held = (
        f"{count} model{'s' if count != 1 else ''} at {texture.rate_Hz / 1e3:g} kHz, up to {texture.force_max_N:.2g} N "
        f"and {1e3 * texture.speed_max_m_s:.0f} mm/s"
    )
    power = texture.power(np.array([0.5 * texture.force_max_N]), np.array([0.5 * texture.speed_max_m_s]))[0]
    said = f"rms at half force and speed; at most {np.sqrt(texture.model_power_m2_s4.max()):.2g} m/s²"
    if np.any(texture.exponents != 0.0):
        force, speed = texture.exponents
        said += (
            f"; beyond its power goes on as force^{force:.2g} and speed^{speed:.2g}, by {LEVEL_BOUND_DB:g} dB at most"
        )
    warped = ", warped" if texture.warp else ""
    return Fact("Texture", f"order {texture.order}{warped}", held), Fact(
        "Vibration", f"{np.sqrt(power):.2g} m/s²", said
    )


def _friction(swatch: Swatch) -> Fact:
    if swatch.friction_static == 0.0:
        return Fact("Friction", "none", "the tool glides")
    interval = swatch.intervals.get("friction_dynamic")
    known = "" if interval is None else f" (95 %: {interval[0]:.3f} to {interval[1]:.3f})"
    return Fact("Friction", f"{swatch.friction_dynamic:.3f}", f"dynamic{known}; static {swatch.friction_static:.3f}")


def _stiffness(swatch: Swatch) -> Fact:
    interval = swatch.intervals.get("stiffness_N_m")
    known = f"damping {swatch.damping_Ns_m:.3g} N·s/m"
    if swatch.hunt_crossley_Ns_m2 > 0.0:
        known = f"damping {swatch.hunt_crossley_Ns_m2:.3g} N·s/m² times the depth"
    if interval is not None:
        known = f"95 %: {interval[0]:.0f} to {interval[1]:.0f} N/m; " + known
    elif any(name.startswith("stiffness") for name in swatch.absent):
        known = "not measured: the default; " + known
    return Fact("Stiffness", f"{swatch.stiffness_N_m:.0f} N/m", known)


def _taps(swatch: Swatch) -> Fact:
    if swatch.taps is None:
        return Fact("Taps", "none", "a touch is silent")
    speed = float(swatch.taps.approach_m_s[-1])
    tap = swatch.taps.at(speed)
    said = f"{tap.amplitude_m_s2:.2g} m/s² at {1e3 * speed:.0f} mm/s, gone to a third in {1e3 / tap.decay_1_s:.0f} ms"
    return Fact("Taps", f"{tap.frequency_Hz:.0f} Hz", said)


# The page of a report: one HTML file, nothing fetched, no script, light or dark as the reader's screen is.


POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content security policy: even if a text slipped through unescaped, nothing could run or be fetched."""


def page(swatch: Swatch, lead: str, rows: Iterable[Row], plots: Iterable[Plot], about: list[tuple[str, str]]) -> str:
    """The HTML of a report. Every text is escaped here; only the drawings of `plots` are taken as they are."""
    name = escape(swatch.name)
    judged = "".join(map(_row, rows))
    body = [
        f'<header><h1>{name}</h1><p class="lead">{escape(lead)}</p></header>',
        f'<div class="facts">{"".join(map(_fact, facts(swatch)))}</div>',
    ]
    if judged:
        head = "<thead><tr><th>measure</th><th>here</th><th>held to</th><th></th></tr></thead>"
        body.append(f'<h2>How good it is</h2><div class="table"><table>{head}<tbody>{judged}</tbody></table></div>')
    body.append(f'<h2>Plots</h2><main class="plots">{"".join(map(figure, plots))}</main>')
    for title, items in (("What is absent, and why", absences(swatch)), ("Where it comes from", about)):
        if items:
            listed = "".join(f"<dt>{escape(what)}</dt><dd>{escape(text)}</dd>" for what, text in items)
            body.append(f"<h2>{title}</h2><dl>{listed}</dl>")
    return document(f"{swatch.name}: swatch report", body)


def document(title: str, body: Iterable[str], style: str = "", policy: str = POLICY) -> str:
    """A page in the style of reports: its title, escaped here, its parts, taken as they are, and further CSS."""
    css = files("hapscene.capture").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{css}{style}</style>\n</head>\n"
        "<body>\n" + "\n".join(body) + "\n</body>\n</html>\n"
    )


def _fact(fact: Fact) -> str:
    return (
        f'<div class="fact"><div class="label">{escape(fact.label)}</div><div class="value">{escape(fact.value)}</div>'
        f'<div class="detail">{escape(fact.detail)}</div></div>'
    )


def _row(row: Row) -> str:
    return (
        f'<tr><th>{escape(row.measure)}</th><td class="value">{escape(row.value)}</td>'
        f'<td class="to">{escape(row.held_to)}</td><td class="{row.verdict}">{MARKS[row.verdict]}</td></tr>'
    )


def figure(plot: Plot) -> str:
    """A plot as HTML, with its title and caption."""
    title, said = f"<h3>{escape(plot.title)}</h3>", escape(plot.caption)
    if not plot.svg:
        return f'<figure>{title}<div class="missing">{said}</div></figure>\n'
    drawing = plot.svg.replace("<svg", f'<svg role="img" aria-label="{escape(plot.alternative)}"', 1)
    return f"<figure>{title}{drawing}<figcaption>{said}</figcaption></figure>\n"


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
    about = [(what, getattr(swatch, what)) for what in TOOL_FIELDS if getattr(swatch, what)]
    about += [
        ("provenance", swatch.provenance or "not said"),
        ("licence", swatch.licence or "not said"),
        ("recording", _described(recording, source)),
    ]
    judged = [] if judgement is None else rows(judgement)
    return page(swatch, _lead(judgement, missing), judged, _plots(swatch, part, judgement, missing), about)


def _plots(swatch: Swatch, part: Part | None, judgement: Judgement | None, missing: str) -> list[Plot]:
    """All plots; those that cannot be drawn say what is missing."""
    texture = swatch.texture
    plots = [Plot("Spectra", "The swatch has no texture: sliding is silent.")] if texture is None else []
    why_not, held = missing, None
    if texture is not None and judgement is not None:  # none is judged without a texture
        why_not, held = f"Cannot be judged on held-out data: {judgement.why_not}", judgement.held_out
        plots.append(plot_models(texture) if held is None else plot_spectra(held))
        plots += [plot_spectrograms(judgement), plot_order(judgement.search, texture)]
        if held is not None:
            plots += [plot_bands(held), plot_life(held), plot_whiteness(held), plot_distribution(held)]
    else:
        plots += [] if texture is None else [plot_models(texture)]
        plots += [Plot("Spectrograms", missing), Plot("Order", missing)]
    if held is None:
        titles = "Level, band by band", "Life", "Residual: is it white?", "Residual: how is it distributed?"
        plots += [Plot(title, why_not) for title in titles]
    if texture is not None:
        plots.append(plot_plane(texture, None if part is None else part[0]))
    if part is not None and part[0].tangential_force_N is not None:
        plots.append(plot_friction(swatch, *part))
    else:
        reason = NEEDS_RECORDING if part is None else "The recording holds no tangential force and no friction."
        plots.append(Plot("Friction", reason))
    if swatch.taps is None:
        return [*plots, Plot("Taps", "The swatch has no taps: a touch is silent.")]
    plots.append(plot_taps(swatch.taps, swatch.intervals))
    return plots if swatch.taps.wave_m_s2 is None else [*plots, plot_transients(swatch.taps)]


def _lead(judgement: Judgement | None, missing: str) -> str:
    """The verdict in a sentence or two."""
    if judgement is None:
        return "Without a recording the swatch is shown and not judged." if missing == NEEDS_RECORDING else missing
    held = judgement.held_out
    if held is None:
        return f"The texture could not be judged on held-out data: {judgement.why_not}"
    short, alike = (
        [row.measure.split(" (")[0] for row in rows(judgement) if row.verdict == verdict]
        for verdict in ("short", "alike")
    )
    text = "Judged by the recording: a model of the first half is held against the second, which it has not seen. "
    if short:
        text += f"Short of what is asked: {', '.join(short)}. "
    if alike:
        text += f"Felt to differ, but no more than the halves themselves: {', '.join(alike)}. "
    return (
        text.strip() if short or alike else text + "Spectrum, level, centroid and bands differ by nothing that is felt."
    )


def _described(recording: SurfaceRecording | None, source: str) -> str:
    if recording is None:
        return "none given"
    seconds = len(recording.acceleration_m_s2) / recording.rate_Hz
    held = [word for name, word in WORDS.items() if getattr(recording, name) is not None]
    rms = float(np.std(recording.acceleration_m_s2))
    return (
        f"{source + ': ' if source else ''}{seconds:.2f} s at {recording.rate_Hz:g} Hz, "
        f"acceleration of {rms:.2g} m/s² rms, {', '.join(held) or 'no force and no speed: 1 N and 0.1 m/s assumed'}"
    )
