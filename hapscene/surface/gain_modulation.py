"""Amplitude modulation of a texture: a slow random gain, as caused by grains that pass under the tool.

The noise of a real surface comes in bursts of some tens of milliseconds, which a filter of a few hundred samples cannot
produce. A gain produces them: its logarithm is a sum of Ornstein–Uhlenbeck processes, each of which decorrelates with
time, with the distance travelled, or with both.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import LIFE_MAX
from hapscene.errors import SwatchError
from hapscene.surface.taps import ByContent, freeze

__all__ = ["SPREAD_MAX", "GainModulation"]

SPREAD_MAX: Final = 1.5
"""Largest standard deviation of the logarithm of the gain, all processes together [1]: 13 dB. Recordings have 0.1 to
0.8; far above this limit, the mean power would be dominated by rare and very loud bursts."""

DECAY_MAX_1_S: Final = 1e4
"""Largest decorrelation rate over time [1/s]; anything faster is noise."""

DECAY_MAX_1_M: Final = 1e6
"""Largest decorrelation rate over distance [1/m]: grains of a micrometre."""

_ROWS: Final = ("spread", "decay_1_s", "decay_1_m")


@dataclass(frozen=True, eq=False)
class GainModulation(ByContent):
    """A random slow gain whose logarithm is the sum of k independent Ornstein–Uhlenbeck processes.

    gain = exp(X)/√E[exp(2X)]: its mean square is 1, so the mean power of the texture is unchanged. X has the
    covariance Σ spread² exp(−decay_1_s |t| − decay_1_m |x|) over a time t and a distance x; it is clipped at 2.5
    standard deviations (`hapscene.dsp.texture_voice`).

    Attributes:
        spread: (k,) standard deviation of each process [1], ≥ 0; k is 1 to `LIFE_MAX`.
        decay_1_s, decay_1_m: (k,) decorrelation rates over time [1/s] and distance [1/m], ≥ 0, not both 0.

    Raises:
        SwatchError: arrays have inconsistent shapes, or numbers are out of range or not finite.
    """

    spread: NDArray[np.float64]
    decay_1_s: NDArray[np.float64]
    decay_1_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in _ROWS:
            freeze(self, name, getattr(self, name))
        count = len(self.spread) if self.spread.ndim == 1 else 0
        if not 1 <= count <= LIFE_MAX:
            raise SwatchError(
                f"modulation: spread must list 1 to {LIFE_MAX} processes, its shape is {self.spread.shape}"
            )
        for name, most in zip(_ROWS, (SPREAD_MAX, DECAY_MAX_1_S, DECAY_MAX_1_M), strict=True):
            row = getattr(self, name)
            if row.shape != (count,):
                raise SwatchError(f"modulation: {name} must have shape ({count},), has {row.shape}")
            if not np.all((row >= 0.0) & (row <= most)):
                raise SwatchError(f"modulation: {name} must be from 0 to {most:g}, is {row.tolist()}")
        if self.log_spread > SPREAD_MAX:
            raise SwatchError(
                f"modulation: the root of the sum of spread² must be at most {SPREAD_MAX}, is {self.log_spread:g}"
            )
        constant = np.flatnonzero(self.decay_1_s + self.decay_1_m == 0.0)
        if len(constant):
            raise SwatchError(f"modulation: process {constant[0]} is constant: decay_1_s or decay_1_m must be above 0")

    @property
    def log_spread(self) -> float:
        """Standard deviation of the logarithm of the gain [1]."""
        return float(np.sqrt(np.sum(self.spread**2)))
