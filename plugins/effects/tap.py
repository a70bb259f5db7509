"""Tap transients: a vibration at the start of each contact, by approach speed, and at its end, by leaving speed.

    a(t) = A e^(−λt) sin(2πft)

Amplitude A [m/s²], frequency f [Hz] and decay λ [1/s] come from the swatch's taps at the approach speed (Okamura,
Cutkosky & Dennerlein 2001). A resonator (`hapscene.surface.resonator`) generates the sinusoid, which continues after
the tool has left. Every contact is a tap, including the bounces of a light hand.

The end of a contact is rendered in the same way, from the swatch's `leaving` and the leaving speed.

If the swatch has recorded transients, they replace the sinusoids. A transient is added to a ring buffer of `RING`
samples at the start of the contact, so transients can overlap and continue on another swatch.

The table of a swatch contains the length of the table of taps, the table of taps, and the table of leaving. Each is
empty or contains the highest speed v_max, the number m of samples of a transient (0: sinusoids) and rows. Sinusoids: A,
f, λ at SPEED_COUNT speeds i·v_max/(SPEED_COUNT − 1). Transients: their number k, k speeds, k rows of m samples, which
are interpolated between two speeds. Below the lowest speed the amplitude is proportional to the speed; above v_max it
is constant."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.resonator import RESONATOR, resonate, strike
from hapscene.surface.swatch import Swatch
from hapscene.surface.taps import Taps

SPEED_COUNT: Final = 257
"""Number of approach speeds in the table; linear interpolation between them is accurate to 0.5 % of the amplitude."""

RING: Final = 4096
"""Longest transient [samples]: 0.4 s at 10 kHz. Longer ones are shortened with a fade."""


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Adds the vibration of the last taps and leavings [m/s²]."""
    if table.size > 0:
        split = 1 + int(table[0])
        if touch.began and split > 1:
            play(touch.approach_m_s, p.tap_gain, table[1:split], s)
        if touch.ended and split < table.size:
            play(touch.leaving_m_s, p.tap_gain, table[split:], s)
    ring(touch, s, out)
    resonate(touch, s, out)


@native
def play(speed_m_s: float, gain: float, table: NDArray[np.float64], s: np.record) -> None:
    """Starts a transient for a speed."""
    if table[1] > 0.0:
        strike_wave(speed_m_s, gain, table, s)
    else:
        strike_sinusoid(speed_m_s, gain, table, s)


@native
def strike_sinusoid(approach_m_s: float, gain: float, table: NDArray[np.float64], s: np.record) -> None:
    """Adds a decaying sinusoid to the resonator."""
    position = min(max(approach_m_s / table[0], 0.0), 1.0) * (SPEED_COUNT - 1)
    i = min(int(position), SPEED_COUNT - 2)
    row, share = 2 + 3 * i, position - i
    strike(
        s,
        gain * (table[row] + share * (table[row + 3] - table[row])),
        table[row + 1] + share * (table[row + 4] - table[row + 1]),
        table[row + 2] + share * (table[row + 5] - table[row + 2]),
    )


@native
def strike_wave(approach_m_s: float, gain: float, table: NDArray[np.float64], s: np.record) -> None:
    """Adds a recorded transient to the ring buffer."""
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
def ring(touch: np.record, s: np.record, out: np.record) -> None:
    """Moves the samples of this tick from the ring buffer to the output."""
    if s.left == 0.0:
        return
    at = int(s.at)
    for i in range(min(touch.block, int(s.left))):
        out.a_m_s2[i] += s.ring_m_s2[at]
        s.ring_m_s2[at] = 0.0
        at = (at + 1) % RING
    s.at, s.left = float(at), max(0.0, s.left - touch.block)


def table(swatch: Swatch, rate_Hz: float) -> NDArray[np.float64]:
    """Table of the taps and leavings of a swatch; empty if it has neither."""
    taps, leaving = (_part(taps, rate_Hz) for taps in (swatch.taps, swatch.leaving))
    return np.concatenate(([len(taps)], taps, leaving)) if len(taps) or len(leaving) else np.empty(0)


def _part(taps: Taps | None, rate_Hz: float) -> NDArray[np.float64]:
    if taps is None:
        return np.empty(0)
    v_max = float(taps.approach_m_s[-1])
    if taps.wave_m_s2 is not None:
        waves = _waves(taps, rate_Hz)
        return np.concatenate(([v_max, waves.shape[1], len(waves)], taps.approach_m_s, waves.ravel()))
    rows = np.array([taps.at(float(v)) for v in np.linspace(0.0, v_max, SPEED_COUNT)], dtype=np.float64)
    rows[rows[:, 1] >= rate_Hz / 2, 0] = 0.0  # above the Nyquist frequency
    rows[0, 0] = 0.0  # no tap without approach speed
    return np.concatenate(([v_max, 0.0], rows.ravel()))


def _waves(taps: Taps, rate_Hz: float) -> NDArray[np.float64]:
    """Transients (k, m) at the output sample rate, at most as long as the ring buffer."""
    waves = np.array(taps.waves_at(rate_Hz))
    if waves.shape[1] > RING:
        waves = waves[:, :RING]
        fade = RING // 8
        waves[:, -fade:] *= 0.5 + 0.5 * np.cos(np.pi * (np.arange(fade) + 0.5) / fade)
    return waves


EFFECT = Effect(
    "tap",
    "Transient vibration at the start and end of contact, by speed.",
    render,
    params=(Param("tap_gain", 1.0, "1", "gain of the taps and leavings", 0.0, 10.0),),
    state=(*RESONATOR, State("at"), State("left"), State("ring_m_s2", (RING,))),
    table=table,
)
