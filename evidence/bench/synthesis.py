"""Time of texture synthesis: the lattice with its noise and its models along a stroke, beside SciPy's direct form."""

import timeit
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hapscene.capture.fit.synthesis import synthesize
from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

from .order import ORDERS
from .sheet import Sheet

Array = NDArray[np.float64]

RATE_HZ: Final = 10_000.0
DURATION_S: Final = 10.0
LIFE: Final = GainModulation(np.array([0.3, 0.3]), np.array([20.0, 5.0]), np.array([100.0, 0.0]))
REPEATS: Final = 7


def measure_synthesis(sheet: Sheet) -> None:
    """Times to make `DURATION_S` at `RATE_HZ`, the best of `REPEATS`, for each order.

    The case "synthesis, order p" has "one model" (one filter for all forces and speeds; the level follows them), "nine
    models" (all differ, along a stroke through all), the same "alive", with a slow gain, and "lfilter": one call of
    `scipy.signal.lfilter` on noise that is there already, with one fixed filter and level; each "over lfilter" is the
    ratio to it.
    """
    for order in ORDERS:
        rng = np.random.default_rng(order)
        common = rng.uniform(-0.3, 0.3, order)
        force, speed = (grid.ravel() for grid in np.meshgrid([0.5, 1.0, 2.0], [0.05, 0.1, 0.2]))
        one = _texture(common[None], np.array([2.0]), np.array([0.2]))
        many = _texture(common + rng.uniform(-0.1, 0.1, (9, order)), force, speed)
        case = f"synthesis, order {order}"
        alive = replace(many, modulation=LIFE)
        filtered_s = _time_filtered(ar_from_reflection(common))
        for name, texture in (("one model", one), ("nine models", many), ("nine models, alive", alive)):
            _add(sheet, case, name, time_s := _time_played(texture))
            sheet.add(case, f"{name} over lfilter", time_s / filtered_s, "times")
        _add(sheet, case, "lfilter", filtered_s)


def _add(sheet: Sheet, case: str, name: str, time_s: float) -> None:
    sheet.add(case, f"{name} for 10 s", time_s, "s")


def _time_played(texture: Texture) -> float:
    """Time to play a texture along a stroke between 5 % and 95 % of its largest force and speed [s]."""
    swatch = Swatch("timed", texture=texture)
    t_s = np.arange(round(RATE_HZ * DURATION_S)) / RATE_HZ
    force_N = texture.force_max_N * (0.5 + 0.45 * np.sin(2.1 * t_s))
    speed_m_s = texture.speed_max_m_s * (0.5 + 0.45 * np.sin(3.3 * t_s))
    return _best(lambda: synthesize(swatch, force_N, speed_m_s, rate_Hz=RATE_HZ))


def _time_filtered(a: Array) -> float:
    """Time of SciPy's filter on noise of the same length [s]."""
    noise = np.random.default_rng(0).standard_normal(round(RATE_HZ * DURATION_S))
    return _best(lambda: lfilter([1.0], a, noise))


def _texture(k: Array, force_N: Array, speed_m_s: Array) -> Texture:
    a = ar_from_reflection(k)
    return Texture.from_models(RATE_HZ, force_N, speed_m_s, a=a, variance_m2_s4=1.0 / power_gain(a))


def _best(job: Callable[[], Array]) -> float:
    job()
    return min(timeit.repeat(job, number=1, repeat=REPEATS))
