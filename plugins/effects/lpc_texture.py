"""The vibration of a tool that slides: autoregressive (LPC) synthesis, chosen by force and slip speed.

A texture is a field of models over normal force and slip speed (Romano & Kuchenbecker 2012; Culbertson, Unwin &
Kuchenbecker 2014), run as a normalised lattice (`hapscene.dsp.lattice`): whatever models follow one another, the
output is no louder than they are. The level is ramped over the tick's block, so that nothing clicks when a contact
begins, ends, or crosses into another swatch.

A texture with life has a random slow gain (`hapscene.dsp.slow_gain`), advanced each tick by the time and the distance
travelled. One with another state changes to it and back by chance: filter and level then go over in `CHANGE_S`.

One with layers sounds like the two that are beside the direction of sliding, or beside the angle that the swatch's
numbers say (`angle_deg`), which the tick knows nothing of; in lattice and power it goes over from one to the other.

Table of a swatch: a section of its texture, and one of its texture's other state where there is one; or a section of
each layer, the first with the life of all, and then where they stand: the period of the angle [rad], 0 without; how
many there are; their places [rad], and where their sections begin. A section:

| number | is |
|---|---|
| 0, 1 | highest force F [N], highest speed V [m/s] |
| 2, 3 | order p, warp λ |
| 4, 5 | exponents of the power over force and speed beyond F and V |
| 6 | after how many ticks the filter follows force and speed: `update_ticks` of the swatch's numbers for this effect |
| 7 | 1 where all models have one filter, else 0 |
| 8 | checksum, which tells this section from others |
| 9 | mean time in this state [s], 0 without another |
| 10 | where the other state's section begins, 0 without one |
| 11 | count of processes of its slow gain |
| 12 | in the first section: where it is said where layers stand, 0 without |
| then | spread, decay_1_s, decay_1_m of each |
| then | where all have one filter: k_1 … k_p |
| then | for each of GRID forces from 0 to F, each of GRID speeds from 0 to V: P [m²/s⁴], k_1 … k_p if they differ |

Between nodes it is bilinear; above, the filter is clamped, and the level goes on by the exponents.
"""

import math
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import LEVEL_BOUND_DB, LIFE_MAX, ORDER_MAX, SLIP_CUTOFF_HZ
from hapscene.dsp.lattice import play, settle, voice_fields
from hapscene.dsp.noise import normal
from hapscene.dsp.slow_gain import CHANGE_S, advance_gain, advance_state, draw_state
from hapscene.native import native
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.resonator import SILENCE_M_S2
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import PERIOD_RAD, Texture

GRID = 33
"""Nodes of the table along force and along speed [count]. On textures fitted to wood, paper and leather
(order 20 and 40, 13 to 18 models) the spectrum at random places is within 0.01 dB (median) and 0.5 dB (95
%) of the texture's own; 17 nodes give 0.07 and 1.4 dB, 49 give 0.004 and 0.3 dB for twice the memory."""

ORDER, WARP, TICKS, SINGLE, CHECKSUM, DWELL, OTHER, PROCESSES, LAYERS = 2, 3, 6, 7, 8, 9, 10, 11, 12
HEADER = 13
"""Places in a section, and how many numbers stand before its processes [count]."""

FACING = 0.9
"""Cosine of the angle to the surface's normal above which a body's axis says no direction on it [1]."""

BOUND = 0.1 * LEVEL_BOUND_DB * math.log(10.0)
"""Logarithm of the largest factor on the power beyond the highest force and speed [1]."""

FADE_S = 0.2
"""Time in which a spread of the slow gain that is tuned is reached under the same touch [s]: it does not click."""


