"""Simulated strokes over surfaces, independent of the renderer."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hapscene.capture.io.streams import Streams

SURFACES: Final = ("steady", "grains", "bursts", "stick-slip")
"""Noise; modulation over distance; modulation over time; stick–slip tones."""


def simulated(
    surface: str, seconds: float, seed: int = 0, rate_Hz: float = 5000.0
) -> tuple[Streams, NDArray[np.bool_]]:
    """A stroke over one of `SURFACES`, simulated without the renderer, and the samples with stick-slip (n,)."""
    rng = np.random.default_rng([seed, SURFACES.index(surface)])
    count = round(seconds * rate_Hz)
    t_s = np.arange(count) / rate_Hz
    turn = rng.uniform(0.0, 2.0 * np.pi, 2)
    force = 1.5 + 0.4 * np.sin(3.1 * t_s + turn[0])
    speed = 0.15 + 0.1 * np.sin(5.0 * t_s + turn[1])
    slipping = np.zeros(count, dtype=np.bool_)
    level = np.sqrt(force * speed)
    if surface == "stick-slip":  # 17 to 25 dB, and 29 to 35 dB at 690 Hz, in turn
        start, loud = 0, False
        while start < count:
            end = start + 1 + int(rng.exponential(0.4 if loud else 0.6) * rate_Hz)
            slipping[start:end] = loud
            level[start:end] = 10.0 ** (rng.uniform(*((29.0, 35.0) if loud else (17.0, 25.0))) / 20.0)
            start, loud = end, not loud
    elif surface != "steady":  # a spread of 0.4, forgotten in 70 ms, or in what is travelled in them at 0.15 m/s
        gone = np.cumsum(speed / (0.07 * 0.15) if surface == "grains" else np.full(count, 1.0 / 0.07)) / rate_Hz
        kept = math.exp(-(step := 1.0 / (0.07 * rate_Hz)))
        drawn = math.sqrt(1.0 - kept**2) * rng.standard_normal(math.ceil(gone[-1] / step) + 2000)
        x = lfilter([1.0], [1.0, -kept], drawn)[1998:]  # even in what it forgets by
        level *= np.exp(0.4 * np.interp(gone, step * np.arange(len(x)), x) - 0.16)
    voices = []
    for poles_Hz, radius in (((150.0, 500.0), 0.95), ((690.0,), 0.995)):
        poles = radius * np.exp(2j * np.pi * np.array(poles_Hz) / rate_Hz)
        y = lfilter([1.0], np.poly([*poles, *np.conj(poles)]).real, rng.standard_normal(count + 2000))[2000:]
        voices.append(y / y.std())
    return Streams(rate_Hz, level * np.where(slipping, voices[1], voices[0]), force, speed, None), slipping
