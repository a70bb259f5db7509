"""The handle, one sample at a time: what is asked for, compensated, limited, amplified, and felt by a hand. Compiled.

lead       make up for the amplifier's lag, where the compensator does
sum        the compensator's signals φ, weighted by the nominal θ: what will be needed   basis.py
fade       the gain that keeps force and travel inside their limits, in time             governor.py
push       φ of a look-ahead ago, weighted by θ as known now, times the gain
amplify    the current loop                                                              motion.py
move       coil, handle and hand                                                         motion.py
adapt      learn θ from the accelerometer, where the compensator does                    adaptation.py
"""

import math
from typing import Any, Final

from hapscene.handle.adaptation import adapt
from hapscene.handle.basis import COUNT, integrals, retune
from hapscene.handle.governor import MASK, fade, foresee, yield_corner
from hapscene.handle.motion import advance, amplify, move, sense
from hapscene.handle.record import ACCELEROMETER_HZ as ACCELEROMETER_HZ
from hapscene.handle.record import ACCELEROMETER_NOISE_M_S2_RTHZ as ACCELEROMETER_NOISE_M_S2_RTHZ
from hapscene.handle.record import HANDLE as HANDLE
from hapscene.handle.record import new_handle as new_handle
from hapscene.native import native

DESIRED_MAX_M_S2: Final = 1e6
"""Largest acceleration that is listened to [m/s²]: 20,000 times what the actuator can do. Keeps the filters finite."""


@native
def vibrate(handle: Any, desired_m_s2: float) -> tuple[float, float, float]:
    """One sample of a handle, one `HANDLE`, for the acceleration that is asked for [m/s²].

    Returns the handle's acceleration [m/s²] with this sample's force on, its displacement at the end of the sample [m],
    and the force [N]. What is asked for is played `delay` samples later; what is not finite counts as 0.
    """
    h = handle
    if not math.isfinite(desired_m_s2):
        desired_m_s2 = 0.0
    wanted = _lead(h, min(max(desired_m_s2, -DESIRED_MAX_M_S2), DESIRED_MAX_M_S2))
    phi = _integrate(h, wanted) if h.kind >= 2 else (wanted, 0.0, 0.0, 0.0, 0.0)
    asked, needed, nominal, pushed = 0.0, 0.0, 0.0, 0.0
    late, slot, due = h.late, h.count & MASK, (h.count - h.delay) & MASK
    for i in range(COUNT):
        asked += h.nominal[i] * phi[i]
        needed += h.theta[i] * phi[i]
        late[slot, i] = phi[i]
        nominal += h.nominal[i] * late[due, i]
        pushed += h.theta[i] * late[due, i]
    gain = fade(h, foresee(h, asked, max(abs(asked), abs(needed))))
    advance(h.scout_step, h.applied_x, gain * nominal)
    h.count += 1
    command = gain * pushed if h.kind > 0 else 0.0
    if abs(command) > h.force_limit_N:  # the last net
        command = math.copysign(h.force_limit_N, command)
        h.clips += 1
    force = amplify(h, command)
    acceleration = move(h, force)
    if h.kind == 3:
        adapt(h, force, sense(h, acceleration), late[due, 0], gain)
    return acceleration, h.x[0], force


@native
def _integrate(h: Any, wanted_m_s2: float) -> tuple[float, float, float, float, float]:
    """φ of a sample, its corner as high as the coil's travel asks for; scaled as θ is, for the corner of learning."""
    g = yield_corner(h)
    retune(h.wanted, g / h.g_now)
    h.g_now = g
    phi = integrals(h.wanted, g, h.d1, h.d2, wanted_m_s2)
    r = h.g / g
    return phi[0], r * phi[1], r * r * phi[2], r * r * r * phi[3], r * r * r * r * phi[4]


@native
def _lead(h: Any, a: float) -> float:
    """What the amplifier makes a of: gain (1 − pole z⁻¹)/(1 + zero z⁻¹)."""
    h.lead_m_s2[1] = h.lead[0] * (a - h.lead[1] * h.lead_m_s2[0]) - h.lead[2] * h.lead_m_s2[1]
    h.lead_m_s2[0] = a
    return float(h.lead_m_s2[1])
