"""The order of a texture's models: the smallest whose error drowns in what the recording itself leaves open.

Two stretches of one stroke differ: by chance, for a spectrum is known only as well as the recording is long, and
because a hand never does the same twice. That is the recording's floor: the distance between the spectra of its two
halves. What a filter of order p misses of the spectrum, its misfit, adds to that in squares, so a misfit of a seventh
of the floor raises the distance to unseen data by a hundredth. The smallest order that gets there is chosen.

To judge orders by their held-out distance alone was tried first, and is not enough: over a second of recording that
distance changes by a tenth from one order to the next by chance, and where the halves differ the lowest orders win.

A plain filter of order p resolves about rate/p: 220 Hz at order 46 and 10 kHz. So where a recording falls off towards
20 Hz, its model is too loud: on wood by 5.5 dB from 20 to 28 Hz at order 46, 2.2 dB at 88, 0.4 dB at 160. A warped one
(`hapscene.dsp.warped_prediction`) resolves 7 times as much there: 0.8 dB at order 16. Which of the two a surface gets
is told by the bands of held-out data (`search_domain`).

White noise of the sensor, where the surface's spectrum falls below it, drives up the order of a plain AR model. Where
a lower order misses nothing once such noise is part of the model, that is taken (`hapscene.capture.fit.whittle`).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.fit import distance as metric
from hapscene.capture.fit.whittle import NoisyModel, over_noise
from hapscene.capture.io.streams import Array, kept_share
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.linear_prediction import autocorrelation, residual_power, smoothed, solve_orders, tapered
from hapscene.dsp.warped_prediction import lag_count, predictor, warp_at, warped, warped_angle
from hapscene.perception import band_edges_Hz, band_jnd, bands_jnd

__all__ = [
    "DISTANCE_RATIO",
    "DOMAINS",
    "DOMAIN_JND",
    "MISFIT_DB",
    "MISFIT_RATIO",
    "OrderSearch",
    "felt_domain",
    "felt_order",
    "search_domain",
    "search_order",
]

ORDERS: Final = range(2, 161)
"""Orders that are tried. On the project's recordings nothing improves beyond 100."""

WARPED_ORDERS: Final = range(2, 61)
"""Orders of warped filters that are tried. On the project's recordings nothing improves beyond 30."""

DOMAINS: Final = ("auto", "plain", "warped")
"""Names of the frequency axes that a texture's filters may be made on."""

DOMAIN_JND: Final = 0.1
"""Difference of held-out bands by which one axis is taken to be better than the other [JND]. On less, a fifth of a
decibel, the taps decide."""

WARPED_TAP: Final = 2.0
"""What a tap of a warped filter costs, in taps of a plain one [1]: two passes instead of one."""

MISFIT_RATIO: Final = 0.14
"""Largest misfit, as a share of the recording's floor [1]. On halves and quarters of wood, paper and leather at 5 and
10 kHz, each judged by the stretch next to it, the distance was then 1.03 times the best of all orders 2 to 160 on
average and 1.08 at most; at 0.10 and at 0.16 it was up to 1.11 and 1.10. Epoxy, whose parts differ, had 1.11."""

MISFIT_DB: Final = 0.5
"""Misfit that is always small enough [dB rms]. No one feels three times as much (1.65 dB, Israr et al. 2006). Without
it the order grows without end with the length of a recording, after the last hertz of the high-pass."""

WARPED_MISFIT_DB: Final = 0.35
"""The same on the warped axis [dB rms], where taps are few: on halves of leather at 0.5 the distance to the other half
was 1.10 times the best plain order's, at this 1.01."""

DISTANCE_RATIO: Final = 1.1
"""How much worse than the best order's held-out distance the chosen order's may be, where none is within the floor."""

