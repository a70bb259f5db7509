"""Spectra of vibrations, distances between them, and amplitude modulation.

Spectra are Welch estimates with Hann windows of `WINDOW_S` that overlap by half.
"""

from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.capture.io.streams import Array
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.ar_filter import power_response
from hapscene.errors import CaptureError
from hapscene.perception import band_edges_Hz

__all__ = [
    "BAND_EDGES_HZ",
    "WINDOW_S",
    "band_power",
    "level_difference_dB",
    "log_spectral_distance",
    "model_spectrum",
    "modulation_depth",
    "residual",
    "spectrum",
    "tonal_share",
]

WINDOW_S: Final = 0.1024
"""Length of the windows of spectra [s]: 512 samples at 5 kHz. Longer windows have a higher resolution and scatter more,
so spectral distances increase with the length. Compare only distances with the same length."""

WINDOWS: Final = 1024
"""Windows of a signal that are transformed at once."""

BAND_COUNT: Final = 12
"""Number of bands from 20 to 1000 Hz. A band is 39 % wide, which is about the largest imperceptible difference of
frequency (13 to 38 %, Israr et al. 2006): people perceive the energy in a band, but not its distribution in the
band."""

BAND_EDGES_HZ: Final = tuple(band_edges_Hz(BAND_COUNT).tolist())
"""Edges of the bands (13,) [Hz]."""


def spectrum(acceleration_m_s2: ArrayLike, rate_Hz: float) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz] and one-sided power spectral density (k,) [(m/s²)²/Hz] of a signal (Welch 1967)."""
    signal = np.asarray(acceleration_m_s2, dtype=np.float64)
    size = min(len(signal), round(WINDOW_S * rate_Hz))
    step = size - size // 2
    count, total = (len(signal) - size // 2) // step, np.zeros(size // 2 + 1)
    for first in range(0, count, WINDOWS):  # in batches, which limits the memory
        windows = min(WINDOWS, count - first)
        part = signal[first * step : (first + windows) * step + size // 2]
        frequency, density = scipy.signal.welch(part, rate_Hz, nperseg=size)
        total += windows / count * density
    return np.asarray(frequency), total


def model_spectrum(
    a: ArrayLike, variance_m2_s4: float, rate_Hz: float, frequency_Hz: ArrayLike, warp: float = 0.0
) -> Array:
    """One-sided power spectral density (..., k) [(m/s²)²/Hz] of AR models (..., p+1) at frequencies (k,).

    It is 2 σ² / (rate |A|²). `warp` is the allpass coefficient of A (`hapscene.dsp.warped_prediction`).
    """
    omega_rad = 2.0 * np.pi / rate_Hz * np.asarray(frequency_Hz, dtype=np.float64)
    return np.asarray(2.0 * variance_m2_s4 / rate_Hz * power_response(a, omega_rad, warp))


def log_spectral_distance(first: ArrayLike, second: ArrayLike, frequency_Hz: ArrayLike) -> float:
    """Log-spectral distance of two spectra from 20 to 1000 Hz [dB] (Gray & Markel 1976, eq. 6).

    LSD = √ mean_f (d(f) − d̄)² with d(f) = 10 log10 (S₁(f)/S₂(f)) compares the shapes, whatever the levels.
    """
    within = _in_band(frequency_Hz)
    tiny = np.finfo(np.float64).tiny
    one, two = (np.maximum(np.asarray(s, dtype=np.float64)[within], tiny) for s in (first, second))
    difference = 10.0 * np.log10(one / two)
    return float(np.sqrt(np.mean((difference - difference.mean()) ** 2)))


def level_difference_dB(first: ArrayLike, second: ArrayLike) -> float:
    """Ratio of the variances of two signals [dB]."""
    return float(10.0 * np.log10(np.var(np.asarray(first)) / np.var(np.asarray(second))))


def band_power(density: ArrayLike, frequency_Hz: ArrayLike, edge_Hz: ArrayLike = BAND_EDGES_HZ) -> Array:
    """Power (..., b) [(m/s²)²] of spectra (..., k) in the bands between edges (b+1,) [Hz].

    P_b = ∫ S(f) df from edge b to edge b+1 by the trapezoidal rule, with linear interpolation at the edges. Frequencies
    must ascend; the power beyond the last one is 0.
    """
    frequency, density = np.asarray(frequency_Hz, dtype=np.float64), np.asarray(density, dtype=np.float64)
    edge = np.clip(np.asarray(edge_Hz, dtype=np.float64), frequency[0], frequency[-1])
    step = np.diff(frequency)
    running = np.zeros(density.shape)
    running[..., 1:] = np.cumsum(0.5 * (density[..., 1:] + density[..., :-1]) * step, axis=-1)
    i = np.clip(np.searchsorted(frequency, edge, side="right") - 1, 0, len(step) - 1)
    into = edge - frequency[i]
    slope = (density[..., i + 1] - density[..., i]) / step[i]
    return np.asarray(np.diff(running[..., i] + into * (density[..., i] + 0.5 * into * slope)))


# Amplitude modulation: variations of the level, which a spectrum does not show.


ENVELOPE_S: Final = 0.01
"""Length of the windows of the envelope [s]."""

MODULATION_HZ: Final = (2.0, 10.0)
"""Band in which the modulation of the envelope is measured [Hz]."""

MODULATION_MIN_S: Final = 0.4
"""Shortest signal whose modulation is measured [s]: two lines of the envelope's spectrum in `MODULATION_HZ`."""


