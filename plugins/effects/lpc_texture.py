"""The vibration of a tool that slides: autoregressive (LPC) synthesis, chosen by force and slip speed.

A texture is a field of models over normal force and slip speed (Romano & Kuchenbecker 2012; Culbertson, Unwin &
Kuchenbecker 2014), run as a normalised lattice (`hapscene.dsp.lattice`): whatever models follow one another, the
output is no louder than they are. The level is ramped over the tick's block, so that nothing clicks when a contact
begins, ends, or crosses into another swatch.

Table of a swatch, on an even grid: highest force F [N], highest speed V [m/s], order p, after how many ticks the
filter follows force and speed (`update_ticks` of the swatch's numbers for this effect, 1 unless it is there), then for
each of GRID forces from 0 to F, for each of GRID speeds from 0 to V: P [m²/s⁴], k_1 … k_p. Between nodes it is
bilinear; above, clamped.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ORDER_MAX
from hapscene.dsp.lattice import advance
from hapscene.dsp.noise import normal
from hapscene.native import native
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.swatch import Swatch

GRID = 33
"""Nodes of the table along force and along speed [count]. On textures fitted to wood, paper and leather
(order 20 and 40, 13 to 18 models) the spectrum at random places is within 0.01 dB (median) and 0.5 dB (95
%) of the texture's own; 17 nodes give 0.07 and 1.4 dB, 49 give 0.004 and 0.3 dB for twice the memory."""

HEADER = 4
"""Numbers that stand before the first node of a table [count]."""

FADE_S = 0.2
"""Time in which a filter becomes one of another order, where a surface is felt coarser or finer under load [s]: two
that differ by 10 dB in a band then change it by 1 dB in 20 ms."""

FADE_DB_S = 50.0
"""How fast the level changes then at most [dB/s], likewise."""

FADED = 1e-3
"""What is left of a level when it is given up, or where it begins anew [1]: 60 dB less."""

SILENT_M_S2 = 1e-3
"""What counts as loud there at least [m/s²]: a tenth of what is felt."""


