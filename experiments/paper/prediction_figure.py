"""Figs. 2, 4 and 5: two materials touched; linear prediction of one of them; real against synthetic.

The acceleration a(t) is predicted from its n last samples, â(t) = −Σ a_k a(t−k); what is left, e = a − â, is near to
white noise. So white noise of its power, filtered by 1/A, is a new stretch of the same texture. Half of the stroke is
fitted, the other half judges.
"""

from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.capture.metric import level_difference_dB, log_spectral_distance, model_spectrum, residual, spectrum
from hapscene.capture.order_search import search_order
from hapscene.capture.report_plots import Plot, decibels, drawn, over_frequency
from hapscene.dsp.linear_prediction import autocorrelation, smoothed, solve, tapered
from hapscene.dsp.spectrogram import spectrogram_error

from .finding import COLOURS, REMEMBERED, UNKNOWN, Array, Finding, Number, spectrogram_panels, trace_panels
from .material import Material

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER_ORDER: Final = 120
"""Order of the paper's filters [count]."""

TWO: Final = ("wood", "leather")
"""The two materials that are shown."""

SEEN_S: Final = 0.05
"""Stretch of a prediction that is shown [s]."""

NOISE_FLOOR: Final = float(np.sqrt(2.0 - np.pi / 2.0))
"""Spectrogram error of two independent stretches of one Gaussian noise [1], whose magnitudes scatter after Rayleigh."""


def predictor(signal: Array, rate_Hz: float, order: int) -> Array:
    """The filter (order+1,), its first number 1, that leaves least of a signal (n,); its spectrum is smoothed."""
    return solve(smoothed(autocorrelation(tapered(signal, rate_Hz), order), rate_Hz))


def synthetic(a: Array, deviation_m_s2: float, count: int, seed: int = 0) -> Array:
    """White Gaussian noise of that deviation through 1/A: `count` samples, the filter already running."""
    from scipy.signal import lfilter

    noise = np.random.default_rng(seed).standard_normal(2 * count) * deviation_m_s2
    return np.asarray(lfilter([1.0], a, noise)[count:])


def two_materials(materials: dict[str, Material]) -> Finding:
    """Fig. 2."""
    numbers, plots = [], []
    for material in (materials[name] for name in TWO):
        signals = {
            "distance along the surface": 1e3 * material.distance_m,
            "normal force": material.force_N,
            "acceleration": material.acceleration_m_s2,
        }
        units = {"distance along the surface": "[mm]", "normal force": "[N]", "acceleration": "[m/s²]"}
        told = "Distance, force and acceleration over time while a tool is dragged over"
        drawing = trace_panels(f"fig2-{material.name}", material.t_s, signals, units)
        plots.append(Plot(material.title, f"{told} {material.name}.", drawing, f"{told} {material.name}."))
        numbers += [
            Number(f"{material.title}: mean force", float(material.force_N.mean()), "N", known=UNKNOWN),
            Number(
                f"{material.title}: acceleration, rms", float(material.cleaned_m_s2.std()), "m/s²", known=UNKNOWN,
                why="other materials, tools and hands",
            ),
        ]  # fmt: skip
    text = (
        "What a tool meets on two surfaces. These recordings hold speed and no position: the distance is the speed "
        "added up. They hold drags; taps and presses were not recorded. Which materials the paper shows is not known "
        "here."
    )
    return Finding("Fig. 2: two materials", text, tuple(numbers), tuple(plots))