TOLD_JND: Final = 0.75
"""How far a shipped texture may be from the highest order tried [JND], root mean square over the bands."""

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
        band_jnd: (k,) how far a half's model, high-passed as the recording, is from the other half in the bands, level
            aside, both ways [JND rms].
        warp: of the frequency axis that the filters are made on.
    """

    orders: NDArray[np.intp]
    distance_dB: Array
    residual: Array
    misfit_dB: Array
    floor_dB: float
    allowed_dB: float
    plain: int
    noise: NoisyModel | None
    band_jnd: Array
    warp: float = 0.0

    @property
    def chosen(self) -> int:
        """The order chosen."""
        return self.plain if self.noise is None else self.noise.order


def felt_domain(acceleration_m_s2: Array, rate_Hz: float) -> tuple[int, float]:
    """The order and the warp of a swatch to ship: of the two axes that which `search_domain` takes, at `felt_order`."""
    found = [search_order(acceleration_m_s2, rate_Hz, warp) for warp in sorted({0.0, warp_at(rate_Hz)})]
    orders = [felt_order(search, acceleration_m_s2, rate_Hz) for search in found]
    best = _better(found, orders)
    return orders[best], found[best].warp


def search_domain(acceleration_m_s2: Array, rate_Hz: float, domain: str = "auto") -> OrderSearch:
    """The search on the plain axis, on the warped one, or with "auto" that of the two which does better on held-out
    data.

    Better is the one whose bands are nearer to those of the other half, by `DOMAIN_JND` or more; where they are as near
    as that, the one that costs less. Where a model over white noise explains all, there is nothing to be bettered.
    """
    warp = warp_at(rate_Hz)
    if domain == "warped" and warp > 0.0:
        return search_order(acceleration_m_s2, rate_Hz, warp)
    plain = search_order(acceleration_m_s2, rate_Hz)
    if domain != "auto" or warp == 0.0 or plain.noise is not None:
        return plain
    found = [plain, search_order(acceleration_m_s2, rate_Hz, warp)]
    return found[_better(found, [search.chosen for search in found])]


def _better(found: list[OrderSearch], orders: list[int]) -> int:
    """Which of a plain and a warped search, if there are both, is the better at those orders."""
    jnd = [float(search.band_jnd[search.orders == order][0]) for search, order in zip(found, orders, strict=True)]
    if len(found) == 1 or jnd[0] < jnd[1] - DOMAIN_JND:
        return 0
    return int(jnd[1] < jnd[0] - DOMAIN_JND or WARPED_TAP * orders[1] < orders[0])


def felt_order(found: OrderSearch, acceleration_m_s2: Array, rate_Hz: float) -> int:
    """The smallest order that a cleaned recording supports and whose lack a person cannot tell: for swatches to ship.

    That is the smallest whose held-out distance lies within the recording's floor (or `DISTANCE_RATIO` of the best) and
    which, as all above it, is within `TOLD_JND` of the highest tried and within one JND in every band; and whose bands
    are within one JND of the recording's, where there is such an order.
    """
    frequency, density = metric.spectrum(acceleration_m_s2, rate_Hz)
    models = _models(acceleration_m_s2, rate_Hz, found.orders, found.warp)
    rms, own_rms = _band_rms(metric.model_spectrum(models, 1.0, rate_Hz, frequency, found.warp), density, frequency)
    apart = band_jnd(rms, rms[-1], BANDS_HZ)
    told = (np.sqrt(np.mean(apart**2, axis=1)) > TOLD_JND) | (apart.max(axis=1) > 1.0)
    enough = int(np.flatnonzero(told)[-1]) + 1 if told.any() else 0
    within = found.distance_dB <= max(found.floor_dB, DISTANCE_RATIO * found.distance_dB.min())
    near = within & (band_jnd(rms, own_rms, BANDS_HZ).max(axis=1) <= 1.0)
    usable = near if near[enough:].any() else within
    return int(found.orders[enough + int(np.argmax(usable[enough:]))])


def search_order(acceleration_m_s2: Array, rate_Hz: float, warp: float = 0.0) -> OrderSearch:
    """Fits all orders to a cleaned recording and to its halves, and takes the smallest that misses nothing.

    That is the smallest whose misfit is at most `MISFIT_RATIO` of the floor or `MISFIT_DB` (on the warped axis
    `WARPED_MISFIT_DB`), and whose held-out distance is within the floor or `DISTANCE_RATIO` of the best. Where none has
    both, the misfit decides. Of plain models, one over white noise that misses nothing at a lower order goes before.
    """
    tried = ORDERS if warp == 0.0 else WARPED_ORDERS
    orders = np.array([p for p in tried if p < len(acceleration_m_s2) // 8])
    middle = len(acceleration_m_s2) // 2
    halves = (acceleration_m_s2[:middle], acceleration_m_s2[middle:])
    spectra = [metric.spectrum(half, rate_Hz) for half in halves]
    (frequency, first), (_, second) = spectra
    floor = metric.log_spectral_distance(first, second, frequency)
    distance, residual, band_jnd = _held_out(halves, spectra, orders, rate_Hz, warp)
    misfit = _misfit(acceleration_m_s2, orders, rate_Hz, warp)
    allowed = max(MISFIT_RATIO * floor, MISFIT_DB if warp == 0.0 else WARPED_MISFIT_DB)
    fits = misfit <= allowed
    within = fits & (distance <= max(floor, DISTANCE_RATIO * distance.min()))
    plain = int(orders[np.argmax(within if within.any() else fits)])
    noise = over_noise(acceleration_m_s2, rate_Hz, plain) if warp == 0.0 else None
    return OrderSearch(orders, distance, residual, misfit, floor, allowed, plain, noise, band_jnd, warp)


def _lags(signal: Array, rate_Hz: float, orders: NDArray[np.intp], warp: float) -> Array:
    """As much of a signal's autocorrelation as the highest order needs."""
    return autocorrelation(tapered(signal, rate_Hz), lag_count(int(orders[-1]), warp))


