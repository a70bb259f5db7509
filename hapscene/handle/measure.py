"""Measurement of a handle: the sweep in several grips, recordings from files, and their frequency response."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import HandleError
from hapscene.handle.force_source import ForceSource
from hapscene.handle.plant import Array, Complex, Plant
from hapscene.io.files import refusing, whole_file

__all__ = [
    "BAND_PER_OCTAVE",
    "REST_S",
    "TRAVEL_SHARE",
    "GripRecording",
    "Response",
    "Sweep",
    "estimate_response",
    "load_grip",
    "load_grips",
    "play_grips",
]

# Estimate frequency response and coherence from a recording of force and acceleration.
#
# The whole recording is one window without taper. A handle that is at rest at both ends of the recording responds
# completely within it, so there is no leakage, and resonances are not smeared as with the short windows of Welch's
# method. The averages that H1 and coherence need are taken over adjacent frequencies instead of over windows (Bendat &
# Piersol 2010, "Random Data", 4th ed., 8.5.1 and 9.2): H1 = Σ F*A / Σ |F|² over the lines of a band.
#
# The response changes within a band, which plain coherence would count as noise. Therefore a straight line in frequency
# is fitted to each band, A = (h + h′ (f − f̄)) F, by least squares. With f̄ the mean frequency weighted by |F|², h equals
# H1, and the residual of the line is noise. To second order h is the response averaged over the band,
# (H(f̄ − σ) + H(f̄ + σ))/2, with σ the weighted standard deviation of its frequencies. A model is averaged in the same
# way before it is compared.


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


# The swept sine, within the limits of actuator and coil.

BAND_HZ: Final = (10.0, ACCELERATION_BAND_HZ[1])
"""Band of the sweep [Hz]: from 10 Hz, as in the paper, to the end of the acceleration channel. The paper's sweep ends
at 200 Hz; higher frequencies determine the mass of the handle and the lag of amplifier and accelerometer."""

OVERSHOOT: Final = 1.06
"""Factor by which the sweep extends beyond both ends of its band, for the fades [1]. With less, the fades reduce the
force at the ends of the band."""

REST_S: Final = 1.0
"""Silence after the sweep, in which the handle comes to rest [s]; the assumed handle decays at 10/s. Vibration after
the end of the recording is missing from the response."""

TRAVEL_SHARE: Final = 0.5
"""Share of the coil's travel that the sweep may use according to the guessed plant [1]."""

DETUNED: Final = 1.5
"""Ratio by which the resonance of the coil may differ from the guess, in both directions [1]. The force is reduced in
this range around the resonance."""

RATE_MIN: Final = 2.5
"""Lowest ratio of sample rate to highest frequency [1]. At 2 the response cannot be sampled."""


