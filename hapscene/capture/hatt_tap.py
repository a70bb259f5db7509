"""Taps of the Penn Haptic Texture Toolkit: transients at 1 kHz, and the swatch's taps."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.hatt_file import HattTaps
from hapscene.surface.taps import Taps

Array = NDArray[np.float64]

RATE_HZ: Final = 1000.0
"""Sample rate of the toolkit's transients [Hz]; the files do not state it."""

SAMPLES: Final = 100
"""Samples of one of the toolkit's transients [count]."""


def as_taps(taps: HattTaps) -> Taps:
    """The transients as they stand, and a decaying sinusoid fitted to each, for what needs amplitude and frequency.

    The sinusoid is the one of least squared error over amplitude, frequency and decay.
    """
    rows = np.array([_decaying_sinusoid(wave) for wave in taps.acceleration_m_s2])
    return Taps(taps.approach_m_s, rows[:, 0], rows[:, 1], rows[:, 2], taps.acceleration_m_s2, RATE_HZ)


def play_taps(taps: Taps) -> HattTaps:
    """The taps as transients of the toolkit, at the approach speeds that the swatch holds.

    Transients at the toolkit's rate stay as they are; others are cut, or filled with silence, to its length. A
    decaying sinusoid above 500 Hz is silent: the toolkit's rate cannot carry it.
    """
    waves = [taps.transient(float(speed), RATE_HZ) for speed in taps.approach_m_s]
    stored = taps.wave_m_s2 is not None and taps.wave_rate_Hz == RATE_HZ
    count = len(waves[0]) if stored else SAMPLES
    return HattTaps(np.asarray(taps.approach_m_s), np.stack([np.resize(np.pad(w, (0, count)), count) for w in waves]))


def _decaying_sinusoid(wave: Array) -> tuple[float, float, float]:
    """Amplitude [m/s²], frequency [Hz] and decay [1/s] of A exp(−βt) sin(2πft) nearest to a transient."""
    from scipy.optimize import least_squares

    peak = float(np.abs(wave).max())
    t_s = np.arange(len(wave)) / RATE_HZ
    if peak == 0.0:
        return 0.0, RATE_HZ / 10, RATE_HZ / 10

    def off(p: Array) -> Array:
        return np.asarray(p[0] * np.exp(-p[2] * t_s) * np.sin(2.0 * np.pi * p[1] * t_s) - wave / peak)

    density = np.abs(np.fft.rfft(wave, 8 * len(wave)))
    loudest = float(np.argmax(density[1:]) + 1) * RATE_HZ / (8 * len(wave))
    bounds = ([-100.0, 1.0, 0.1], [100.0, RATE_HZ / 2, 5000.0])
    tries = [
        least_squares(off, [sign, min(max(frequency, 2.0), 499.0), decay], bounds=bounds)
        for frequency in (loudest, 1.5 * loudest)
        for decay in (20.0, 150.0)
        for sign in (1.0, -1.0)
    ]
    best = min(tries, key=lambda fit: float(fit.cost))
    return peak * abs(float(best.x[0])), float(best.x[1]), float(best.x[2])
