"""Chooses the order of the AR models of a texture: the smallest whose error is small against that of the recording.

Two parts of a stroke have different spectra, by chance and because the hand moves differently. The spectral distance of
the two halves of the recording is therefore a lower limit for the distance between a model and new data, the floor. The
misfit of a model of order p, its distance from the spectrum to which it is fitted, adds to the floor in squares. A
misfit of 1/7 of the floor increases the distance to new data by 1 %. The smallest order with such a misfit is chosen.

The held-out distance alone is not a sufficient criterion: for a second of recording it varies by a tenth from one order
to the next by chance, and if the halves differ, it favours the lowest orders.

A plain filter of order p has a resolution of about rate/p: 220 Hz at order 46 and 10 kHz. If the spectrum falls towards
20 Hz, such a model is too loud there: on wood by 5.5 dB from 20 to 28 Hz at order 46, 2.2 dB at 88, 0.4 dB at 160. A
frequency-warped filter (`hapscene.dsp.warped_prediction`) has 7 times the resolution there: 0.8 dB at order 16.
`search_domain` chooses between the two by the band powers of held-out data.

White sensor noise above the spectrum of the surface increases the order of a plain AR model. If a model of lower order
plus white noise fits, it is chosen instead (`hapscene.capture.fit.whittle`).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.fit import distance as spectral
from hapscene.capture.fit.whittle import NoisyModel, over_noise
from hapscene.capture.io.streams import Array, kept_share
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.linear_prediction import autocorrelation, smoothed, solve_orders, tapered
from hapscene.dsp.warped_prediction import lag_count, warp_at, warped, warped_angle
from hapscene.perception import band_edges_Hz, band_jnd, bands_jnd

__all__ = [
    "DISTANCE_RATIO",
    "DOMAINS",
    "DOMAIN_JND",
    "MISFIT_DB",
    "MISFIT_RATIO",
    "OrderSearch",
    "perceptual_domain",
    "perceptual_order",
    "search_domain",
    "search_order",
]

ORDERS: Final = range(2, 161)
"""Orders that are tried. On the project's recordings, orders above 100 are no improvement."""

WARPED_ORDERS: Final = range(2, 61)
"""Orders of warped filters that are tried. On the project's recordings, orders above 30 are no improvement."""

DOMAINS: Final = ("auto", "plain", "warped")
"""Options for the frequency axis of the AR models."""

DOMAIN_JND: Final = 0.1
"""Smallest difference of held-out band powers by which one frequency axis counts as better [JND]: a fifth of a decibel.
Below it, the computing cost decides."""

WARPED_TAP: Final = 2.0
"""Computing cost per coefficient of a warped filter, relative to a plain one [1]: two passes instead of one."""

MISFIT_RATIO: Final = 0.14
"""Largest misfit relative to the floor [1]. On halves and quarters of wood, paper and leather at 5 and 10 kHz, compared
with the adjacent part, the distance was then 1.03 times that of the best order from 2 to 160 on average and at most
1.08; with 0.10 and 0.16 it was up to 1.11 and 1.10. Epoxy, whose parts differ, had 1.11."""

MISFIT_DB: Final = 0.5
"""Misfit that is always small enough [dB rms]: a third of the JND (1.65 dB, Israr et al. 2006). Without this limit, the
order would increase with the length of the recording to reproduce details of the high-pass."""

WARPED_MISFIT_DB: Final = 0.35
"""As `MISFIT_DB`, on the warped axis [dB rms]. With 0.5, the distance to the other half of leather was 1.10 times that
of the best plain order; with this value, it is 1.01."""

DISTANCE_RATIO: Final = 1.1
"""Largest held-out distance, relative to the best order, that is accepted if no order reaches the floor [1]."""

PERCEPTUAL_JND: Final = 0.75
"""Largest difference between a shipped texture and the model of the highest order [JND], rms over the bands."""

BANDS_HZ: Final = band_edges_Hz()
"""Edges of the bands for perceptual comparisons [Hz]."""

_DB: Final = 10.0 / np.log(10.0)


