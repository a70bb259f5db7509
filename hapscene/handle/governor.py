"""Saturation, anticipated: a gain that is down before the signal that needs it so. Compiled.

The signal is played `LOOK_AHEAD_S` late. Meanwhile a model of the nominal handle, driven by the whole of what the
compensator asks for, says how much of its force and travel is needed: need = max(|F|/F_max, swing/r_max), swing =
√(r² + (ṙ/ω)²) being how far the coil swings if nothing more is done. Where need is above 1 the gain must be below
1/need. It is made so by the least of the gains over the look-ahead, averaged over the look-ahead: no sample is played
above its own bound, and the gain has no corner sharper than a ramp of that length. Afterwards it comes back slowly,
as the swing that is still in the coil dies away.

What is averaged are whole numbers: a running sum of them never drifts.
"""

import math
from typing import Any, Final

from hapscene.handle.motion import advance
from hapscene.native import native

LOOK_AHEAD_S: Final = 0.004
"""How much later than asked for the signal is played [s]. A tenth of what is felt (Okamoto et al. 2009: 40 ms changes a
texture) and a sixth of the asynchrony of touch and sound that is noticed (24 ms, Adelstein et al. 2003). Shorter, and
the gain falls faster: more of it is heard."""

RELEASE_S: Final = 0.1
"""Time constant of the gain's return [s]: that of the coil's ringing, 2 m_c/b_s. Shorter, and the gain beats with the
ringing."""

TRAVEL_SHARE: Final = 0.6
"""Share of the travel that the nominal model may use [1]. For one acceleration the travel is (m_c + m_h)/m_c a/ω²:
with both masses off by 30 % it is up to 1.7 times the nominal, and a gain in motion adds to it."""

RING: Final = 512
"""Room for the look-ahead [samples]: up to 100 kHz."""

_ONE: Final = 2.0**40
"""The gain 1 as a whole number: steps of 1e-12, and the sum over a look-ahead far from overflow."""


@native
def need(h: Any, force_N: float) -> float:
    """Force and travel that a force of the nominal compensator needs, over what there is [1]."""
    x = h.scout_x
    advance(h.scout_step, x, force_N)
    swing = math.hypot(x[2], x[3] / h.scout_rad_s)
    return max(abs(force_N) / (h.force_share * h.force_limit_N), swing / (TRAVEL_SHARE * h.travel_limit_m))


@native
def fade(h: Any, need: float) -> float:
    """The gain for the sample of `delay` samples ago, once this one's need is known; 0 … 1."""
    target = 1.0 / max(need, 1.0)
    h.released = min(target, h.released + (1.0 - h.released) * h.release)
    now, length = h.count, h.delay + 1
    while h.last > h.first and h.least[(h.last - 1) % RING] >= h.released:
        h.last -= 1
    h.least[h.last % RING] = h.released
    h.when[h.last % RING] = now
    h.last += 1
    if h.when[h.first % RING] <= now - length:
        h.first += 1
    whole = int(h.least[h.first % RING] * _ONE)
    h.sum += whole - h.gains[now % length]
    h.gains[now % length] = whole
    return float(h.sum / (length * _ONE))