@dataclass(frozen=True)
class Sweep:
    """An exponential sine sweep: equal time for each octave, so that low frequencies, where the response is weak, get
    most.

    Attributes:
        low_Hz, high_Hz: band [Hz].
        sweep_s: duration [s]; `REST_S` of silence follow.
        force_N: force amplitude [N]; reduced where the coil would travel too far.

    Raises:
        HandleError: band, duration or force out of range.
    """

    low_Hz: float = BAND_HZ[0]
    high_Hz: float = BAND_HZ[1]
    sweep_s: float = 10.0
    force_N: float = 1.0

    def __post_init__(self) -> None:
        if not 0.5 <= self.low_Hz <= 0.5 * self.high_Hz <= 5000.0:
            raise HandleError(
                f"sweep: band {self.low_Hz:g} to {self.high_Hz:g} Hz is invalid: it must start at 0.5 Hz or above, "
                "span an octave or more, and end at 10 kHz or below"
            )
        least_s = 20.0 / self.low_Hz
        if not least_s <= self.sweep_s <= 600.0:
            raise HandleError(
                f"sweep: duration {self.sweep_s:g} s is out of range: from {self.low_Hz:g} Hz, {least_s:g} to 600 s"
            )
        if not 0.0 < self.force_N <= 1000.0:
            raise HandleError(f"sweep: force must be above 0 N and at most 1000 N, is {self.force_N:g}")

    def force(self, rate_Hz: float, guess: Plant) -> Array:
        """The force (n,) [N], constant over each sample. It starts and ends with 0.

        Phase 2π f₁ (T/L)(exp(L t/T) − 1) with L = ln(f₂/f₁) (Farina 2000, "Simultaneous measurement of impulse
        response and distortion with a swept-sine technique", AES 108, eq. 2). The amplitude is `force_N`, or that of
        `amplitude` where it is lower.

        Raises:
            HandleError: the rate is too low for the band.
        """
        if not rate_Hz >= RATE_MIN * self.high_Hz:
            raise HandleError(
                f"sweep: highest frequency {self.high_Hz:g} Hz is too high for a sample rate of {rate_Hz:g} Hz: "
                f"at most {rate_Hz / RATE_MIN:g} Hz"
            )
        first, last = self.low_Hz / OVERSHOOT, min(self.high_Hz * OVERSHOOT, 0.49 * rate_Hz)
        octaves = np.log(last / first)
        t_s = np.arange(round(self.sweep_s * rate_Hz)) / rate_Hz
        growth = np.exp(octaves * t_s / self.sweep_s)
        wave = np.sin(2.0 * np.pi * first * self.sweep_s / octaves * (growth - 1.0))
        fade_s = self.sweep_s * np.log(OVERSHOOT) / octaves
        fade = np.clip(np.minimum(t_s, self.sweep_s - t_s) / fade_s, 0.0, 1.0)
        force_N = self.amplitude(first * growth, guess) * np.sin(0.5 * np.pi * fade) ** 2 * wave
        return np.concatenate([force_N, np.zeros(round(REST_S * rate_Hz))])

    def amplitude(self, frequency_Hz: Array, guess: Plant) -> Array:
        """Largest force (n,) [N] at each frequency within `force_N`, the actuator's limit and the travel.

        The travel is the largest that the guessed plant has within a factor `DETUNED` of the frequency.
        """
        around = np.geomspace(1.0 / DETUNED, DETUNED, 25)
        few_Hz = frequency_Hz[:: max(1, len(frequency_Hz) // 1000)]  # the travel is smooth
        travel_m_N = np.abs(guess.travel_response(few_Hz[:, None] * around)).max(axis=1)
        allowed_N = np.interp(frequency_Hz, few_Hz, TRAVEL_SHARE * guess.travel_limit_m / travel_m_N)
        return np.asarray(np.minimum(allowed_N, min(self.force_N, guess.force_limit_N)))


# Recordings of the sweep.


@dataclass(frozen=True)
class GripRecording:
    """Force (n,) [N] and acceleration (n,) [m/s²] of one grip, at `rate_Hz`."""

    name: str
    force_N: Array
    acceleration_m_s2: Array
    rate_Hz: float

    def response(self, band_Hz: tuple[float, float]) -> Response:
        """Estimate the frequency response in the band, up to 0.45 of the sample rate.

        Raises:
            HandleError: as `estimate_response`, with the name of the recording.
        """
        band_Hz = (band_Hz[0], min(band_Hz[1], 0.45 * self.rate_Hz))
        with refusing(HandleError, self.name):
            return estimate_response(self.force_N, self.acceleration_m_s2, self.rate_Hz, band_Hz=band_Hz)

    def save(self, path: Path) -> None:
        """Write the recording as npz, atomically, for `hapscene device identify --from`.

        Raises:
            OSError: the folder does not exist or is not writable.
        """
        with whole_file(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file,
                force=self.force_N.astype(np.float32),
                acceleration=self.acceleration_m_s2.astype(np.float32),
                rate_Hz=self.rate_Hz,
                units=np.array(["force=N", "acceleration=m/s2"]),
            )


def play_grips(
    source: ForceSource, sweep: Sweep, guess: Plant, names: Sequence[str], ready: Callable[[int], None]
) -> list[GripRecording]:
    """Play the sweep once in each grip. The travel of the coil is predicted for the plant `guess`.

    `ready` is called with the index of each grip before the sweep; it returns when the hand holds the handle in that
    grip.

    Raises:
        HandleError: the handle is disconnected, or cannot play the sweep.
    """
    force_N = sweep.force(source.rate_Hz, guess)
    recordings = []
    for i, name in enumerate(names):
        ready(i)
        recordings.append(GripRecording(name, *source.play(force_N), source.rate_Hz))
    return recordings


def load_grips(
    paths: Sequence[str],
    rate_Hz: float | None = None,
    columns: dict[str, str] | None = None,
    units: dict[str, str] | None = None,
) -> list[GripRecording]:
    """Load one grip from each file. Raises CaptureError, HandleError: as `load_grip`, or the sample rates differ."""
    recordings = [load_grip(path, rate_Hz, columns, units) for path in paths]
    for recording, path in zip(recordings, paths, strict=True):
        if recording.rate_Hz != recordings[0].rate_Hz:
            raise HandleError(
                f"{path}: sample rate {recording.rate_Hz:g} Hz differs from {recordings[0].rate_Hz:g} Hz of "
                f"{paths[0]}: record all grips at the same rate"
            )
    return recordings


def load_grip(
    path: str, rate_Hz: float | None = None, columns: dict[str, str] | None = None, units: dict[str, str] | None = None
) -> GripRecording:
    """Load a grip from a file with the columns force and acceleration, as `hapscene.capture.load_recording`.

    Raises:
        CaptureError: the file does not exist, is not numeric, or lacks rate or units.
        HandleError: the force is missing; or the acceleration has three axes, whose combination would lose the
            phase.
    """
    from hapscene.capture.io.formats import read_recording_source
    from hapscene.capture.io.recording import load_recording

    chosen = columns or {}
    named = chosen.get("acceleration", "acceleration")
    known = read_recording_source(Path(path)).columns
    if named not in known and ("acceleration" not in chosen or "+" in named):
        raise HandleError(
            f"{path}: the column of the acceleration along the handle is not known: name it by "
            f"--columns acceleration=COLUMN; columns of the file: {', '.join(known)}"
        )
    del known
    recording = load_recording(path, rate_Hz, columns={"acceleration": named, **chosen}, units=units)
    if recording.force_N is None:
        raise HandleError(f'{path}: no column "force": name the column of the force by --columns force=COLUMN')
    return GripRecording(Path(path).stem, recording.force_N, recording.acceleration_m_s2, recording.rate_Hz)
