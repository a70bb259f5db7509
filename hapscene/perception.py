"""What a person can feel: just-noticeable differences (JND) with their sources, and errors in units of them.

A JND is told apart three times in four (d′ = 0.95 in a choice of two). Two renderings are as far apart as the quantity
that gives them away most, so a total is the largest of its parts; so judges `hapscene.capture.report.compare`.
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
"""Force below which its JND falls no further [N]: Weber's law does not hold there (Pang et al. measured 2.5 to 10 N;
assumed, and to be checked)."""

DIRECTION_DEG: Final = 18.4
"""Change of a force's direction that is felt where it is seen as well [°]; 25.6° where it is not (Barbagli et al.
2006)."""

COMPLIANCE: Final = 0.22
"""Weber fraction of a compliance [1] (Tan et al. 1995)."""

FRICTION: Final = 0.11
"""Weber fraction of a coefficient of friction [1] (Gueorguiev et al. 2017)."""

BAND_DB: Final = 2.0
"""Difference of vibration in a band [dB]: 1.65 to 2.98 (Israr, Tan & Reed 2006)."""

FLUCTUATION_DB: Final = BAND_DB / (2.0 * 2.0**0.5)
"""Slow rise and fall of a vibration's level that is just felt, root mean square [dB]: of a modulation whose peak and
trough are `BAND_DB` apart, 0.7 dB and 11 % deep. Weisenberger 1986 had people tell modulated vibration from steady,
best at some tens of hertz and in tones better than in noise (remembered, to be checked): what is dropped by this is
hardly felt."""

FREQUENCY: Final = 0.25
"""Weber fraction of a vibration's frequency [1]: 0.13 to 0.38 (Israr et al. 2006), its middle."""

VIBRATION_LEAST_M_S2: Final = 0.1
"""Vibration that is just felt through a tool up to `VIBRATION_KNEE_HZ`, root mean square [m/s²]; it rises by 12 dB an
octave above. Verrillo's 1963 threshold at 250 Hz, 0.1 µm, is 0.17 m/s² (remembered, to be checked), and his curve rises
faster: what is dropped by this is certainly not felt."""

VIBRATION_KNEE_HZ: Final = 300.0
"""Frequency above which less and less vibration is felt [Hz]."""

LATENCY_S: Final = 0.040
"""Delay of a vibration that changes the texture [s]; 0.060 is noticed as such (Okamoto et al. 2009)."""

AUDIO_S: Final = 0.024
"""Asynchrony of touch and sound that is noticed [s] (Adelstein et al. 2003); of touch and sight 0.045."""


def force_jnd(f_N: ArrayLike, true_N: ArrayLike) -> Array:
    """How far forces (n, 3) [N] are from the true ones (n, 3), (n,) [JND]: the larger of magnitude and direction.

    The direction counts where both can be felt: from `FORCE` · `FORCE_LEAST_N` on.
    """
    f, true = np.asarray(f_N, np.float64), np.asarray(true_N, np.float64)
    size, true_size = np.linalg.norm(f, axis=-1), np.linalg.norm(true, axis=-1)
    by_size = np.abs(size - true_size) / (FORCE * np.maximum(true_size, FORCE_LEAST_N))
    sine, cosine = np.linalg.norm(np.cross(f, true), axis=-1), np.sum(f * true, axis=-1)
    angle_deg = np.degrees(np.arctan2(sine, cosine))
    felt = np.minimum(size, true_size) >= FORCE * FORCE_LEAST_N
    return np.asarray(np.maximum(by_size, np.where(felt, angle_deg / DIRECTION_DEG, 0.0)))


def vibration_least_m_s2(frequency_Hz: ArrayLike) -> Array:
    """Root mean square of a vibration (n,) at those frequencies (n,) that is just felt [m/s²]."""
    above = np.maximum(np.asarray(frequency_Hz, np.float64) / VIBRATION_KNEE_HZ, 1.0)
    return np.asarray(VIBRATION_LEAST_M_S2 * above**2)


def band_jnd(rms_m_s2: ArrayLike, true_m_s2: ArrayLike, edges_Hz: ArrayLike) -> Array:
    """How far vibrations (…, k) in k bands are from the true ones (…, k), band by band (…, k) [JND].

    Args:
        rms_m_s2, true_m_s2: root mean squares within each band [m/s²].
        edges_Hz: (k + 1,) of the bands.

    What lies under the threshold in a band counts as the threshold, so differences below it count nothing.
    """
    edges = np.asarray(edges_Hz, np.float64)
    least = vibration_least_m_s2(np.sqrt(edges[1:] * edges[:-1]))
    one, two = (np.maximum(np.asarray(levels, np.float64), least) for levels in (rms_m_s2, true_m_s2))
    return np.asarray(np.abs(20.0 * np.log10(one / two)) / BAND_DB)


def bands_jnd(rms_m_s2: ArrayLike, true_m_s2: ArrayLike, edges_Hz: ArrayLike) -> Array:
    """The same over all bands, (…,) [JND]: root mean square."""
    return np.asarray(np.sqrt(np.mean(band_jnd(rms_m_s2, true_m_s2, edges_Hz) ** 2, axis=-1)))


def band_rms_m_s2(acceleration_m_s2: ArrayLike, rate_Hz: float, edges_Hz: ArrayLike, window: str = "hann") -> Array:
    """Root mean squares (k,) [m/s²] of a signal (n,) in bands with edges (k + 1,) [Hz], after Welch 1967.

    Its `window` hears next to nothing at the ends of the signal: "boxcar" for what begins there and is over soon.
    """
    from scipy.signal import welch

    signal, edges = np.asarray(acceleration_m_s2, np.float64), np.asarray(edges_Hz, np.float64)
    frequency, density = welch(signal, rate_Hz, window, min(len(signal), round(0.2048 * rate_Hz)), detrend=False)
    total = np.concatenate(([0.0], np.cumsum(density) * (frequency[1] - frequency[0])))
    upper = np.concatenate((frequency, [2 * frequency[-1] - frequency[-2]])) - 0.5 * frequency[1]
    power = np.diff(np.interp(edges, upper, total))
    return np.asarray(np.sqrt(np.maximum(power, 0.0)))


def band_edges_Hz(count: int = 12) -> Array:
    """Edges (count + 1,) [Hz] of bands from 20 to 1000 Hz of one ratio: 12 are 39 % wide, the widest difference of
    frequency that nobody feels (Israr et al. 2006): where in a band the energy lies is not felt, how much of it is."""
    return np.geomspace(*ACCELERATION_BAND_HZ, count + 1)
