"""Texture synthesis: lattice filter, level ramp and amplitude modulation. Compiled.

The state of a voice is a record `s` with the fields of `voice_fields`. The caller writes the reflection coefficients to
`s.k` and calls `settle`; then, for each block, it calls `modulate` and `play`. The effect `lpc_texture` reads the
coefficients from a table on a grid; `run_texture` reads them from an array, for offline synthesis.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import BLOCK_MAX, LIFE_MAX
from hapscene.dsp.lattice import advance_all, advance_warped, solve_loop
from hapscene.dsp.noise import normal
from hapscene.dsp.slow_gain import advance_gain

Array = NDArray[np.float64]

__all__ = ["Stroke", "modulate", "play", "run_texture", "settle", "voice_fields"]


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