@dataclass(frozen=True)
class OrderSearch:
    """Result of the search over orders.

    Attributes:
        orders: (k,) orders that were tried.
        distance_dB: (k,) log-spectral distance between the model of one half and the other half, mean of both ways.
        misfit_dB: (k,) distance of the model of the whole recording from its spectrum.
        floor_dB: distance between the spectra of the two halves.
        allowed_dB: largest permitted misfit.
        plain: order of the model without sensor noise.
        noise: model with white sensor noise that needs a lower order, or None.
        band_jnd: (k,) difference between the model of one half and the other half in the bands, without level, rms of
            both ways [JND].
        warp: allpass coefficient of the frequency axis.
    """

    orders: NDArray[np.intp]
    distance_dB: Array
    misfit_dB: Array
    floor_dB: float
    allowed_dB: float
    plain: int
    noise: NoisyModel | None
    band_jnd: Array
    warp: float = 0.0

    @property
    def chosen(self) -> int:
        """The chosen order."""
        return self.plain if self.noise is None else self.noise.order


def perceptual_domain(acceleration_m_s2: Array, rate_Hz: float) -> tuple[int, float]:
    """Order and allpass coefficient of a shipped swatch: `perceptual_order` on the better frequency axis."""
    found = [search_order(acceleration_m_s2, rate_Hz, warp) for warp in sorted({0.0, warp_at(rate_Hz)})]
    orders = [perceptual_order(search, acceleration_m_s2, rate_Hz) for search in found]
    best = _better(found, orders)
    return orders[best], found[best].warp


