"""Tap transients of a surface over approach speed: decaying sinusoids, and measured transients.

a(t) = A exp(−β t) sin(2π f t) (Okamura, Cutkosky & Dennerlein 2001, "Reality-Based Models for Vibration Feedback in
Virtual Environments", IEEE/ASME Trans. Mechatronics 6(3)).
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, DTypeLike, NDArray

from hapscene.errors import SwatchError

__all__ = ["TAP_MAX", "TAP_ROWS", "ByContent", "Tap", "Taps", "freeze"]

Array = NDArray[np.float64]

TAP_MAX: Final = 1024
"""Most approach speeds of a swatch [count]."""

WAVE_MAX: Final = 4096
"""Most samples of a measured transient [count]: 0.4 s at 10 kHz."""

RING_TIMES: Final = 7.0
"""Time constants after which a tap transient ends [1]: below a thousandth."""

TAP_ROWS: Final = ("approach_m_s", "amplitude_m_s2", "frequency_Hz", "decay_1_s")


def freeze(owner: object, name: str, values: ArrayLike, dtype: DTypeLike = np.float64) -> None:
    """Set a field of a frozen dataclass to a read-only copy of an array."""
    array = np.array(values, dtype)
    array.setflags(write=False)
    object.__setattr__(owner, name, array)


class ByContent:
    """Equality and hash of a frozen dataclass by the content of its arrays."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(np.array_equal(value, getattr(other, name)) for name, value in vars(self).items())

    def __hash__(self) -> int:
        return hash(tuple(value.tobytes() for value in vars(self).values() if isinstance(value, np.ndarray)))


class Tap(NamedTuple):
    """One decaying sinusoid: a(t) = amplitude exp(−decay t) sin(2π frequency t)."""

    amplitude_m_s2: float
    frequency_Hz: float
    decay_1_s: float


