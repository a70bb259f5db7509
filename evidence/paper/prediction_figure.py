"""Figs. 2, 4 and 5: two materials touched; linear prediction of one of them; real against synthetic.

The acceleration a(t) is predicted from its n last samples, â(t) = −Σ a_k a(t−k); what is left, e = a − â, is near to
white noise. So white noise of its power, filtered by 1/A, is a new stretch of the same texture. Half of the stroke is
fitted, the other half judges.
"""

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.signal import lfilter

from hapscene.capture.fit.distance import level_difference_dB, log_spectral_distance, model_spectrum, residual, spectrum
from hapscene.capture.fit.order import search_order
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, smoothed, solve, tapered
from hapscene.dsp.spectrogram import spectrogram_error

from .finding import (
    COLOURS,
    REMEMBERED,
    Array,
    Finding,
    Number,
    Plot,
    decibels,
    drawn,
    spectrogram_panels,
    trace_panels,
)
from .material import Material

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER_ORDER: Final = 120
"""Order of the paper's filters [count]."""

NOISE_ERROR: Final = 100.0 * float(np.sqrt(2.0 - np.pi / 2.0))
"""Spectrogram error of two independent stretches of one Gaussian noise [%], whose magnitudes scatter after Rayleigh."""


def predictor(signal: Array, rate_Hz: float, order: int) -> tuple[Array, float]:
    """The filter (order+1,), its first number 1, that leaves least of a signal (n,) with a smoothed spectrum.

    And the standard deviation of the noise with which 1/A has the power of the signal [m/s²].
    """
    r = smoothed(autocorrelation(tapered(signal, rate_Hz), order), rate_Hz)
    a = solve(r)
    return a, float(np.sqrt(residual_power(a, r) / r[0] * np.mean(signal**2)))


def synthetic(a: Array, deviation_m_s2: float, count: int, seed: int = 0) -> Array:
    """White Gaussian noise of that deviation through 1/A: `count` samples, the filter already running."""
    return np.asarray(lfilter([1.0], a, np.random.default_rng(seed).normal(0.0, deviation_m_s2, 2 * count))[count:])


def two_materials(materials: dict[str, Material]) -> Finding:
    """Fig. 2."""
    finding = Finding("Fig. 2: two materials", _TWO, [], [])
    for material in (materials["wood"], materials["leather"]):
        s = material.streams
        distance_mm, t_s = 1e3 * np.cumsum(s.speed_m_s) / s.rate_Hz, np.arange(len(s.speed_m_s)) / s.rate_Hz
        signals = {"distance": distance_mm, "normal force": s.force_N, "acceleration": s.acceleration_m_s2}
        labels = dict(zip(signals, ("[mm]", "[N]", "[m/s²]"), strict=True))
        told = f"Distance, force and acceleration over time while a tool is dragged over {material.name}."
        drawing = trace_panels(f"fig2-{material.name}", t_s, signals, labels)
        finding.plots.append(Plot(material.title, told, drawing))
        finding.numbers.append(Number(f"{material.title}: mean force", float(s.force_N.mean()), "N"))
        rms = float(s.acceleration_m_s2.std())
        finding.numbers.append(Number(f"{material.title}: acceleration, rms", rms, "m/s²", why="other surfaces, tools"))
    return finding


_TWO: Final = (
    "What a tool meets on two surfaces; which ones the paper shows is not known here. The distance is the speed added "
    "up, for no position was recorded. Both are drags: taps and presses were not recorded either."
)