def modulation_depth(acceleration_m_s2: ArrayLike, rate_Hz: float) -> float:
    """Modulation depth of a signal (n,): rms of the envelope from 2 to 10 Hz, relative to its mean [1].

    Stationary noise with the spectrum of a texture has 0.1 to 0.2.

    Raises:
        CaptureError: the signal is shorter than `MODULATION_MIN_S`.
    """
    signal = bandpassed(acceleration_m_s2, rate_Hz)
    if len(signal) < MODULATION_MIN_S * rate_Hz:
        raise CaptureError(
            f"{len(signal) / rate_Hz:.2f} s are too short to measure amplitude modulation; expected at least "
            f"{MODULATION_MIN_S:g} s"
        )
    frequency, density = envelope_spectrum(signal, rate_Hz)
    within = (frequency >= MODULATION_HZ[0]) & (frequency <= MODULATION_HZ[1])
    return float(np.sqrt(np.sum(density[within]) * frequency[1]))


def envelope_spectrum(signal: Array, rate_Hz: float) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz] and power spectral density (k,) [1/Hz] of the envelope of a signal, relative to its mean.

    The envelope is the root mean square in windows of `ENVELOPE_S`. The spectrum is a Welch estimate with Hann windows
    of 1 s.
    """
    envelope = np.sqrt(_window_power(signal, rate_Hz, ENVELOPE_S))
    envelope /= max(float(envelope.mean()), np.finfo(np.float64).tiny)
    frequency, density = scipy.signal.welch(
        envelope, 1.0 / ENVELOPE_S, nperseg=min(len(envelope), round(1.0 / ENVELOPE_S))
    )
    return np.asarray(frequency), np.asarray(density)


def bandpassed(acceleration_m_s2: ArrayLike, rate_Hz: float) -> Array:
    """Band-pass filters a signal (n,) from 20 to 1000 Hz, without delay."""
    signal = np.asarray(acceleration_m_s2, dtype=np.float64)
    low_Hz, high_Hz = ACCELERATION_BAND_HZ
    sections = scipy.signal.butter(4, (low_Hz, min(high_Hz, 0.45 * rate_Hz)), "bandpass", fs=rate_Hz, output="sos")
    # padded with five periods of 20 Hz at both ends, to avoid transients of the filter
    return np.asarray(
        scipy.signal.sosfiltfilt(sections, signal, padlen=min(len(signal) - 1, round(5.0 * rate_Hz / low_Hz)))
    )


def _window_power(signal: Array, rate_Hz: float, window_s: float) -> Array:
    length = round(window_s * rate_Hz)
    return np.asarray(np.mean(signal[: len(signal) // length * length].reshape(-1, length) ** 2, axis=1))


def _in_band(frequency_Hz: ArrayLike) -> NDArray[np.bool_]:
    """True for frequencies in the perceptible band, 20 to 1000 Hz."""
    frequency, (low_Hz, high_Hz) = np.asarray(frequency_Hz), ACCELERATION_BAND_HZ
    return np.asarray((frequency >= low_Hz) & (frequency <= high_Hz))


TONE_HZ: Final = 30.0
"""Width of the band around a spectral line [Hz]; the line is compared with the median of the band."""

TONE_RATIO: Final = 8.0
"""Smallest ratio of a spectral line to that median [1]; noise exceeds it at 0.4 % of all frequencies."""


TONE_S: Final = 10.0
"""Longest part of a signal in which tones are searched [s]; this limits the memory."""


def tonal_share(acceleration_m_s2: Array, rate_Hz: float) -> float:
    """Fraction of the power of a signal (n,) from 20 to 1000 Hz that is in narrow lines: noise 0, tones 1 [1]."""
    signal = acceleration_m_s2[: round(TONE_S * rate_Hz)]
    frequency, density = scipy.signal.welch(signal, rate_Hz, nperseg=min(len(signal), round(rate_Hz)))
    density = density[_in_band(frequency)]
    local = scipy.ndimage.median_filter(density, max(3, round(TONE_HZ / frequency[1])))
    return float(density[density > TONE_RATIO * local].sum() / max(float(density.sum()), np.finfo(np.float64).tiny))


def residual(a: ArrayLike, acceleration_m_s2: ArrayLike) -> Array:
    """Prediction residual (n−p,) [m/s²] of a signal (n,) for a filter a (p+1,), a[0] = 1, without the first p samples.

    Raises:
        CaptureError: the signal is not longer than the filter.
    """
    a, signal = np.asarray(a, dtype=np.float64), np.asarray(acceleration_m_s2, dtype=np.float64)
    if len(signal) <= len(a):
        raise CaptureError(f"{len(signal)} samples are too few for a model of order {len(a) - 1}")
    return np.asarray(scipy.signal.lfilter(a, [1.0], signal)[len(a) - 1 :])
