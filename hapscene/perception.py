"""Just-noticeable differences (JND) of touch with their sources, and errors in units of JND.

A difference of one JND is detected in three of four trials (d′ = 0.95 in two-interval forced choice). The difference of
two renderings is that of their most different quantity, so a total is the maximum of its parts; see
`hapscene.capture.report.compare`.
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_BAND_HZ

__all__ = [
    "BAND_DB",
    "COMPLIANCE",
    "DIRECTION_DEG",
    "FORCE",
    "FORCE_LEAST_N",
    "FREQUENCY",
    "FRICTION",
    "band_edges_Hz",
    "band_jnd",
    "band_rms_m_s2",
    "bands_jnd",
    "force_jnd",
    "vibration_least_m_s2",
]

Array = NDArray[np.float64]

FORCE: Final = 0.07
"""Weber fraction of a force [1] (Pang, Tan & Durlach 1991)."""

FORCE_LEAST_N: Final = 0.5
"""Force below which the JND is constant [N], since Weber's law does not hold there (assumed, to be checked; Pang et al.
measured 2.5 to 10 N)."""

DIRECTION_DEG: Final = 18.4
"""JND of the direction of a force with visual feedback [°]; 25.6° without (Barbagli et al. 2006)."""

COMPLIANCE: Final = 0.22
"""Weber fraction of a compliance [1] (Tan et al. 1995)."""

FRICTION: Final = 0.11
"""Weber fraction of a coefficient of friction [1] (Gueorguiev et al. 2017)."""

BAND_DB: Final = 2.0
"""JND of the vibration level in a band [dB]: 1.65 to 2.98 (Israr, Tan & Reed 2006)."""

FREQUENCY: Final = 0.25
"""Weber fraction of a vibration's frequency [1]: the middle of 0.13 to 0.38 (Israr et al. 2006)."""

VIBRATION_LEAST_M_S2: Final = 0.1
"""Detection threshold of vibration through a tool up to `VIBRATION_KNEE_HZ`, root mean square [m/s²]; above, it rises
by 12 dB per octave. The threshold of Verrillo 1963 at 250 Hz, 0.1 µm, is 0.17 m/s² (cited from memory, to be checked),
and his curve rises faster, so weaker vibration is certainly not felt."""

VIBRATION_KNEE_HZ: Final = 300.0
"""Frequency above which the detection threshold rises [Hz]."""


def force_jnd(f_N: ArrayLike, true_N: ArrayLike) -> Array:
    """Difference (n,) of forces (n, 3) from the true forces (n, 3) [N]: the larger of magnitude and direction [JND].

    The direction is only compared if both forces can be felt, from `FORCE` · `FORCE_LEAST_N` on.
    """
    f, true = np.asarray(f_N, np.float64), np.asarray(true_N, np.float64)
    size, true_size = np.linalg.norm(f, axis=-1), np.linalg.norm(true, axis=-1)
    by_size = np.abs(size - true_size) / (FORCE * np.maximum(true_size, FORCE_LEAST_N))
    sine, cosine = np.linalg.norm(np.cross(f, true), axis=-1), np.sum(f * true, axis=-1)
    angle_deg = np.degrees(np.arctan2(sine, cosine))
    felt = np.minimum(size, true_size) >= FORCE * FORCE_LEAST_N
    return np.asarray(np.maximum(by_size, np.where(felt, angle_deg / DIRECTION_DEG, 0.0)))


def vibration_least_m_s2(frequency_Hz: ArrayLike) -> Array:
    """Detection threshold of vibration (n,) at frequencies (n,) [m/s²], root mean square."""
    above = np.maximum(np.asarray(frequency_Hz, np.float64) / VIBRATION_KNEE_HZ, 1.0)
    return np.asarray(VIBRATION_LEAST_M_S2 * above**2)


def band_jnd(rms_m_s2: ArrayLike, true_m_s2: ArrayLike, edges_Hz: ArrayLike) -> Array:
    """Difference (…, k) of vibrations (…, k) from the true ones (…, k) in each of k bands [JND].

    Args:
        rms_m_s2, true_m_s2: root mean squares in each band [m/s²].
        edges_Hz: (k + 1,) edges of the bands.

    Levels below the detection threshold are replaced by the threshold.
    """
    edges = np.asarray(edges_Hz, np.float64)
    least = vibration_least_m_s2(np.sqrt(edges[1:] * edges[:-1]))
    one, two = (np.maximum(np.asarray(levels, np.float64), least) for levels in (rms_m_s2, true_m_s2))
    return np.asarray(np.abs(20.0 * np.log10(one / two)) / BAND_DB)


def bands_jnd(rms_m_s2: ArrayLike, true_m_s2: ArrayLike, edges_Hz: ArrayLike) -> Array:
    """Root mean square (…,) of `band_jnd` over all bands [JND]."""
    return np.asarray(np.sqrt(np.mean(band_jnd(rms_m_s2, true_m_s2, edges_Hz) ** 2, axis=-1)))


def band_rms_m_s2(acceleration_m_s2: ArrayLike, rate_Hz: float, edges_Hz: ArrayLike, window: str = "hann") -> Array:
    """Root mean squares (k,) [m/s²] of a signal (n,) in bands with edges (k + 1,) [Hz], after Welch 1967.

    Most windows suppress the ends of the signal: use "boxcar" for a transient at the start.
    """
    from scipy.signal import welch

    signal, edges = np.asarray(acceleration_m_s2, np.float64), np.asarray(edges_Hz, np.float64)
    frequency, density = welch(signal, rate_Hz, window, min(len(signal), round(0.2048 * rate_Hz)), detrend=False)
    total = np.concatenate(([0.0], np.cumsum(density) * (frequency[1] - frequency[0])))
    upper = np.concatenate((frequency, [2 * frequency[-1] - frequency[-2]])) - 0.5 * frequency[1]
    power = np.diff(np.interp(edges, upper, total))
    return np.asarray(np.sqrt(np.maximum(power, 0.0)))


def band_edges_Hz(count: int = 12) -> Array:
    """Edges (count + 1,) [Hz] of logarithmic bands from 20 to 1000 Hz.

    12 bands are 39 % wide each, about the largest JND of frequency (Israr et al. 2006), so that the distribution of the
    energy within a band is not felt.
    """
    return np.geomspace(*ACCELERATION_BAND_HZ, count + 1)