@native
def choose(table: Any, force_N: float, slip_m_s: float, k: Any, c: Any, share: float = 1.0, order: int = 0) -> float:
    """Fill in the lattice for a force and a speed; the power of its output [m²/s⁴].

    With a `share` below 1 it goes as much of the way there from where it is; to 0 beyond the table's order, up to
    `order`.
    """
    row = min(max(force_N / table[0], 0.0), 1.0) * (GRID - 1)
    column = min(max(slip_m_s / table[1], 0.0), 1.0) * (GRID - 1)
    i, j = min(int(row), GRID - 2), min(int(column), GRID - 2)
    u, v = row - i, column - j
    w00, w01, w10, w11 = (1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v
    size = 1 + int(table[2])
    at00 = HEADER + (i * GRID + j) * size
    at01, at10, at11 = at00 + size, at00 + GRID * size, at00 + GRID * size + size
    if share < 1.0:
        for m in range(1, max(size, order + 1)):
            to = 0.0
            if m < size:
                to = w00 * table[at00 + m] + w01 * table[at01 + m] + w10 * table[at10 + m] + w11 * table[at11 + m]
            k[m] += share * (to - k[m])
            c[m] = math.sqrt((1.0 - k[m]) * (1.0 + k[m]))
    else:
        for m in range(1, size):
            k[m] = w00 * table[at00 + m] + w01 * table[at01 + m] + w10 * table[at10 + m] + w11 * table[at11 + m]
            c[m] = math.sqrt((1.0 - k[m]) * (1.0 + k[m]))
    return float(w00 * table[at00] + w01 * table[at01] + w10 * table[at10] + w11 * table[at11])


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Add the texture's vibration [m/s²]; silent in the air, at no force and at no speed."""
    target_m_s2, ticks = 0.0, 1.0
    if touch.touching and table.size > 0:
        new = touch.began or touch.crossed
        of = table[2] if p.texture_gain > 0.0 else 0.0
        if of != s.of or new:
            begin_filter(table[2], FADE_S / touch.tick_s if touch.stepped and not new else 0.0, s)
            s.of = of
        if s.wait <= 0.0 or new:
            s.wait = table[3]
            share = s.wait / s.fade if s.fade > s.wait else 1.0
            s.fade = max(0.0, s.fade - s.wait)
            if share == 1.0:
                s.order = table[2]
            power = choose(table, touch.force_N, touch.slip_m_s, s.k, s.c, share, int(s.order))
            s.goal_m_s2 = p.texture_gain * math.sqrt(power)
        if not new:
            ticks = s.wait  # in which the level gets there
        s.wait -= 1.0
        target_m_s2 = s.goal_m_s2
        if ticks > 1.0:
            target_m_s2 = s.level_m_s2 + (s.goal_m_s2 - s.level_m_s2) / ticks
        if s.loud_m_s2 > 0.0:
            target_m_s2 = slowly(touch, target_m_s2, s)
        s.force_N, s.slip_m_s = touch.force_N, touch.slip_m_s
    if target_m_s2 == 0.0 and s.level_m_s2 == 0.0:
        return
    step_m_s2 = (target_m_s2 - s.level_m_s2) / touch.block
    order = int(s.order)
    for i in range(touch.block):
        level_m_s2 = s.level_m_s2 + (i + 1) * step_m_s2
        out.a_m_s2[i] += level_m_s2 * advance(s.k, s.c, s.b, order, normal(s.rng))
    s.level_m_s2 = target_m_s2


@native
def begin_filter(order: float, fade: float, s: Any) -> None:
    """Go over to a filter of another order: at once, or, where the same surface is felt coarser or finer, in time."""
    for m in range(int(s.order) + 1, int(order) + 1 if fade > 0.0 else 0):
        s.k[m], s.c[m] = 0.0, 1.0
    s.order = max(order, s.order) if fade > 0.0 else order
    s.loud_m_s2 = max(s.level_m_s2, SILENT_M_S2) if fade > 0.0 else 0.0
    s.fade, s.wait = fade, 0.0


@native
def slowly(touch: Any, target_m_s2: float, s: Any) -> float:
    """The level of this tick on its way to that of another filter: by no more than `FADE_DB_S`, force and speed aside.

    `s.loud_m_s2` is what it was, and 0 when it has got there.
    """
    most = 10.0 ** (0.05 * FADE_DB_S * touch.tick_s)
    least = s.level_m_s2 / most
    if s.slip_m_s > 0.0 and s.force_N > 0.0:
        least *= min(1.0, touch.slip_m_s / s.slip_m_s) * min(1.0, touch.force_N / s.force_N)
    highest = most * max(s.level_m_s2, FADED * max(target_m_s2, s.loud_m_s2))
    if least > target_m_s2 and least > FADED * s.loud_m_s2:
        return float(least)
    if target_m_s2 > highest:
        return float(highest)
    s.loud_m_s2 = 0.0
    return target_m_s2


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
    ticks = max(1.0, round(swatch.parameter("lpc_texture", "update_ticks", 1.0)))
    header = (force_N[-1], speed_m_s[-1], texture.order, ticks)
    return np.concatenate((header, nodes.ravel()))


EFFECT = Effect(
    "lpc_texture",
    "The vibration of sliding, by force and slip speed.",
    render,
    params=(Param("texture_gain", 1.0, "1", "factor on the swatch's texture", 0.0, 10.0),),
    state=(
        State("k", (ORDER_MAX + 1,)),
        State("c", (ORDER_MAX + 1,)),
        State("b", (ORDER_MAX + 1,)),
        State("order"),  # of the filter that runs
        State("of"),  # of the table's, 0 where it is silent
        State("level_m_s2"),
        State("goal_m_s2"),  # level of the filter that was chosen last
        State("wait"),  # ticks until the next is
        State("fade"),  # ticks until it has become that of the table
        State("loud_m_s2"),
        State("force_N"),
        State("slip_m_s"),
        State("rng", seeded=True),
    ),
    table=table,
)
