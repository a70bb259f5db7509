"""How near one vibration is to another, as numbers: distances between spectra and between spectrograms.

Spectra are compared as Welch's estimate with Hann windows of `WINDOW_S`, half overlapping, because that is what the
reference numbers of the project were measured with. Below stand, in this order, the distances, what a model leaves
unexplained, and what a person makes of the difference.
"""

from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.capture.io.streams import Array
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.ar_filter import power_response
from hapscene.dsp.spectrogram import spectrogram as spectrogram_of
from hapscene.dsp.spectrogram import spectrogram_error as error_of_spectrogram
from hapscene.errors import CaptureError
from hapscene.io.files import refusing
from hapscene.perception import band_edges_Hz

__all__ = [
    "BAND_EDGES_HZ",
    "WINDOW_S",
    "Liveliness",
    "band_power",
    "goodness_of_fit",
    "level_difference_dB",
    "liveliness",
    "log_spectral_distance",
    "model_spectrum",
    "residual",
    "spectral_centroid_Hz",
    "spectrogram",
    "spectrogram_error",
    "spectrum",
]

WINDOW_S: Final = 0.1024
"""Length of the windows that spectra are estimated with [s]: 512 samples at 5 kHz. Longer ones resolve more and
scatter more, so every distance grows with it: compare only distances of one length."""

WINDOWS: Final = 1024
"""Windows of a signal that are transformed at once [count]."""

BAND_COUNT: Final = 12
"""Bands that 20 to 1000 Hz is cut into [count]. Each is then 39 % wide, the widest difference of frequency that no one
feels (13 to 38 %, Israr et al. 2006): where in a band the energy lies is not felt, how much there is in it is."""

BAND_EDGES_HZ: Final = tuple(band_edges_Hz(BAND_COUNT).tolist())
"""Edges of those bands (13,) [Hz]."""