def _models(signal: Array, rate_Hz: float, orders: NDArray[np.intp], warp: float) -> Array:
    """The filters (k, p+1) of a signal, those of the lower orders with zeros after them."""
    r = warped(smoothed(_lags(signal, rate_Hz, orders, warp), rate_Hz), int(orders[-1]), warp)
    return solve_orders(r)[orders - 1]


def _held_out(
    halves: tuple[Array, Array],
    spectra: list[tuple[Array, Array]],
    orders: NDArray[np.intp],
    rate_Hz: float,
    warp: float,
) -> tuple[Array, Array, Array]:
    """Distance, residual and difference of bands (k,) of each order, each half judged by the model of the other."""
    distance, log_residual, square = np.zeros((3, len(orders)))
    for own, other in ((0, 1), (1, 0)):
        a = _models(halves[own], rate_Hz, orders, warp)
        frequency, density = spectra[other]
        spectrum = metric.model_spectrum(a, 1.0, rate_Hz, frequency, warp)
        distance += [0.5 * metric.log_spectral_distance(model, density, frequency) for model in spectrum]
        lags = _lags(halves[other], rate_Hz, orders, warp)
        log_residual += 0.5 * np.log(residual_power(predictor(a, warp), lags) / lags[0])
        heard = spectrum * kept_share(frequency)
        square += 0.5 * bands_jnd(*_band_rms(heard, density, frequency), BANDS_HZ) ** 2
    return distance, np.exp(log_residual), np.sqrt(square)


def _band_rms(spectrum: Array, density: Array, frequency_Hz: Array) -> tuple[Array, Array]:
    """Root mean squares in the bands of models' spectra (k, f), at the level of a recording's, and of its own (f,)."""
    power, own = (metric.band_power(one, frequency_Hz, BANDS_HZ) for one in (spectrum, density))
    return np.sqrt(power * (own.sum() / power.sum(axis=-1, keepdims=True))), np.sqrt(own)


def _misfit(signal: Array, orders: NDArray[np.intp], rate_Hz: float, warp: float = 0.0) -> Array:
    """What each order misses of the recording's own smoothed spectrum (k,) [dB rms], chance taken out.

    The spectrum is that of the highest order. Between it and a lower order lies also what chance puts into the lags
    that the lower one does not see: a variance of 2/n Σ w² of the logarithm, w the window on those lags (Blackman &
    Tukey). On a warped axis an order sees as many lags as the axis is stretched. Frequencies that the high-pass has
    bent are left out.
    """
    low_Hz, high_Hz = ACCELERATION_BAND_HZ
    frequency = np.arange(1.5 * low_Hz, min(high_Hz, 0.5 * rate_Hz), 0.5 / metric.WINDOW_S)
    a = _models(signal, rate_Hz, orders, warp)
    models = 10.0 * np.log10(metric.model_spectrum(a, 1.0, rate_Hz, frequency, warp))
    difference = models - models[-1]
    error = difference.var(axis=1)
    angle = 2.0 * np.pi * frequency / rate_Hz
    stretch = (warped_angle(angle + 1e-6, warp) - warped_angle(angle - 1e-6, warp)) / 2e-6
    window = smoothed(np.ones(lag_count(int(orders[-1]), warp) + 1), rate_Hz)
    seen = np.interp(orders[:, None] * stretch, np.arange(len(window)), np.cumsum(window**2))
    chance = _DB**2 * 2.0 / len(signal) * (seen[-1] - seen).mean(axis=1)
    return np.asarray(np.sqrt(np.maximum(error - chance, 0.0)))
