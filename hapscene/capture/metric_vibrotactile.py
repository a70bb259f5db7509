"""How much alike two vibrations feel: the Spectral Temporal SIMilarity, ST-SIM.

Hassen & Steinbach 2020, "Subjective Evaluation of the Spectral Temporal SIMilarity (ST-SIM) Measure for Vibrotactile
Quality Assessment", IEEE Trans. Haptics 13(1), doi 10.1109/TOH.2019.2962446. It was made to judge codecs: the distorted
signal is to follow the reference sample by sample.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import CaptureError

Array = NDArray[np.float64]

BLOCK: Final = 512
"""Length of the blocks that are compared [samples]."""

TEMPORAL_SHARE: Final = 2.0 / 3.0
"""Exponent η of the temporal part [1]."""

SUPPORT_DB: Final = 12.0
"""Standard deviation of the normal distribution that turns a level above threshold into a sensation [dB]."""


class Similarity(NamedTuple):
    """ST-SIM and its two parts [1]: 1 is alike.

    Attributes:
        score: temporal^η · spectral^(1−η).
        spectral: likeness of the spectra as felt.
        temporal: likeness of the waveforms, 0 where they are opposed.
    """

    score: float
    spectral: float
    temporal: float


def st_sim(distorted: ArrayLike, reference: ArrayLike, rate_Hz: float) -> Similarity:
    """ST-SIM of a signal (n,) [m/s²] to a reference (n,), over whole blocks of `BLOCK` samples.

    Per block: X, the orthonormal DCT-II in dB re 1 m/s²; support Φ((X − T(f)) / 12 dB), Φ the normal distribution and
    T the threshold of `threshold_dB`; and z, the block less its mean over its standard deviation. Then

        spectral = mean over blocks of Σ Φ_r Φ_d / Σ Φ_r²,   temporal = mean over blocks of Σ z_r z_d / Σ z_r²,
        score = temporal^(2/3) · spectral^(1/3).

    It is not symmetric: the reference normalises. The temporal part of two stretches of noise that merely share
    their statistics is near 0, and so is the score: of a synthesised texture only the spectral part says something.

    What is as published: the paper itself was not to be had. The above is the definition in the library vibromaf 0.0.8,
    by the measure's second author and others (Noll, Hofbauer, Muschter, Li & Steinbach 2022, "Automated Quality
    Assessment for Compressed Vibrotactile Signals Using Multi-Method Assessment Fusion", IEEE Haptics Symposium); its
    scores come out to the last digit. What differs: the threshold is laid over the signal's own rate, where the library
    assumes 8 kHz whatever the signal, and a negative temporal part counts as 0, where the library's score is complex.

    Raises:
        CaptureError: the signals differ in length, or are shorter than a block.
    """
    from scipy.fft import dct
    from scipy.special import ndtr

    one, two = (np.asarray(s, dtype=np.float64) for s in (distorted, reference))
    if one.ndim != 1 or one.shape != two.shape or len(one) < BLOCK:
        raise CaptureError(f"ST-SIM needs two signals of one length, {BLOCK} or more: have {one.shape} and {two.shape}")
    blocks = [s[: len(s) // BLOCK * BLOCK].reshape(-1, BLOCK) for s in (one, two)]
    tiny = np.finfo(np.float64).tiny
    level = [20.0 * np.log10(np.maximum(np.abs(dct(block, norm="ortho", axis=1)), tiny)) for block in blocks]
    felt = [ndtr((x - threshold_dB(rate_Hz)) / SUPPORT_DB) for x in level]
    shape = [(b - b.mean(axis=1, keepdims=True)) / (b.std(axis=1, keepdims=True) + _EPSILON) for b in blocks]
    spectral, temporal = _likeness(*felt), max(0.0, _likeness(*shape))
    return Similarity(temporal**TEMPORAL_SHARE * spectral ** (1.0 - TEMPORAL_SHARE), spectral, temporal)


_EPSILON = float(np.finfo(np.float64).eps)


def _likeness(distorted: Array, reference: Array) -> float:
    """Mean over blocks (rows) of Σ r d / Σ r²."""
    return float(np.mean(np.sum(reference * distorted, axis=1) / (np.sum(reference**2, axis=1) + _EPSILON)))


def threshold_dB(rate_Hz: float) -> Array:
    """Least level that is felt at the frequencies of a block, (BLOCK,) [dB re 1 m/s², as an orthonormal DCT].

    T(f) = 62 (log10(f/550 Hz + 6/11) / log10(6/11))² − 77, which is lowest at 250 Hz; from where it first rises above 0
    (about 780 Hz) it stays.
    """
    frequency = np.linspace(0.0, rate_Hz, 2 * BLOCK)[:BLOCK]  # the library's own grid
    threshold = 62.0 * (np.log10(frequency / 550.0 + 6.0 / 11.0) / np.log10(6.0 / 11.0)) ** 2 - 77.0
    above = np.flatnonzero(threshold > 0.0)
    if len(above):
        threshold[above[0] :] = threshold[above[0]]
    return np.asarray(threshold)