def spectrum(acceleration_m_s2: ArrayLike, rate_Hz: float) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz] and one-sided power spectral density (k,) [(m/s²)²/Hz] of a signal, after Welch 1967."""
    signal = np.asarray(acceleration_m_s2, dtype=np.float64)
    size = min(len(signal), round(WINDOW_S * rate_Hz))
    step = size - size // 2
    count, total = (len(signal) - size // 2) // step, np.zeros(size // 2 + 1)
    for first in range(0, count, WINDOWS):  # a long signal part by part, for memory's sake
        windows = min(WINDOWS, count - first)
        part = signal[first * step : (first + windows) * step + size // 2]
        frequency, density = scipy.signal.welch(part, rate_Hz, nperseg=size)
        total += windows / count * density
    return np.asarray(frequency), total


def model_spectrum(
    a: ArrayLike, variance_m2_s4: float, rate_Hz: float, frequency_Hz: ArrayLike, warp: float = 0.0
) -> Array:
    """One-sided power spectral density (..., k) [(m/s²)²/Hz] of AR models (..., p+1) at those frequencies (k,).

    It is 2 σ² / (rate |A|²), A on the axis that `warp` bends (`hapscene.dsp.warped_prediction`).
    """
    omega_rad = 2.0 * np.pi / rate_Hz * np.asarray(frequency_Hz, dtype=np.float64)
    return np.asarray(2.0 * variance_m2_s4 / rate_Hz * power_response(a, omega_rad, warp))


def log_spectral_distance(first: ArrayLike, second: ArrayLike, frequency_Hz: ArrayLike, level: bool = False) -> float:
    """Root mean square of the difference of two spectra in dB, 20 to 1000 Hz (Gray & Markel 1976, eq. 6).

    LSD = √ mean_f (d(f) − d̄)², d(f) = 10 log10 (S₁(f)/S₂(f)). With `level` the mean d̄ stays in: then the distance
    holds the difference of level as well; without, it is one of shape alone, as in the project's reference table.
    """
    within = _felt(frequency_Hz)
    tiny = np.finfo(np.float64).tiny
    one, two = (np.maximum(np.asarray(s, dtype=np.float64)[within], tiny) for s in (first, second))
    difference = 10.0 * np.log10(one / two)
    if not level:
        difference = difference - difference.mean()
    return float(np.sqrt(np.mean(difference**2)))


def goodness_of_fit(first: ArrayLike, second: ArrayLike, frequency_Hz: ArrayLike) -> float:
    """Goodness-of-fit coefficient of two spectra, 20 to 1000 Hz [1] (Hernández-Andrés, Romero & Lee 2001, J. Opt. Soc.
    Am. A 18(2), 412–420).

    GFC = |Σ S₁(f) S₂(f)| / (√Σ S₁(f)² √Σ S₂(f)²), the cosine of the angle between them: 1 for spectra of one shape at
    whatever level, 0 for spectra that share no frequency. For daylight they call 0.995 acceptable, 0.999 good and
    0.9999 exact. The loudest lines decide it. The haptography papers take it of DFT magnitudes: give √ of a power
    density for theirs. It is 0 when one of the two is silent.
    """
    within = _felt(frequency_Hz)
    one, two = (np.asarray(s, dtype=np.float64)[within] for s in (first, second))
    one, two = (s / s.max() if s.max() > 0.0 else s for s in (one, two))  # squares of small densities would underflow
    norm = np.sqrt(np.sum(one**2) * np.sum(two**2))
    return float(np.abs(np.sum(one * two)) / norm) if norm > 0.0 else 0.0


def spectrogram(acceleration_m_s2: ArrayLike, rate_Hz: float) -> tuple[Array, Array, Array]:
    """`hapscene.dsp.spectrogram.spectrogram`.

    Raises:
        CaptureError: the signal is shorter than a window.
    """
    with refusing(CaptureError):
        return spectrogram_of(acceleration_m_s2, rate_Hz)


def spectrogram_error(desired: ArrayLike, actual: ArrayLike, rate_Hz: float) -> float:
    """`hapscene.dsp.spectrogram.spectrogram_error`: the swatch is judged as the handle is.

    Raises:
        CaptureError: the signals differ in length, are shorter than a window, or the desired one is silent.
    """
    with refusing(CaptureError):
        return error_of_spectrogram(desired, actual, rate_Hz)


def level_difference_dB(first: ArrayLike, second: ArrayLike) -> float:
    """10 log10 of the ratio of the variances of two signals [dB]."""
    return float(10.0 * np.log10(np.var(np.asarray(first)) / np.var(np.asarray(second))))


def spectral_centroid_Hz(density: ArrayLike, frequency_Hz: ArrayLike) -> float:
    """Power-weighted mean frequency within 20 to 1000 Hz: Σ f S(f) / Σ S(f) [Hz]."""
    frequency, density = np.asarray(frequency_Hz), np.asarray(density)
    within = _felt(frequency)
    return float(np.sum(frequency[within] * density[within]) / np.sum(density[within]))


def band_power(density: ArrayLike, frequency_Hz: ArrayLike, edge_Hz: ArrayLike = BAND_EDGES_HZ) -> Array:
    """Power (..., b) [(m/s²)²] of spectra (..., k) between each two of the edges (b+1,) [Hz].

    P_b = ∫ S(f) df from edge b to edge b+1, by the trapezoidal rule, edges between two frequencies included
    exactly. Frequencies must ascend; beyond the last of them there is nothing.
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


# How alive a vibration is: how its level comes and goes, which a spectrum does not show.


ENVELOPE_S: Final = 0.01
"""Length of the windows of the envelope [s]."""

LEVEL_S: Final = 0.05
"""Length of the windows of the level [s]: shorter changes are felt as roughness, longer ones as louder and softer."""

MODULATION_HZ: Final = (2.0, 10.0)
"""Band in which the envelope's modulation is measured [Hz]."""

LIVELINESS_MIN_S: Final = 0.4
"""Shortest signal whose liveliness is measured [s]: two lines of its envelope's spectrum in `MODULATION_HZ`."""


class Liveliness(NamedTuple):
    """How the level of a vibration comes and goes, within 20 to 1000 Hz.

    Attributes:
        modulation: rms of the envelope's components from 2 to 10 Hz over its mean [1].
        spread_dB: standard deviation of the levels of windows of `LEVEL_S` [dB].
        crest: largest magnitude over rms [1].
    """

    modulation: float
    spread_dB: float
    crest: float