@native
def choose(table: Any, at: int, force_N: float, slip_m_s: float, s: Any, share: float, fill: bool) -> float:
    """Power [m²/s⁴] of the section `at` at a force and a speed; with `fill` its model goes into the lattice.

    With a `share` below 1 it goes as much of the way there from where it is; to 0 beyond the section's order. Where
    nothing is heard before and after, the lattice is left as it is.
    """
    row = min(max(force_N / table[at], 0.0), 1.0) * (GRID - 1)
    column = min(max(slip_m_s / table[at + 1], 0.0), 1.0) * (GRID - 1)
    i, j = min(int(row), GRID - 2), min(int(column), GRID - 2)
    u, v = row - i, column - j
    w00, w01, w10, w11 = (1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v
    order, single = int(table[at + ORDER]), table[at + SINGLE] > 0.0
    first = at + HEADER + 3 * int(table[at + PROCESSES])
    size = 1 if single else 1 + order
    at00 = (first + order if single else first) + (i * GRID + j) * size
    at01, at10, at11 = at00 + size, at00 + GRID * size, at00 + GRID * size + size
    power = w00 * table[at00] + w01 * table[at01] + w10 * table[at10] + w11 * table[at11]
    if force_N > table[at] or slip_m_s > table[at + 1]:
        log = table[at + 4] * math.log(max(force_N / table[at], 1.0))
        log += table[at + 5] * math.log(max(slip_m_s / table[at + 1], 1.0))
        power *= math.exp(min(max(log, -BOUND), BOUND))
    if power < SILENCE_M_S2**2:
        power = 0.0
    if fill and power == 0.0 and s.level_m_s2 == 0.0:
        s.stale = 1.0
    elif fill:
        for m in range(1, order + 1):
            if single:
                to = table[first + m - 1]
            else:
                to = w00 * table[at00 + m] + w01 * table[at01 + m] + w10 * table[at10 + m] + w11 * table[at11 + m]
            s.k[m] = to if share == 1.0 else s.k[m] + share * (to - s.k[m])
        for m in range(order + 1, int(s.order) + 1):
            s.k[m] -= share * s.k[m]
        s.order = order if share == 1.0 else max(order, int(s.order))
        s.warp = table[at + WARP] if share == 1.0 else s.warp + share * (table[at + WARP] - s.warp)
        settle(s)
    return float(power)


@native
def choose_layers(table: Any, angle_rad: float, touch: Any, s: Any, share: float) -> float:
    """As `choose`, of the two layers beside an angle: a share of the one's, then what makes it that of both."""
    at = int(table[LAYERS])
    period, count = table[at], int(table[at + 1])
    i, first, last = 0, table[at + 2], table[at + 1 + count]
    if period > 0.0:
        angle_rad = first + (angle_rad - first) % period
    while i + 1 < count and angle_rad >= table[at + 3 + i]:
        i += 1
    j = i + 1
    low, high = table[at + 2 + i], first + period
    if j < count:
        high = table[at + 2 + j]
    elif period > 0.0:
        j = 0
    else:
        j, high = i, last + 1.0
    weight = min(max((angle_rad - low) / (high - low), 0.0), 1.0)
    one, two = int(table[at + 2 + count + i]), int(table[at + 2 + count + j])
    rest = share * (1.0 - weight) / (1.0 - share * weight) if weight < 1.0 else 0.0
    power = choose(table, one, touch.force_N, touch.slip_m_s, s, rest, rest > 0.0)
    other = choose(table, two, touch.force_N, touch.slip_m_s, s, share * weight, weight > 0.0)
    return float(power + weight * (other - power))


@native
def heading(touch: Any, new: bool, s: Any) -> float:
    """Direction [rad] of sliding over the body, from its x-axis towards its y-axis, seen from outside.

    Where the surface faces along x, from the y-axis. It is that of the slip velocity, low-passed as its speed is.
    """
    take = 1.0 if new else 1.0 - math.exp(-2.0 * math.pi * SLIP_CUTOFF_HZ * touch.tick_s)
    n, way = touch.nhat_W, s.way_m_s
    for i in range(3):
        way[i] += take * (touch.slip_W_m[i] / touch.tick_s - way[i])
    up, x = n[0] * touch.x_WB[0] + n[1] * touch.x_WB[1] + n[2] * touch.x_WB[2], touch.x_WB
    if abs(up) > FACING:
        up, x = n[0] * touch.y_WB[0] + n[1] * touch.y_WB[1] + n[2] * touch.y_WB[2], touch.y_WB
    away = n[0] * way[0] + n[1] * way[1] + n[2] * way[2]
    along = x[0] * way[0] + x[1] * way[1] + x[2] * way[2] - up * away
    across = (n[1] * x[2] - n[2] * x[1]) * way[0] + (n[2] * x[0] - n[0] * x[2]) * way[1]
    return math.atan2(across + (n[0] * x[1] - n[1] * x[0]) * way[2], along)


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Add the texture's vibration [m/s²]; silent in the air, at no force and at no speed."""
    target_m_s2, ticks, gain = 0.0, 1.0, s.gain
    if touch.touching and table.size > 0:
        new = touch.began or touch.crossed
        changed = table[OTHER] > 0.0 and change_state(touch.tick_s, table, new, s)
        at = int(table[OTHER]) if table[OTHER] > 0.0 and s.state[0] > 0.0 else 0
        layered, angle_rad = table[LAYERS] > 0.0, p.angle_deg * math.pi / 180.0
        if layered and table[int(table[LAYERS])] > 0.0:
            angle_rad = heading(touch, new, s) - angle_rad
        if table[at + CHECKSUM] != s.of or new:
            s.change = CHANGE_S / touch.tick_s if changed and not new else 0.0
            begin_filter(table[at + ORDER], s.change, s)
            s.of = table[at + CHECKSUM]
        if s.wait <= 0.0 or new:
            s.wait = table[at + TICKS]
            share = s.wait / s.fade if s.fade > s.wait else 1.0
            s.fade = max(0.0, s.fade - s.wait)
            fill = s.stale > 0.0 or table[at + SINGLE] == 0.0
            s.stale = 1.0 if share < 1.0 else 0.0
            if layered:
                power = choose_layers(table, angle_rad, touch, s, share)
            else:
                power = choose(table, at, touch.force_N, touch.slip_m_s, s, share, fill)
            s.goal_m_s2 = p.texture_gain * math.sqrt(power)
        if not new:
            ticks = max(s.wait, s.change)  # in which the level gets there
        s.wait -= 1.0
        s.change = max(0.0, s.change - 1.0)
        target_m_s2 = s.goal_m_s2
        if ticks > 1.0:
            target_m_s2 = s.level_m_s2 + (s.goal_m_s2 - s.level_m_s2) / ticks
        gain = live(touch, p.texture_life, new, table, at, s)
        gain = s.gain + (gain - s.gain) / (s.change + 1.0) if s.change > 0.0 else gain
    if target_m_s2 == 0.0 and s.level_m_s2 == 0.0:
        return
    play(s, target_m_s2, gain, s.rng, out.a_m_s2, 0, touch.block, touch.block)


@native
def change_state(tick_s: float, table: Any, new: bool, s: Any) -> bool:
    """Whether the texture has changed to its other state or back; a contact begins in either."""
    here_s, other_s = table[DWELL], table[int(table[OTHER]) + DWELL]
    if new:
        draw_state(s.rng, here_s, other_s, s.state)
        return False
    return bool(advance_state(s.rng, here_s, other_s, tick_s, s.state))


@native
def live(touch: Any, life: float, new: bool, table: Any, at: int, s: Any) -> float:
    """The slow gain [1] of this tick. How lively it is follows `life` within `FADE_S`, in a new contact at once."""
    most = touch.tick_s / FADE_S
    s.lively = life if new else s.lively + min(max(life - s.lively, -most), most)
    count = int(table[at + PROCESSES])
    if count == 0 or s.lively == 0.0:
        return 1.0
    if s.life[0] == 0.0:  # not drawn yet
        for i in range(s.life.size):
            s.life[i] = normal(s.rng)
    travelled_m = touch.slip_m_s * touch.tick_s
    return advance_gain(s.rng, s.life, table, at + HEADER, count, touch.tick_s, travelled_m, s.lively, s.norm)


@native
def begin_filter(order: float, fade: float, s: Any) -> None:
    """Go over to another filter: at once, or in so many ticks."""
    for m in range(int(s.order) + 1, int(order) + 1 if fade > 0.0 else 0):
        s.k[m] = 0.0
    s.order = max(order, s.order) if fade > 0.0 else order
    s.fade, s.wait, s.stale = fade, 0.0, 1.0


def table(swatch: Swatch, rate_Hz: float) -> NDArray[np.float64]:
    """The sections of a swatch's texture at `rate_Hz`; empty where it has none."""
    texture = swatch.texture
    if texture is None:
        return np.empty(0)
    if texture.rate_Hz != rate_Hz:
        texture = texture.resampled(rate_Hz)
    ticks = max(1.0, round(swatch.parameter("lpc_texture", "update_ticks", 1.0)))
    if texture.layers:
        return layers(texture, ticks)
    numbers = section(texture, texture.dwell_s[0], ticks)
    if texture.other is None:
        return numbers
    numbers[OTHER] = len(numbers)
    return np.concatenate((numbers, section(texture.other, texture.dwell_s[1], ticks)))


def layers(texture: Texture, ticks: float) -> NDArray[np.float64]:
    """The sections of a texture's layers, and where they stand."""
    first = replace(texture.layers[0], life=texture.life)
    sections = [section(one, 0.0, ticks) for one in (first, *texture.layers[1:])]
    starts = np.cumsum([0, *map(len, sections)])
    sections[0][LAYERS], sections[0][CHECKSUM] = starts[-1], sum(one[CHECKSUM] for one in sections)
    period = PERIOD_RAD[texture.layer_by]
    head = 0.0 if math.isinf(period) else period, len(sections)
    return np.concatenate((*sections, head, texture.layer_at_rad, starts[:-1]))


def section(texture: Texture, dwell_s: float, ticks: float) -> NDArray[np.float64]:
    """The numbers of one state of a texture."""
    force_N, speed_m_s = (np.linspace(0.0, most, GRID) for most in (texture.force_max_N, texture.speed_max_m_s))
    k, power = texture.lattice(np.repeat(force_N, GRID), np.tile(speed_m_s, GRID))
    nodes = (k.ravel(), power) if texture.single else (np.column_stack((power, k)).ravel(),)
    life = texture.life
    rows = np.empty(0) if life is None else np.column_stack((life.spread, life.decay_1_s, life.decay_1_m)).ravel()
    numbers = np.concatenate((rows, *nodes))
    edge = texture.force_max_N, texture.speed_max_m_s, texture.order, texture.warp, *texture.exponents
    checksum = 1.0 + zlib.crc32(np.array(edge).tobytes() + numbers.tobytes())
    return np.array((*edge, ticks, texture.single, checksum, dwell_s, 0.0, len(rows) // 3, 0.0, *numbers))


EFFECT = Effect(
    "lpc_texture",
    "The vibration of sliding, by force and slip speed.",
    render,
    params=(
        Param("texture_gain", 1.0, "1", "factor on the swatch's texture", 0.0, 10.0),
        Param(
            "angle_deg",
            0.0,
            "°",
            "how far layers by direction are turned; of those by the tool's angle, that",
            -360,
            360,
        ),
        Param("texture_life", 1.0, "1", "factor on the spread of its slow gain; the mean power stays", 0.0, 2.0),
    ),
    state=(
        *(State(name, shape) for name, shape in voice_fields(ORDER_MAX)),  # of the filter that runs
        State("of"),  # checksum of the section that it is of
        State("stale"),  # 1 where it is still to become that
        State("goal_m_s2"),  # level of the filter that was chosen last
        State("wait"),  # ticks until the next is
        State("fade"),  # ticks until it has become that of the table
        State("change"),  # ticks until the level is that of another state
        State("life", (LIFE_MAX,)),  # its processes, each of variance 1
        State("lively"),  # factor on their spread
        State("norm", (2,)),  # see `advance_gain`
        State("way_m_s", (3,)),  # slip velocity, low-passed, where there are layers by it
        State("state", (2,)),  # 0 or 1 in the other, and the time left in it [s]
        State("rng", seeded=True),
    ),
    table=table,
)
