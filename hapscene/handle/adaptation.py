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

LEARN_ABOVE: Final = 0.9
"""Gain of the governor above which it is learnt [1]: below, the coil is near its stops."""

SURE: Final = 4.0
"""A force that the model leaves unexplained is a knock where its square is above so much of the mean square of what is
played [1]: a handle of three times the nominal mass is not taken for one."""


@native
def adapt(h: Any, force_N: float, measured_m_s2: float, asked_m_s2: float, gain: float) -> None:
    """Learn from one sample: the force that acted, the acceleration that was read, the one that was due at that gain.

    A force that nothing explains is the coil's knock at a stop. Then nothing is learnt for a while, and the governor
    gives out less travel.
    """
    h.loud += h.loud_share * ((gain * asked_m_s2) ** 2 - h.loud)
    h.sensed_N += (1.0 - h.sensor_pole) * (force_N - h.sensed_N)  # the accelerometer's own pole, on both sides alike
    f = section(h.heard, 0, h.heard_g, h.heard_d, h.sensed_N)[1]
    a = section(h.heard, 2, h.heard_g, h.heard_d, measured_m_s2)[1]
    y = differences(h.pushed, h.g, h.d1, h.d2, h.heard_d * f)
    phi = integrals(h.felt, h.g, h.d1, h.d2, h.heard_d * a)
    surprise = y
    for i in range(COUNT):
        surprise -= h.theta[i] * phi[i]
    h.room += h.room_back * (1.0 - h.room)
    if surprise * surprise > h.knock_N**2 + SURE * h.nominal[0] ** 2 * h.loud:
        if h.deaf == 0:
            h.room *= h.knocked
        h.deaf = h.deaf_count
    if h.deaf > 0:
        h.deaf -= 1
    elif gain > LEARN_ABOVE:
        _learn(h, y, phi, surprise)


@native
def _learn(h: Any, y: float, phi: tuple[float, float, float, float, float], surprise: float) -> None:
    """The Kalman filter's step: θ and its covariance, which goes back to what it was before with time."""
    p, k, theta = h.spread, h.gain, h.theta
    variance = h.doubt_N2 * (1.0 + h.quiet / (h.loud + 1e-12)) + (h.doubt * y) ** 2
    for i in range(COUNT):
        k[i] = p[i, 0] * phi[0] + p[i, 1] * phi[1] + p[i, 2] * phi[2] + p[i, 3] * phi[3] + p[i, 4] * phi[4]
        variance += phi[i] * k[i]
    share, keep = 1.0 / variance, 1.0 - h.forget
    for i in range(COUNT):
        theta[i] = min(max(theta[i] + k[i] * surprise * share, h.theta_low[i]), h.theta_high[i])
        for j in range(i + 1):
            p[i, j] = p[j, i] = keep * (p[i, j] - k[i] * k[j] * share) + h.forget * h.spread_before[i, j]