def liveliness(acceleration_m_s2: ArrayLike, rate_Hz: float) -> Liveliness:
    """How the level of a signal (n,) comes and goes. Noise is lively too: 0.1 to 0.2, 1 to 1.5 dB and 4 for textures.

    Raises:
        CaptureError: the signal is shorter than `LIVELINESS_MIN_S`.
    """
    signal = felt_part(acceleration_m_s2, rate_Hz)
    if len(signal) < LIVELINESS_MIN_S * rate_Hz:
        raise CaptureError(f"{len(signal) / rate_Hz:.2f} s are too few for liveliness: {LIVELINESS_MIN_S:g} s or more")
    edge = round(0.5 * LEVEL_S * rate_Hz)  # where a filter swings in
    inner = signal[edge:-edge]
    frequency, density = envelope_spectrum(signal, rate_Hz)
    within = (frequency >= MODULATION_HZ[0]) & (frequency <= MODULATION_HZ[1])
    modulation = float(np.sqrt(np.sum(density[within]) * frequency[1]))
    return Liveliness(
        modulation,
        float(np.std(levels_dB(signal, rate_Hz))),
        float(np.abs(inner).max() / max(float(np.std(inner)), np.finfo(np.float64).tiny)),
    )


def envelope_spectrum(felt: Array, rate_Hz: float) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz] and one-sided power spectral density (k,) [1/Hz] of a signal's envelope over its mean.

    The envelope is the root mean square of windows of `ENVELOPE_S`; Welch's estimate with Hann windows of 1 s.
    """
    envelope = np.sqrt(_window_power(felt, rate_Hz, ENVELOPE_S))
    envelope /= max(float(envelope.mean()), np.finfo(np.float64).tiny)
    frequency, density = scipy.signal.welch(
        envelope, 1.0 / ENVELOPE_S, nperseg=min(len(envelope), round(1.0 / ENVELOPE_S))
    )
    return np.asarray(frequency), np.asarray(density)


def levels_dB(felt: Array, rate_Hz: float) -> Array:
    """Levels (k,) [dB re 1 m/s²] of a signal's windows of `LEVEL_S`."""
    return np.asarray(10.0 * np.log10(np.maximum(_window_power(felt, rate_Hz, LEVEL_S), np.finfo(np.float64).tiny)))


def felt_part(acceleration_m_s2: ArrayLike, rate_Hz: float) -> Array:
    """What a signal (n,) has within 20 to 1000 Hz, without delay."""
    signal = np.asarray(acceleration_m_s2, dtype=np.float64)
    low_Hz, high_Hz = ACCELERATION_BAND_HZ
    sections = scipy.signal.butter(4, (low_Hz, min(high_Hz, 0.45 * rate_Hz)), "bandpass", fs=rate_Hz, output="sos")
    # turned over at the ends for five periods of 20 Hz, or it would ring there
    return np.asarray(
        scipy.signal.sosfiltfilt(sections, signal, padlen=min(len(signal) - 1, round(5.0 * rate_Hz / low_Hz)))
    )


def _window_power(signal: Array, rate_Hz: float, window_s: float) -> Array:
    length = round(window_s * rate_Hz)
    return np.asarray(np.mean(signal[: len(signal) // length * length].reshape(-1, length) ** 2, axis=1))


def _felt(frequency_Hz: ArrayLike) -> NDArray[np.bool_]:
    """Which of the frequencies lie in the band that is felt, 20 to 1000 Hz."""
    frequency, (low_Hz, high_Hz) = np.asarray(frequency_Hz), ACCELERATION_BAND_HZ
    return np.asarray((frequency >= low_Hz) & (frequency <= high_Hz))


def residual(a: ArrayLike, acceleration_m_s2: ArrayLike) -> Array:
    """Residual (n−p,) [m/s²] of a signal (n,) under a filter a (p+1,), a[0] = 1; the first p samples are left out.

    Raises:
        CaptureError: the signal is not longer than the filter.
    """
    a, signal = np.asarray(a, dtype=np.float64), np.asarray(acceleration_m_s2, dtype=np.float64)
    if len(signal) <= len(a):
        raise CaptureError(f"{len(signal)} samples are too few for the residual of a model of order {len(a) - 1}")
    return np.asarray(scipy.signal.lfilter(a, [1.0], signal)[len(a) - 1 :])
