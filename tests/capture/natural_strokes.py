"""Recordings of a hand that strokes, with known friction: for tests of 95 % intervals.

A stroke has a minimum-jerk profile (Flash & Hogan 1985). Friction holds or drags a tip on a spring and a damper. The
strokes of a recording are not independent samples: friction differs between strokes, directions and places, and the
normal force drifts. Force sensors have white noise, a drifting zero and a step; speed is that of a tracked position.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.signal import lfilter

from hapscene.capture.fit.segment import SegmentedRecording, segment
from hapscene.capture.io.streams import clean, speed_of

Array = np.ndarray

RATE_HZ = 1000.0
STEPS = 10
"""Steps of the motion of the tip per sample."""


@dataclass(frozen=True)
class Surface:
    """True friction μ(v) = dynamic + (static − dynamic) exp(−(v/stribeck)²) + viscous v."""

    static: float = 0.3
    dynamic: float = 0.3
    stribeck_m_s: float = 0.02
    viscous_s_m: float = 0.0

    def ratio(self, speed_m_s: Array) -> Array:
        return np.asarray(
            self.dynamic
            + (self.static - self.dynamic) * np.exp(-((speed_m_s / self.stribeck_m_s) ** 2))
            + self.viscous_s_m * speed_m_s
        )


@dataclass(frozen=True)
class Hand:
    """Medians over strokes: length, duration, rest between strokes, and normal force."""

    strokes: int = 10
    length_m: float = 0.09
    duration_s: float = 0.9
    rest_s: float = 0.2
    force_N: float = 2.0
    spread: float = 0.2
    """standard deviation of the logarithms of length and duration between strokes"""


def stroked(surface: Surface, hand: Hand, seed: int) -> SegmentedRecording:
    """A recording of to-and-fro strokes, filtered and segmented."""
    rng = np.random.default_rng(seed)
    drive, rough = [np.zeros(round(0.3 * RATE_HZ))], [np.zeros(round(0.3 * RATE_HZ))]
    for i in range(hand.strokes):
        length, duration, rest = (
            m * np.exp(hand.spread * rng.standard_normal()) for m in (hand.length_m, hand.duration_s, hand.rest_s)
        )
        share = (np.arange(round(duration * RATE_HZ)) + 0.5) / round(duration * RATE_HZ)
        speed = 30.0 * length / duration * (share * (1.0 - share)) ** 2
        drive += [(-1) ** i * speed, np.zeros(round(rest * RATE_HZ))]
        own = 0.02 * rng.standard_normal() + 0.01 * (-1) ** i
        rough.append(np.full(len(speed) + len(drive[-1]), own))
    drive_m_s = np.concatenate(drive)
    count = len(drive_m_s)
    place = np.cumsum(drive_m_s) / RATE_HZ
    lateral = 0.005 * _wander(rng, count, 1.0)
    patches = 0.02 * rng.standard_normal((401, 101))  # friction over the place, in patches of 3 mm
    cell = np.stack([place / 0.003 + 200.0, lateral / 0.003 + 50.0])
    local = map_coordinates(patches, cell, order=1, mode="nearest") + np.concatenate(rough)
    pressed = hand.force_N * np.exp(0.15 * _wander(rng, count, 1.0)) + 0.1 * _wander(rng, count, 0.2)
    pressed = np.maximum(pressed, 0.3)
    moved = dragged(
        np.repeat(drive_m_s, STEPS), np.repeat(pressed * (1.0 + local), STEPS), 1.0 / (STEPS * RATE_HZ),
        surface.static, surface.dynamic, surface.stribeck_m_s, surface.viscous_s_m,
    )  # fmt: skip
    speed, friction = moved.reshape(2, count, STEPS).mean(axis=2)
    tracked = np.round((np.cumsum(speed) / RATE_HZ + 1e-5 * rng.standard_normal(count)) / 2e-5) * 2e-5
    channels = clean(
        rng.standard_normal(count) * (0.02 + 20.0 * np.abs(speed)),
        RATE_HZ,
        _sensed(pressed, rng),
        speed_of([tracked], RATE_HZ),
        _sensed(friction, rng),
    )
    return channels, segment(channels)


def _sensed(force_N: Array, rng: np.random.Generator) -> Array:
    """Readings of a force sensor: noise of 15 mN, a zero that drifts by 3 mN, steps of 6 mN."""
    read = force_N + 0.015 * rng.standard_normal(len(force_N)) + 0.003 * _wander(rng, len(force_N), 3.0)
    return np.asarray(0.006 * np.round(read / 0.006))


def _wander(rng: np.random.Generator, count: int, time_s: float) -> Array:
    """Ornstein–Uhlenbeck process (count,) with a variance of 1."""
    kept = np.exp(-1.0 / (time_s * RATE_HZ))
    start = rng.standard_normal()
    made = lfilter([np.sqrt(1.0 - kept**2)], [1.0, -kept], rng.standard_normal(count), zi=[kept * start])[0]
    return np.asarray(made)


@numba.njit
def dragged(
    drive_m_s: Array,
    normal_N: Array,
    h_s: float,
    static: float,
    dynamic: float,
    stribeck_m_s: float,
    viscous_s_m: float,
    mass_kg: float = 0.02,
    spring_N_m: float = 2000.0,
    damping_Ns_m: float = 12.0,
) -> Array:
    """Speed and friction (2, n) of a tip on a spring and a damper that are pulled at the speeds `drive_m_s`."""
    made = np.zeros((2, len(drive_m_s)))
    stretch = v = 0.0
    for i in range(len(drive_m_s)):
        n = normal_N[i]
        pull = spring_N_m * stretch + damping_Ns_m * (drive_m_s[i] - v)
        if v == 0.0 and abs(pull) <= static * n:
            friction = pull
        else:
            size = abs(v)
            ratio = dynamic + (static - dynamic) * np.exp(-((size / stribeck_m_s) ** 2)) + viscous_s_m * size
            friction = ratio * n * (np.sign(v) if v != 0.0 else np.sign(pull))
            moved = v + h_s / mass_kg * (pull - friction)
            v = 0.0 if v * moved < 0.0 else moved
        stretch += h_s * (drive_m_s[i] - v)
        made[0, i], made[1, i] = v, friction
    return made
