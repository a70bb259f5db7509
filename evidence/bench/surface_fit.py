"""Time and memory of fitting a swatch to a short and a long recording."""

import time
import tracemalloc
from typing import Final

import numpy as np

from hapscene.capture import SurfaceRecording, fit_swatch, synthesize
from hapscene.swatches.library import load_swatch

from .sheet import Sheet

RATE_HZ: Final = 10_000.0


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
