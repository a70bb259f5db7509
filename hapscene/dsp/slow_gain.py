"""What changes slowly in a texture: its random gain. Compiled.

The gain's logarithm is a sum of Ornstein–Uhlenbeck processes (`hapscene.surface.life.Life`). Each is kept as a number x
of variance 1 and advanced exactly, whatever the step: x ← ρ x + √(1 − ρ²) z with z standard normal and
ρ = exp(−dt · decay_1_s − dx · decay_1_m). So its law does not depend on the length of a tick, and a number drawn once
is stationary. What recordings never reach is not played: the logarithm stays within `BOUND` of its deviations.
"""

import math
from typing import Any, Final

from hapscene.compiled.native import native
from hapscene.dsp.noise import normal

__all__ = ["BOUND", "advance_gain", "log_power"]

ROOT_2: Final = math.sqrt(2.0)

BOUND: Final = 2.5
"""How far the gain's logarithm goes from its median, in standard deviations [1]. In a few seconds recordings reach 1.6
to 2.5; without a bound half a minute of epoxy has peaks of 20 times its level, which was recorded at 9."""

BOUND_LOG: Final = 2.0
"""And how far at most [1]: 17 dB; the loudest 50 ms of what was recorded are 15 dB above their median."""


@native
def log_power(spread: float) -> float:
    """Half the logarithm of the mean square of exp(X), with X normal of that standard deviation, held to its bound."""
    if spread == 0.0:
        return 0.0
    far = min(BOUND, BOUND_LOG / spread)
    within = math.erfc((2.0 * spread - far) / ROOT_2) - math.erfc((2.0 * spread + far) / ROOT_2)
    beyond = math.cosh(2.0 * spread * far) * math.erfc(far / ROOT_2)
    return 0.5 * math.log(0.5 * math.exp(2.0 * spread * spread) * within + beyond)


@native
def advance_gain(
    rng: Any, x: Any, rows: Any, first: int, count: int, dt_s: float, dx_m: float, life: float, mean: Any
) -> float:
    """The gain [1] after a time [s] in which a distance [m] was travelled; the processes x (≥ count,) are advanced.

    `rows` holds, from `first` on, the spread, decay_1_s and decay_1_m of each of `count` processes; each spread counts
    `life` times. The mean of the gain's square is 1: `mean` (2,) keeps the square of the spread that was last, and
    what its gain is divided by for that, as a logarithm.
    """
    log = variance = 0.0
    for i in range(count):
        at = first + 3 * i
        spread, loss = life * rows[at], dt_s * rows[at + 1] + dx_m * rows[at + 2]
        if loss > 0.0:
            rho = math.exp(-loss)
            x[i] = rho * x[i] + math.sqrt((1.0 - rho) * (1.0 + rho)) * normal(rng)
        log += spread * x[i]
        variance += spread * spread
    if variance != mean[0]:
        mean[0], mean[1] = variance, log_power(math.sqrt(variance))
    far = min(BOUND * math.sqrt(variance), BOUND_LOG)
    return math.exp(min(max(log, -far), far) - mean[1])
