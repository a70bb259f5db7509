"""Dynamics of the simulated handle: amplifier, coil, handle and hand, end stops, accelerometer. Compiled.

The amplifier is one pole; its output over a sample is replaced by its mean. For a force that is constant over a sample,
the state of the two masses is advanced exactly (zero-order hold). A change of the grip recomputes the matrices in
place.
"""

import math
from typing import Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.dsp.noise import normal
from hapscene.handle.plant import Array
from hapscene.records import Record

__all__ = ["MASK", "RING", "advance", "amplify", "delay", "grip_handle", "hold", "move", "sense", "set_delay"]

RING: Final = 512
"""Length of the ring buffers of delay lines and look-ahead [samples], a power of two: a look-ahead at up to 100 kHz."""

MASK: Final = RING - 1
"""Mask that wraps an index into a ring buffer. A modulo would cost as much as the rest of the loop."""

_TERMS: Final = 12
"""Terms of the series of the matrix exponential [count]. For a norm of 1/2 the remainder is below 1e-13."""


@native
def grip_handle(handle: np.record, k_u_N_m: float, b_u_Ns_m: float) -> None:
    """Change the grip of one `HANDLE`: stiffness [N/m] and damping [N·s/m] of the hand. Allocates nothing."""
    handle.k_u_N_m, handle.b_u_Ns_m = k_u_N_m, b_u_Ns_m
    hold(handle, handle.step)


@native
def hold(h: np.record, step: Array) -> None:
    """Fill step (5, 5) with exp([A B; 0 0] T): the transition of state and force over one sample."""
    work, power = h.work[0], h.work[1]
    _derivative(h, work)
    largest = 0.0
    for i in range(5):
        total = 0.0
        for j in range(5):
            total += abs(work[i, j])
        largest = max(largest, total)
    halvings = max(0, math.ceil(math.log2(max(largest, 1e-30) / h.rate_Hz)) + 1)
    scale = math.ldexp(1.0 / h.rate_Hz, -halvings)
    for i in range(5):
        for j in range(5):
            work[i, j] *= scale
            step[i, j] = 1.0 if i == j else 0.0
    for term in range(_TERMS, 0, -1):  # Horner: I + M (I + M/2 (I + M/3 (…)))
        _product(work, step, power)
        for i in range(5):
            for j in range(5):
                step[i, j] = power[i, j] / term + (1.0 if i == j else 0.0)
    for _ in range(halvings):
        _product(step, step, power)
        for i in range(5):
            for j in range(5):
                step[i, j] = power[i, j]


@native
def _derivative(h: np.record, m: Array) -> None:
    """Fill m (5, 5) with [A B; 0 0] of `Plant.state_space`."""
    for i in range(5):
        for j in range(5):
            m[i, j] = 0.0
    m[0, 1] = m[2, 3] = 1.0
    m[1, 0], m[1, 1] = -h.k_u_N_m / h.m_h_kg, -h.b_u_Ns_m / h.m_h_kg
    m[1, 2], m[1, 3], m[1, 4] = h.k_s_N_m / h.m_h_kg, h.b_s_Ns_m / h.m_h_kg, 1.0 / h.m_h_kg
    for j in range(5):
        m[3, j] = -m[1, j]
    m[3, 2] -= h.k_s_N_m / h.m_c_kg
    m[3, 3] -= h.b_s_Ns_m / h.m_c_kg
    m[3, 4] -= 1.0 / h.m_c_kg


@native
def _product(a: Array, b: Array, c: Array) -> None:
    for i in range(5):
        for j in range(5):
            total = 0.0
            for k in range(5):
                total += a[i, k] * b[k, j]
            c[i, j] = total


@native
def amplify(h: np.record, command_N: float) -> float:
    """The mean force of a sample [N] for a constant command: one pole at the bandwidth of the amplifier."""
    mean = command_N + (h.amplifier_N - command_N) * h.amplifier_mean
    h.amplifier_N = command_N + (h.amplifier_N - command_N) * h.amplifier_pole
    return float(mean)


@native
def advance(step: Array, x: Array, force_N: float) -> None:
    """Advance the state x (4,) by one sample with the transition step (5, 5)."""
    x0, x1, x2, x3 = x[0], x[1], x[2], x[3]
    for i in range(4):
        x[i] = step[i, 0] * x0 + step[i, 1] * x1 + step[i, 2] * x2 + step[i, 3] * x3 + step[i, 4] * force_N


@native
def move(h: np.record, force_N: float) -> float:
    """Advance the handle by one sample. Returns its acceleration at the start of the sample under the force [m/s²].

    A coil that reaches a stop remains there without rebound. Momentum is conserved, so the handle receives an impulse,
    which the acceleration includes. `hits` counts the impacts.
    """
    x = h.x
    spring = h.k_s_N_m * x[2] + h.b_s_Ns_m * x[3]
    acceleration = (force_N + (spring - h.k_u_N_m * x[0] - h.b_u_Ns_m * x[1])) * (1.0 / h.m_h_kg)
    before = abs(x[2])
    advance(h.step, x, force_N)
    if abs(x[2]) > h.travel_limit_m:
        stop = math.copysign(h.travel_limit_m, x[2])
        share = h.m_c_kg / (h.m_c_kg + h.m_h_kg)
        x[0] += share * (x[2] - stop)
        x[2] = stop
        if x[3] * stop > 0.0:
            x[1] += share * x[3]
            acceleration += share * x[3] * h.rate_Hz
            x[3] = 0.0
        h.hits += 1 if before < h.travel_limit_m else 0
    return float(acceleration)


@native
def sense(h: Record, acceleration_m_s2: float) -> float:
    """The reading of the accelerometer [m/s²]: noise, one pole, delay."""
    noisy = acceleration_m_s2 + h.noise_m_s2 * normal(h.rng)
    h.sensor_m_s2 += (1.0 - h.sensor_pole) * (noisy - h.sensor_m_s2)
    return delay(h.sensor_delay, h.sensor_m_s2)


@native
def set_delay(line: np.record, samples: float) -> None:
    """Set the delay of one `DELAY_LINE`; fractions of a sample by Lagrange interpolation of third order."""
    line.whole = max(0, int(samples) - 1)
    at = samples - line.whole
    for i in range(4):
        line.taps[i] = 1.0
        for j in range(4):
            if i != j:
                line.taps[i] *= (at - j) / (i - j)


@native
def delay(line: np.record, x: float) -> float:
    """Pass a sample x through one `DELAY_LINE`. Returns the delayed sample."""
    n = line.count
    line.last[n & MASK] = x
    line.count = n + 1
    n -= line.whole
    taps, last = line.taps, line.last
    newer = taps[0] * last[n & MASK] + taps[1] * last[(n - 1) & MASK]
    return float(newer + taps[2] * last[(n - 2) & MASK] + taps[3] * last[(n - 3) & MASK])