def linear_prediction(material: Material) -> Finding:
    """Fig. 4: a, â and e, at the paper's order and at the one that is chosen here."""
    rate, (first, second) = material.rate_Hz, np.array_split(material.cleaned_m_s2, 2)
    chosen = search_order(material.cleaned_m_s2, rate).chosen
    numbers = [
        Number(
            f"order n, {material.title}", chosen, "1", PAPER_ORDER, REMEMBERED,
            "chosen here: the smallest order that misses nothing the recording supports; the paper's is fixed",
        )
    ]  # fmt: skip
    plots = []
    for order in dict.fromkeys((PAPER_ORDER, chosen)):
        e = residual(predictor(first, rate, order), second)
        a = second[order:]
        share = 100.0 * float(np.mean(e**2) / np.mean(a**2))
        numbers.append(
            Number(
                f"power left of the half not fitted, n = {order}", share, "%", known=UNKNOWN,
                why="hangs on the sample rate, the high-pass and the surface",
            )
        )  # fmt: skip
        seen = slice(0, round(SEEN_S * rate))
        rows = {"recorded a" if material.real else "a": a[seen], "predicted â": (a - e)[seen], "left e": e[seen]}
        drawing = trace_panels(f"fig4-{order}", material.t_s[seen], rows, "[m/s²]")
        said = f"Half a stroke was fitted; {1e3 * SEEN_S:.0f} ms of the other half: {share:.2g} % of its power is left."
        plots.append(Plot(f"{material.title}, n = {order}", said, drawing, "Acceleration, its prediction, the rest."))
    text = "The acceleration a, what n past samples predict of it, â, and what that leaves, e = a − â."
    return Finding("Fig. 4: linear prediction", text, tuple(numbers), tuple(plots))


def real_against_synthetic(material: Material) -> Finding:
    """Fig. 5: the half that was not fitted beside what the filters make of white noise."""
    rate, (first, second) = material.rate_Hz, np.array_split(material.cleaned_m_s2, 2)
    chosen = search_order(material.cleaned_m_s2, rate).chosen
    real = "recorded" if material.real else "the half not fitted"
    signals, spectra, numbers = {real: second}, {}, list[Number]()
    frequency, density = spectrum(second, rate)
    for order in dict.fromkeys((PAPER_ORDER, chosen)):
        a = predictor(first, rate, order)
        deviation = float(residual(a, first).std())
        made = synthetic(a, deviation, len(second))
        model = model_spectrum(a, deviation**2, rate, frequency)
        signals[f"synthetic, n = {order}"] = made
        spectra[f"synthetic, n = {order}"] = model
        error, distance = spectrogram_error(second, made, rate), log_spectral_distance(model, density, frequency)
        numbers += [
            Number(f"log-spectral distance, n = {order}", distance, "dB", known=UNKNOWN),
            Number(f"level of the synthetic, n = {order}", level_difference_dB(made, second), "dB", known=UNKNOWN),
            Number(
                f"spectrogram error, n = {order}", 100.0 * error, "%", known=UNKNOWN,
                why=f"other noise of exactly the same spectrum and level has {100.0 * NOISE_FLOOR:.1f} %",
            ),
        ]  # fmt: skip
    floor = log_spectral_distance(spectrum(first, rate)[1], density, frequency)
    numbers.append(Number("log-spectral distance of the two real halves", floor, "dB", known=UNKNOWN))

    def draw(axes: "Axes") -> None:
        lines = {real: density, **spectra}
        within = (frequency >= 20.0) & (frequency <= 1000.0)
        levels = {label: decibels(values) for label, values in lines.items()}
        for (label, level), colour, width in zip(levels.items(), COLOURS, (1.0, 1.8, 1.8), strict=False):
            axes.plot(frequency, level, color=colour, linewidth=width, label=label)
        shown = np.array([level[within] for level in levels.values()])
        over_frequency(axes, float(shown.min()), float(shown.max()))

    short = slice(0, round(0.2 * rate))
    t_s = material.t_s[short]
    drawings = (
        ("in time", trace_panels("fig5-time", t_s, {k: v[short] for k, v in signals.items()}, "[m/s²]")),
        ("in spectrum", drawn("fig5-spectrum", draw, 3.2, columns=1)),
        ("in spectrogram", spectrogram_panels("fig5-spectrogram", signals, rate)),
    )
    plots = (Plot(f"{material.title}: {where}", "", svg, f"Real and synthetic {where}.") for where, svg in drawings)
    text = (
        "White Gaussian noise of the power that the fitted half leaves, through the filter. Nothing is drawn from the "
        "half beside which it is shown."
    )
    return Finding("Fig. 5: real against synthetic", text, tuple(numbers), tuple(plots))
