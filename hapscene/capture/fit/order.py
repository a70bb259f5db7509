"""Chooses the order of the AR models of a texture: the smallest one whose vibration feels like that of the highest.

This is the only criterion for an order in hapscene; docs/explanation/texture-model.md explains it. In twelve bands from
20 to 1000 Hz, the levels of the model and of all higher orders differ by less than one JND from those of the highest
order, and if possible from those of the recording. The spectral distance to the half of the recording that was not
fitted is no larger than that of the two halves, the floor, or hardly larger than at the best order: more coefficients
would describe this recording, not the surface.

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
from hapscene.dsp.linear_prediction import autocorrelation, smoothed, solve_orders, tapered
from hapscene.dsp.warped_prediction import lag_count, warp_at, warped
from hapscene.perception import band_edges_Hz, band_jnd, bands_jnd

__all__ = ["DOMAINS", "PERCEPTUAL_JND", "OrderSearch", "search_domain", "search_order"]

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

DISTANCE_RATIO: Final = 1.1
"""Largest held-out distance, relative to the best order, that is accepted if no order reaches the floor [1]."""

PERCEPTUAL_JND: Final = 0.75
"""Largest difference of a model from that of the highest order [JND], rms over the bands; one JND in each band."""

BANDS_HZ: Final = band_edges_Hz()
"""Edges of the bands for perceptual comparisons [Hz]."""


@dataclass(frozen=True)
class OrderSearch:
    """Result of the search over orders.

    Attributes:
        orders: (k,) orders that were tried.
        distance_dB: (k,) log-spectral distance between the model of one half and the other half, mean of both ways.
        difference_jnd: (k,) difference of the model of the whole recording from that of the highest order, rms over the
            bands [JND].
        floor_dB: distance between the spectra of the two halves.
        plain: order of the model without sensor noise.
        noise: model with white sensor noise that needs a lower order, or None.
        band_jnd: (k,) difference between the model of one half and the other half in the bands, without level, rms of
            both ways [JND].
        warp: allpass coefficient of the frequency axis.
    """

    orders: NDArray[np.intp]
    distance_dB: Array
    difference_jnd: Array
    floor_dB: float
    plain: int
    noise: NoisyModel | None
    band_jnd: Array
    warp: float = 0.0

    @property
    def chosen(self) -> int:
        """The chosen order."""
        return self.plain if self.noise is None else self.noise.order


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
    other = search_order(acceleration_m_s2, rate_Hz, warp)
    jnd = [float(search.band_jnd[search.orders == search.chosen][0]) for search in (plain, other)]
    if abs(jnd[1] - jnd[0]) > DOMAIN_JND:
        return other if jnd[1] < jnd[0] else plain
    return other if WARPED_TAP * other.chosen < plain.chosen else plain


def search_order(acceleration_m_s2: Array, rate_Hz: float, warp: float = 0.0) -> OrderSearch:
    """Fits models of all orders to a filtered recording and to its halves, and chooses the smallest sufficient order.

    On the plain axis, a model with sensor noise of lower order is preferred if it fits.
    """
    tried = ORDERS if warp == 0.0 else WARPED_ORDERS
    orders = np.array([p for p in tried if p < len(acceleration_m_s2) // 8])
    middle = len(acceleration_m_s2) // 2
    halves = (acceleration_m_s2[:middle], acceleration_m_s2[middle:])
    spectra = [spectral.spectrum(half, rate_Hz) for half in halves]
    (frequency, first), (_, second) = spectra
    floor = spectral.log_spectral_distance(first, second, frequency)
    distance, held_jnd = _held_out(halves, spectra, orders, rate_Hz, warp)
    frequency, density = spectral.spectrum(acceleration_m_s2, rate_Hz)
    models = _models(acceleration_m_s2, rate_Hz, orders, warp)
    rms, own_rms = _band_rms(spectral.model_spectrum(models, 1.0, rate_Hz, frequency, warp), density, frequency)
    difference = band_jnd(rms, rms[-1], BANDS_HZ)
    difference_jnd = np.sqrt(np.mean(difference**2, axis=1))
    perceptible = (difference_jnd > PERCEPTUAL_JND) | (difference.max(axis=1) > 1.0)
    enough = int(np.flatnonzero(perceptible)[-1]) + 1 if perceptible.any() else 0
    within = distance <= max(floor, DISTANCE_RATIO * distance.min())
    near = within & (band_jnd(rms, own_rms, BANDS_HZ).max(axis=1) <= 1.0)
    usable = near if near[enough:].any() else within
    order = int(orders[enough + int(np.argmax(usable[enough:]))])
    noise = over_noise(acceleration_m_s2, rate_Hz, order) if warp == 0.0 else None
    return OrderSearch(orders, distance, difference_jnd, floor, order, noise, held_jnd, warp)


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
