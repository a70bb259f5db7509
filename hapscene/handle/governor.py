"""Saturation, anticipated: a gain that is down before the signal that needs it so. Compiled.

Travel is asked for by low frequencies: an acceleration a takes a/ω². So the more the coil will swing, the higher the
inverse's corner goes (`yield_corner`): the slow is given up, what is felt stays. Only where that is not enough, or the
force is over its limit, the gain of it all falls.

The signal is played `LOOK_AHEAD_S` late. Meanwhile a model of the handle tells what it will ask for. A sample
bears a gain at which the force is inside its limit, and at which the coil, at the end of the look-ahead, swings no
further than it may: it is where what has been played will leave it, plus the gain times what is still to be played
(a reference governor, Gilbert & Kolmanovsky 2002, "Nonlinear tracking control in the presence of state and control
constraints: a generalized reference governor", Automatica 38; here in closed form, a quadratic equation). Swing is
√(r² + (ṙ/ω)²), how far the coil goes if nothing more is done.

What is played is the least of the gains over the look-ahead, averaged over the look-ahead: no sample has more than its
own, and the gain has no corner sharper than a ramp of that length. Afterwards it comes back slowly.

The model is the nominal handle, under the force that the handle needs as far as it was learnt: a grip four times as
firm takes four times the force below 10 Hz, and the coil goes four times as far. One that differs before that is learnt
may reach its stops where the signal is far too loud: see `handle_dynamics.move`; the learning compensator hears that,
and gives out less travel (`handle_loop.learn`).
"""

import math
from typing import Any, Final

from hapscene.compiled.native import native
from hapscene.handle.handle_dynamics import MASK as MASK
from hapscene.handle.handle_dynamics import advance

__all__ = ["HIGH_HZ", "LOOK_AHEAD_S", "ONE", "RELEASE_S", "TRAVEL_SHARE", "YIELD", "fade", "foresee", "yield_corner"]

LOOK_AHEAD_S: Final = 0.004
"""How much later than asked for the signal is played [s]. A tenth of what is felt (Okamoto et al. 2009: 40 ms changes a
texture) and a sixth of the asynchrony of touch and sound that is noticed (24 ms, Adelstein et al. 2003). Shorter, and
the gain falls faster: more of it is heard."""

HIGH_HZ: Final = 25.0
"""The corner that the low one yields to [Hz]. Higher takes from the band that is felt, lower leaves less room."""

YIELD: Final = (0.3, 1.2)
"""Swing, over the room that there is, from where to where the corner goes from low to high, as its square [1]. Chosen
on taps of 1 to 200 m/s², 100 to 300 Hz: with f₀ = 5 Hz one of 20 m/s², 180 Hz is played with an error of 10 %, without
this 75 %. Earlier, and quieter taps lose; later, and the gain falls first."""

RELEASE_S: Final = 0.1
"""Time constant of the gain's return [s]: that of the coil's ringing, 2 m_c/b_s. Shorter, and the gain beats with the
ringing."""

TRAVEL_SHARE: Final = 0.6
"""Share of the travel that the nominal model may use where nothing is learnt [1]. For one acceleration the travel is
(m_c + m_h)/m_c a/ω²: with both masses off by 30 % it is up to 1.7 times the nominal. While the gain falls, up to a
fifth more was seen."""

ONE: Final = 1 << 40
"""The gain 1 as a whole number, for a running sum of whole numbers never drifts: steps of 1e-12, far from overflow."""


@native
def yield_corner(h: Any) -> float:
    """tan(ω₀T/2) of the corner for the next sample: the low one while the coil swings little, then higher.

    What counts is the swing of the nominal handle, or where that is much more, of the one that was learnt.
    """
    learnt, plain = _swing2(h, h.scout_x) / (h.yield_m * h.yield_m), _swing2(h, h.plain_x) / (h.plain_m * h.plain_m)
    swing2, room2 = max(learnt, plain), h.room * h.room
    if swing2 <= YIELD[0] * YIELD[0] * room2:  # nearly always, and foretold: the filter need not wait for a root
        return float(h.g_low)
    u = min((math.sqrt(swing2 / room2) - YIELD[0]) / (YIELD[1] - YIELD[0]), 1.0)
    return float(h.g_low + (h.g_high - h.g_low) * u * u)


@native
def _swing2(h: Any, x: Any) -> float:
    """How far the coil in the state x (4,) goes if nothing more is done, squared [m²]."""
    r, v = x[2], x[3] / h.scout_rad_s
    return float(r * r + v * v)


@native
def foresee(h: Any, needed_N: float) -> float:
    """The gain that the sample asked for now will bear, when it is played a look-ahead from now; 0 … 1.

    `needed_N` is the force that the handle needs for it, as far as it is known.
    """
    bound, most_N = 1.0, h.force_share * h.force_limit_N
    if abs(needed_N) > most_N:
        bound = most_N / abs(needed_N)
    s, x, ahead = h.scout_x, h.applied_x, h.ahead
    advance(h.scout_step, s, needed_N)
    old = h.scouted[(h.count - h.delay) & MASK]
    # where the coil is at the end of the look-ahead: (r, v) if nothing is played, (dr, dv) more at gain 1
    r = v = dr = dv = 0.0
    for j in range(4):
        r += ahead[2, j] * x[j]
        v += ahead[3, j] * x[j]
        dr -= ahead[2, j] * old[j]
        dv -= ahead[3, j] * old[j]
    dr += s[2]
    dv += s[3]
    for j in range(4):
        h.scouted[h.count & MASK, j] = s[j]
    v, dv = v / h.scout_rad_s, dv / h.scout_rad_s
    room = h.room * h.room_m
    a, b, c = dr * dr + dv * dv, r * dr + v * dv, r * r + v * v - room * room
    if a + 2.0 * b + c <= 0.0:
        return float(bound)
    if c >= 0.0 or a == 0.0:
        return 0.0
    root = math.sqrt(b * b - a * c)
    gain = c / (-b - root) if b > 0.0 else (root - b) / a  # of two forms the one that does not cancel
    return float(min(bound, gain))


@native
def fade(h: Any, target: float) -> float:
    """The gain for the sample of `delay` samples ago, once this one's is known; 0 … 1."""
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
