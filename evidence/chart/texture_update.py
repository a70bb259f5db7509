"""How often a texture's filter must follow the hand."""

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np

from hapscene.constants import STIFFNESS_N_M, TICK_S
from hapscene.motion.hand_path import STROKE_M_S, PathBuilder
from hapscene.motion.look_from_above import look_from_above
from hapscene.render.renderer import Renderer
from hapscene.stability.rig import sheet
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

from .measuring import ISRAR, Array, apart_jnd, effect_us, enough, texture_bands
from .question import Measure, Point, Question, Setting
from .texture import planted_texture

EVERY: Final = (1, 2, 5, 10, 20, 50)
"""Ticks from one look at force and speed to the next [count]."""

FORCE_N, SHARE, CHANGES_HZ = 1.0, 0.5, 3.0
"""Mean force of the hand that strokes [N], how much of it comes and goes [1], how often [Hz]."""

STROKES: Final = 4
"""Strokes to and fro [count]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    return [Setting("the shipped texture", f"{n} ms", {"every": n}) for n in ((1, 10, 50) if quick else EVERY)]


@cache
def hand() -> tuple[Array, Array]:
    """Normal force [N] and slip speed [m/s] (n,), tick by tick, of a hand that strokes to and fro."""
    scene = sheet(Swatch("stroked"))
    moved = PathBuilder((-0.05, 0.01, 0.01), TICK_S, look_from_above(scene))
    way = moved.line((-0.05, 0.01), (0.05, 0.01), STROKE_M_S)
    way = np.concatenate([way, way[::-1]] * STROKES)
    force = FORCE_N * (1.0 + SHARE * np.sin(2.0 * np.pi * CHANGES_HZ * TICK_S * np.arange(len(way))))
    moved.trace(way, force / STIFFNESS_N_M)
    felt = Renderer(scene, ("wall",)).run(moved.p_WT_m)
    return felt.normal_force_N[felt.touching], felt.slip_m_s[felt.touching]


@cache
def _texture() -> Texture:
    return planted_texture("lsf", 5)  # a shipped swatch has one filter for all forces and speeds


def error(every: int) -> dict[str, float]:
    force, speed = hand()
    return held_error(_texture(), force, speed, every)


def held_error(texture: Texture, force_N: Array, speed_m_s: Array, every: int) -> dict[str, float]:
    """How far the bands of each tick are from those at its own force and speed [JND]: median and 95th percentile."""
    last = np.arange(len(force_N)) // every * every
    true = texture_bands(texture, force_N, speed_m_s)
    level = np.sqrt(texture.power(force_N, speed_m_s))
    share = followed(level, every) / np.maximum(level[last], 1e-12)
    median, late = np.percentile(apart_jnd(true[last] * share[:, None], true), (50, 95))
    return {"median": float(median), "p95": float(late)}


def followed(level_m_s2: Array, every: int) -> Array:
    """The level that is played (n,) where it would be (n,): it is looked at each `every` ticks, and then gone to evenly
    until the next look."""
    looks = np.arange(0, len(level_m_s2), every)
    return np.interp(np.arange(len(level_m_s2)) + 1, looks + every, level_m_s2[looks])


def time(every: int) -> tuple[float, float]:
    swatch = Swatch("timed", texture=_texture(), effects={"lpc_texture": {"update_ticks": float(every)}})
    return effect_us(swatch, ("wall", "lpc_texture"), ("wall",))


def advice(points: Sequence[Point]) -> str:
    """The rarest update that is not felt, and what it saves in the worst tick."""
    at_once = next(p for p in points if p.label == "1 ms")
    chosen = enough(points, "p95", 1.0)
    single = "; where all models share one filter its level alone need follow at all"
    return (
        f"Follow the hand every {chosen.label} (`update_ticks`): 95 % of the blocks are then within "
        f"{chosen.errors['p95']:.2g} JND, and a block takes {chosen.median_us:.2g} µs where one that follows in every "
        f"tick takes {at_once.median_us:.2g}. Not for the sake of the worst tick, which still makes a filter "
        f"({chosen.p99_us:.2g} against {at_once.p99_us:.2g} µs at the 99th percentile){single}."
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
        "against those of its own force and speed, in closed form; between two looks the filter stays, and "
        "the level goes to that of the last one."
    ),
    per="block",
)
