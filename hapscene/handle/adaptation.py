"""The inverse learnt from the handle's accelerometer, while it plays. Compiled.

The inverse is linear in θ (see `basis`), and so is what is measured: s⁴/D · F = Σ θ_i φ_i(a) + e, whatever is played
and wherever it comes from. θ is estimated by a Kalman filter (recursive least squares with the spread of handles as its
prior): before anything is heard θ is that of the nominal handle, after a few samples of texture its mass is known, and
the rest as far as it is excited.

Nothing measured is fed back into the force but through θ, which is kept inside bounds: the force is a stable filter of
what is asked for, whatever the handle and the hand do. There is no loop whose gain could be too high.
"""

from typing import Any, Final

from hapscene.handle.basis import COUNT, differences, integrals, section
from hapscene.native import native

COUPLING_D: Final = 1.4142135623730951
"""Damping of the coupling capacitor's section [1]: Butterworth."""


@native
def adapt(h: Any, force_N: float, measured_m_s2: float, asked_m_s2: float) -> None:
    """Learn from one sample: the force that acted [N], the acceleration that was read and the one that was due."""
    h.loud += h.loud_share * (asked_m_s2 * asked_m_s2 - h.loud)
    h.sensed_N += (1.0 - h.sensor_pole) * (force_N - h.sensed_N)  # the accelerometer's own pole, on both sides alike
    f = section(h.coupling, 0, h.coupling_g, COUPLING_D, h.sensed_N)[0]
    a = section(h.coupling, 2, h.coupling_g, COUPLING_D, measured_m_s2)[0]
    y = differences(h.pushed, h.g, h.d1, h.d2, f)
    phi = integrals(h.felt, h.g, h.d1, h.d2, a)
    if not y * y < 1e12:  # nothing finite to learn from
        return
    p, gain = h.spread, h.gain
    predicted, variance = 0.0, h.doubt_N2 * (1.0 + h.quiet / (h.loud + 1e-12)) + (h.doubt * y) ** 2
    for i in range(COUNT):
        total = 0.0
        for j in range(COUNT):
            total += p[i, j] * phi[j]
        gain[i] = total
        predicted += h.theta[i] * phi[i]
    for i in range(COUNT):
        variance += phi[i] * gain[i]
    surprise = (y - predicted) / variance
    for i in range(COUNT):
        h.theta[i] = min(max(h.theta[i] + gain[i] * surprise, h.theta_low[i]), h.theta_high[i])
        for j in range(i, COUNT):
            left = p[i, j] - gain[i] * gain[j] / variance
            p[i, j] = p[j, i] = left + h.forget * (h.spread_before[i, j] - left)
