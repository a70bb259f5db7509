"""Spectrograms of acceleration, and the spectrogram error, which measures the fidelity of a haptography handle."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import HandleError

__all__ = ["SPECTROGRAM_S", "decibels", "row_of", "spectrogram", "spectrogram_error"]


def row_of(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Converts values to a signal (n,) of real numbers, which may be infinite or NaN.

    Raises:
        HandleError: the values are not one row of real numbers; `name` is the name in the message.
    """
    try:
        given = np.asarray(values)
        signal = given.astype(np.float64, casting="same_kind" if given.size else "unsafe")
    except (TypeError, ValueError):
        raise HandleError(f"{name} is of type {type(values).__name__}; expected a row of real numbers") from None
    if signal.ndim != 1:
        raise HandleError(f"{name} has shape {signal.shape}; expected (n,)")
    return signal


Array = NDArray[np.float64]

SPECTROGRAM_S: Final = 0.05
"""Length of the windows of a spectrogram [s]; they overlap by half, as in the haptography paper."""


def decibels(magnitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """20 log10 of a magnitude, with a lower limit of −180 dB."""
    return np.asarray(20.0 * np.log10(np.maximum(magnitude, 1e-9)))


def spectrogram(acceleration_m_s2: ArrayLike, rate_Hz: float) -> tuple[Array, Array, Array]:
    """Times (n,) [s], frequencies (k,) [Hz] and magnitudes (n, k) [m/s²] of Hann windows of `SPECTROGRAM_S`.

    |S| = |Σ_t w(t) x(t) e^(−2πjft)| / Σ_t w(t). A rest at the end of less than half a window is ignored.

    Raises:
        HandleError: the signal is not one row of finite numbers or is shorter than a window; a window has fewer than
            four samples.
    """
    signal = row_of(acceleration_m_s2, "acceleration_m_s2")
    if not np.isfinite(signal).all():
        raise HandleError("acceleration_m_s2 contains samples that are not finite")
    if not 4.0 <= SPECTROGRAM_S * rate_Hz < np.inf:
        raise HandleError(f"rate_Hz is {rate_Hz}; expected a finite number, at least {4.0 / SPECTROGRAM_S:g}")
    length = round(SPECTROGRAM_S * rate_Hz)
    if len(signal) < length:
        raise HandleError(f"{len(signal)} samples at {rate_Hz:g} Hz are too short; expected at least {SPECTROGRAM_S} s")
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    parts = np.lib.stride_tricks.sliding_window_view(signal, length)[:: length // 2]
    magnitude = np.abs(np.fft.rfft(parts * window, axis=1)) / window.sum()
    time = (np.arange(len(parts)) * (length // 2) + 0.5 * length) / rate_Hz
    return np.asarray(time), np.asarray(np.fft.rfftfreq(length, 1.0 / rate_Hz)), np.asarray(magnitude)


def spectrogram_error(
    desired: ArrayLike, rendered: ArrayLike, rate_Hz: float, *, band_Hz: tuple[float, float] = ACCELERATION_BAND_HZ
) -> float:
    """Relative root-mean-square error of a spectrogram [1], the fidelity measure of the haptography papers.

    E = √Σ(|S_d|−|S_a|)² / √Σ|S_d|² with the desired spectrogram S_d and the rendered one S_a, for windows of 50 ms that
    overlap by half, from 20 to 1000 Hz. The handle of the papers reached 0.48. No output gives 1. Two independent
    realisations of the same Gaussian noise give √(2 − π/2) = 0.655, since the magnitudes have a Rayleigh distribution;
    a synthesised texture, which has the statistics of a surface but not its waveform, cannot be better than that.

    Raises:
        HandleError: as in `spectrogram`; the signals differ in length, or the desired one has no power in the band.
    """
    desired, rendered = row_of(desired, "desired"), row_of(rendered, "rendered")
    if desired.shape != rendered.shape:
        raise HandleError(f"the signals have shapes {desired.shape} and {rendered.shape}; expected equal lengths")
    _, frequency, wanted = spectrogram(desired, rate_Hz)
    got = spectrogram(rendered, rate_Hz)[2]
    within = (frequency >= band_Hz[0]) & (frequency <= band_Hz[1])
    power = np.sum(wanted[:, within] ** 2)
    if power == 0.0:
        raise HandleError("the desired signal has no power in the band: the relative error is undefined")
    return float(np.sqrt(np.sum((wanted - got)[:, within] ** 2) / power))
