"""The state machine that plays a texture: filter, level ramp and amplitude modulation. Compiled.

One voice is one record `s` with the fields of `voice_fields`. A caller puts the reflection coefficients into `s.k`,
calls `settle`, and then once per block `modulate` and `play`. The effect `lpc_texture` takes the coefficients from a
table on a grid; `run_texture` takes them from an array, for synthesis offline.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import BLOCK_MAX, LIFE_MAX
from hapscene.dsp.lattice import advance_all, advance_warped, solve_loop
from hapscene.dsp.noise import normal
from hapscene.dsp.slow_gain import advance_gain

__all__ = ["Stroke", "modulate", "play", "run_texture", "settle", "voice_fields"]


def voice_fields(order: int) -> list[tuple[str, tuple[int, ...]]]:
    """Names and shapes of a voice's fields, for models up to an order; all are 0 at the start.

    The random state `rng` (4,) u8, from which excitation and modulation are drawn, is added by the caller.
    """
    size = 4 * math.ceil(order / 4) + 1
    return [
        *[("k", (size,)), ("c", (size,)), ("b", (size,)), ("rows", (8, size))],  # of the lattice
        ("f", (BLOCK_MAX,)),  # excitation and output of a block
        *((name, ()) for name in ("order", "warp")),  # of the model
        ("scale", ()),  # 1 over the standard deviation of the lattice's output
        *((name, ()) for name in ("level_m_s2", "gain")),  # reached at the end of the last block
        ("processes", (LIFE_MAX,)),  # of the modulation, each of variance 1
        ("norm", (2,)),  # see `advance_gain`
        ("spread_scale", ()),  # factor on the spread of the modulation
    ]


@native
def settle(s: Any) -> None:
    """Fill in what the lattice needs beside its order, its warp and k."""
    order = int(s.order)
    if s.warp != 0.0:
        s.scale = 1.0 / math.sqrt(solve_loop(s.k, order, s.warp, s.rows))
        return
    s.scale = 1.0
    for m in range(1, order + 1):
        s.c[m] = math.sqrt((1.0 - s.k[m]) * (1.0 + s.k[m]))


@native
def modulate(s: Any, rates: Any, first: int, count: int, step_s: float, travel_m: float) -> float:
    """The gain [1] after a time and a distance; `rates[first:]` holds `count` processes as `advance_gain` has them."""
    if count == 0 or s.spread_scale == 0.0:
        return 1.0
    if s.processes[0] == 0.0:  # not drawn yet
        for i in range(s.processes.size):
            s.processes[i] = normal(s.rng)
    return advance_gain(s.rng, s.processes, rates, first, count, step_s, travel_m, s.spread_scale, s.norm)


@native
def play(s: Any, level_m_s2: float, gain: float, out: Any, start: int, stop: int, block: int) -> None:
    """Add samples to out[start:stop]; in a whole `block` they are ramped to a level √P [m/s²] times a gain."""
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
    """What a texture is played along, in n blocks."""

    k: NDArray[np.float64]  # (m, p) reflection coefficients: row 0 for all, or row i from block i · hold on
    level_m_s2: NDArray[np.float64]  # (n,) √P at the end of each block
    travel_m: NDArray[np.float64]  # (n,) distance in each
    rates: NDArray[np.float64]  # (3l,) of the modulation, as `advance_gain` has them
    step_s: float  # duration of a block
    block: int  # samples in it
    hold: int  # blocks for which a row of k holds


@native
def run_texture(s: Any, stroke: Stroke, out: Any) -> None:
    """Add the next samples of a texture to `out`, a block after the other; the last may be shorter."""
    k, block, hold, count = stroke.k, stroke.block, stroke.hold, stroke.rates.size // 3
    for i in range(stroke.level_m_s2.size):
        if i == 0 or (k.shape[0] > 1 and i % hold == 0):
            row = i // hold if k.shape[0] > 1 else 0
            for m in range(k.shape[1]):
                s.k[m + 1] = k[row, m]
            settle(s)
        gain = modulate(s, stroke.rates, 0, count, stroke.step_s, stroke.travel_m[i])
        play(s, stroke.level_m_s2[i], gain, out, i * block, min((i + 1) * block, out.size), block)
