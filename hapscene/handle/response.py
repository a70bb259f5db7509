"""Frequency response and coherence from a recording of force and acceleration.

The whole recording is one window, without taper: a handle that is at rest at its beginning and end answers in it
completely, so nothing leaks and no resonance is smeared, as it is by Welch's short windows. The averages that H1 and
coherence need are taken over adjacent frequencies instead of over windows (Bendat & Piersol 2010, "Random Data", 4th
ed., 8.5.1 and 9.2): H1 = Σ F*A / Σ |F|² over the lines of a band.

Within a band the response changes, which plain coherence would count as noise. So a straight line in frequency is
fitted to each band, A = (h + h′ (f − f̄)) F, by least squares. With f̄ the mean frequency weighted by |F|², h is exactly
H1, and what the line leaves is noise. To second order h is the response averaged over the band,
(H(f̄ − σ) + H(f̄ + σ))/2, with σ the weighted spread of its frequencies; a model that is compared with it is averaged so.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import HandleError
from hapscene.handle.plant import Array, Complex

__all__ = ["BAND_PER_OCTAVE", "Response", "estimate_response"]

BAND_PER_OCTAVE: Final = 24
"""Bands an octave [count]: each 3 % wide, a fifth of the half-power width of the assumed coil's resonance. With wider
ones the straight line in a band no longer follows it."""

LINE_MIN: Final = 6
"""Fewest lines of the spectrum in a band [count]. Two are used up by the straight line; from the others the noise is
estimated."""

FORCE_SHARE: Final = 1e-6
"""Least power of force in a band, over that of the strongest [1]: below, nothing was played there."""

CONFIDENCE: Final = 0.95


@dataclass(frozen=True)
class Response:
    """Acceleration over force at k frequencies.

    Attributes:
        frequency_Hz: (k,) mean frequency of each band.
        spread_Hz: (k,) standard deviation of the frequencies in it.
        response: (k,) complex, averaged over the band [1/kg].
        coherence: (k,) share of the acceleration's power in the band that the force explains [1].
        deviation: (k,) standard deviation of its real part, and of its imaginary part [1/kg].
        freedom: (k,) degrees of freedom behind that [count].
        force_power: (k,) power of the force in the band, of any unit.
    """

    frequency_Hz: Array
    spread_Hz: Array
    response: Complex
    coherence: Array
    deviation: Array
    freedom: Array
    force_power: Array

    def magnitude_interval(self) -> tuple[Array, Array]:
        """Bounds (k,) of |A/F| at 95 %: |h| ± t s, with s² = (1 − γ²)/(2 γ² (n − 2)) |h|², from n lines.

        That is Bendat & Piersol's normalised random error, (1 − γ²)^½/(|γ| (2 n)^½) (2010, 9.2.3), with the estimated
        noise's own uncertainty in Student's t.
        """
        reach = scipy.stats.t.ppf(0.5 + 0.5 * CONFIDENCE, self.freedom) * self.deviation
        magnitude = np.abs(self.response)
        return np.maximum(magnitude - reach, 0.0), magnitude + reach


def estimate_response(
    force_N: ArrayLike, acceleration_m_s2: ArrayLike, rate_Hz: float, *, band_Hz: tuple[float, float]
) -> Response:
    """H1 and coherence in bands of 1/24 octave.

    Args:
        force_N: (n,) what drives the handle; nothing else may, but noise.
        acceleration_m_s2: (n,) of the handle, sample by sample. Both begin and end at rest.
        rate_Hz: of the samples.
        band_Hz: lowest and highest frequency that force was played at. Bands without any are left out.

    Raises:
        HandleError: recordings that differ in length, are not finite, too short, or without force in the band.
    """
    force, acceleration = np.asarray(force_N, dtype=np.float64), np.asarray(acceleration_m_s2, dtype=np.float64)
    if force.ndim != 1 or force.shape != acceleration.shape:
        raise HandleError(f"force and acceleration must have one length, have {force.shape} and {acceleration.shape}")
    if not (np.isfinite(force).all() and np.isfinite(acceleration).all()):
        raise HandleError("force and acceleration must be finite; some samples are not")
    low, high = (round(edge * len(force) / rate_Hz) for edge in band_Hz)
    high = min(high, len(force) // 2)
    if high - low < 10 * LINE_MIN:
        raise HandleError(
            f"{len(force) / rate_Hz:.3g} s are too short to see {band_Hz[0]:g} to {band_Hz[1]:g} Hz; "
            f"{20 / band_Hz[0]:.2g} s or more are needed"
        )
    f, a = (np.fft.rfft(signal)[low:high] for signal in (force, acceleration))
    return _banded(np.arange(low, high) * rate_Hz / len(force), f, a)


def _banded(frequency: Array, f: Complex, a: Complex) -> Response:
    """The straight line in each band, from sums over its lines."""
    power = np.abs(f) ** 2
    if not power.any():
        raise HandleError("no force was played in the band")
    start = _starts(frequency)

    def total(values: NDArray[np.generic]) -> NDArray[np.generic]:
        return np.add.reduceat(values, start)

    count = np.diff(np.append(start, len(frequency)))
    s_ff = total(power).real
    played = s_ff > FORCE_SHARE * s_ff.max()
    s_ff = np.where(played, s_ff, 1.0)
    mean = np.where(played, total(frequency * power).real / s_ff, frequency[start])
    off = frequency - np.repeat(mean, count)
    s_fa, s_aa = total(f.conj() * a), total(np.abs(a) ** 2).real
    s_xx, s_xa = total(off**2 * power).real, total(off * f.conj() * a)
    explained = np.abs(s_fa) ** 2 / s_ff + np.abs(s_xa) ** 2 / np.where(s_xx > 0.0, s_xx, np.inf)
    noise = np.maximum(s_aa - explained, 1e-24 * s_aa) / (count - 2)
    spread, coherence = np.sqrt(s_xx / s_ff), explained / np.where(s_aa > 0.0, s_aa, 1.0)
    columns = mean, spread, s_fa / s_ff, coherence, np.sqrt(0.5 * noise / s_ff), 2.0 * (count - 2.0), s_ff
    return Response(*(column[played] for column in columns))


def _starts(frequency: Array) -> NDArray[np.intp]:
    """Index of the first line of each band."""
    bands = np.arange(0.0, BAND_PER_OCTAVE * np.log2(frequency[-1] / frequency[0]))
    edges = frequency[0] * 2.0 ** (bands / BAND_PER_OCTAVE)
    starts = [0]
    for index in np.searchsorted(frequency, edges):
        if starts[-1] + LINE_MIN <= index <= len(frequency) - LINE_MIN:
            starts.append(int(index))
    return np.array(starts)
