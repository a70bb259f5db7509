"""The question of the texture update: how often the filter must follow force and speed."""

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

from .measuring import ISRAR, Array, apart_jnd, texture_bands, texture_us
from .question import Measure, Question, Setting
from .texture import known_texture

EVERY: Final = (1, 2, 4, 8, 16, 50)
"""Ticks between updates of the filter [count]."""

FORCE_N, SHARE, CHANGES_HZ = 1.0, 0.5, 3.0
"""Mean force of the stroking hand [N], relative amplitude of its variation [1], frequency of the variation [Hz]."""

STROKES: Final = 4
"""Number of strokes forth and back [count]."""


def settings(scene_file: str | None) -> list[Setting]:
    return [Setting("Update of the texture filter", "", f"{n} ms", {"every": n}, default=n == 1) for n in EVERY]


@cache
def hand() -> tuple[Array, Array]:
    """Return normal force [N] and slip speed [m/s] (n,) of a stroking hand, tick by tick."""
    scene = sheet(Swatch("stroked"))
    moved = PathBuilder((-0.05, 0.01, 0.01), TICK_S, look_from_above(scene))
    way = moved.line((-0.05, 0.01), (0.05, 0.01), STROKE_M_S)
    way = np.concatenate([way, way[::-1]] * STROKES)
    force = FORCE_N * (1.0 + SHARE * np.sin(2.0 * np.pi * CHANGES_HZ * TICK_S * np.arange(len(way))))
    moved.trace(way, force / STIFFNESS_N_M)
    recording = Renderer(scene, ("wall",)).run(moved.p_WT_m)
    return recording.normal_force_N[recording.touching], recording.slip_m_s[recording.touching]


@cache
def _texture() -> Texture:
    return known_texture("lsf", 5)  # each shipped swatch has one filter for all forces and speeds


def error(every: int) -> dict[str, float]:
    force, speed = hand()
    return held_error(_texture(), force, speed, every)


def held_error(texture: Texture, force_N: Array, speed_m_s: Array, every: int) -> dict[str, float]:
    """Return median and 95th percentile over ticks of the distance to the bands at the tick's force and speed [JND]."""
    last = np.arange(len(force_N)) // every * every
    true = texture_bands(texture, force_N, speed_m_s)
    level = np.sqrt(texture.power(force_N, speed_m_s))
    share = followed(level, every) / np.maximum(level[last], 1e-12)
    median, p95 = np.percentile(apart_jnd(true[last] * share[:, None], true), (50, 95))
    return {"median": float(median), "p95": float(p95)}


def followed(level_m_s2: Array, every: int) -> Array:
    """Return the played level (n,) for the true one (n,): updated every `every` ticks, interpolated linearly."""
    updates = np.arange(0, len(level_m_s2), every)
    return np.interp(np.arange(len(level_m_s2)) + 1, updates + every, level_m_s2[updates])


def time(every: int) -> tuple[float, float]:
    swatch = Swatch("timed", texture=_texture(), effects={"lpc_texture": {"update_ticks": float(every)}})
    return texture_us(swatch)


QUESTION: Final = Question(
    name="texture-update",
    title="Update interval of the texture filter",
    measures=(
        Measure("p95", "bands, 95 % of the ticks", "JND", 1.0, ISRAR),
        Measure("median", "bands, median tick", "JND"),
    ),
    settings=settings,
    error=error,
    time=time,
    conditions=(
        "A simulated surface whose spectral lines rise with the speed, stroked at 0.12 m/s on average with a force of "
        f"{FORCE_N:g} N that varies by half {CHANGES_HZ:g} times per second. Error: each tick's levels in twelve bands "
        "against those at its force and speed, in closed form. Between updates the filter is constant and the level is "
        "interpolated."
    ),
)
