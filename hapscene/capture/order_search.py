"""The order of a texture's models: the smallest whose error drowns in what the recording itself leaves open.

Two stretches of one stroke differ: by chance, for a spectrum is known only as well as the recording is long, and
because a hand never does the same twice. That is the recording's floor: the distance between the spectra of its two
halves. What a filter of order p misses of the spectrum, its misfit, adds to that in squares, so a misfit of a seventh
of the floor raises the distance to unseen data by a hundredth. The smallest order that gets there is chosen.

To judge orders by their held-out distance alone was tried first, and is not enough: over a second of recording that
distance changes by a tenth from one order to the next by chance, and where the halves differ the lowest orders win.

A filter of order p resolves about rate/p: 220 Hz at order 46 and 10 kHz. So where a recording falls off towards 20 Hz,
its model is too loud: on wood by 5.5 dB from 20 to 28 Hz at order 46, 2.2 dB at 88, 0.4 dB at 160, whatever the
frequencies are weighted with. The search does not pay for that: 20 to 50 Hz are 3 % of the felt frequencies, and with
the order that they ask for, paper's distance to unseen data is 1.12 times the best.

White noise of the sensor, where the surface's spectrum falls below it, drives up the order of a plain AR model. Where
a lower order misses nothing once such noise is part of the model, that is taken (`hapscene.capture.whittle`).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture import metric
from hapscene.capture.streams import Array
from hapscene.capture.whittle import NoisyModel, over_noise
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, smoothed, solve, tapered
from hapscene.perception import band_edges_Hz, bands_jnd

ORDERS: Final = range(2, 161)
"""Orders that are tried. On the project's recordings nothing improves beyond 100."""

MISFIT_RATIO: Final = 0.14
"""Largest misfit, as a share of the recording's floor [1]. On halves and quarters of wood, paper and leather at 5 and
10 kHz, each judged by the stretch next to it, the distance was then 1.03 times the best of all orders 2 to 160 on
average and 1.08 at most; at 0.10 and at 0.16 it was up to 1.11 and 1.10. Epoxy, whose parts differ, had 1.11."""

MISFIT_DB: Final = 0.5
"""Misfit that is always small enough [dB rms]. No one feels three times as much (1.65 dB, Israr et al. 2006). Without
it the order grows without end with the length of a recording, after the last hertz of the high-pass."""

DISTANCE_RATIO: Final = 1.1
"""How much worse than the best order's held-out distance the chosen order's may be, where none is within the floor."""

TOLD_JND: Final = 0.75
"""How far a shipped texture may be from the highest order tried [JND], root mean square over the bands. At a whole JND
wood's order is 34 and its tail below 28 Hz, too loud, makes the handle's error 4.2 %; at this one it is 3.7 %."""

BANDS_HZ: Final = band_edges_Hz()
"""Edges of the bands in which it is judged whether a person can tell [Hz]."""

_DB: Final = 10.0 / np.log(10.0)


@dataclass(frozen=True)
class OrderSearch:
    """What was found for each order.

    Attributes:
        orders: (k,) orders tried.
        distance_dB: (k,) log-spectral distance of a half's model and the other half, mean of both ways.
        residual: (k,) held-out residual power over signal power, geometric mean of both ways.
        misfit_dB: (k,) what the model of the whole recording misses of its spectrum.
        floor_dB: the distance between the spectra of the two halves themselves.
        allowed_dB: the largest misfit that does not matter.
        plain: the order that a plain AR model needs.
        noise: the model over white noise that needs less, or None where there is none.
    """

    orders: NDArray[np.intp]
    distance_dB: Array
    residual: Array
    misfit_dB: Array
    floor_dB: float
    allowed_dB: float
    plain: int
    noise: NoisyModel | None

    @property
    def chosen(self) -> int:
        """The order chosen."""
        return self.plain if self.noise is None else self.noise.order


