"""Figs. 2, 4 and 5: drags over two materials; linear prediction; recorded and synthetic acceleration.

The acceleration a(t) is predicted from its n previous samples: â(t) = −Σ a_k a(t−k). The residual e = a − â is nearly
white. White noise of the power of e, filtered by 1/A, is therefore new acceleration of the same texture. As in the
paper, signals are at 5000 Hz. The filter is fitted to the first half of a stroke and judged on the second half.
"""

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.signal import lfilter, resample_poly

from hapscene.capture.fit.distance import level_difference_dB, log_spectral_distance, model_spectrum, residual, spectrum
from hapscene.capture.fit.order import search_order
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, smoothed, solve, tapered
from hapscene.dsp.spectrogram import decibels, spectrogram_error

from .material import Material
from .result import COLOURS, Array, FigureResult, Number, Plot, drawn, spectrogram_panels, trace_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER_ORDER: Final = 120
"""Order of the filter in the paper's Fig. 4 [coefficients]."""

PAPER_RATE_HZ: Final = 5000.0
"""Sample rate of the paper's recordings (Section 3, Texture Modeling) [Hz]."""

NOISE_ERROR: Final = 100.0 * float(np.sqrt(2.0 - np.pi / 2.0))
"""Spectrogram error between two independent stretches of the same Gaussian noise [%]: magnitudes are Rayleigh."""


def predictor(signal: Array, rate_Hz: float, order: int) -> tuple[Array, float]:
    """Return the linear prediction filter of a signal (n,) with a smoothed spectrum.

    Returns:
        The filter A (order+1,) with a leading 1, and the standard deviation [m/s²] of the white noise for which 1/A
        has the power of the signal.
    """
    r = smoothed(autocorrelation(tapered(signal, rate_Hz), order), rate_Hz)
    a = solve(r)
    return a, float(np.sqrt(residual_power(a, r) / r[0] * np.mean(signal**2)))


def synthetic(a: Array, deviation_m_s2: float, count: int, seed: int = 0) -> Array:
    """Return `count` samples of white Gaussian noise filtered by 1/A, after the filter's transient."""
    return np.asarray(lfilter([1.0], a, np.random.default_rng(seed).normal(0.0, deviation_m_s2, 2 * count))[count:])


def at_paper_rate(material: Material) -> Array:
    """Return the acceleration (n,) [m/s²] of a material at `PAPER_RATE_HZ`."""
    return np.asarray(
        resample_poly(material.streams.acceleration_m_s2, 1, round(material.streams.rate_Hz / PAPER_RATE_HZ))
    )


def two_materials(materials: dict[str, Material]) -> FigureResult:
    """Reproduce Fig. 2."""
    numbers, plots = list[Number](), list[Plot]()
    for material in (materials["wood"], materials["leather"]):
        s = material.streams
        distance_mm, t_s = 1e3 * np.cumsum(s.speed_m_s) / s.rate_Hz, np.arange(len(s.speed_m_s)) / s.rate_Hz
        signals = {"distance": distance_mm, "normal force": s.force_N, "acceleration": s.acceleration_m_s2}
        labels = dict(zip(signals, ("[mm]", "[N]", "[m/s²]"), strict=True))
        caption = f"Distance, normal force and acceleration over time of a tool dragged over {material.name}."
        plots.append(Plot(material.title, caption, trace_panels(f"fig2-{material.name}", t_s, signals, labels)))
        numbers.append(Number(f"{material.title}: mean force", float(s.force_N.mean()), "N"))
        numbers.append(Number(f"{material.title}: acceleration, rms", float(s.acceleration_m_s2.std()), "m/s²"))
    text = (
        "The paper shows plastic and foam, touched with a stylus that holds an accelerometer; no recording of them is "
        "available here. Wood and leather replace them. The distance is the integral of the speed, because the "
        "recordings hold no position. Both are drags: taps and presses were not recorded."
    )
    return FigureResult("Fig. 2: two materials", text, numbers, plots)


