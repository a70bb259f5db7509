"""One event felt by two devices with clocks of their own: taps and strokes, by plain formulas, and the truth.

A tap presses as half a sine and rings as a decaying one. A stroke's force and speed wander, and its vibration, noise
through two resonances, is as loud as they say. The second clock reads 0 when the first reads the offset.
"""

from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, lfilter, sosfiltfilt

Array = np.ndarray
Sampled = tuple[float, dict[str, Array]]

FINE_HZ: Final = 20_000.0
LEAD_S: Final = 2.6


def planted(
    seed: int, *, taps: bool, second: str = "force+speed", seconds: float | None = None, related: bool = True
) -> tuple[Sampled, Sampled, float, float]:
    """The first device (rate, streams), the second one, offset within ± 2 s, drift within ± 200 ppm.

    Args:
        seed: of all that is random.
        taps: three at the begin and three at the end; else strokes alone.
        second: what the second device feels: "force+speed", "force" or "acceleration".
        seconds: how long each records; None: 15 to 60.
        related: False: of another event than the first.
    """
    rng = np.random.default_rng([seed, taps, len(second)])
    seconds = rng.uniform(15.0, 60.0) if seconds is None else seconds
    offset_s, drift = rng.uniform(-2.0, 2.0), rng.uniform(-200e-6, 200e-6)
    one = _event(rng, seconds, taps)
    other = one if related else _event(rng, seconds, taps)
    rate_Hz = float(rng.choice([1000.0, 2000.0, 3200.0, 5000.0]))
    first = {"acceleration": _sampled(one["acceleration"], 10_000.0, 0.0, 0.0, seconds)}
    second_streams = {name: _sampled(other[name], rate_Hz, offset_s, drift, seconds) for name in second.split("+")}
    for streams in (first, second_streams):
        for name, stream in streams.items():
            streams[name] = stream + 0.05 * stream.std() * rng.standard_normal(len(stream))
    return (10_000.0, first), (rate_Hz, second_streams), offset_s, drift


def farthest_s(offset_s: float, drift: float, found_offset_s: float, found_drift: float, seconds: float) -> float:
    """Largest time error of an alignment while both devices record [s]."""
    t_s = np.array([max(0.0, -offset_s), seconds])
    return float(np.abs(found_offset_s - offset_s + (found_drift - drift) * t_s).max())


def _event(rng: np.random.Generator, seconds: float, taps: bool) -> dict[str, Array]:
    """Acceleration, force and speed at `FINE_HZ`, from `LEAD_S` before the first device records to after its end."""
    count = int((seconds + 2.0 * LEAD_S + 1.0) * FINE_HZ)
    made = {name: np.zeros(count) for name in ("acceleration", "force", "speed")}
    start_s, stop_s = (5.5, seconds - 5.0) if taps else (rng.uniform(-2.0, 0.5), seconds)
    poles = np.exp((2j * np.pi * np.array([180.0, 420.0]) - 160.0) / FINE_HZ)
    a = np.poly([*poles, *poles.conj()]).real
    while start_s < stop_s:
        end_s = min(stop_s, start_s + rng.uniform(1.0, 5.0))
        part = slice(int((LEAD_S + start_s) * FINE_HZ), int((LEAD_S + end_s) * FINE_HZ))
        length = part.stop - part.start
        ramp = np.minimum(1.0, np.minimum(np.arange(length), np.arange(length)[::-1]) / FINE_HZ / 0.05)
        force, speed = ramp * np.exp(0.3 * _wander(rng, length)), 0.1 * ramp * np.exp(0.5 * _wander(rng, length))
        noise = lfilter([1.0], a, rng.standard_normal(length))
        made["acceleration"][part] = 40.0 * noise / (noise.std() + 1e-12) * force**0.6 * speed
        made["force"][part], made["speed"][part] = force, speed
        start_s = end_s + rng.uniform(0.05, 1.0)
    first, last = np.cumsum(rng.uniform(0.25, 0.7, (2, 3)), axis=1) + rng.uniform(0.0, 0.5, (2, 1))
    for tap_s in (*(first + 2.2), *(seconds - 2.5 - last)) if taps else ():
        at, width, speed_m_s = int((LEAD_S + tap_s) * FINE_HZ), rng.uniform(0.008, 0.04), rng.uniform(0.03, 0.2)
        press = 10.0 * speed_m_s * np.sin(np.pi * np.arange(int(width * FINE_HZ)) / (width * FINE_HZ))
        t_s = np.arange(int(0.15 * FINE_HZ)) / FINE_HZ
        ring = 100.0 * speed_m_s * np.exp(-70.0 * t_s) * np.sin(2.0 * np.pi * rng.uniform(120.0, 300.0) * t_s)
        made["force"][at : at + len(press)] += press
        made["acceleration"][at : at + len(ring)] += ring
    return made


def _wander(rng: np.random.Generator, count: int) -> Array:
    """Random hand motion below 3 Hz with a variance of about 1."""
    knots = rng.standard_normal(max(2, int(count / FINE_HZ * 6.0)) + 10)
    spline = make_interp_spline(np.linspace(-0.1, count / FINE_HZ + 0.1, len(knots)), knots, 3)
    return np.asarray(spline(np.arange(count) / FINE_HZ))


def _sampled(stream: Array, rate_Hz: float, offset_s: float, drift: float, seconds: float) -> Array:
    """Samples a signal with the clock of a device, after a low-pass without delay."""
    smooth = sosfiltfilt(butter(4, 0.4 * rate_Hz, fs=FINE_HZ, output="sos"), stream)
    t_s = LEAD_S + offset_s + (1.0 + drift) * np.arange(int(seconds * rate_Hz)) / rate_Hz
    return np.interp(t_s * FINE_HZ, np.arange(len(smooth)), smooth)
