"""The governor: a gain that falls before force or travel would exceed their limits. Compiled.

Low frequencies need travel: an acceleration a needs a/ω². The more the coil would swing, the higher the corner of the
inverse becomes (`yield_corner`): slow motion is given up, the vibrotactile band stays. Only where this is not enough,
or where the force exceeds its limit, the gain of the whole signal falls.

The signal is delayed by `LOOK_AHEAD_S`. In the meantime a model of the handle predicts what the signal needs. The gain
of a sample keeps the force within its limit, and keeps the swing of the coil at the end of the look-ahead within the
allowed travel. The predicted state is the response to what was played, plus the gain times the response to what is
still to be played (a reference governor: Gilbert & Kolmanovsky 2002, "Nonlinear tracking control in the presence of
state and control constraints: a generalized reference governor", Automatica 38; here in closed form, as a quadratic
equation). The swing √(r² + (ṙ/ω)²) is the travel that the coil reaches without further force.

The applied gain is the minimum over the look-ahead, averaged over the look-ahead. So no sample exceeds its own gain,
and the gain changes no faster than a ramp of that length. Afterwards the gain returns slowly.

The model is the nominal handle under the force that the handle needs according to the estimate: a grip four times as
firm needs four times the force below 10 Hz, and the coil then moves four times as far. A handle that deviates before
this is learnt may reach its stops when the signal is far too strong (`handle_dynamics.move`). The adaptive compensator
detects the impact and reduces the allowed travel (`handle_loop.learn`).
"""

import math
from typing import Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.handle.handle_dynamics import MASK as MASK
from hapscene.handle.handle_dynamics import advance
from hapscene.handle.plant import Array

__all__ = ["HIGH_HZ", "LOOK_AHEAD_S", "ONE", "RELEASE_S", "TRAVEL_SHARE", "YIELD", "fade", "foresee", "yield_corner"]

LOOK_AHEAD_S: Final = 0.004
"""Delay of the signal [s]. It is a tenth of the delay that changes a texture (40 ms, Okamoto et al. 2009), and a sixth
of the audio-haptic asynchrony that is noticed (24 ms, Adelstein et al. 2003). With less, the gain falls faster and
becomes perceptible."""

HIGH_HZ: Final = 25.0
"""Highest corner of the inverse [Hz]. A higher one cuts into the vibrotactile band, a lower one leaves less travel."""

YIELD: Final = (0.3, 1.2)
"""Swing, relative to the allowed travel, at which the corner starts to rise and at which it is highest [1]; quadratic
in between. Chosen on taps of 1 to 200 m/s², 100 to 300 Hz: with f₀ = 5 Hz a tap of 20 m/s², 180 Hz has an error of 10
%, without the rising corner 75 %. Lower values weaken quieter taps; with higher ones the gain falls first."""

RELEASE_S: Final = 0.1
"""Time constant with which the gain returns [s]: equal to the decay time of the coil, 2 m_c/b_s. With less, the gain
oscillates with the coil."""

TRAVEL_SHARE: Final = 0.6
"""Share of the travel that the nominal model may use without adaptation [1]. The travel for an acceleration is
(m_c + m_h)/m_c a/ω²: with both masses 30 % off it is up to 1.7 times the nominal one. While the gain falls, up to a
fifth more was observed."""

ONE: Final = 1 << 40
"""The gain 1 as an integer, since a running sum of integers does not drift. Steps of 1e-12, far from overflow."""


@native
def yield_corner(h: np.record) -> float:
    """Return tan(ω₀T/2) of the corner frequency for the next sample: lowest for small coil travel, else higher.

    The travel is predicted for the nominal handle, or for the estimated handle if that gives much more.
    """
    learnt = _swing2(h, h.demand_x) / (h.yield_m * h.yield_m)
    plain = _swing2(h, h.nominal_x) / (h.nominal_m * h.nominal_m)
    swing2, room2 = max(learnt, plain), h.room * h.room
    if swing2 <= YIELD[0] * YIELD[0] * room2:  # the usual case: saves the square root
        return float(h.g_low)
    u = min((math.sqrt(swing2 / room2) - YIELD[0]) / (YIELD[1] - YIELD[0]), 1.0)
    return float(h.g_low + (h.g_high - h.g_low) * u * u)


@native
def _swing2(h: np.record, x: Array) -> float:
    """Squared travel that the coil reaches from state x (4,) without further force [m²]."""
    r, v = x[2], x[3] / h.swing_rad_s
    return float(r * r + v * v)


@native
def foresee(h: np.record, needed_N: float) -> float:
    """The gain, 0 … 1, that keeps the sample that is asked for now within the limits when it is played.

    `needed_N` is the force for the sample according to the estimate.
    """
    bound, most_N = 1.0, h.force_share * h.force_limit_N
    if abs(needed_N) > most_N:
        bound = most_N / abs(needed_N)
    s, x, ahead = h.demand_x, h.applied_x, h.ahead
    advance(h.nominal_step, s, needed_N)
    old = h.past_demand[(h.count - h.delay) & MASK]
    # state of the coil at the end of the look-ahead: (r, v) if nothing is played, (dr, dv) more at gain 1
    r = v = dr = dv = 0.0
    for j in range(4):
        r += ahead[2, j] * x[j]
        v += ahead[3, j] * x[j]
        dr -= ahead[2, j] * old[j]
        dv -= ahead[3, j] * old[j]
    dr += s[2]
    dv += s[3]
    for j in range(4):
        h.past_demand[h.count & MASK, j] = s[j]
    v, dv = v / h.swing_rad_s, dv / h.swing_rad_s
    room = h.room * h.room_m
    a, b, c = dr * dr + dv * dv, r * dr + v * dv, r * r + v * v - room * room
    if a + 2.0 * b + c <= 0.0:
        return float(bound)
    if c >= 0.0 or a == 0.0:
        return 0.0
    root = math.sqrt(b * b - a * c)
    gain = c / (-b - root) if b > 0.0 else (root - b) / a  # the form without cancellation
    return float(min(bound, gain))


@native
def fade(h: np.record, target: float) -> float:
    """The gain, 0 … 1, of the sample of `delay` samples ago, given the bound `target` of the newest sample.

    A monotonic queue (`least`, `when`) gives the minimum over the look-ahead, a running sum its average.
    """
    h.released = min(target, h.released + (1.0 - h.released) * h.release)
    now, length = h.count, h.delay + 1
    while h.last > h.first and h.least[(h.last - 1) & MASK] >= h.released:
        h.last -= 1
    h.least[h.last & MASK] = h.released
    h.when[h.last & MASK] = now
    h.last += 1
    if h.when[h.first & MASK] <= now - length:
        h.first += 1
    whole = int(h.least[h.first & MASK] * ONE)
    h.total += whole - h.gains[(now - length) & MASK]
    h.gains[now & MASK] = whole
    return float(h.total * h.share)
