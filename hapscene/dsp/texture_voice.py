"""Texture synthesis: lattice filter, level ramp and amplitude modulation. Compiled.

The state of a voice is a record `s` with the fields of `voice_fields`. The caller writes the reflection coefficients to
`s.k` and calls `settle`; then, for each block, it calls `modulate` and `play`. The effect `lpc_texture` reads the
coefficients from a table on a grid; `run_texture` reads them from an array, for offline synthesis.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import BLOCK_MAX, LIFE_MAX
from hapscene.dsp.lattice import advance_all, advance_warped, solve_loop
from hapscene.dsp.noise import normal

Array = NDArray[np.float64]
Random = NDArray[np.uint64]

__all__ = ["Stroke", "log_power", "modulate", "play", "run_texture", "settle", "voice_fields"]


def voice_fields(order: int) -> list[tuple[str, tuple[int, ...]]]:
    """Names and shapes of the fields of a voice, for models up to an order; all start at 0.

    The caller adds the random state `rng` (4,) u8 for excitation and modulation.
    """
    size = 4 * math.ceil(order / 4) + 1
    return [
        *[("k", (size,)), ("c", (size,)), ("b", (size,)), ("rows", (8, size))],  # lattice
        ("f", (BLOCK_MAX,)),  # excitation and output of a block
        *((name, ()) for name in ("order", "warp")),  # model: order and allpass coefficient
        ("scale", ()),  # 1 over the standard deviation of the lattice's output
        *((name, ()) for name in ("level_m_s2", "gain")),  # at the end of the last block
        ("processes", (LIFE_MAX,)),  # modulation processes, each of variance 1
        ("norm", (2,)),  # cache of `advance_gain`
        ("spread_scale", ()),  # factor on the spread of the modulation
    ]


@native
def settle(s: np.record) -> None:
    """Computes the remaining lattice coefficients from order, allpass coefficient and k."""
    order = int(s.order)
    if s.warp != 0.0:
        s.scale = 1.0 / math.sqrt(solve_loop(s.k, order, s.warp, s.rows))
        return
    s.scale = 1.0
    for m in range(1, order + 1):
        s.c[m] = math.sqrt((1.0 - s.k[m]) * (1.0 + s.k[m]))


@native
def modulate(s: np.record, rates: Array, first: int, count: int, step_s: float, travel_m: float) -> float:
    """Advance the modulation by a time and a distance; return its gain [1]. `rates[first:]` has `count` rows."""
    if count == 0 or s.spread_scale == 0.0:
        return 1.0
    if s.processes[0] == 0.0:  # first call: draw the processes
        for i in range(s.processes.size):
            s.processes[i] = normal(s.rng)
    return advance_gain(s.rng, s.processes, rates, first, count, step_s, travel_m, s.spread_scale, s.norm)


@native
def play(s: np.record, level_m_s2: float, gain: float, out: Array, start: int, stop: int, block: int) -> None:
    """Adds samples to out[start:stop], ramped to a level √P [m/s²] times a gain over a whole `block`."""
    order, now = int(s.order), s.level_m_s2 * s.gain
    step = (level_m_s2 * gain - now) / block
    for at in range(start, stop, BLOCK_MAX):
        count = min(BLOCK_MAX, stop - at)
        for i in range(count):
            s.f[i] = normal(s.rng)
        if s.warp == 0.0:
            advance_all(s.k, s.c, s.b, order, s.f, count)
        else:
            for i in range(count):
                s.f[i] = s.scale * advance_warped(s.rows, s.b, order, s.warp, s.f[i])
        for i in range(count):
            out[at + i] += (now + (at + i + 1 - start) * step) * s.f[i]
    s.level_m_s2, s.gain = level_m_s2, gain


class Stroke(NamedTuple):
    """Input of `run_texture`: coefficients, level and travel of n blocks."""

    k: Array  # (m, p) reflection coefficients: one row for all blocks, or row i from block i · hold on
    level_m_s2: Array  # (n,) √P at the end of each block
    travel_m: Array  # (n,) distance travelled in each block
    rates: Array  # (3l,) rows of the modulation for `advance_gain`
    step_s: float  # duration of a block
    block: int  # samples per block
    hold: int  # blocks per row of k


@native
def run_texture(s: np.record, stroke: Stroke, out: Array) -> None:
    """Adds the next samples of a texture to `out`, block by block; the last block may be shorter."""
    k, block, hold, count = stroke.k, stroke.block, stroke.hold, stroke.rates.size // 3
    for i in range(stroke.level_m_s2.size):
        if i == 0 or (k.shape[0] > 1 and i % hold == 0):
            row = i // hold if k.shape[0] > 1 else 0
            for m in range(k.shape[1]):
                s.k[m + 1] = k[row, m]
            settle(s)
        gain = modulate(s, stroke.rates, 0, count, stroke.step_s, stroke.travel_m[i])
        play(s, stroke.level_m_s2[i], gain, out, i * block, min((i + 1) * block, out.size), block)


# Amplitude modulation of a texture by a slow random gain.
#
# The logarithm of the gain is a sum of Ornstein–Uhlenbeck processes (`hapscene.surface.gain_modulation`). Each process
# is a number x of variance 1 with an exact update for any step: x ← ρ x + √(1 − ρ²) z, with z standard normal and ρ =
# exp(−dt · decay_1_s − dx · decay_1_m). The distribution does not depend on the length of a tick, and is stationary
# from the first draw. The logarithm is limited to `BOUND` standard deviations, because recordings do not exceed this.

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
