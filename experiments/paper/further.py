"""Beyond the paper: every compensator on four signals from 20 to 1000 Hz, and the order that perception needs."""

from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.capture.metric import band_power, model_spectrum, spectrum
from hapscene.capture.order_search import ORDERS, search_order
from hapscene.capture.report_plots import DOTTED, MUTED, Plot, drawn
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, smoothed, solve, tapered
from hapscene.handle.compensator import COMPENSATORS
from hapscene.perception import BAND_DB
from hapscene_benchmarks.handle import SIGNALS, judge, signals

from .finding import COLOURS, Array, Finding, Number
from .material import Material
from .prediction_figure import PAPER_ORDER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLANTS: Final = 8
"""Handles off by up to 30 % that each compensator is tried on [count]; the benchmark tries 100."""


def compensators() -> Finding:
    """Each compensator on each of the benchmark's signals: with the handle as it is known, and with others."""
    played, names = signals(), tuple(COMPENSATORS)
    errors = {(name, signal): judge(played[signal], name, PLANTS) for name in names for signal in SIGNALS}
    numbers = []
    for (name, signal), found in errors.items():
        for value, words in ((found.nominal, "handle as known"), (found.median, "all ±30 %, median")):
            numbers.append(Number(f"{name}, {signal}, {words}", 100.0 * value, "%"))

    def draw(axes: "Axes") -> None:
        for k, signal in enumerate(SIGNALS):
            at = np.arange(len(names)) + 0.19 * (k - 1.5)
            ends = 100.0 * np.array([(errors[name, signal].nominal, errors[name, signal].p95) for name in names])
            axes.vlines(at, ends[:, 0], ends[:, 1], color=COLOURS[k])
            axes.plot(at, ends[:, 0], "o", color=COLOURS[k], markersize=5, label=signal)
        axes.set_xticks(range(len(names)), names)
        axes.set(ylabel="spectrogram error [%]", yscale="log", ylim=(1.0, 200.0))
        axes.set_yticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
        axes.yaxis.minorticks_off()

    said = "A dot is the handle as the compensator knows it; the line goes up to the 95th percentile of the others."
    text = (
        f"Accelerations of 20 to 1000 Hz played through the assumed handle, and through {PLANTS} whose six parameters "
        "are each off by up to 30 %. “hapscene lab bench” does it with 100 handles, and times a sample."
    )
    plots = [Plot("Error by compensator", said, drawn("beyond-compensators", draw, 3.2, 4), said)]
    return Finding("Beyond: the compensators", text, numbers, plots)


def off_by_order(signal: Array, rate_Hz: float) -> tuple[Array, Array]:
    """Orders (k,), and how far the band levels of each are off those of the largest in its worst band (k,) [dB].

    Each half is fitted. The noise that drives the filter has the power that the filter leaves of the other half, so one
    that predicts badly there is too loud. The worst of the twelve bands that are felt and of both halves counts.
    """
    orders = np.array([order for order in ORDERS if order < len(signal) // 8])
    halves = np.array_split(signal, 2)
    lags = [autocorrelation(tapered(half, rate_Hz), int(orders[-1])) for half in halves]
    frequency, _ = spectrum(halves[0], rate_Hz)
    levels = np.empty((2, len(orders), 12))
    for own, other in ((0, 1), (1, 0)):
        r = smoothed(lags[own], rate_Hz)
        for i, order in enumerate(orders):
            a = solve(r[: order + 1])
            variance = float(residual_power(a, lags[other])) / len(halves[other])
            levels[own, i] = 10.0 * np.log10(band_power(model_spectrum(a, variance, rate_Hz, frequency), frequency))
    return orders.astype(np.float64), np.asarray(np.abs(levels - levels[:, -1:]).max(axis=(0, 2)))


def orders_by_perception(materials: dict[str, Material]) -> Finding:
    """Of every material: the paper's order, the search's, and perception's."""
    found, numbers = {}, list[Number]()
    for material in materials.values():
        signal, rate = material.streams.acceleration_m_s2, material.streams.rate_Hz
        orders, worst = off_by_order(signal, rate)
        smallest = int(orders[np.argmax(worst <= BAND_DB)])
        found[f"{material.title}: {smallest}"] = orders, worst
        numbers += [
            Number(f"{material.title}: smallest order within {BAND_DB:g} dB in every band", smallest),
            Number(f"{material.title}: order that our search chooses", search_order(signal, rate).chosen),
            Number(f"{material.title}: worst band of the paper's order", float(worst[orders == PAPER_ORDER][0]), "dB"),
        ]

    def draw(axes: "Axes") -> None:
        for (label, (orders, worst)), colour in zip(found.items(), COLOURS, strict=False):
            axes.plot(orders, worst, color=colour, label=label)
        axes.axhline(BAND_DB, color=MUTED, linestyle=DOTTED)
        axes.axvline(PAPER_ORDER, color=MUTED, linestyle=DOTTED)
        axes.set(xlabel="order of the model", ylabel="worst band off [dB]", ylim=(0.0, 8.0))

    said = f"Dotted: {BAND_DB:g} dB, which is just felt, and the paper's order, {PAPER_ORDER}."
    text = (
        "The smallest order whose levels in all twelve bands that are felt lie within 2 dB of those of order 160, on "
        "the half that was not fitted. One band decides; our search weighs the whole spectrum instead, and what is "
        "missed is to drown in what the two halves differ by anyway."
    )
    plots = [Plot("Order by perception", said, drawn("beyond-orders", draw, 3.2), said)]
    return Finding("Beyond: the order that perception needs", text, numbers, plots)