def linear_prediction(material: Material) -> Finding:
    """Fig. 4: a, â and e, at the paper's order and at the one that is chosen here."""
    s = material.streams
    first, second = np.array_split(s.acceleration_m_s2, 2)
    chosen = search_order(s.acceleration_m_s2, s.rate_Hz).chosen
    why = "ours is the smallest that misses nothing the recording supports; the paper's is one for all"
    numbers, plots = [Number(f"order n, {material.title}", chosen, "1", PAPER_ORDER, REMEMBERED, why)], []
    for order in dict.fromkeys((PAPER_ORDER, chosen)):
        e, a = residual(predictor(first, s.rate_Hz, order)[0], second), second[order:]
        left = 100.0 * float(np.mean(e**2) / np.mean(a**2))
        why = "hangs on sample rate, high-pass and surface"
        numbers.append(Number(f"power left of the half not fitted, n = {order}", left, "%", why=why))
        start = max(PAPER_ORDER, chosen) - order  # the same stretch for both
        seen = slice(start, start + round(0.05 * s.rate_Hz))
        rows = {"a": a[seen], "â, predicted": (a - e)[seen], "e, left": e[seen]}
        drawing = trace_panels(f"fig4-{order}", np.arange(seen.stop - start) / s.rate_Hz, rows, "[m/s²]")
        said = f"Half a stroke was fitted; 50 ms of the other half: {left:.2g} % of its power is left."
        plots.append(Plot(f"{material.title}, n = {order}", said, drawing))
    text = "The acceleration a, what n past samples predict of it, â, and what that leaves, e = a − â."
    return Finding("Fig. 4: linear prediction", text, numbers, plots)


def real_against_synthetic(material: Material) -> Finding:
    """Fig. 5: the half that was not fitted beside what the filters make of white noise."""
    rate = material.streams.rate_Hz
    first, second = np.array_split(material.streams.acceleration_m_s2, 2)
    chosen = search_order(material.streams.acceleration_m_s2, rate).chosen
    frequency, density = spectrum(second, rate)
    real = "recorded" if material.real else "the half not fitted"
    signals, spectra = {real: second}, {real: density}
    floor = log_spectral_distance(spectrum(first, rate)[1], density, frequency)
    numbers = [Number("log-spectral distance of the two real halves", floor, "dB")]
    for order in dict.fromkeys((PAPER_ORDER, chosen)):
        name, (a, deviation) = f"synthetic, n = {order}", predictor(first, rate, order)
        signals[name] = synthetic(a, deviation, len(second))
        spectra[name] = model_spectrum(a, deviation**2, rate, frequency)
        halves = f"the fitted half itself is {level_difference_dB(first, second):+.2f} dB off"
        noise = f"other noise of exactly the same spectrum and level has {NOISE_ERROR:.1f} %"
        error = 100.0 * spectrogram_error(second, signals[name], rate)
        numbers += [
            Number(
                f"log-spectral distance, n = {order}", log_spectral_distance(spectra[name], density, frequency), "dB"
            ),
            Number(f"level, n = {order}", level_difference_dB(signals[name], second), "dB", why=halves),
            Number(f"spectrogram error, n = {order}", error, "%", why=noise),
        ]

    def draw(axes: "Axes") -> None:
        levels = {label: decibels(values) for label, values in spectra.items()}
        for (label, level), colour, width in zip(levels.items(), COLOURS, (1.0, 1.8, 1.8), strict=False):
            axes.plot(frequency, level, color=colour, linewidth=width, label=label)
        shown = np.array(list(levels.values()))[:, (frequency >= 20.0) & (frequency <= 1000.0)]
        axes.set(
            xlabel="frequency [Hz]", ylabel="density [dB re 1 (m/s²)²/Hz]", xscale="log", xlim=ACCELERATION_BAND_HZ
        )
        axes.set_ylim(float(shown.min()) - 3.0, float(shown.max()) + 3.0)

    short = round(0.2 * rate)
    starts = {name: signal[:short] for name, signal in signals.items()}
    drawings = {
        "in time": trace_panels("fig5-time", np.arange(short) / rate, starts, "[m/s²]"),
        "in spectrum": drawn("fig5-spectrum", draw, 3.2),
        "in spectrogram": spectrogram_panels("fig5-spectrogram", signals, rate),
    }
    plots = [
        Plot(f"{material.title}: {where}", f"Real and synthetic, {where}.", svg) for where, svg in drawings.items()
    ]
    text = "White Gaussian noise of the power that the fitted half leaves, through the filter, beside the other half."
    return Finding("Fig. 5: real against synthetic", text, numbers, plots)
