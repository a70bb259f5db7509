"""A tool on a surface by its equations of motion: what sensors record of it, and the truth.

No model of a fit is used: friction holds or drags a mass that is pulled by a spring, a press follows a law of force
over depth, a tap is a mass that meets a spring (linear or Hertz's) and carries another one that rings.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray


def noisy(stream: Array, rng: np.random.Generator, snr_dB: float = 20.0) -> Array:
    """Adds white noise with a given SNR relative to the nonzero part of a stream (n,)."""
    level = np.sqrt(np.mean(stream[stream != 0.0] ** 2)) * 10 ** (-snr_dB / 20)
    return np.asarray(stream + level * rng.standard_normal(len(stream)))


def pulled(
    drive_m_s: Array,
    normal_N: Array,
    static: float,
    kinetic: Callable[[float], float],
    rate_Hz: float,
    mass_kg: float = 0.05,
    spring_N_m: float = 1000.0,
    damping_Ns_m: float = 5.0,
) -> tuple[Array, Array]:
    """Speed and tangential force at the surface (n,) of a mass on a spring and a damper.

    The mass holds until the pull reaches `static` times the normal force, then slips at `kinetic(speed)` times it.
    """
    fine = round(40_000.0 / rate_Hz)
    h = 1.0 / (fine * rate_Hz)
    streams = np.zeros((2, len(drive_m_s) * fine))
    stretch = v = 0.0
    driven = np.repeat([drive_m_s, normal_N], fine, axis=1).T.tolist()
    for i, (v_d, n) in enumerate(driven):
        pull = spring_N_m * stretch + damping_Ns_m * (v_d - v)
        if v == 0.0 and abs(pull) <= static * n:
            friction = pull
        else:
            friction = np.copysign(kinetic(abs(v)) * n, v or pull)
            moved = v + h / mass_kg * (pull - friction)
            v = 0.0 if v * moved < 0.0 else moved
        stretch += h * (v_d - v)
        streams[:, i] = v, friction
    speed, friction = streams.reshape(2, -1, fine).mean(axis=2)
    return np.abs(speed), friction


def tapped(
    speeds_m_s: Sequence[float],
    force: Callable[[float, float], float],
    rate_Hz: float,
    masses_kg: tuple[float, float] = (0.06, 0.03),
    ring: tuple[float, float] = (180.0, 70.0),
    stays_N: float = 0.0,
) -> tuple[Array, Array, Array]:
    """Acceleration of the tip, force and depth (n,) of a tool that comes each second at another speed.

    `force(depth, speed)` pushes the tip while it is in the surface; the second mass hangs on it so that both, in the
    air, ring at `ring` = (frequency, decay). A hand that stays pushes with so much, and the surface sticks to the tip;
    else the tool bounces off.
    """
    m1, m2 = masses_kg
    reduced = m1 * m2 / (m1 + m2)
    c = 2.0 * reduced * ring[1]
    k = reduced * ((2.0 * np.pi * ring[0]) ** 2 + ring[1] ** 2)
    each = round(rate_Hz)
    acceleration, push, depth = np.zeros((3, each * (len(speeds_m_s) + 1)))
    depth[:] = -0.02

    def contact(x: Array, v: Array) -> Array:
        pushed = force(x if stays_N else np.maximum(x, 0.0), v)
        return np.asarray(pushed if stays_N else np.where(x > 0.0, np.maximum(pushed, 0.0), 0.0))

    for i, speed in enumerate(speeds_m_s, 1):

        def moves(t: float, y: Array) -> list[float]:
            x1, v1, x2, v2 = y
            between = k * (x2 - x1) + c * (v2 - v1)
            hand = stays_N * np.sin(0.5 * np.pi * t / 0.45) ** 2
            return [v1, (between - float(contact(x1, v1))) / m1, v2, (hand - between) / m2]

        t = np.arange(round(0.45 * rate_Hz)) / rate_Hz
        y = solve_ivp(moves, (0.0, 0.45), [0.0, speed, 0.0, speed], t_eval=t, rtol=1e-7, atol=1e-10, max_step=5e-4).y
        start = i * each
        part = slice(start, start + len(t))
        acceleration[part] = -np.array([moves(s, z)[1] for s, z in zip(t, y.T, strict=True)])
        push[part] = contact(y[0], y[1])
        depth[part] = np.maximum(y[0], -0.02)
        away = np.arange(min(each // 4, round(0.02 / speed * rate_Hz))) / rate_Hz
        depth[start - len(away) : start] = -speed * away[::-1]
        if stays_N:  # and lifts off again, slowly
            lift = np.linspace(1.0, 0.0, round(0.1 * rate_Hz))
            after = slice(part.stop, part.stop + len(lift))
            push[after], depth[after] = push[part.stop - 1] * lift, depth[part.stop - 1] * lift
    return acceleration, push, depth
