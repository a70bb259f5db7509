"""A simulated recording with known parameters: taps, a press, and sliding over two surfaces."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.fit.segment import InteractionState

from .signals import resonant

STIFFNESS_N_M, FRICTION, TAP_HZ, TAP_DECAY_1_S, TAP_GAIN_1_S = 500.0, 0.35, 180.0, 70.0, 100.0


@dataclass
class Truth:
    """Streams (n,) with noise at 20 dB SNR, and the interaction states."""

    rate_Hz: float
    acceleration_m_s2: np.ndarray
    force_N: np.ndarray
    speed_m_s: np.ndarray
    tangential_force_N: np.ndarray
    depth_m: np.ndarray
    states: np.ndarray
    change: int
    """sample at which the surface changes during sliding"""
    tap_m_s: list[float] = field(default_factory=list)


def played(a: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Noise through 1/A, of variance 1."""
    y = lfilter([1.0], a, rng.standard_normal(count + 3000))[3000:]
    return np.asarray(y / y.std())


def handled(seed: int = 0, rate_Hz: float = 10_000.0, snr_dB: float = 20.0) -> Truth:
    """The recording: air with four taps, a press, surface A, surface B, rest, air, A again, air."""
    rng = np.random.default_rng(seed)
    taps = [0.05, 0.1, 0.2, 0.15]
    plan = [("air", 0.6)]
    for speed in taps:
        plan += [(f"tap {speed}", 0.04), ("air", 0.4)]
    plan += [("press", 0.5), ("A", 1.0), ("B", 1.2), ("rest", 0.5), ("air", 0.5), ("A again", 1.1), ("air", 0.6)]
    count = [round(s * rate_Hz) for _, s in plan]
    n = sum(count)
    a, force, speed, tangential = np.zeros((4, n))
    depth, states = np.full(n, -0.01), np.zeros(n, dtype=np.int8)
    surfaces = {"A": resonant([150, 500], 0.97, rate_Hz), "B": resonant([250, 700], 0.97, rate_Hz)}
    change = start = 0
    for (what, _), m in zip(plan, count, strict=True):
        part, t = slice(start, start + m), np.arange(m) / rate_Hz
        rise, fall = np.minimum(1.0, t / 0.1), np.minimum(1.0, t[::-1] / 0.05)
        if what.startswith("tap"):
            v = float(what.split()[1])
            force[part] = STIFFNESS_N_M * v * 0.04 / np.pi * np.sin(np.pi * t / 0.04)
            ring = np.arange(round(0.15 * rate_Hz)) / rate_Hz
            wave = TAP_GAIN_1_S * v * np.exp(-TAP_DECAY_1_S * ring) * np.sin(2 * np.pi * TAP_HZ * ring)
            a[start : start + len(ring)] += wave
            away = np.arange(round(0.01 / v * rate_Hz)) / rate_Hz
            depth[start - len(away) : start] = -v * away[::-1]
            depth[start + m : start + m + len(away)] = -v * away
            states[part] = InteractionState.TAP
        elif what != "air":
            force[part] = (
                1.5 * (rise if what in ("press", "A again") else 1.0) * (fall if what in ("rest", "A again") else 1.0)
            )
            states[part] = InteractionState.STILL if what in ("press", "rest") else InteractionState.SLIDING
        if what[0] in surfaces:
            ramp = np.minimum(1.0, t / 0.02) if what != "B" else np.ones(m)
            ramp *= np.minimum(1.0, t[::-1] / 0.02) if what != "A" else 1.0
            speed[part] = 0.15 * ramp
            a[part] += 2.0 * ramp * played(surfaces[what[0]], m, rng)
        if what == "press":
            come = np.arange(round(0.2 * rate_Hz)) / rate_Hz
            depth[start - len(come) : start] = -0.05 * come[::-1]
        change = start if what == "B" else change
        start += m
    depth = np.where(force > 0.0, force / STIFFNESS_N_M, depth)
    tangential = np.where(speed > 0.0, FRICTION, 0.2) * force

    def noisy(stream: np.ndarray, where: np.ndarray) -> np.ndarray:
        level = np.sqrt(np.mean(stream[where] ** 2)) * 10 ** (-snr_dB / 20)
        return np.asarray(stream + level * rng.standard_normal(n))

    contact = force > 0.0
    return Truth(
        rate_Hz,
        noisy(a, states == InteractionState.SLIDING),
        noisy(force, contact),
        noisy(speed, speed > 0.0),
        noisy(tangential, contact),
        noisy(depth, contact),
        states,
        change,
        taps,
    )


@pytest.fixture(scope="session")
def handled_recording() -> Callable[..., Truth]:
    return handled
