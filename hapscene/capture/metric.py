"""How near a model is to a recording, as numbers.

Spectra are compared as Welch's estimate with Hann windows of `WINDOW_S`, half overlapping, because that is what the
reference numbers of the project were measured with.
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_BAND_HZ

Array = NDArray[np.float64]

WINDOW_S: Final = 0.1024
"""Length of the windows that spectra are estimated with [s]: 512 samples at 5 kHz. Longer ones resolve more and
scatter more, so every distance grows with it: compare only distances of one length."""


def spectrum(acceleration_m_s2: ArrayLike, rate_Hz: float) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz] and one-sided power spectral density (k,) [(m/s²)²/Hz] of a signal, after Welch 1967."""
    from scipy.signal import welch

    signal = np.asarray(acceleration_m_s2, dtype=np.float64)
    frequency, density = welch(signal, rate_Hz, nperseg=min(len(signal), round(WINDOW_S * rate_Hz)))
    return np.asarray(frequency), np.asarray(density)


def model_spectrum(a: ArrayLike, variance_m2_s4: float, rate_Hz: float, frequency_Hz: ArrayLike) -> Array:
    """One-sided power spectral density (k,) [(m/s²)²/Hz] of an AR model at those frequencies: 2 σ² / (rate |A|²)."""
    from scipy.signal import freqz

    _, response = freqz([1.0], np.asarray(a), worN=np.asarray(frequency_Hz), fs=rate_Hz)
    return np.asarray(2.0 * variance_m2_s4 * np.abs(response) ** 2 / rate_Hz)


def log_spectral_distance(
    first: ArrayLike,
    second: ArrayLike,
    frequency_Hz: ArrayLike,
    band_Hz: tuple[float, float] = ACCELERATION_BAND_HZ,
    level: bool = False,
) -> float:
    """Root mean square of the difference of two spectra in dB, over the band (Gray & Markel 1976, eq. 6).

    LSD = √ mean_f (d(f) − d̄)², d(f) = 10 log10 (S₁(f)/S₂(f)). With `level` the mean d̄ stays in: then the distance
    holds the difference of level as well; without, it is one of shape alone, as in the project's reference table.
    """
    frequency = np.asarray(frequency_Hz)
    within = (frequency >= band_Hz[0]) & (frequency <= band_Hz[1])
    tiny = np.finfo(np.float64).tiny
    one, two = (np.maximum(np.asarray(s, dtype=np.float64)[within], tiny) for s in (first, second))
    difference = 10.0 * np.log10(one / two)
    if not level:
        difference = difference - difference.mean()
    return float(np.sqrt(np.mean(difference**2)))


def level_difference_dB(first: ArrayLike, second: ArrayLike) -> float:
    """10 log10 of the ratio of the variances of two signals [dB]."""
    return float(10.0 * np.log10(np.var(np.asarray(first)) / np.var(np.asarray(second))))


def spectral_centroid_Hz(
    density: ArrayLike, frequency_Hz: ArrayLike, band_Hz: tuple[float, float] = ACCELERATION_BAND_HZ
) -> float:
    """Power-weighted mean frequency within the band: Σ f S(f) / Σ S(f) [Hz]."""
    frequency, density = np.asarray(frequency_Hz), np.asarray(density)
    within = (frequency >= band_Hz[0]) & (frequency <= band_Hz[1])
    return float(np.sum(frequency[within] * density[within]) / np.sum(density[within]))
