"""The transient of a tap at the start of each contact, by the speed of approach, and that of leaving at its end.

    a(t) = A e^(−λt) sin(2πft)

with amplitude A [m/s²], frequency f [Hz] and decay λ [1/s] from the swatch's taps at that speed (Okamura,
Cutkosky & Dennerlein 2001), which a resonator makes (`hapscene.surface.resonator`). It rings on after the
tool has left. Bounces of a light hand are real: every contact is a tap.

Leaving is played in the same way at the end of each contact, from the swatch's `leaving`, by the speed at which the
tool leaves.

Where the swatch has measured transients, they are played instead: at its start a tap is added whole to a ring of
`RING` samples, which is then read off, so taps overlap, and ring on over another swatch.

Table of a swatch: how long that of its taps is, that of its taps, that of leaving; each empty where there is none, else
highest speed v_max, samples m of a transient (0: sinusoids), then rows. Sinusoids: A, f, λ
at SPEED_COUNT speeds i·v_max/(SPEED_COUNT − 1). Transients: k, k speeds, k rows of m samples; those of two speeds are
cross-faded. Below the lowest speed a tap is scaled down to nothing at rest, faster ones are clamped to v_max.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.resonator import RESONATOR, resonate, strike
from hapscene.surface.swatch import Swatch
from hapscene.surface.taps import Taps

SPEED_COUNT: Final = 257
"""Speeds of approach in the table [count]: the taps between two are straight, to 0.5 % of the amplitude."""

RING: Final = 4096
"""Longest transient that is played [count]: 0.4 s at 10 kHz. Of a longer one the end is faded out."""


def render(touch: np.record, p: np.record, table: NDArray[np.float64], s: np.record, out: np.record) -> None:
    """Add the ringing of the last taps and leavings to the acceleration [m/s²]."""
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
    """Begin the transient of a speed."""
    if table[1] > 0.0:
        strike_wave(speed_m_s, gain, table, s)
    else:
        strike_sinusoid(speed_m_s, gain, table, s)


@native
def strike_sinusoid(approach_m_s: float, gain: float, table: NDArray[np.float64], s: np.record) -> None:
    """Add a tap to the resonator."""
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
def ring(touch: np.record, s: np.record, out: np.record) -> None:
    """Read off what the ring holds for this tick."""
    if s.left == 0.0:
        return
    at = int(s.at)
    for i in range(min(touch.block, int(s.left))):
        out.a_m_s2[i] += s.ring_m_s2[at]
        s.ring_m_s2[at] = 0.0
        at = (at + 1) % RING
    s.at, s.left = float(at), max(0.0, s.left - touch.block)


def table(swatch: Swatch, rate_Hz: float) -> NDArray[np.float64]:
    """The taps and leavings of a swatch; empty where it has neither."""
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
    "A transient at the start and the end of contact, by speed.",
    render,
    params=(Param("tap_gain", 1.0, "1", "factor on the swatch's taps and leavings", 0.0, 10.0),),
    state=(*RESONATOR, State("at"), State("left"), State("ring_m_s2", (RING,))),
    table=table,
)
