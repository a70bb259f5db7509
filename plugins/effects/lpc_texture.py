"""The vibration of a tool that slides: autoregressive (LPC) synthesis, chosen by force and slip speed.

A texture is a field of models over normal force and slip speed (Romano & Kuchenbecker 2012; Culbertson, Unwin &
Kuchenbecker 2014), run as a normalised lattice (`hapscene.dsp.lattice`): whatever models follow one another, the
output is no louder than they are. The level is ramped over the tick's block, so that nothing clicks when a contact
begins, ends, or crosses into another swatch.

Table of a swatch, on an even grid: highest force F [N], highest speed V [m/s], order p, count q of the excitation's
knots, then for each of GRID forces from 0 to F, for each of GRID speeds from 0 to V: P [m²/s⁴], k_1 … k_p; then the
q knots. Between nodes it is bilinear; above, clamped.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ORDER_MAX
from hapscene.dsp.lattice import advance, excite
from hapscene.native import native
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.swatch import Swatch

GRID = 33
"""Nodes of the table along force and along speed [count]. On textures fitted to wood, paper and leather
(order 20 and 40, 13 to 18 models) the spectrum at random places is within 0.01 dB (median) and 0.5 dB (95
%) of the texture's own; 17 nodes give 0.07 and 1.4 dB, 49 give 0.004 and 0.3 dB for twice the memory."""

HEADER = 4
"""Numbers that stand before the first node of a table [count]."""


@native
def choose(table: Any, force_N: float, slip_m_s: float, k: Any, c: Any) -> float:
    """Fill in the lattice for a force and a speed; the power of its output [m²/s⁴]."""
    row = min(max(force_N / table[0], 0.0), 1.0) * (GRID - 1)
    column = min(max(slip_m_s / table[1], 0.0), 1.0) * (GRID - 1)
    i, j = min(int(row), GRID - 2), min(int(column), GRID - 2)
    u, v = row - i, column - j
    w00, w01, w10, w11 = (1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v
    size = 1 + int(table[2])
    at00 = HEADER + (i * GRID + j) * size
    at01, at10, at11 = at00 + size, at00 + GRID * size, at00 + GRID * size + size
    for m in range(1, size):
        k[m] = w00 * table[at00 + m] + w01 * table[at01 + m] + w10 * table[at10 + m] + w11 * table[at11 + m]
        c[m] = math.sqrt((1.0 - k[m]) * (1.0 + k[m]))
    return float(w00 * table[at00] + w01 * table[at01] + w10 * table[at10] + w11 * table[at11])


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Add the texture's vibration [m/s²]; silent in the air, at no force and at no speed."""
    target_m_s2 = 0.0
    if touch.touching and table.size > 0:
        s.order = table[2]
        target_m_s2 = p.texture_gain * math.sqrt(choose(table, touch.force_N, touch.slip_m_s, s.k, s.c))
    if target_m_s2 == 0.0 and s.level_m_s2 == 0.0:
        return
    step_m_s2 = (target_m_s2 - s.level_m_s2) / touch.block
    order, knots = int(s.order), int(table[3]) if table.size > 0 else 0
    for i in range(touch.block):
        level_m_s2 = s.level_m_s2 + (i + 1) * step_m_s2
        f = excite(s.rng, table, table.size - knots, knots)
        out.a_m_s2[i] += level_m_s2 * advance(s.k, s.c, s.b, order, f)
    s.level_m_s2 = target_m_s2


def table(swatch: Swatch, rate_Hz: float) -> NDArray[np.float64]:
    """Powers and reflection coefficients of a swatch's texture at `rate_Hz`; empty where it has none."""
    texture = swatch.texture
    if texture is None:
        return np.empty(0)
    if texture.rate_Hz != rate_Hz:
        texture = texture.resampled(rate_Hz)
    force_N, speed_m_s = (
        np.linspace(0.0, texture.force_max_N, GRID),
        np.linspace(0.0, texture.speed_max_m_s, GRID),
    )
    k, power = texture.lattice(np.repeat(force_N, GRID), np.tile(speed_m_s, GRID))
    nodes = np.column_stack((power, np.broadcast_to(k, (len(power), texture.order))))
    header = (force_N[-1], speed_m_s[-1], texture.order, len(texture.excitation))
    return np.concatenate((header, nodes.ravel(), texture.excitation))


EFFECT = Effect(
    "lpc_texture",
    "The vibration of sliding, by force and slip speed.",
    render,
    params=(Param("texture_gain", 1.0, "1", "factor on the swatch's texture", 0.0, 10.0),),
    state=(
        State("k", (ORDER_MAX + 1,)),
        State("c", (ORDER_MAX + 1,)),
        State("b", (ORDER_MAX + 1,)),
        State("order"),
        State("level_m_s2"),
        State("rng", seeded=True),
    ),
    table=table,
)