@dataclass(frozen=True, eq=False)
class Taps(ByContent):
    """Decaying sinusoids over approach speed, and measured transients if there are any.

    Attributes:
        approach_m_s: (k,) approach speeds, ascending, > 0.
        amplitude_m_s2: (k,) amplitude A of the acceleration, ≥ 0.
        frequency_Hz, decay_1_s: (k,) frequency f and decay rate β, > 0.
        wave_m_s2: (k, m) measured transient at each speed, from its onset, or None.
        wave_rate_Hz: sample rate of the transients; 0 without them.

    Raises:
        SwatchError: arrays have inconsistent shapes, or numbers are out of range or not finite.
    """

    approach_m_s: Array
    amplitude_m_s2: Array
    frequency_Hz: Array
    decay_1_s: Array
    wave_m_s2: Array | None = None
    wave_rate_Hz: float = 0.0

    def __post_init__(self) -> None:
        for name in TAP_ROWS:
            freeze(self, name, getattr(self, name))
        shape = self.approach_m_s.shape
        if len(shape) != 1 or not 1 <= shape[0] <= TAP_MAX:
            raise SwatchError(f"taps: approach_m_s must list 1 to {TAP_MAX} speeds, its shape is {shape}")
        for name in TAP_ROWS:
            array = getattr(self, name)
            if array.shape != shape:
                raise SwatchError(f"taps: {name} must have shape {shape}, has {array.shape}")
            low = array >= 0.0 if name == "amplitude_m_s2" else array > 0.0
            if not np.all(np.isfinite(array) & low):
                least = "not negative" if name == "amplitude_m_s2" else "above 0"
                raise SwatchError(f"taps: {name} must be finite and {least}")
        if not np.all(np.diff(self.approach_m_s) > 0.0):
            raise SwatchError("taps: approach_m_s must ascend")
        self._check_waves()

    def __repr__(self) -> str:
        count = len(self.approach_m_s)
        return f"<Taps: {count} approach speeds, {self.approach_m_s.min():g} to {self.approach_m_s.max():g} m/s>"

    def _check_waves(self) -> None:
        object.__setattr__(self, "wave_rate_Hz", float(self.wave_rate_Hz))
        if self.wave_m_s2 is None:
            if self.wave_rate_Hz != 0.0:
                raise SwatchError("taps: wave_rate_Hz is given without wave_m_s2: give both or neither")
            return
        freeze(self, "wave_m_s2", self.wave_m_s2)
        waves, count = self.wave_m_s2, len(self.approach_m_s)
        if waves.ndim != 2 or len(waves) != count or not 1 <= waves.shape[1] <= WAVE_MAX:
            raise SwatchError(f"taps: wave_m_s2 must have shape ({count}, 1 to {WAVE_MAX}), has {waves.shape}")
        if not np.all(np.isfinite(waves)):
            raise SwatchError("taps: wave_m_s2 must be finite")
        if not 0.0 < self.wave_rate_Hz < float("inf"):
            raise SwatchError(f"taps: wave_rate_Hz must be finite and above 0, is {self.wave_rate_Hz}")

    def at(self, approach_m_s: float) -> Tap:
        """Return the tap at an approach speed [m/s].

        Between two speeds the three parameters are interpolated linearly. Below the lowest speed, the amplitude falls
        linearly to zero, and frequency and decay stay. Above the highest speed, its tap is returned, so that no tap
        is louder than those in the swatch. A negative speed or NaN counts as zero.
        """
        speed = approach_m_s if approach_m_s > 0.0 else 0.0
        lowest = float(self.approach_m_s[0])
        columns = (self.amplitude_m_s2, self.frequency_Hz, self.decay_1_s)
        amplitude, frequency, decay = (float(np.interp(speed, self.approach_m_s, column)) for column in columns)
        return Tap(amplitude * min(1.0, speed / lowest), frequency, decay)

    def transient(self, approach_m_s: float, rate_Hz: float) -> Array:
        """Return the acceleration (n,) of a tap at an approach speed [m/s], sampled at `rate_Hz` from its onset.

        It is the measured transient if there is one, otherwise the decaying sinusoid until it is below a thousandth.
        Between two speeds, both transients are cross-faded linearly; outside the range of speeds see `at`.
        """
        if self.wave_m_s2 is None:
            tap = self.at(approach_m_s)
            t_s = np.arange(max(1, round(RING_TIMES * rate_Hz / tap.decay_1_s))) / rate_Hz
            audible = tap.amplitude_m_s2 if tap.frequency_Hz < 0.5 * rate_Hz else 0.0
            return audible * np.exp(-tap.decay_1_s * t_s) * np.sin(2.0 * np.pi * tap.frequency_Hz * t_s)
        speed = approach_m_s if approach_m_s > 0.0 else 0.0
        place = float(np.interp(speed, self.approach_m_s, np.arange(len(self.approach_m_s))))
        row = int(place)
        after = min(row + 1, len(self.approach_m_s) - 1)
        waves = self.waves_at(rate_Hz)
        wave = (1.0 - (place - row)) * waves[row] + (place - row) * waves[after]
        return np.asarray(min(1.0, speed / float(self.approach_m_s[0])) * wave)

    def waves_at(self, rate_Hz: float) -> Array:
        """Return the measured transients (k, n) at another sample rate; (k, 0) without them.

        They are resampled in the frequency domain, so that frequencies that both rates can represent are preserved.
        """
        if self.wave_m_s2 is None:
            return np.zeros((len(self.approach_m_s), 0))
        if rate_Hz == self.wave_rate_Hz:
            return self.wave_m_s2
        length = self.wave_m_s2.shape[1]
        padded = np.pad(self.wave_m_s2, ((0, 0), (0, length)))  # keeps the end from wrapping into the start
        count = max(1, round(length * rate_Hz / self.wave_rate_Hz))
        return np.asarray(scipy.signal.resample(padded, 2 * count, axis=1))[:, :count]
