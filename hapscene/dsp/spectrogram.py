"""Spectrograms of acceleration, and how far one is from another: the measure that handles are judged by."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import HandleError

__all__ = ["SPECTROGRAM_S", "decibels", "row_of", "spectrogram", "spectrogram_error"]

# What is given as a signal, checked.


def row_of(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """A signal (n,) of real numbers, which need not be finite.

    Raises:
        HandleError: something else, called `name`.
    """
    try:
        given = np.asarray(values)
        signal = given.astype(np.float64, casting="same_kind" if given.size else "unsafe")
    except (TypeError, ValueError):
        raise HandleError(f"{name} must be a row of real numbers, is {type(values).__name__}") from None
    if signal.ndim != 1:
        raise HandleError(f"{name} must have shape (n,), has {signal.shape}")
    return signal


Array = NDArray[np.float64]

SPECTROGRAM_S: Final = 0.05
"""Length of the windows of spectrograms [s], half overlapping, as in the haptography paper."""


def decibels(magnitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """20 log10; silence is far down, and not infinite."""
    return np.asarray(20.0 * np.log10(np.maximum(magnitude, 1e-9)))


def spectrogram(acceleration_m_s2: ArrayLike, rate_Hz: float) -> tuple[Array, Array, Array]:
    """Times (n,) [s], frequencies (k,) [Hz] and magnitudes (n, k) [m/s²] of Hann windows of `SPECTROGRAM_S`.

    |S| = |Σ_t w(t) x(t) e^(−2πjft)| / Σ_t w(t). What is left over at the end is less than half a window, and not seen.

    Raises:
        HandleError: not one row of finite numbers, or shorter than a window; a window must hold four samples or more.
    """
    signal = row_of(acceleration_m_s2, "acceleration_m_s2")
    if not np.isfinite(signal).all():
        raise HandleError("acceleration_m_s2 must be finite; some samples are not")
    if not 4.0 <= SPECTROGRAM_S * rate_Hz < np.inf:
        raise HandleError(f"rate_Hz must be finite and at least {4.0 / SPECTROGRAM_S:g}, is {rate_Hz}")
    length = round(SPECTROGRAM_S * rate_Hz)
    if len(signal) < length:
        raise HandleError(f"{len(signal)} samples at {rate_Hz:g} Hz are shorter than a window of {SPECTROGRAM_S} s")
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    parts = np.lib.stride_tricks.sliding_window_view(signal, length)[:: max(1, length // 2)]
    magnitude = np.abs(np.fft.rfft(parts * window, axis=1)) / window.sum()
    time = (np.arange(len(parts)) * max(1, length // 2) + 0.5 * length) / rate_Hz
    return np.asarray(time), np.asarray(np.fft.rfftfreq(length, 1.0 / rate_Hz)), np.asarray(magnitude)


def spectrogram_error(
    desired: ArrayLike, rendered: ArrayLike, rate_Hz: float, *, band_Hz: tuple[float, float] = ACCELERATION_BAND_HZ
) -> float:
    """Root-mean-square error of a spectrogram over its own root mean square [1], as the haptography handle is judged.

    E = √Σ(|S_d|−|S_a|)² / √Σ|S_d|² with S_d desired and S_a rendered, windows of 50 ms, half overlapping, 20–1000 Hz:
    the normalisation of the haptography papers, whose handle reached 0.48. No output gives 1 (100 %). Two independent
    stretches of one Gaussian noise give √(2 − π/2) = 0.655, for magnitudes in a spectrogram scatter after Rayleigh: a
    synthesised texture, which repeats a surface's statistics and not its waveform, can come no nearer.

    Raises:
        HandleError: as of `spectrogram`; the signals differ in length, or the desired one is silent.
    """
    desired, rendered = row_of(desired, "desired"), row_of(rendered, "rendered")
    if desired.shape != rendered.shape:
        raise HandleError(f"the two signals must have one length, have {desired.shape} and {rendered.shape}")
    _, frequency, wanted = spectrogram(desired, rate_Hz)
    got = spectrogram(rendered, rate_Hz)[2]
    within = (frequency >= band_Hz[0]) & (frequency <= band_Hz[1])
    power = np.sum(wanted[:, within] ** 2)
    if power == 0.0:
        raise HandleError("the desired signal is silent in the band: no error can be put in relation to it")
    return float(np.sqrt(np.sum((wanted - got)[:, within] ** 2) / power))
