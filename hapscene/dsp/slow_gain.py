"""What changes slowly in a texture: its random gain, and which of two states it is in. Compiled.

The gain's logarithm is a sum of Ornstein–Uhlenbeck processes (`hapscene.surface.life.Life`). Each is kept as a number x
of variance 1 and advanced exactly, whatever the step: x ← ρ x + √(1 − ρ²) z with z standard normal and
ρ = exp(−dt · decay_1_s − dx · decay_1_m). So its law does not depend on the length of a tick, and a number drawn once
is stationary.
"""

import math
from typing import Any, Final

from hapscene.dsp.noise import normal, uniform
from hapscene.native import native

CHANGE_S: Final = 0.02
"""Time in which a texture's filter and level become those of its other state [s]: short beside any state, long beside a
click."""


@native
def advance_gain(rng: Any, x: Any, rows: Any, first: int, count: int, dt_s: float, dx_m: float, life: float) -> float:
    """The gain [1] after a time [s] in which a distance [m] was travelled; the processes x (≥ count,) are advanced.

    `rows` holds, from `first` on, the spread, decay_1_s and decay_1_m of each of `count` processes; each spread counts
    `life` times. The mean of the gain's square is 1.
    """
    log = 0.0
    for i in range(count):
        at = first + 3 * i
        spread, loss = life * rows[at], dt_s * rows[at + 1] + dx_m * rows[at + 2]
        if loss > 0.0:
            rho = math.exp(-loss)
            x[i] = rho * x[i] + math.sqrt((1.0 - rho) * (1.0 + rho)) * normal(rng)
        log += spread * (x[i] - spread)
    return math.exp(log)


@native
def draw_state(rng: Any, here_s: float, other_s: float, state: Any) -> None:
    """A state by chance: `state` (2,) is 0 here or 1 in the other, and the time left in it [s]."""
    state[0] = 1.0 if uniform(rng) * (here_s + other_s) >= here_s else 0.0
    state[1] = -(other_s if state[0] > 0.0 else here_s) * math.log(1.0 - uniform(rng))


@native
def advance_state(rng: Any, here_s: float, other_s: float, dt_s: float, state: Any) -> bool:
    """Whether the state is another after a time [s]. How long it stays is exponentially distributed, to the instant."""
    before = state[0]
    state[1] -= dt_s
    while state[1] <= 0.0:
        state[0] = 1.0 - state[0]
        state[1] -= (other_s if state[0] > 0.0 else here_s) * math.log(1.0 - uniform(rng))
    return bool(state[0] != before)
