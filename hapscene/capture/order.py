"""The order of a texture's models, chosen on data that they were not fitted to."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture import metric
from hapscene.capture.linear_prediction import autocorrelation, residual_power, solve, tapered
from hapscene.constants import ACCELERATION_BAND_HZ

Array = NDArray[np.float64]

ORDERS: Final = range(2, 161)
"""Orders that are tried. On the project's recordings nothing improves beyond 80."""

DISTANCE_RATIO: Final = 1.06
"""How much worse than the best order's log-spectral distance a chosen order's may be [1]."""

RESIDUAL_RATIO: Final = 1.07
"""How much worse than the best residual power of those orders the chosen order's may be [1]. The distance alone is
flat and noisy on recordings of a second: there it chose orders 2 to 10, where 30 to 60 were up to 40 % nearer to the
next second. The residual weighs every sample and is steady. Both ratios are the best of a grid on the project's
recordings, each half judged by the other: the distance was then 1.08 times the best of all orders on average."""


@dataclass(frozen=True)
class OrderSearch:
    """What was found for each order, each half of the recording judged by the model of the other half.

    Attributes:
        orders: (k,) orders tried.
        distance_dB: (k,) log-spectral distance of model and held-out half, mean of both ways.
        residual: (k,) held-out residual power over signal power, geometric mean of both ways.
        floor_dB: the distance between the spectra of the two halves themselves.
        chosen: the order chosen.
    """

    orders: NDArray[np.intp]
    distance_dB: Array
    residual: Array
    floor_dB: float
    chosen: int


def search_order(
    acceleration_m_s2: Array,
    rate_Hz: float,
    band_Hz: tuple[float, float] = ACCELERATION_BAND_HZ,
) -> OrderSearch:
    """Fits all orders to one half of a cleaned recording and judges them by the other, and the other way round.

    Chosen is, among the orders whose distance is within `DISTANCE_RATIO` of the best (and, where any order gets
    there, within the recording's own floor), the smallest whose residual is within `RESIDUAL_RATIO` of theirs. Unlike
    AIC and BIC, which chose 31 to 221 on the project's recordings, this asks for nothing that does not also hold on
    the next second of the same surface.
    """
    orders = np.array([p for p in ORDERS if p < len(acceleration_m_s2) // 8])
    middle = len(acceleration_m_s2) // 2
    halves = (acceleration_m_s2[:middle], acceleration_m_s2[middle:])
    spectra = [metric.spectrum(half, rate_Hz) for half in halves]
    lags = [autocorrelation(tapered(half, rate_Hz), int(orders[-1])) for half in halves]
    frequency = spectra[0][0]
    distance, log_residual = np.zeros(len(orders)), np.zeros(len(orders))
    for own, other in ((0, 1), (1, 0)):
        for i, order in enumerate(orders):
            a = solve(lags[own][: order + 1])
            model = metric.model_spectrum(a, 1.0, rate_Hz, frequency)
            distance[i] += 0.5 * metric.log_spectral_distance(model, spectra[other][1], frequency, band_Hz)
            log_residual[i] += 0.5 * np.log(residual_power(a, lags[other]) / lags[other][0])
    floor = metric.log_spectral_distance(spectra[0][1], spectra[1][1], frequency, band_Hz)
    bound = DISTANCE_RATIO * distance.min()
    if floor >= distance.min():
        bound = min(bound, floor)
    near = distance <= bound
    near &= log_residual <= log_residual[near].min() + np.log(RESIDUAL_RATIO)
    return OrderSearch(orders, distance, np.exp(log_residual), floor, int(orders[np.argmax(near)]))
