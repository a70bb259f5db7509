"""Linear prediction on a warped frequency axis: a filter resolves more where more is felt, and has fewer taps.

In a warped filter a first-order allpass D(z) = (z⁻¹ − λ)/(1 − λ z⁻¹) stands in the place of each unit delay (Strube
1980, "Linear prediction on a warped frequency scale", J. Acoust. Soc. Am. 68; Härmä et al. 2000, "Frequency-warped
signal processing for audio applications", J. Audio Eng. Soc. 48). Its phase bends the frequency axis,

    ω̃(ω) = ω + 2 arctan(λ sin ω / (1 − λ cos ω)),   tan(ω̃/2) = (1 + λ)/(1 − λ) tan(ω/2),

so that its spectrum is σ²/|A(e^{jω̃(ω)})|². A of order p resolves about π/p of ω̃: at 10 kHz and λ = 0.75 that is
seven times finer at 20 Hz than a plain filter's, and seven times coarser at 5 kHz, where nothing is felt.

Strube's method makes least the residual's power, which weighs frequencies as the plain axis does. Here the spectrum
itself is predicted on the warped axis, as Makhoul (1975) does on any axis: r̃_k = ∫ S(ω) cos(k ω̃) ω̃' dω.
"""

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["lag_count", "predictor", "warp_at", "warped", "warped_angle"]

Array = NDArray[np.float64]

MIDDLE_HZ: Final = 451.67
"""Frequency in the middle of the warped axis [Hz], at every rate: λ = 0.75 at 10 kHz. On wood, paper, leather and
epoxy, one half judged by the other, 0.6 needs half as many taps more for the same bands, and 0.85 buys nothing."""

WARP_LEAST: Final = 0.3
"""Warp below which a warped filter is not worth its time [1]: at rates up to 3.2 kHz the plain axis is as good."""

TAIL: Final = 40.0
"""Lags that the allpass chain rings on for, in units of 1/(1 − λ) [1]: to rounding."""


def warp_at(rate_Hz: float) -> float:
    """The warp λ that maps frequencies [Hz] at a rate as 0.75 does at 10 kHz; 0, no warp, at low rates.

    `MIDDLE_HZ` lies in the middle: λ = tan(π/4 − π f/rate). Far below the rate the whole map is then the same.
    """
    warp = math.tan(0.25 * math.pi - math.pi * min(MIDDLE_HZ / rate_Hz, 0.25))
    return warp if warp >= WARP_LEAST else 0.0


def warped_angle(angle_rad: ArrayLike, warp: float) -> Array:
    """Where angles (n,) [rad] of the plain axis lie on the warped one (n,) [rad]."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    return np.asarray(angle + 2.0 * np.arctan2(warp * np.sin(angle), 1.0 - warp * np.cos(angle)))


def lag_count(order: int, warp: float) -> int:
    """Lags of a signal's autocorrelation, without lag 0, that warped prediction of that order needs."""
    return order if warp == 0.0 else math.ceil((order * (1.0 + warp) + TAIL) / (1.0 - warp))


def warped(r: Array, order: int, warp: float) -> Array:
    """Autocorrelation on the warped axis (..., order+1) of signals of autocorrelation r (..., > `lag_count`).

    `hapscene.dsp.linear_prediction.solve` makes the filter of it.
    """
    if warp == 0.0:
        return r[..., : order + 1]
    to_warped = _maps(order, warp)[0]
    return np.asarray(r[..., : to_warped.shape[1]] @ to_warped.T)


def predictor(a: Array, warp: float) -> Array:
    """The filters A (..., p+1) as coefficients of plain delays, the first 1: (..., `lag_count`+1), to rounding.

    What they leave of a signal is what is new in each sample, of 1/A's whole excitation scaled to that.
    """
    if warp == 0.0:
        return a
    taps = a @ _maps(a.shape[-1] - 1, warp)[1]
    return np.asarray(taps / taps[..., :1])


@lru_cache(maxsize=8)
def _maps(order: int, warp: float) -> tuple[Array, Array]:
    """What takes an autocorrelation (`lag_count`+1,) to the warped one, and the first samples of D⁰ … D^p, each
    (order+1, `lag_count`+1).

    Both are the series in cos(n ω): of ω̃' cos(k ω̃), and of cos(k ω̃), the real part of D^k.
    """
    count = lag_count(order, warp)
    angle = np.linspace(0.0, np.pi, (1 << (2 * count).bit_length()) + 1)
    chain = np.cos(np.arange(order + 1)[:, None] * warped_angle(angle, warp))
    slope = (1.0 - warp**2) / (1.0 + warp**2 - 2.0 * warp * np.cos(angle))
    series = np.fft.irfft(np.stack([slope * chain, chain]), axis=-1)[..., : count + 1]
    series[..., 1:] *= 2.0
    return series[0], series[1]
