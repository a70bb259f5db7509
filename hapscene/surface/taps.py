"""A surface's answer to a tap: decaying sinusoids over approach speed.

a(t) = A exp(−β t) sin(2π f t) (Okamura, Cutkosky & Dennerlein 2001, "Reality-Based Models for Vibration Feedback in
Virtual Environments", IEEE/ASME Trans. Mechatronics 6(3)).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SwatchError

Array = NDArray[np.float64]

TAP_MAX = 1024
"""Most approach speeds of a swatch [count]."""


class Tap(NamedTuple):
    """One decaying sinusoid: a(t) = amplitude exp(−decay t) sin(2π frequency t)."""

    amplitude_m_s2: float
    frequency_Hz: float
    decay_1_s: float


@dataclass(frozen=True, eq=False)
class Taps:
    """Decaying sinusoids over approach speed.

    Attributes:
        approach_m_s: (k,) approach speeds, ascending, > 0.
        amplitude_m_s2: (k,) amplitude A of the acceleration, ≥ 0.
        frequency_Hz: (k,) frequency f, > 0.
        decay_1_s: (k,) decay rate β, > 0.

    Raises:
        SwatchError: shapes that do not fit, numbers out of range or not finite.
    """

    approach_m_s: Array
    amplitude_m_s2: Array
    frequency_Hz: Array
    decay_1_s: Array

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        shape = self.approach_m_s.shape
        if len(shape) != 1 or not 1 <= shape[0] <= TAP_MAX:
            raise SwatchError(f"taps: approach_m_s must list 1 to {TAP_MAX} speeds, its shape is {shape}")
        for name in self.__dataclass_fields__:
            array = getattr(self, name)
            if array.shape != shape:
                raise SwatchError(f"taps: {name} must have shape {shape}, has {array.shape}")
            low = array >= 0.0 if name == "amplitude_m_s2" else array > 0.0
            if not np.all(np.isfinite(array) & low):
                least = "not negative" if name == "amplitude_m_s2" else "above 0"
                raise SwatchError(f"taps: {name} must be finite and {least}")
        if not np.all(np.diff(self.approach_m_s) > 0.0):
            raise SwatchError("taps: approach_m_s must ascend")

    def at(self, approach_m_s: float) -> Tap:
        """The tap at an approach speed [m/s].

        Between two speeds all three numbers are interpolated linearly. Below the lowest speed the amplitude falls
        linearly to zero at rest, frequency and decay stay. Above the highest speed the tap of the highest is given:
        nothing louder than what is in the swatch is ever played. A speed that is negative or NaN counts as zero.
        """
        speed = approach_m_s if approach_m_s > 0.0 else 0.0
        lowest = float(self.approach_m_s[0])
        amplitude, frequency, decay = (
            float(np.interp(speed, self.approach_m_s, column))
            for column in (self.amplitude_m_s2, self.frequency_Hz, self.decay_1_s)
        )
        return Tap(amplitude * min(1.0, speed / lowest), frequency, decay)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Taps):
            return NotImplemented
        return all(np.array_equal(getattr(self, n), getattr(other, n)) for n in self.__dataclass_fields__)

    def __hash__(self) -> int:
        return hash(self.approach_m_s.tobytes() + self.amplitude_m_s2.tobytes())
