"""Estimate frequency response and coherence from a recording of force and acceleration.

The whole recording is one window without taper. A handle that is at rest at both ends of the recording responds
completely within it, so there is no leakage, and no smearing of resonances as with the short windows of Welch's method.
The averages that H1 and coherence need are taken over adjacent frequencies instead of over windows (Bendat & Piersol
2010, "Random Data", 4th ed., 8.5.1 and 9.2): H1 = Σ F*A / Σ |F|² over the lines of a band.

The response changes within a band, which plain coherence would count as noise. Therefore a straight line in frequency
is fitted to each band, A = (h + h′ (f − f̄)) F, by least squares. With f̄ the mean frequency weighted by |F|², h equals
H1, and the residual of the line is noise. To second order h is the response averaged over the band,
(H(f̄ − σ) + H(f̄ + σ))/2, with σ the weighted standard deviation of its frequencies. A model is averaged in the same
way before it is compared.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import HandleError
from hapscene.handle.plant import Array, Complex

__all__ = ["BAND_PER_OCTAVE", "Response", "estimate_response"]

BAND_PER_OCTAVE: Final = 24
"""Bands per octave [count]. Each is 3 % wide: a fifth of the half-power width of the assumed coil resonance. In wider
bands a straight line does not follow the response."""

LINE_MIN: Final = 6
"""Fewest lines of the spectrum in a band [count]. The straight line uses two degrees of freedom, the noise estimate the
others."""

FORCE_SHARE: Final = 1e-6
"""Lowest power of the force in a band, relative to the strongest band [1]. Bands below it are left out."""


@dataclass(frozen=True)
class Response:
    """Acceleration over force at k frequencies.

    Attributes:
        frequency_Hz: (k,) mean frequency of each band.
        spread_Hz: (k,) standard deviation of the frequencies in each band.
        response: (k,) complex response, averaged over the band [1/kg].
        coherence: (k,) share of the acceleration's power that the force explains [1].
        deviation: (k,) standard deviation of the real part, and of the imaginary part, of the response [1/kg].
        freedom: (k,) degrees of freedom of `deviation` [count].
        force_power: (k,) power of the force in the band, in arbitrary units.
    """

    frequency_Hz: Array
    spread_Hz: Array
    response: Complex
    coherence: Array
    deviation: Array
    freedom: Array
    force_power: Array


def estimate_response(
    force_N: ArrayLike, acceleration_m_s2: ArrayLike, rate_Hz: float, *, band_Hz: tuple[float, float]
) -> Response:
    """Estimate the response H1 and the coherence in bands of 1/24 octave.

    Args:
        force_N: (n,) force that drives the handle [N]. It must be the only excitation apart from noise.
        acceleration_m_s2: (n,) acceleration of the handle [m/s²]. Both signals start and end at rest.
        rate_Hz: sample rate [Hz].
        band_Hz: lowest and highest frequency of the force [Hz]. Bands without force are left out.

    Raises:
        HandleError: recordings that differ in length, are not finite, are too short, or contain no force in the band.
    """
    force, acceleration = np.asarray(force_N, dtype=np.float64), np.asarray(acceleration_m_s2, dtype=np.float64)
    if force.ndim != 1 or force.shape != acceleration.shape:
        raise HandleError(
            "force and acceleration must be one-dimensional and of equal length, are "
            f"{force.shape} and {acceleration.shape}"
        )
    if not (np.isfinite(force).all() and np.isfinite(acceleration).all()):
        raise HandleError("force and acceleration must be finite: remove samples that are NaN or infinite")
    low, high = (round(edge * len(force) / rate_Hz) for edge in band_Hz)
    high = min(high, len(force) // 2)
    if high - low < 10 * LINE_MIN:
        raise HandleError(
            f"{len(force) / rate_Hz:.3g} s is too short to estimate {band_Hz[0]:g} to {band_Hz[1]:g} Hz: "
            f"record {20 / band_Hz[0]:.2g} s or more"
        )
    f, a = (np.fft.rfft(signal)[low:high] for signal in (force, acceleration))
    return _banded(np.arange(low, high) * rate_Hz / len(force), f, a)


def _banded(frequency: Array, f: Complex, a: Complex) -> Response:
    """Fit the straight line of each band, from sums over the lines of the spectrum."""
    power = np.abs(f) ** 2
    if not power.any():
        raise HandleError("the force is 0 in the whole band: check the column of the force, and --low and --high")
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
