"""The question of the rate of the force channel, for three devices."""

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from hapscene.constants import TICK_S
from hapscene.device.model import DEVICES
from hapscene.device.sim.hand import GRIPS
from hapscene.device.sim.point import PointMass
from hapscene.perception import force_jnd
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene
from hapscene.stability.z_width import trace
from hapscene.surface.swatch import Swatch

from ..bench.case import slide_path, sphere
from .measuring import Array, spread_us, ticks_ns
from .question import Measure, Point, Question, Setting

RATES_HZ: Final = (4000.0, 2000.0, 1000.0, 500.0)

DEVICES_TRIED: Final = ("omni", "premium-1.5", "phantom-1.0")

REFERENCE_HZ: Final = 20_000.0
"""Rate of the reference [Hz]: a multiple of all other rates."""

SLIDE_S, SUBDIVISIONS = 4.0, 5
"""Duration of the slide over the sphere [s]; subdivisions of the sphere [count]."""


def settings(scene_file: str | None) -> list[Setting]:
    return [
        Setting("Force rate", "", f"{r / 1e3:g} kHz", {"device": d, "rate_Hz": r}, d, r == 1.0 / TICK_S)
        for r in RATES_HZ
        for d in DEVICES_TRIED
    ]


def error(device: str, rate_Hz: float) -> dict[str, float]:
    """Return the force error [JND] against 20 kHz, and the stiffest wall that is stable with a light grip [N/m]."""
    point = _point(device)
    wall_N_m = trace(device, point, point, rate_Hz, 0, GRIPS["light"], (0.0,)).limit_N_m[0]
    return {"force": off_jnd(slid(rate_Hz), slid(REFERENCE_HZ)), "wall": wall_N_m}


def _point(device: str) -> PointMass:
    point = DEVICES[device].point
    assert point is not None
    return point


def _scene() -> Scene:
    scene = Scene()
    scene.add(sphere(SUBDIVISIONS), name="sphere", swatch=Swatch("wall"))
    return scene


@cache
def slid(rate_Hz: float) -> Array:
    """Return the forces (n, 3) [N] of a slide over a sphere at a rate; all rates sample the same path."""
    path = _path()[:: round(REFERENCE_HZ / rate_Hz)]
    return Renderer(_scene(), ("wall",), tick_s=1.0 / rate_Hz, a_rate_Hz=rate_Hz).run(path).f_W_N


@cache
def _path() -> Array:
    coarse = slide_path(round(SLIDE_S * 1000.0))
    at = np.arange(round(SLIDE_S * REFERENCE_HZ)) / REFERENCE_HZ
    return np.asarray(CubicSpline(np.arange(len(coarse)) / 1000.0, coarse)(at))


def off_jnd(slow_N: Array, fast_N: Array) -> float:
    """Return the 95th percentile over time of the difference of forces (n, 3), held, from fast ones (m, 3) [JND]."""
    held = np.repeat(slow_N, -(-len(fast_N) // len(slow_N)), axis=0)[: len(fast_N)]
    on = np.linalg.norm(fast_N, axis=1) > 0.0
    return float(np.percentile(force_jnd(held, fast_N)[on], 95))


def time(device: str, rate_Hz: float) -> tuple[float, float]:
    renderer = Renderer(_scene(), device=device, tick_s=1.0 / rate_Hz, a_rate_Hz=10.0 * rate_Hz)
    median, p99 = spread_us(ticks_ns(renderer, _path()[:: round(REFERENCE_HZ / rate_Hz)]))
    return 1e-3 * rate_Hz * median, 1e-3 * rate_Hz * p99


def caveat(used: Sequence[Point], every: Sequence[Point]) -> str:
    """Return the stiffest stable wall of the device with the softest one, at a rate and at the default."""
    softest, usual = (min(points, key=lambda p: p.errors["wall"]) for points in (used, [p for p in every if p.default]))
    return f"walls above {softest.errors['wall']:.0f} N/m ({softest.case}; default: {usual.errors['wall']:.0f})"


QUESTION: Final = Question(
    name="force-rate",
    title="Rate of the force channel",
    measures=(
        Measure("force", "force on a slide", "JND", 1.0, "7 %, 18° (Pang et al. 1991, Barbagli et al. 2006)"),
        Measure("wall", "stiffest stable wall", "N/m"),
    ),
    settings=settings,
    error=error,
    time=time,
    conditions=(
        "Force: slide over a sphere at 500 N/m, against 20 kHz, 95 % of the time. Stiffest wall: undamped, without the "
        "device's limits; by search with a light grip that taps and presses. Time: ticks of one "
        "millisecond of touch with all effects; the acceleration rate is ten times the force rate."
    ),
    caveat=caveat,
)
