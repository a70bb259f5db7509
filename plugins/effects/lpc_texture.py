"""Vibrotactile texture of a sliding tool: autoregressive (LPC) synthesis by normal force and slip speed.

A texture consists of AR models over normal force and slip speed (Romano & Kuchenbecker 2012; Culbertson, Unwin &
Kuchenbecker 2014), synthesised by `hapscene.dsp.texture_voice`. A change of model is never louder than the models. The
level is ramped over the block of the tick, so that there are no clicks when a contact begins, ends or crosses to
another swatch.

A texture can have amplitude modulation by a slow random gain (`hapscene.dsp.texture_voice`), which advances with time
and with the travelled distance.

Table of a swatch:

| index | content |
|---|---|
| 0, 1 | highest force F [N], highest speed V [m/s] |
| 2, 3 | order p, allpass coefficient λ |
| 4, 5 | exponents of the power over force and speed beyond F and V |
| 6 | update interval of the filter in ticks: `update_ticks` in the swatch's parameters of this effect |
| 7 | 1 if all models have the same filter, else 0 |
| 8 | checksum that identifies the table |
| 9 | number of modulation processes |
| … | spread, decay_1_s, decay_1_m of each process |
| … | if all models have the same filter: k_1 … k_p |
| … | for each of GRID forces from 0 to F and GRID speeds from 0 to V: P [m²/s⁴], and k_1 … k_p if filters differ |

The table is interpolated bilinearly. Beyond F and V the filter is constant and the level follows the exponents.
"""

import math
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import LEVEL_BOUND_DB, ORDER_MAX
from hapscene.dsp.texture_voice import modulate, play, settle, voice_fields
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.resonator import SILENCE_M_S2
from hapscene.surface.swatch import Swatch

GRID = 33
"""Number of nodes of the table along force and along speed. For textures fitted to wood, paper and leather (order 20
and 40, 13 to 18 models), the spectrum at random forces and speeds differs from that of the texture by 0.01 dB (median)
and 0.5 dB (95 %). 17 nodes give 0.07 and 1.4 dB; 49 nodes give 0.004 and 0.3 dB and need twice the memory."""

ORDER, WARP, TICKS, SINGLE, CHECKSUM, PROCESSES, HEADER = 2, 3, 6, 7, 8, 9, 10
"""Indices in the table, and the number of entries before the modulation processes."""

BOUND = 0.1 * LEVEL_BOUND_DB * math.log(10.0)
"""Largest logarithm of the power gain beyond the highest force and speed [1]."""

FADE_S = 0.2
"""Time over which a changed modulation depth is reached during a contact [s], which avoids clicks."""


