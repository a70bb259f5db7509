"""Amplitude modulation of a texture by a slow random gain. Compiled.

The logarithm of the gain is a sum of Ornstein–Uhlenbeck processes (`hapscene.surface.gain_modulation`). Each process is
a number x of variance 1 with an exact update for any step: x ← ρ x + √(1 − ρ²) z, with z standard normal and
ρ = exp(−dt · decay_1_s − dx · decay_1_m). The distribution does not depend on the length of a tick, and is stationary
from the first draw. The logarithm is limited to `BOUND` standard deviations, because recordings do not exceed this.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.dsp.noise import normal

Array = NDArray[np.float64]
Random = NDArray[np.uint64]

__all__ = ["BOUND", "advance_gain", "log_power"]

ROOT_2: Final = math.sqrt(2.0)

BOUND: Final = 2.5
"""Largest deviation of the logarithm of the gain from its median, in standard deviations [1]. Recordings of a few
seconds reach 1.6 to 2.5. Without the limit, half a minute of epoxy has peaks of 20 times its level; 9 were recorded."""

BOUND_LOG: Final = 2.0
"""Largest deviation of the logarithm [1]: 17 dB. The loudest recorded 50 ms are 15 dB above the median."""


@native
def log_power(spread: float) -> float:
    """½ ln E[exp(2X)] for a normal X of that standard deviation, limited as the gain is."""
    if spread == 0.0:
        return 0.0
    far = min(BOUND, BOUND_LOG / spread)
    within = math.erfc((2.0 * spread - far) / ROOT_2) - math.erfc((2.0 * spread + far) / ROOT_2)
    beyond = math.cosh(2.0 * spread * far) * math.erfc(far / ROOT_2)
    return 0.5 * math.log(0.5 * math.exp(2.0 * spread * spread) * within + beyond)


@native
def advance_gain(
    rng: Random, x: Array, rows: Array, first: int, count: int, dt_s: float, dx_m: float, depth: float, mean: Array
) -> float:
    """Advances the processes x (≥ count,) by a time [s] and a travelled distance [m] and returns the gain [1].

    From index `first` on, `rows` holds spread, decay_1_s and decay_1_m of each of `count` processes. `depth` scales all
    spreads. The gain is normalised to a mean square of 1; `mean` (2,) caches the total variance for which the
    normalisation was computed, and the logarithm of the normalisation.
    """
    log = variance = 0.0
    for i in range(count):
        at = first + 3 * i
        spread, loss = depth * rows[at], dt_s * rows[at + 1] + dx_m * rows[at + 2]
        if loss > 0.0:
            rho = math.exp(-loss)
            x[i] = rho * x[i] + math.sqrt((1.0 - rho) * (1.0 + rho)) * normal(rng)
        log += spread * x[i]
        variance += spread * spread
    if variance != mean[0]:
        mean[0], mean[1] = variance, log_power(math.sqrt(variance))
    far = min(BOUND * math.sqrt(variance), BOUND_LOG)
    return math.exp(min(max(log, -far), far) - mean[1])
