"""How much of a vibration a model explains, and whether what it leaves is noise: the residual of an AR model.

The residual e(t) = y(t) + Σ a_k y(t−k) is what would have to go into the model for the recording to come out. A model
that explains all there is to explain leaves white noise.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import CaptureError

Array = NDArray[np.float64]

LAG_COUNT: Final = 100
"""Lags that whiteness is judged over [count]: 10 ms at 10 kHz, which is two periods of 200 Hz."""


class LjungBox(NamedTuple):
    """A test of whiteness.

    Attributes:
        statistic: Q [1], expected to be near `freedom` for white noise.
        p_value: chance that white noise gives as large a Q [1].
        freedom: degrees of freedom of the χ² that Q is held against [count].
    """

    statistic: float
    p_value: float
    freedom: int


def residual(a: ArrayLike, acceleration_m_s2: ArrayLike) -> Array:
    """Residual (n−p,) [m/s²] of a signal (n,) under a filter a (p+1,), a[0] = 1; the first p samples are left out.

    Raises:
        CaptureError: the signal is not longer than the filter.
    """
    a, signal = np.asarray(a, dtype=np.float64), np.asarray(acceleration_m_s2, dtype=np.float64)
    if len(signal) <= len(a):
        raise CaptureError(f"{len(signal)} samples are too few for the residual of a model of order {len(a) - 1}")
    from scipy.signal import lfilter

    return np.asarray(lfilter(a, [1.0], signal)[len(a) - 1 :])


def variance_ratio(a: ArrayLike, acceleration_m_s2: ArrayLike) -> float:
    """Residual power over signal power, Σ e² / Σ y² [1] (the normalised error of Makhoul 1975).

    1 for a model that explains nothing, 1/power gain for the model that made the signal; it can exceed 1 for the
    model of another surface.
    """
    signal = np.asarray(acceleration_m_s2, dtype=np.float64)
    left = residual(a, signal)
    return float(np.mean(left**2) / np.mean(signal**2))


def correlation(signal: ArrayLike, lag_count: int = LAG_COUNT) -> Array:
    """Autocorrelation ρ_k of a signal for lags 1 … lag_count, (lag_count,) [1]; mean removed, biased (over n).

    For white noise each is normal with variance 1/n: 95 % lie within ±1.96/√n (Box & Jenkins 1970).
    """
    x = np.asarray(signal, dtype=np.float64)
    x = x - x.mean()
    size = 1 << (len(x) + lag_count).bit_length()
    r = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: lag_count + 1]
    return np.asarray(r[1:] / r[0])


def ljung_box(signal: ArrayLike, lag_count: int = LAG_COUNT, fitted: int = 0) -> LjungBox:
    """Tests whether a signal is white (Ljung & Box 1978, "On a measure of lack of fit in time series models").

    Q = n (n+2) Σ_k ρ_k² / (n−k) over lags 1 … lag_count, which for white noise is χ² of lag_count − `fitted` degrees
    of freedom. `fitted` is the order of the model where the signal is the residual of the data that the model was
    fitted to; 0 where it is the residual of held-out data. Long recordings fail it by correlations that no one feels:
    look at their size as well.

    Raises:
        CaptureError: more fitted than lags, or not more samples than lags.
    """
    from scipy.special import chdtrc

    signal = np.asarray(signal, dtype=np.float64)
    if not 0 <= fitted < lag_count < len(signal):
        raise CaptureError(f"{lag_count} lags must be more than {fitted} fitted and fewer than {len(signal)} samples")
    rho, count = correlation(signal, lag_count), len(signal)
    statistic = count * (count + 2.0) * np.sum(rho**2 / (count - np.arange(1, lag_count + 1)))
    return LjungBox(float(statistic), float(chdtrc(lag_count - fitted, statistic)), lag_count - fitted)


def excess_kurtosis(signal: ArrayLike) -> float:
    """Fourth central moment over the squared variance, less 3 [1]: 0 for Gaussian noise, above for bursts."""
    x = np.asarray(signal, dtype=np.float64)
    x = x - x.mean()
    return float(np.mean(x**4) / np.mean(x**2) ** 2 - 3.0)
