"""How near one vibration is to another, as numbers: distances between spectra and between spectrograms.

Spectra are compared as Welch's estimate with Hann windows of `WINDOW_S`, half overlapping, because that is what the
reference numbers of the project were measured with. What a model leaves unexplained is judged in `metric_residual`,
what a person makes of the difference in `metric_vibrotactile`.
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import CaptureError, HandleError
from hapscene.handle.spectrogram import spectrogram as spectrogram_of
from hapscene.handle.spectrogram import spectrogram_error as error_of_spectrogram

Array = NDArray[np.float64]

WINDOW_S: Final = 0.1024
"""Length of the windows that spectra are estimated with [s]: 512 samples at 5 kHz. Longer ones resolve more and
scatter more, so every distance grows with it: compare only distances of one length."""

BAND_COUNT: Final = 12
"""Bands that 20 to 1000 Hz is cut into [count]. Each is then 39 % wide, the widest difference of frequency that no one
feels (13 to 38 %, Israr et al. 2006): where in a band the energy lies is not felt, how much there is in it is."""

BAND_EDGES_HZ: Final = tuple(float(f) for f in np.geomspace(*ACCELERATION_BAND_HZ, BAND_COUNT + 1))
"""Edges of those bands (13,) [Hz]."""


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
    within = _within(frequency_Hz, band_Hz)
    tiny = np.finfo(np.float64).tiny
    one, two = (np.maximum(np.asarray(s, dtype=np.float64)[within], tiny) for s in (first, second))
    difference = 10.0 * np.log10(one / two)
    if not level:
        difference = difference - difference.mean()
    return float(np.sqrt(np.mean(difference**2)))


def goodness_of_fit(
    first: ArrayLike,
    second: ArrayLike,
    frequency_Hz: ArrayLike,
    band_Hz: tuple[float, float] = ACCELERATION_BAND_HZ,
) -> float:
    """Goodness-of-fit coefficient of two spectra over the band [1] (Hernández-Andrés, Romero & Lee 2001, J. Opt. Soc.
    Am. A 18(2), 412–420).

    GFC = |Σ S₁(f) S₂(f)| / (√Σ S₁(f)² √Σ S₂(f)²), the cosine of the angle between them: 1 for spectra of one shape at
    whatever level, 0 for spectra that share no frequency. For daylight they call 0.995 acceptable, 0.999 good and
    0.9999 exact. The loudest lines decide it. The haptography papers take it of DFT magnitudes: give √ of a power
    density for theirs. It is 0 when one of the two is silent.
    """
    within = _within(frequency_Hz, band_Hz)
    one, two = (np.asarray(s, dtype=np.float64)[within] for s in (first, second))
    one, two = (s / s.max() if s.max() > 0.0 else s for s in (one, two))  # squares of small densities would underflow
    norm = np.sqrt(np.sum(one**2) * np.sum(two**2))
    return float(np.abs(np.sum(one * two)) / norm) if norm > 0.0 else 0.0


def spectrogram(acceleration_m_s2: ArrayLike, rate_Hz: float) -> tuple[Array, Array, Array]:
    """`hapscene.handle.spectrogram.spectrogram`.

    Raises:
        CaptureError: the signal is shorter than a window.
    """
    try:
        return spectrogram_of(acceleration_m_s2, rate_Hz)
    except HandleError as error:
        raise CaptureError(str(error)) from None


def spectrogram_error(
    desired: ArrayLike,
    actual: ArrayLike,
    rate_Hz: float,
    band_Hz: tuple[float, float] = ACCELERATION_BAND_HZ,
) -> float:
    """`hapscene.handle.spectrogram.spectrogram_error`: the swatch is judged as the handle is.

    Raises:
        CaptureError: the signals differ in length, are shorter than a window, or the desired one is silent.
    """
    try:
        return error_of_spectrogram(desired, actual, rate_Hz, band_Hz)
    except HandleError as error:
        raise CaptureError(str(error)) from None


def level_difference_dB(first: ArrayLike, second: ArrayLike) -> float:
    """10 log10 of the ratio of the variances of two signals [dB]."""
    return float(10.0 * np.log10(np.var(np.asarray(first)) / np.var(np.asarray(second))))


def spectral_centroid_Hz(
    density: ArrayLike, frequency_Hz: ArrayLike, band_Hz: tuple[float, float] = ACCELERATION_BAND_HZ
) -> float:
    """Power-weighted mean frequency within the band: Σ f S(f) / Σ S(f) [Hz]."""
    frequency, density = np.asarray(frequency_Hz), np.asarray(density)
    within = _within(frequency, band_Hz)
    return float(np.sum(frequency[within] * density[within]) / np.sum(density[within]))


def band_power(density: ArrayLike, frequency_Hz: ArrayLike, edge_Hz: ArrayLike = BAND_EDGES_HZ) -> Array:
    """Power (b,) [(m/s²)²] of a spectrum between each two of the edges (b+1,) [Hz].

    P_b = ∫ S(f) df from edge b to edge b+1, by the trapezoidal rule, edges between two frequencies included
    exactly. Frequencies must ascend; beyond the last of them there is nothing.
    """
    frequency, density = np.asarray(frequency_Hz, dtype=np.float64), np.asarray(density, dtype=np.float64)
    edge = np.clip(np.asarray(edge_Hz, dtype=np.float64), frequency[0], frequency[-1])
    whole = np.union1d(frequency, edge)
    at = np.interp(whole, frequency, density)
    running = np.concatenate([[0.0], np.cumsum(0.5 * (at[1:] + at[:-1]) * np.diff(whole))])
    return np.asarray(np.diff(running[np.searchsorted(whole, edge)]))


def _within(frequency_Hz: ArrayLike, band_Hz: tuple[float, float]) -> NDArray[np.bool_]:
    frequency = np.asarray(frequency_Hz)
    return np.asarray((frequency >= band_Hz[0]) & (frequency <= band_Hz[1]))
