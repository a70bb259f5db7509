"""The transient of a tap at the start of each contact, chosen by the speed of approach.

    a(t) = A e^(−λt) sin(2πft)

with amplitude A [m/s²], frequency f [Hz] and decay λ [1/s] from the swatch's taps at that speed (Okamura,
Cutkosky & Dennerlein 2001). A resonator makes it: a phasor that turns by 2πf/rate and shrinks by
e^(−λ/rate) each sample, heard as its imaginary part. A tap adds A to the real part, so that it starts
without a step, on top of one that still rings, and rings on after the tool has left. Bounces of a light
hand are real: every contact is a tap.

Where the swatch has measured transients, they are played instead: at its start a tap is added whole to a ring of
`RING` samples, which is then read off, so taps overlap, and ring on over another swatch.

Table of a swatch: highest speed v_max, samples m of a transient (0: sinusoids), then rows. Sinusoids: A, f, λ
at SPEED_COUNT speeds i·v_max/(SPEED_COUNT − 1). Transients: k, k speeds, k rows of m samples; those of two speeds are
cross-faded. Below the lowest speed a tap is scaled down to nothing at rest, faster ones are clamped to v_max.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.native import native
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.swatch import Swatch
from hapscene.surface.taps import Taps

SPEED_COUNT: Final = 257
"""Speeds of approach in the table [count]: the taps between two are straight, to 0.5 % of the amplitude."""

SILENCE_M_S2: Final = 1e-6
"""Level at which a ringing tap is over [m/s²]: far below what is felt (about 1e-2), far above denormal numbers."""

RING: Final = 4096
"""Longest transient that is played [count]: 0.4 s at 10 kHz. Of a longer one the end is faded out."""


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Add the ringing of the last taps to the acceleration [m/s²]."""
    if touch.began and table.size > 0:
        if table[1] > 0.0:
            strike_wave(touch.approach_m_s, p.tap_gain, table, s)
        else:
            strike_sinusoid(touch.approach_m_s, p.tap_gain, table, s)
    ring(touch, s, out)
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


@native
def strike_sinusoid(approach_m_s: float, gain: float, table: Any, s: Any) -> None:
    """Add a tap to the resonator."""
    position = min(max(approach_m_s / table[0], 0.0), 1.0) * (SPEED_COUNT - 1)
    i = min(int(position), SPEED_COUNT - 2)
    row, share = 2 + 3 * i, position - i
    s.real_m_s2 += gain * (table[row] + share * (table[row + 3] - table[row]))
    s.frequency_Hz = table[row + 1] + share * (table[row + 4] - table[row + 1])
    s.decay_1_s = table[row + 2] + share * (table[row + 5] - table[row + 2])


@native
def strike_wave(approach_m_s: float, gain: float, table: Any, s: Any) -> None:
    """Add a transient to what the ring still holds."""
    length, count = int(table[1]), int(table[2])
    speed = min(max(approach_m_s, 0.0), table[0])
    row = 0
    while row < count - 2 and speed > table[4 + row]:
        row += 1
    after = min(row + 1, count - 1)
    low, high = table[3 + row], table[3 + after]
    share = min(max((speed - low) / (high - low), 0.0), 1.0) if after > row else 0.0
    level = gain * min(1.0, speed / table[3])
    first, second = 3 + count + row * length, 3 + count + after * length
    at = int(s.at)
    for i in range(length):
        s.ring_m_s2[(at + i) % RING] += level * ((1.0 - share) * table[first + i] + share * table[second + i])
    s.left = max(s.left, float(length))


@native
def ring(touch: Any, s: Any, out: Any) -> None:
    """Read off what the ring holds for this tick."""
    at = int(s.at)
    for i in range(min(touch.block, int(s.left))):
        out.a_m_s2[i] += s.ring_m_s2[at]
        s.ring_m_s2[at] = 0.0
        at = (at + 1) % RING
    s.at, s.left = float(at), max(0.0, s.left - touch.block)


def table(swatch: Swatch, rate_Hz: float) -> NDArray[np.float64]:
    """The taps of a swatch; empty where it has none."""
    taps = swatch.taps
    if taps is None:
        return np.empty(0)
    v_max = float(taps.approach_m_s[-1])
    if taps.wave_m_s2 is not None:
        waves = _waves(taps, rate_Hz)
        return np.concatenate(([v_max, waves.shape[1], len(waves)], taps.approach_m_s, waves.ravel()))
    rows = np.array([taps.at(float(v)) for v in np.linspace(0.0, v_max, SPEED_COUNT)], dtype=np.float64)
    rows[rows[:, 1] >= rate_Hz / 2, 0] = 0.0  # this rate cannot carry it
    rows[0, 0] = 0.0  # a touch without speed is no tap
    return np.concatenate(([v_max, 0.0], rows.ravel()))


def _waves(taps: Taps, rate_Hz: float) -> NDArray[np.float64]:
    """The transients (k, m) at the channel's rate, as long as the ring at most."""
    waves = np.array(taps.waves_at(rate_Hz))
    if waves.shape[1] > RING:
        waves = waves[:, :RING]
        fade = RING // 8
        waves[:, -fade:] *= 0.5 + 0.5 * np.cos(np.pi * (np.arange(fade) + 0.5) / fade)
    return waves


EFFECT = Effect(
    "tap",
    "A transient at the start of contact, by speed of approach.",
    render,
    params=(Param("tap_gain", 1.0, "1", "factor on the swatch's taps", 0.0, 10.0),),
    state=(
        State("real_m_s2"),
        State("imag_m_s2"),
        State("frequency_Hz"),
        State("decay_1_s"),
        State("at"),
        State("left"),
        State("ring_m_s2", (RING,)),
    ),
    table=table,
)
