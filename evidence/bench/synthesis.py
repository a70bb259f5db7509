"""Time of texture synthesis along a stroke, compared with SciPy's direct-form filter; time and memory of a fit."""

import time
import timeit
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hapscene.capture import SurfaceRecording, fit_swatch, synthesize
from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch

from .sheet import Sheet

Array = NDArray[np.float64]

RATE_HZ: Final = 10_000.0
ORDER: Final = 40
DURATION_S: Final = 10.0
MODULATION: Final = GainModulation(np.array([0.3, 0.3]), np.array([20.0, 5.0]), np.array([100.0, 0.0]))
REPEATS: Final = 7


def measure_synthesis(sheet: Sheet) -> None:
    """Measure the time to synthesise `DURATION_S` at `RATE_HZ`, the best of `REPEATS`.

    Figures of the case "synthesis, order 40": "nine models" (nine filters, along a stroke through all), the same
    "alive" (with amplitude modulation), and "over lfilter", the latter over the time of one call of
    `scipy.signal.lfilter` on existing noise with one filter.
    """
    rng = np.random.default_rng(ORDER)
    common = rng.uniform(-0.3, 0.3, ORDER)
    force, speed = (grid.ravel() for grid in np.meshgrid([0.5, 1.0, 2.0], [0.05, 0.1, 0.2]))
    a = ar_from_reflection(common + rng.uniform(-0.1, 0.1, (9, ORDER)))
    many = Texture.from_models(RATE_HZ, force, speed, a=a, variance_m2_s4=1.0 / power_gain(a))
    case = f"synthesis, order {ORDER}"
    sheet.add(case, "nine models for 10 s", _time_played(many), "s")
    alive_s = _time_played(replace(many, modulation=MODULATION))
    sheet.add(case, "nine models, alive over lfilter", alive_s / _time_filtered(ar_from_reflection(common)), "times")


def measure_fit(sheet: Sheet, durations_s: tuple[float, ...]) -> None:
    """Fit strokes over the shipped wood whose force and speed vary by a factor of ten; cases "fit, 10 s" and so on.

    "time" is that of `hapscene.capture.fit_swatch` without imports. "memory" is the peak of Python and NumPy memory
    including the recording, over the size of its three streams as float64; it is measured by tracemalloc in a separate
    run, because tracemalloc slows the fit.
    """
    wood = load_swatch("wood")
    for duration_s in (1.0, *durations_s):
        t = np.arange(round(RATE_HZ * duration_s)) / RATE_HZ
        force_N = 1.0 + 0.8 * np.sin(0.82 * t) + 0.1 * np.sin(10.7 * t)
        speed_m_s = 0.12 + 0.1 * np.sin(1.95 * t + 1.0)
        played = synthesize(wood, force_N, speed_m_s, rate_Hz=RATE_HZ)
        start_s = time.perf_counter()
        fit_swatch(SurfaceRecording(RATE_HZ, played, force_N, speed_m_s))
        taken_s = time.perf_counter() - start_s
        if duration_s not in durations_s:
            continue
        tracemalloc.start()
        fit_swatch(SurfaceRecording(RATE_HZ, played, force_N, speed_m_s))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        case = f"fit, {duration_s:g} s"
        sheet.add(case, "time", taken_s, "s")
        sheet.add(case, "memory", 1.0 + most / (3 * played.nbytes), "times")


def _time_played(texture: Texture) -> float:
    """Return the time to play a texture along a stroke between 5 % and 95 % of its largest force and speed [s]."""
    swatch = Swatch("timed", texture=texture)
    t_s = np.arange(round(RATE_HZ * DURATION_S)) / RATE_HZ
    force_N = texture.force_max_N * (0.5 + 0.45 * np.sin(2.1 * t_s))
    speed_m_s = texture.speed_max_m_s * (0.5 + 0.45 * np.sin(3.3 * t_s))
    return _best(lambda: synthesize(swatch, force_N, speed_m_s, rate_Hz=RATE_HZ))


def _time_filtered(a: Array) -> float:
    """Return the time of SciPy's filter for noise of the same length [s]."""
    noise = np.random.default_rng(0).standard_normal(round(RATE_HZ * DURATION_S))
    return _best(lambda: lfilter([1.0], a, noise))


def _best(job: Callable[[], Array]) -> float:
    job()
    return min(timeit.repeat(job, number=1, repeat=REPEATS))
