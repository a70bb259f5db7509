"""The question of the rate of the force channel, for three devices."""

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from hapscene.device.model import DEVICES
from hapscene.device.sim.hand import GRIPS
from hapscene.device.sim.point import PointMass
from hapscene.perception import force_jnd
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene
from hapscene.stability.closed_form import limit_of_small_motion
from hapscene.stability.rig import Rig
from hapscene.stability.z_width import trace, try_wall
from hapscene.surface.swatch import Swatch

from ..bench.case import slide_path, sphere
from .measuring import Array, enough, spread_us, ticks_ns
from .question import Measure, Point, Question, Setting

RATES_HZ: Final = (500.0, 1000.0, 2000.0, 4000.0)

TOUCHED: Final = ("omni", "premium-1.5", "phantom-1.0")

REFERENCE_HZ: Final = 20_000.0
"""Rate of the reference [Hz]: a multiple of all other rates."""

SLIDE_S, SUBDIVISIONS = 4.0, 5
"""Duration of the slide over the sphere [s]; subdivisions of the sphere [count]."""

BUZZ_N_M: Final = 1000.0
"""Stiffness of the wall on which a device is tested for vibration [N/m]: CHAI3D's value for a Phantom 1.0."""

REST_MM_S, LEAST_MM_S = 5.0, 0.01
"""Largest speed that counts as rest (as in `hapscene.stability.z_width`); smallest speed that is drawn [mm/s]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    rates = RATES_HZ[1:3] if quick else RATES_HZ
    devices = TOUCHED[:1] if quick else TOUCHED
    return [Setting(d, f"{r / 1e3:g} kHz", {"device": d, "rate_Hz": r, "quick": quick}) for d in devices for r in rates]


def error(device: str, rate_Hz: float, quick: bool = False) -> dict[str, float]:
    """Return the stiffest wall in closed form and by simulation, the speed on the test wall, and the force error."""
    point, grip = _point(device), GRIPS["light"]
    found = {
        "closed": limit_of_small_motion(point.mass_kg, point.b_Ns_m, 1.0 / rate_Hz),
        "buzz": max(LEAST_MM_S, 1e3 * try_wall(Rig(point, 1.0 / rate_Hz), BUZZ_N_M, 0.0, grip).end_speed_m_s),
        "force": held_force_jnd(rate_Hz),
    }
    if not quick:
        found["felt"] = trace(device, point, point, rate_Hz, 0, grip, (0.0,)).limit_N_m[0]
    return found


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


def held_force_jnd(rate_Hz: float) -> float:
    """Return the 95th percentile over time of the difference from the force at 20 kHz, with zero-order hold [JND]."""
    return off_jnd(slid(rate_Hz), slid(REFERENCE_HZ))


def off_jnd(slow_N: Array, fast_N: Array) -> float:
    """Return the same for forces (n, 3), each held over m/n of the fast forces (m, 3)."""
    held = np.repeat(slow_N, -(-len(fast_N) // len(slow_N)), axis=0)[: len(fast_N)]
    on = np.linalg.norm(fast_N, axis=1) > 0.0
    return float(np.percentile(force_jnd(held, fast_N)[on], 95))


def time(device: str, rate_Hz: float, quick: bool = False) -> tuple[float, float]:
    renderer = Renderer(_scene(), device=device, tick_s=1.0 / rate_Hz, a_rate_Hz=10.0 * rate_Hz)
    median, p99 = spread_us(ticks_ns(renderer, _path()[:: round(REFERENCE_HZ / rate_Hz)]))
    return 1e-3 * rate_Hz * median, 1e-3 * rate_Hz * p99


def advice(points: Sequence[Point]) -> str:
    """Recommend the lowest rate whose force error is below one JND, and state the stiffest wall at other rates."""
    chosen = enough(points, "force", 1.0)
    gains = []
    for device in dict.fromkeys(p.method for p in points):
        own = sorted((p for p in points if p.method == device), key=lambda p: float(p.label.split()[0]))
        key = "felt" if all("felt" in p.errors for p in own) else "closed"
        stable = [p for p in own if p.errors["buzz"] <= REST_MM_S and p.errors.get("felt", BUZZ_N_M) >= BUZZ_N_M]
        quiet = stable[0].label if stable else "no rate tested"
        gains.append(
            f"{device}: {own[0].errors[key]:.0f} N/m at {own[0].label}, {own[-1].errors[key]:.0f} N/m at "
            f"{own[-1].label}, stable at {BUZZ_N_M:g} N/m from {quiet}"
        )
    return (
        f"For the force alone {chosen.label} is sufficient ({chosen.errors['force']:.2g} JND for 95 % of a slide). "
        f"Stiffer walls need a higher rate; stiffest stable wall: {'; '.join(gains)}. The time per second grows with "
        "the rate."
    )


QUESTION: Final = Question(
    name="force-rate",
    title="Rate of the force channel",
    measures=(
        Measure("force", "force on a slide, 95 %", "JND", 1.0, "7 %, 18° (Pang et al. 1991, Barbagli et al. 2006)"),
        Measure(
            "buzz", f"speed on a wall of {BUZZ_N_M:g} N/m", "mm/s", REST_MM_S, "half an encoder's noise", limit="rest"
        ),
        Measure("felt", "stiffest stable wall, light grip", "N/m", more_is_better=True),
        Measure("closed", "stiffest stable wall, no friction, no hand", "N/m", more_is_better=True),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"Force: slide over a sphere at 500 N/m, against 20 kHz. Speed: a light grip taps and presses an undamped wall "
        f"of {BUZZ_N_M:g} N/m without the device's limits; stiffest wall: the same by search, and in closed form. "
        "Time: ticks of one millisecond with all effects and ten acceleration samples per tick."
    ),
    per="ms of touch",
)