def felt_order(acceleration_m_s2: Array, rate_Hz: float) -> int:
    """The smallest order that a cleaned recording supports and whose lack a person cannot tell: for swatches to ship.

    That is the smallest whose held-out distance lies within the recording's floor (or `DISTANCE_RATIO` of the best) and
    which, as all above it, is within `TOLD_JND` of the highest tried.
    """
    found = search_order(acceleration_m_s2, rate_Hz)
    r, edges = smoothed(autocorrelation(tapered(acceleration_m_s2, rate_Hz), int(found.orders[-1])), rate_Hz), BANDS_HZ
    frequency = np.arange(edges[0], edges[-1])
    models = [metric.model_spectrum(solve(r[: p + 1]), 1.0, rate_Hz, frequency) for p in found.orders]
    power = np.add.reduceat(np.array(models), np.searchsorted(frequency, edges[:-1]), axis=1)
    rms = np.sqrt(power / power.sum(axis=1, keepdims=True)) * acceleration_m_s2.std()
    told = bands_jnd(rms, rms[-1], edges) > TOLD_JND
    enough = int(np.flatnonzero(told)[-1]) + 1 if told.any() else 0
    within = found.distance_dB <= max(found.floor_dB, DISTANCE_RATIO * found.distance_dB.min())
    return int(found.orders[max(enough, int(np.argmax(within)))])


def search_order(acceleration_m_s2: Array, rate_Hz: float) -> OrderSearch:
    """Fits all orders to a cleaned recording and to its halves, and takes the smallest that misses nothing.

    That is the smallest whose misfit is at most `MISFIT_RATIO` of the floor or `MISFIT_DB`, and whose held-out
    distance is within the floor or `DISTANCE_RATIO` of the best. Where none has both, the misfit decides. A model over
    white noise that misses nothing at a lower order goes before.
    """
    orders = np.array([p for p in ORDERS if p < len(acceleration_m_s2) // 8])
    middle = len(acceleration_m_s2) // 2
    halves = (acceleration_m_s2[:middle], acceleration_m_s2[middle:])
    spectra = [metric.spectrum(half, rate_Hz) for half in halves]
    (frequency, first), (_, second) = spectra
    floor = metric.log_spectral_distance(first, second, frequency)
    distance, residual = _held_out(halves, spectra, orders, rate_Hz)
    misfit = _misfit(acceleration_m_s2, orders, rate_Hz)
    allowed = max(MISFIT_RATIO * floor, MISFIT_DB)
    fits = misfit <= allowed
    within = fits & (distance <= max(floor, DISTANCE_RATIO * distance.min()))
    plain = int(orders[np.argmax(within if within.any() else fits)])
    noise = over_noise(acceleration_m_s2, rate_Hz, plain)
    return OrderSearch(orders, distance, residual, misfit, floor, allowed, plain, noise)


def _held_out(
    halves: tuple[Array, Array], spectra: list[tuple[Array, Array]], orders: NDArray[np.intp], rate_Hz: float
) -> tuple[Array, Array]:
    """Distance and residual (k,) of each order, each half judged by the model of the other."""
    lags = [autocorrelation(tapered(half, rate_Hz), int(orders[-1])) for half in halves]
    distance, log_residual = np.zeros(len(orders)), np.zeros(len(orders))
    for own, other in ((0, 1), (1, 0)):
        r = smoothed(lags[own], rate_Hz)
        frequency, density = spectra[other]
        for i, order in enumerate(orders):
            a = solve(r[: order + 1])
            model = metric.model_spectrum(a, 1.0, rate_Hz, frequency)
            distance[i] += 0.5 * metric.log_spectral_distance(model, density, frequency)
            log_residual[i] += 0.5 * np.log(residual_power(a, lags[other]) / lags[other][0])
    return distance, np.exp(log_residual)


def _misfit(signal: Array, orders: NDArray[np.intp], rate_Hz: float) -> Array:
    """What each order misses of the recording's own smoothed spectrum (k,) [dB rms], chance taken out.

    The spectrum is that of the highest order. Between it and a lower order lies also what chance puts into the lags
    that the lower one does not see: a variance of 2/n Σ w² of the logarithm, w the window on those lags (Blackman &
    Tukey). Frequencies that the high-pass has bent are left out.
    """
    r = smoothed(autocorrelation(tapered(signal, rate_Hz), int(orders[-1])), rate_Hz)
    low_Hz, high_Hz = ACCELERATION_BAND_HZ
    frequency = np.arange(1.5 * low_Hz, min(high_Hz, 0.5 * rate_Hz), 0.5 / metric.WINDOW_S)
    models = [10.0 * np.log10(metric.model_spectrum(solve(r[: p + 1]), 1.0, rate_Hz, frequency)) for p in orders]
    difference = np.array(models) - models[-1]
    error = difference.var(axis=1)
    window = smoothed(np.ones(len(r)), rate_Hz)
    unseen = np.cumsum(window[::-1] ** 2)[::-1]
    chance = _DB**2 * 2.0 / len(signal) * (unseen[orders] - window[orders] ** 2)
    return np.asarray(np.sqrt(np.maximum(error - chance, 0.0)))
