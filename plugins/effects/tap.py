"""The transient of a tap: a decaying sinusoid at the start of each contact, chosen by the speed of approach.

    a(t) = A e^(−λt) sin(2πft)

with amplitude A [m/s²], frequency f [Hz] and decay λ [1/s] from the swatch's taps at that speed (Okamura,
Cutkosky & Dennerlein 2001). A resonator makes it: a phasor that turns by 2πf/rate and shrinks by
e^(−λ/rate) each sample, heard as its imaginary part. A tap adds A to the real part, so that it starts
without a step, on top of one that still rings, and rings on after the tool has left. Bounces of a light
hand are real: every contact is a tap.

Table of a swatch, speeds v_i = i·v_max/(n − 1): v_max, then n rows of A, f, λ. Faster taps are clamped to
v_max.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.swatch import Swatch

SPEED_COUNT = 257
"""Speeds of approach in the table [count]: the taps between two are straight, to 0.5 % of the amplitude."""

SILENCE_M_S2 = 1e-6
"""Level at which a ringing tap is over [m/s²]: far below what is felt (about 1e-2), far above denormal
numbers."""


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Add the ringing of the last taps to the acceleration [m/s²]."""
    if touch.began and table.size > 0:
        position = min(max(touch.approach_m_s / table[0], 0.0), 1.0) * (SPEED_COUNT - 1)
        i = min(int(position), SPEED_COUNT - 2)
        row, share = 1 + 3 * i, position - i
        s.real_m_s2 += p.tap_gain * (table[row] + share * (table[row + 3] - table[row]))
        s.frequency_Hz = table[row + 1] + share * (table[row + 4] - table[row + 1])
        s.decay_1_s = table[row + 2] + share * (table[row + 5] - table[row + 2])
    if abs(s.real_m_s2) + abs(s.imag_m_s2) < SILENCE_M_S2:
        s.real_m_s2 = s.imag_m_s2 = 0.0
        return
    angle, shrink = 2.0 * math.pi * s.frequency_Hz / touch.rate_Hz, math.exp(-s.decay_1_s / touch.rate_Hz)
    cosine, sine = shrink * math.cos(angle), shrink * math.sin(angle)
    for i in range(touch.block):
        out.a_m_s2[i] += s.imag_m_s2
        real_m_s2 = cosine * s.real_m_s2 - sine * s.imag_m_s2
        s.imag_m_s2 = sine * s.real_m_s2 + cosine * s.imag_m_s2
        s.real_m_s2 = real_m_s2


def table(swatch: Swatch, rate_Hz: float) -> NDArray[np.float64]:
    """The taps of a swatch on an even grid of speeds (1 + 3 SPEED_COUNT,); empty where it has none."""
    taps = swatch.taps
    if taps is None:
        return np.empty(0)
    speed_m_s = np.linspace(0.0, float(np.max(taps.approach_m_s)), SPEED_COUNT)
    rows = np.array([taps.at(float(v)) for v in speed_m_s], dtype=np.float64)
    rows[rows[:, 1] >= rate_Hz / 2, 0] = 0.0  # this rate cannot carry it
    rows[0, 0] = 0.0  # a touch without speed is no tap
    return np.concatenate((speed_m_s[-1:], rows.ravel()))


EFFECT = Effect(
    "tap",
    "A transient at the start of contact, by speed of approach.",
    render,
    params=(Param("tap_gain", 1.0, "1", "factor on the swatch's taps", 0.0, 10.0),),
    state=(State("real_m_s2"), State("imag_m_s2"), State("frequency_Hz"), State("decay_1_s")),
    table=table,
)