def search_domain(acceleration_m_s2: Array, rate_Hz: float, domain: str = "auto") -> OrderSearch:
    """Searches the order on the plain or the warped frequency axis; "auto" chooses the axis on held-out data.

    Chooses the axis whose band powers predict the held-out half better by at least `DOMAIN_JND`; for smaller
    differences, the axis with the lower computing cost. If a plain model with sensor noise fits, it is chosen.
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
    """Index of the better of a plain and, if present, a warped search at the given orders."""
    jnd = [float(search.band_jnd[search.orders == order][0]) for search, order in zip(found, orders, strict=True)]
    if len(found) == 1 or jnd[0] < jnd[1] - DOMAIN_JND:
        return 0
    return int(jnd[1] < jnd[0] - DOMAIN_JND or WARPED_TAP * orders[1] < orders[0])


def perceptual_order(found: OrderSearch, acceleration_m_s2: Array, rate_Hz: float) -> int:
    """Smallest order of a texture that is perceptually equal to that of the highest order; for shipped swatches.

    Its held-out distance is within the floor (or `DISTANCE_RATIO` of the best). The model and those of all higher
    orders are within `PERCEPTUAL_JND` of the highest order and within one JND in each band. If possible, the bands are
    also within one JND of the recording."""
    frequency, density = spectral.spectrum(acceleration_m_s2, rate_Hz)
    models = _models(acceleration_m_s2, rate_Hz, found.orders, found.warp)
    rms, own_rms = _band_rms(spectral.model_spectrum(models, 1.0, rate_Hz, frequency, found.warp), density, frequency)
    difference = band_jnd(rms, rms[-1], BANDS_HZ)
    perceptible = (np.sqrt(np.mean(difference**2, axis=1)) > PERCEPTUAL_JND) | (difference.max(axis=1) > 1.0)
    enough = int(np.flatnonzero(perceptible)[-1]) + 1 if perceptible.any() else 0
    within = found.distance_dB <= max(found.floor_dB, DISTANCE_RATIO * found.distance_dB.min())
    near = within & (band_jnd(rms, own_rms, BANDS_HZ).max(axis=1) <= 1.0)
    usable = near if near[enough:].any() else within
    return int(found.orders[enough + int(np.argmax(usable[enough:]))])


def search_order(acceleration_m_s2: Array, rate_Hz: float, warp: float = 0.0) -> OrderSearch:
    """Fits models of all orders to a filtered recording and to its halves, and chooses the smallest sufficient order.

    The misfit must be at most `MISFIT_RATIO` of the floor or `MISFIT_DB` (`WARPED_MISFIT_DB` on the warped axis), and
    the held-out distance within the floor or `DISTANCE_RATIO` of the best. If no order satisfies both, the misfit
    decides. On the plain axis, a model with sensor noise of lower order is preferred if it fits."""
    tried = ORDERS if warp == 0.0 else WARPED_ORDERS
    orders = np.array([p for p in tried if p < len(acceleration_m_s2) // 8])
    middle = len(acceleration_m_s2) // 2
    halves = (acceleration_m_s2[:middle], acceleration_m_s2[middle:])
    spectra = [spectral.spectrum(half, rate_Hz) for half in halves]
    (frequency, first), (_, second) = spectra
    floor = spectral.log_spectral_distance(first, second, frequency)
    distance, band_jnd = _held_out(halves, spectra, orders, rate_Hz, warp)
    misfit = _misfit(acceleration_m_s2, orders, rate_Hz, warp)
    allowed = max(MISFIT_RATIO * floor, MISFIT_DB if warp == 0.0 else WARPED_MISFIT_DB)
    fits = misfit <= allowed
    within = fits & (distance <= max(floor, DISTANCE_RATIO * distance.min()))
    plain = int(orders[np.argmax(within if within.any() else fits)])
    noise = over_noise(acceleration_m_s2, rate_Hz, plain) if warp == 0.0 else None
    return OrderSearch(orders, distance, misfit, floor, allowed, plain, noise, band_jnd, warp)


def _lags(signal: Array, rate_Hz: float, orders: NDArray[np.intp], warp: float) -> Array:
    """Autocorrelation of a signal up to the lag that the highest order needs."""
    return autocorrelation(tapered(signal, rate_Hz), lag_count(int(orders[-1]), warp))


def _models(signal: Array, rate_Hz: float, orders: NDArray[np.intp], warp: float) -> Array:
    """Filters (k, p+1) of a signal for all orders, padded with zeros."""
    r = warped(smoothed(_lags(signal, rate_Hz, orders, warp), rate_Hz), int(orders[-1]), warp)
    return solve_orders(r)[orders - 1]


def _held_out(
    halves: tuple[Array, Array],
    spectra: list[tuple[Array, Array]],
    orders: NDArray[np.intp],
    rate_Hz: float,
    warp: float,
) -> tuple[Array, Array]:
    """Held-out distance and band difference (k,) of each order, by cross-validation between the halves."""
    distance, square = np.zeros((2, len(orders)))
    for own, other in ((0, 1), (1, 0)):
        a = _models(halves[own], rate_Hz, orders, warp)
        frequency, density = spectra[other]
        spectrum = spectral.model_spectrum(a, 1.0, rate_Hz, frequency, warp)
        distance += [0.5 * spectral.log_spectral_distance(model, density, frequency) for model in spectrum]
        high_passed = spectrum * kept_share(frequency)
        square += 0.5 * bands_jnd(*_band_rms(high_passed, density, frequency), BANDS_HZ) ** 2
    return distance, np.sqrt(square)


def _band_rms(spectrum: Array, density: Array, frequency_Hz: Array) -> tuple[Array, Array]:
    """Band rms of model spectra (k, f), scaled to the level of a recording, and of the recording (f,)."""
    power, own = (spectral.band_power(one, frequency_Hz, BANDS_HZ) for one in (spectrum, density))
    return np.sqrt(power * (own.sum() / power.sum(axis=-1, keepdims=True))), np.sqrt(own)


def _misfit(signal: Array, orders: NDArray[np.intp], rate_Hz: float, warp: float = 0.0) -> Array:
    """Misfit (k,) [dB rms] of each order to the smoothed spectrum of the recording, corrected for estimation noise.

    The reference is the model of the highest order. It contains estimation noise in the lags that a lower order does
    not use, with a variance of 2/n Σ w² of the logarithm, where w is the window on those lags (Blackman & Tukey). On
    the warped axis, the number of used lags is scaled by the stretch of the axis. Frequencies near the cut-off of the
    high-pass are omitted."""
    low_Hz, high_Hz = ACCELERATION_BAND_HZ
    frequency = np.arange(1.5 * low_Hz, min(high_Hz, 0.5 * rate_Hz), 0.5 / spectral.WINDOW_S)
    a = _models(signal, rate_Hz, orders, warp)
    models = 10.0 * np.log10(spectral.model_spectrum(a, 1.0, rate_Hz, frequency, warp))
    difference = models - models[-1]
    error = difference.var(axis=1)
    angle = 2.0 * np.pi * frequency / rate_Hz
    stretch = (warped_angle(angle + 1e-6, warp) - warped_angle(angle - 1e-6, warp)) / 2e-6
    window = smoothed(np.ones(lag_count(int(orders[-1]), warp) + 1), rate_Hz)
    used = np.interp(orders[:, None] * stretch, np.arange(len(window)), np.cumsum(window**2))
    chance = _DB**2 * 2.0 / len(signal) * (used[-1] - used).mean(axis=1)
    return np.asarray(np.sqrt(np.maximum(error - chance, 0.0)))