@native
def choose(table: Any, force_N: float, slip_m_s: float, s: Any, fill: bool) -> float:
    """Power [m²/s⁴] of a table at a force and a speed; with `fill`, also writes the model to the lattice.

    The lattice is not changed if the output is silent before and after.
    """
    row = min(max(force_N / table[0], 0.0), 1.0) * (GRID - 1)
    column = min(max(slip_m_s / table[1], 0.0), 1.0) * (GRID - 1)
    i, j = min(int(row), GRID - 2), min(int(column), GRID - 2)
    u, v = row - i, column - j
    w00, w01, w10, w11 = (1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v
    order, single = int(table[ORDER]), table[SINGLE] > 0.0
    first = HEADER + 3 * int(table[PROCESSES])
    size = 1 if single else 1 + order
    at00 = (first + order if single else first) + (i * GRID + j) * size
    at01, at10, at11 = at00 + size, at00 + GRID * size, at00 + GRID * size + size
    power = w00 * table[at00] + w01 * table[at01] + w10 * table[at10] + w11 * table[at11]
    if force_N > table[0] or slip_m_s > table[1]:
        log = table[4] * math.log(max(force_N / table[0], 1.0))
        log += table[5] * math.log(max(slip_m_s / table[1], 1.0))
        power *= math.exp(min(max(log, -BOUND), BOUND))
    if power < SILENCE_M_S2**2:
        power = 0.0
    if fill and power == 0.0 and s.level_m_s2 == 0.0:
        s.stale = 1.0
    elif fill:
        for m in range(1, order + 1):
            if single:
                s.k[m] = table[first + m - 1]
            else:
                s.k[m] = w00 * table[at00 + m] + w01 * table[at01 + m] + w10 * table[at10 + m] + w11 * table[at11 + m]
        s.order, s.warp = order, table[WARP]
        settle(s)
    return float(power)


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Adds the vibration of the texture [m/s²]; it is 0 without contact, force or speed."""
    target_m_s2, ticks, gain = 0.0, 1.0, s.gain
    if touch.touching and table.size > 0:
        new = touch.began or touch.crossed
        if table[CHECKSUM] != s.of or new:
            s.of, s.wait, s.stale = table[CHECKSUM], 0.0, 1.0
        if s.wait <= 0.0 or new:
            s.wait = table[TICKS]
            fill = s.stale > 0.0 or table[SINGLE] == 0.0
            s.stale = 0.0
            power = choose(table, touch.force_N, touch.slip_m_s, s, fill)
            s.goal_m_s2 = p.texture_gain * math.sqrt(power)
        if not new:
            ticks = s.wait  # over which the level is ramped
        s.wait -= 1.0
        target_m_s2 = s.goal_m_s2
        if ticks > 1.0:
            target_m_s2 = s.level_m_s2 + (s.goal_m_s2 - s.level_m_s2) / ticks
        gain = advance_modulation(touch, p.texture_life, new, table, s)
    if target_m_s2 == 0.0 and s.level_m_s2 == 0.0:
        return
    play(s, target_m_s2, gain, out.a_m_s2, 0, touch.block, touch.block)


@native
def advance_modulation(touch: Any, depth: float, new: bool, table: Any, s: Any) -> float:
    """Modulation gain [1] of this tick; its depth follows `depth` within `FADE_S`, at once in a new contact."""
    most = touch.tick_s / FADE_S
    s.spread_scale = depth if new else s.spread_scale + min(max(depth - s.spread_scale, -most), most)
    return modulate(s, table, HEADER, int(table[PROCESSES]), touch.tick_s, touch.slip_m_s * touch.tick_s)


def table(swatch: Swatch, rate_Hz: float) -> NDArray[np.float64]:
    """Table of the texture of a swatch at `rate_Hz`; empty if the swatch has no texture."""
    texture = swatch.texture
    if texture is None:
        return np.empty(0)
    if texture.rate_Hz != rate_Hz:
        texture = texture.resampled(rate_Hz)
    ticks = max(1.0, round(swatch.parameter("lpc_texture", "update_ticks", 1.0)))
    force_N, speed_m_s = (np.linspace(0.0, most, GRID) for most in (texture.force_max_N, texture.speed_max_m_s))
    k, power = texture.lattice(np.repeat(force_N, GRID), np.tile(speed_m_s, GRID))
    nodes = (k.ravel(), power) if texture.single else (np.column_stack((power, k)).ravel(),)
    life = texture.modulation
    rows = np.empty(0) if life is None else np.column_stack((life.spread, life.decay_1_s, life.decay_1_m)).ravel()
    numbers = np.concatenate((rows, *nodes))
    edge = texture.force_max_N, texture.speed_max_m_s, texture.order, texture.warp, *texture.exponents
    checksum = 1.0 + zlib.crc32(np.array(edge).tobytes() + numbers.tobytes())
    return np.array((*edge, ticks, texture.single, checksum, len(rows) // 3, *numbers))


EFFECT = Effect(
    "lpc_texture",
    "Texture vibration of sliding, by normal force and slip speed.",
    render,
    params=(
        Param("texture_gain", 1.0, "1", "gain of the texture", 0.0, 10.0),
        Param("texture_life", 1.0, "1", "depth of the amplitude modulation; the mean power is unchanged", 0.0, 2.0),
    ),
    state=(
        *(State(name, shape) for name, shape in voice_fields(ORDER_MAX)),  # texture synthesis
        State("of"),  # checksum of the current table
        State("stale"),  # 1 if the lattice does not have the coefficients of this table yet
        State("goal_m_s2"),  # level at the last update
        State("wait"),  # ticks until the next update
        State("rng", seeded=True),
    ),
    table=table,
)
