"""What lives in a texture: a random slow gain, as of grains that pass under the tool.

The noise of a real surface comes in bursts, of some tens of milliseconds, that no filter of a few hundred samples can
make. A gain makes them: its logarithm is a sum of Ornstein–Uhlenbeck processes, each of which forgets with time, with
the distance travelled, or with both.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import LIFE_MAX
from hapscene.errors import SwatchError
from hapscene.surface.taps import freeze

__all__ = ["SPREAD_MAX", "Life"]

SPREAD_MAX: Final = 1.5
"""Largest standard deviation of the logarithm of the gain, all processes together [1]: 13 dB. Recordings have 0.1 to
0.8; far beyond it the mean power would be that of rare and very loud bursts."""

DECAY_MAX_1_S: Final = 1e4
"""Fastest rate at which a process forgets with time [1/s]; what is faster is noise."""

DECAY_MAX_1_M: Final = 1e6
"""Fastest rate at which it forgets with the distance travelled [1/m]: grains of a micrometre."""

_ROWS: Final = ("spread", "decay_1_s", "decay_1_m")


@dataclass(frozen=True, eq=False)
class Life:
    """A random slow gain: its logarithm is the sum of k independent Ornstein–Uhlenbeck processes.

    gain = exp(X)/√E[exp(2X)]: its mean square is 1, so the mean power stays what the texture says. X has covariance
    Σ spread² exp(−decay_1_s |t| − decay_1_m |x|) over a time t and a distance x; it is held to 2.5 of its standard
    deviations (`hapscene.dsp.slow_gain`).

    Attributes:
        spread: (k,) standard deviation of each process [1], ≥ 0; k is 1 to `LIFE_MAX`.
        decay_1_s: (k,) rate at which each forgets with time [1/s], ≥ 0.
        decay_1_m: (k,) rate at which each forgets with the distance travelled [1/m], ≥ 0; not both are 0.

    Raises:
        SwatchError: shapes that do not fit, numbers out of range or not finite.
    """

    spread: NDArray[np.float64]
    decay_1_s: NDArray[np.float64]
    decay_1_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in _ROWS:
            freeze(self, name, getattr(self, name))
        count = len(self.spread) if self.spread.ndim == 1 else 0
        if not 1 <= count <= LIFE_MAX:
            raise SwatchError(f"life: spread must list 1 to {LIFE_MAX} processes, its shape is {self.spread.shape}")
        for name, most in zip(_ROWS, (SPREAD_MAX, DECAY_MAX_1_S, DECAY_MAX_1_M), strict=True):
            row = getattr(self, name)
            if row.shape != (count,):
                raise SwatchError(f"life: {name} must have shape ({count},), has {row.shape}")
            if not np.all((row >= 0.0) & (row <= most)):
                raise SwatchError(f"life: {name} must be from 0 to {most:g}, is {row.tolist()}")
        if self.log_spread > SPREAD_MAX:
            raise SwatchError(f"life: the root of the sum of spread² must be at most {SPREAD_MAX}: {self.log_spread:g}")
        still = np.flatnonzero(self.decay_1_s + self.decay_1_m == 0.0)
        if len(still):
            raise SwatchError(f"life: process {still[0]} never forgets: decay_1_s or decay_1_m must be above 0")

    @property
    def log_spread(self) -> float:
        """Standard deviation of the gain's logarithm [1]."""
        return float(np.sqrt(np.sum(self.spread**2)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Life):
            return NotImplemented
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in _ROWS)

    def __hash__(self) -> int:
        return hash(tuple(getattr(self, name).tobytes() for name in _ROWS))
