"""How often a texture's filter must follow the hand."""

import math
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.clock import new_clock, now_ns
from hapscene.constants import TICK_S
from hapscene.dsp.lattice import advance, excite
from hapscene.dsp.noise import seeded_state
from hapscene.native import native
from hapscene_plugins.effects.lpc_texture import GRID, HEADER, choose, table

from .measuring import ISRAR, RATE_HZ, Array, apart_jnd, enough, model_bands, spread_us
from .question import Measure, Point, Question, Setting
from .texture_domain import planted_texture

if TYPE_CHECKING:
    from hapscene.surface.texture import Texture

EVERY: Final = (1, 2, 5, 10, 20, 50)
"""Ticks from one look at force and speed to the next [count]."""

METHODS: Final = {"all": "filter and level", "filter": "filter; level in every tick"}

BLOCK: Final = round(RATE_HZ * TICK_S)

FORCE_N, SHARE, CHANGES_HZ = 1.0, 0.5, 3.0
"""Mean force of the hand that strokes [N], how much of it comes and goes [1], how often [Hz]."""

STROKES: Final = 4
"""Strokes to and fro [count]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    every = (1, 10, 50) if quick else EVERY
    return [Setting(said, f"{n} ms", {"held": held, "every": n}) for held, said in METHODS.items() for n in every]


@cache
def hand() -> tuple[Array, Array]:
    """Normal force [N] and slip speed [m/s] (n,), tick by tick, of a hand that strokes to and fro."""
    from hapscene.constants import STIFFNESS_N_M
    from hapscene.motion.hand_path import STROKE_M_S, Hand
    from hapscene.motion.look_from_above import look_from_above
    from hapscene.renderer import Renderer
    from hapscene.stability.rig import sheet
    from hapscene.surface.swatch import Swatch

    scene = sheet(Swatch("stroked"))
    moved = Hand((-0.05, 0.01, 0.01), TICK_S, look_from_above(scene))
    way = moved.line((-0.05, 0.01), (0.05, 0.01), STROKE_M_S)
    way = np.concatenate([way, way[::-1]] * STROKES)
    force = FORCE_N * (1.0 + SHARE * np.sin(2.0 * np.pi * CHANGES_HZ * TICK_S * np.arange(len(way))))
    moved.trace(way, force / STIFFNESS_N_M)
    felt = Renderer(scene, ("wall",)).run(moved.p_WT_m)
    return felt.normal_force_N[felt.touching], felt.slip_m_s[felt.touching]


@cache
def _texture() -> "Texture":
    return planted_texture("lsf", 5)  # a shipped swatch has one filter for all forces and speeds


def error(held: str, every: int) -> dict[str, float]:
    force, speed = hand()
    return held_error(_texture(), force, speed, held, every)


def held_error(texture: "Texture", force_N: Array, speed_m_s: Array, held: str, every: int) -> dict[str, float]:
    """How far the bands of each tick are from those at its own force and speed [JND]: median and 95th percentile."""
    last = np.arange(len(force_N)) // every * every
    a, variance = texture.models(force_N, speed_m_s)
    true = np.stack([model_bands(*each, texture.rate_Hz) for each in zip(a, variance, strict=True)])
    found = true[last]
    if held == "filter":
        level = np.sqrt(texture.power(force_N, speed_m_s))
        found = found * (level / np.maximum(level[last], 1e-12))[:, None]
    median, late = np.percentile(apart_jnd(found, true), (50, 95))
    return {"median": float(median), "p95": float(late)}


@native
def play(
    table: Any,
    force_N: Any,
    speed_m_s: Any,
    every: int,
    level_held: int,
    rng: Any,
    state: Any,
    out: Any,
    ns: Any,
    clock: Any,
) -> None:
    """The texture along forces and speeds (n,), and the time of each block [ns] (n,)."""
    order, knots = int(table[2]), int(table[3])
    power = level = 0.0
    for t in range(len(force_N)):
        start = now_ns(clock)
        if t % every == 0:
            power = choose(table, force_N[t], speed_m_s[t], state[0], state[1])
        elif level_held == 0:
            power = level_of(table, force_N[t], speed_m_s[t])
        target = math.sqrt(power)
        step = (target - level) / len(out)
        for i in range(len(out)):
            level += step
            out[i] = level * advance(state[0], state[1], state[2], order, excite(rng, table, table.size - knots, knots))
        ns[t] = now_ns(clock) - start


@native
def level_of(table: Any, force_N: float, speed_m_s: float) -> float:
    """What `choose` gives, without the filter."""
    row = min(max(force_N / table[0], 0.0), 1.0) * (GRID - 1)
    column = min(max(speed_m_s / table[1], 0.0), 1.0) * (GRID - 1)
    i, j = min(int(row), GRID - 2), min(int(column), GRID - 2)
    u, v, size = row - i, column - j, 1 + int(table[2])
    at = HEADER + (i * GRID + j) * size
    low = (1.0 - v) * table[at] + v * table[at + size]
    high = (1.0 - v) * table[at + GRID * size] + v * table[at + (GRID + 1) * size]
    return float((1.0 - u) * low + u * high)


def time(held: str, every: int) -> tuple[float, float]:
    from hapscene.surface.swatch import Swatch

    texture, (force, speed) = _texture(), hand()
    rows, runs = table(Swatch("timed", texture=texture), RATE_HZ), []
    for _ in range(6):
        ns, state = np.zeros(len(force), np.int64), np.zeros((3, texture.order + 1))
        play(
            rows,
            force,
            speed,
            every,
            int(held == "all"),
            seeded_state(0, "time"),
            state,
            np.zeros(BLOCK),
            ns,
            new_clock(),
        )
        runs.append(ns)
    return spread_us(np.min(runs[1:], axis=0))


def advice(points: Sequence[Point]) -> str:
    """The rarest update that is not felt, and what it saves in the worst tick."""
    at_once = min((p for p in points if p.label == "1 ms"), key=lambda p: p.median_us)
    chosen = enough(points, "p95", 1.0)
    single = "; where all models share one filter its level alone need follow at all"
    return (
        f"Follow the hand every {chosen.label} ({chosen.method}): 95 % of the blocks are then within "
        f"{chosen.errors['p95']:.2g} JND, and a block takes {chosen.median_us:.2g} µs where one that follows in every "
        f"tick takes {at_once.median_us:.2g}. Not for the sake of the worst tick, which still makes a filter "
        f"({chosen.p99_us:.2g} against {at_once.p99_us:.2g} µs at the 99th percentile), and not where a hand crosses "
        f"from one swatch into another: there the filter is another one at once{single}."
    )


QUESTION: Final = Question(
    name="texture-update",
    title="How often must a texture follow the hand?",
    measures=(
        Measure("p95", "bands, 95 % of the ticks", "JND", 1.0, ISRAR),
        Measure("median", "bands, median tick", "JND", 1.0, ISRAR),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        "A known surface whose lines rise with the speed, stroked to and fro by a hand at 0.12 m/s in the mean, its "
        f"{FORCE_N:g} N coming and going by half {CHANGES_HZ:g} times a second: each tick's levels in twelve bands "
        "against those of its own force and speed, in closed form."
    ),
    per="block",
)
