"""Vibrations of known models, and a fit of plain streams."""

from typing import Any

import numpy as np
from scipy.signal import lfilter

from hapscene.capture import FitOptions, SurfaceRecording, fit_swatch
from hapscene.surface.swatch import Swatch


def resonant(frequency_Hz: list[float], radius: float, rate_Hz: float) -> np.ndarray:
    """The filter with a pair of poles at each frequency."""
    a = np.array([1.0])
    for f in frequency_Hz:
        a = np.convolve(a, [1.0, -2.0 * radius * np.cos(2 * np.pi * f / rate_Hz), radius**2])
    return a


def played(a: np.ndarray, count: int, seed: int = 0, snr_dB: float = np.inf) -> np.ndarray:
    """`count` samples of noise through 1/A, plus white noise."""
    rng = np.random.default_rng(seed)
    y = lfilter([1.0], a, rng.standard_normal(count + 4000))[4000:]
    return np.asarray(y + rng.standard_normal(count) * y.std() * 10 ** (-snr_dB / 20))


def noisy(stream: np.ndarray, rng: np.random.Generator, snr_dB: float = 20.0) -> np.ndarray:
    """Adds white noise with a given SNR relative to the nonzero part of a stream (n,)."""
    level = np.sqrt(np.mean(stream[stream != 0.0] ** 2)) * 10 ** (-snr_dB / 20)
    return np.asarray(stream + level * rng.standard_normal(len(stream)))


def fit(acceleration_m_s2: Any, rate_Hz: Any, **given: Any) -> Swatch:
    """Fits a swatch to streams; other arguments are fields of `FitOptions`."""
    streams = {name: given.pop(name) for name in list(given) if name.endswith(("_N", "_m_s", "_m", "_rad", "_Nm"))}
    return fit_swatch(SurfaceRecording(rate_Hz, acceleration_m_s2, **streams), FitOptions(**given))