def linear_prediction(material: Material) -> FigureResult:
    """Reproduce Fig. 4: a, â and e at the paper's order and at the order that `search_order` chooses."""
    s, signal = material.streams, at_paper_rate(material)
    first, second = np.array_split(signal, 2)
    chosen = search_order(signal, PAPER_RATE_HZ).chosen
    note = "the smallest order within one JND of the highest order; another surface"
    by_hand = "another surface, moved freely by hand"
    caption = "Fig. 4, caption"
    numbers = [
        Number(f"order n, {material.title}, at {PAPER_RATE_HZ:g} Hz", chosen, "1", PAPER_ORDER, caption, note),
        Number("mean speed", 100.0 * float(s.speed_m_s.mean()), "cm/s", 4.0, caption, by_hand),
        Number("mean force", float(s.force_N.mean()), "N", 1.5, caption, by_hand),
    ]
    plots = []
    for order in dict.fromkeys((PAPER_ORDER, chosen)):
        e, a = residual(predictor(first, PAPER_RATE_HZ, order)[0], second), second[order:]
        left = 100.0 * float(np.mean(e**2) / np.mean(a**2))
        numbers.append(Number(f"residual power on the half that was not fitted, n = {order}", left, "%"))
        start = max(PAPER_ORDER, chosen) - order  # the same stretch for both orders
        stretch = slice(start, start + round(0.05 * PAPER_RATE_HZ))
        rows = {"a": a[stretch], "â, predicted": (a - e)[stretch], "e, residual": e[stretch]}
        drawing = trace_panels(f"fig4-{order}", np.arange(stretch.stop - start) / PAPER_RATE_HZ, rows, "[m/s²]")
        text = f"50 ms of the half that was not fitted; its residual power is {left:.2g} %."
        plots.append(Plot(f"{material.title}, n = {order}", text, drawing))
    text = (
        "The acceleration a, its prediction â from the n previous samples, and the residual e = a − â. The paper shows "
        "organza on a stiff substrate, touched with a plastic probe."
    )
    return FigureResult("Fig. 4: linear prediction", text, numbers, plots)


def real_against_synthetic(material: Material) -> FigureResult:
    """Reproduce Fig. 5: the half that was not fitted beside filtered white noise."""
    rate, signal = PAPER_RATE_HZ, at_paper_rate(material)
    first, second = np.array_split(signal, 2)
    chosen = search_order(signal, rate).chosen
    frequency, density = spectrum(second, rate)
    real = "recorded" if material.recorded else "half that was not fitted"
    signals, spectra = {real: second}, {real: density}
    floor = log_spectral_distance(spectrum(first, rate)[1], density, frequency)
    numbers = [Number("log-spectral distance between the two halves of the stroke", floor, "dB")]
    for order in dict.fromkeys((PAPER_ORDER, chosen)):
        name, (a, deviation) = f"synthetic, n = {order}", predictor(first, rate, order)
        signals[name] = synthetic(a, deviation, len(second))
        spectra[name] = model_spectrum(a, deviation**2, rate, frequency)
        distance = log_spectral_distance(spectra[name], density, frequency)
        error = 100.0 * spectrogram_error(second, signals[name], rate)
        halves = f"the fitted half itself differs by {level_difference_dB(first, second):+.2f} dB"
        noise = f"two stretches of the same Gaussian noise differ by {NOISE_ERROR:.1f} %"
        numbers += [
            Number(f"log-spectral distance, n = {order}", distance, "dB"),
            Number(f"level difference, n = {order}", level_difference_dB(signals[name], second), "dB", note=halves),
            Number(f"spectrogram error, n = {order}", error, "%", note=noise),
        ]

    def draw(axes: "Axes") -> None:
        levels = {label: decibels(np.sqrt(values)) for label, values in spectra.items()}
        for (label, level), colour, width in zip(levels.items(), COLOURS, (1.0, 1.8, 1.8), strict=False):
            axes.plot(frequency, level, color=colour, linewidth=width, label=label)
        low_Hz, high_Hz = ACCELERATION_BAND_HZ
        inside = np.array(list(levels.values()))[:, (frequency >= low_Hz) & (frequency <= high_Hz)]
        axes.set(
            xlabel="frequency [Hz]", ylabel="density [dB re 1 (m/s²)²/Hz]", xscale="log", xlim=ACCELERATION_BAND_HZ
        )
        axes.set_ylim(float(inside.min()) - 3.0, float(inside.max()) + 3.0)

    short = round(0.2 * rate)
    starts = {name: signal[:short] for name, signal in signals.items()}
    drawings = {
        "time domain": trace_panels("fig5-time", np.arange(short) / rate, starts, "[m/s²]"),
        "spectrum": drawn("fig5-spectrum", draw, 3.2),
        "spectrogram": spectrogram_panels("fig5-spectrogram", signals, rate),
    }
    plots = [
        Plot(f"{material.title}: {where}", f"Real and synthetic: {where}.", svg) for where, svg in drawings.items()
    ]
    text = (
        "White Gaussian noise of the residual power of the fitted half, filtered by 1/A, beside the other half. The "
        "paper shows the same conditions and filter as in its Fig. 4."
    )
    return FigureResult("Fig. 5: real and synthetic acceleration", text, numbers, plots)
