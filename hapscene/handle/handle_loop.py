"""The handle, one sample at a time: what is asked for, compensated, limited, amplified, and felt by a hand. Compiled.

lead       make up for the amplifier's lag, where the compensator does
sum        the compensator's signals φ, weighted by the nominal θ: what will be needed   compensator.py
fade       the gain that keeps force and travel inside their limits, in time             governor.py
push       φ of a look-ahead ago, weighted by θ as known now, times the gain
amplify    the current loop                                                              handle_dynamics.py
move       coil, handle and hand                                                         handle_dynamics.py
adapt      learn θ from the accelerometer, where the compensator does                    below
"""

import math
from typing import Any, Final

from hapscene.handle.compensator import COUNT, differences, integrals, retune, section
from hapscene.handle.governor import fade, foresee, yield_corner
from hapscene.handle.handle_dynamics import MASK, RING, advance, amplify, delay, move, sense, set_late
from hapscene.handle.handle_record import ACCELEROMETER_HZ as ACCELEROMETER_HZ
from hapscene.handle.handle_record import ACCELEROMETER_NOISE_M_S2_RTHZ as ACCELEROMETER_NOISE_M_S2_RTHZ
from hapscene.handle.handle_record import HANDLE as HANDLE
from hapscene.handle.handle_record import new_handle as new_handle
from hapscene.native import native

# The inverse learnt from the handle's accelerometer, while it plays. Compiled.
#
# The inverse is linear in θ (see `compensator`), and so is what is measured: s⁴/D · F = Σ θ_i φ_i(a) + e, whatever is
# played and wherever it comes from. θ is estimated by a Kalman filter (recursive least squares with the spread of
# handles as its prior): before anything is heard θ is that of the nominal handle, after a few samples of texture its
# mass is known, and the rest as far as it is excited.
#
# Nothing measured is fed back into the force but through θ, which is kept inside bounds: the force is a stable filter
# of what is asked for, whatever the handle and the hand do. There is no loop whose gain could be too high.


LEARN_ABOVE: Final = 0.9
"""Gain of the governor above which it is learnt [1]: below, the coil is near its stops."""

KNOCK_SHARE: Final = 0.5

SURE: Final = 4.0
"""A force that the model leaves unexplained is a knock where its square is above so much of the mean square of what is
played [1]: a handle of three times the nominal mass is not taken for one."""


@native
def learn(handle: Any, sample: int, force_N: float, read_m_s2: float) -> None:
    """Hear what a sample did, one `HANDLE`: the force that acted [N], and the acceleration that was read with it [m/s²].

    Samples are counted as `command_force` gave them, from 0, and heard in order, as late as may be; where some were
    lost, or there is nothing finite to be heard, nothing is learnt for a while. Where the force is not measured, it is
    the command, as `command_force` gave it. What the reading is late beside that, `Sensor.delay_s` says.
    """
    h = handle
    if h.kind != 3:
        return
    if sample != h.heard_count or not 0 < h.count - sample < RING or not math.isfinite(force_N + read_m_s2):
        h.heard_count, h.deaf = sample + 1, h.deaf_count
        return
    h.heard_count = sample + 1
    due, gain = h.due[sample & MASK], h.gain_due[sample & MASK]
    h.loud += h.loud_share * (due * due - h.loud)
    if h.force_measured == 0:
        command, force_N = force_N, force_N + (h.command_N - force_N) * h.believed_amplifier_mean
        h.command_N = command + (h.command_N - command) * h.believed_amplifier_pole
    # the accelerometer's own pole and delay, on all sides alike
    h.sensed_N += (1.0 - h.believed_pole) * (force_N - h.sensed_N)
    f = section(h.heard, 0, h.heard_g, h.heard_d, delay(h.force_late, h.sensed_N))[1]
    a = section(h.heard, 2, h.heard_g, h.heard_d, read_m_s2)[1]
    w = h.model[4] * f
    for i in range(4):
        w += h.model[i] * h.model_x[i]
    advance(h.scout_step, h.model_x, f)
    y = differences(h.pushed, h.g, h.d1, h.d2, h.heard_d * f)
    phi, z = h.phi, h.z
    phi[0], phi[1], phi[2], phi[3], phi[4] = integrals(h.felt, h.g, h.d1, h.d2, h.heard_d * a)
    z[0], z[1], z[2], z[3], z[4] = integrals(h.wished, h.g, h.d1, h.d2, h.heard_d * w)
    z[1], z[2], z[3], z[4] = phi[1], phi[2], phi[3], phi[4]
    j = h.jerk * (phi[0] - h.felt_before)
    phi[6] = h.jerk * (j - phi[5])
    phi[5], h.felt_before = j, phi[0]
    j = h.jerk * (z[0] - h.wished_before)
    z[6] = h.jerk * (j - z[5])
    z[5], h.wished_before = j, z[0]
    surprise = y - h.lag * phi[5] - h.snap * phi[6]
    for i in range(COUNT):
        surprise -= h.theta[i] * phi[i]
    h.room += h.room_back * (1.0 - h.room)
    r, v = h.applied_x[2], h.applied_x[3] / h.scout_rad_s
    swing = math.sqrt(r * r + v * v) / h.room_m
    if surprise * surprise > h.knock_N**2 + SURE * h.nominal[0] ** 2 * h.loud:
        if swing < KNOCK_SHARE:
            _fall_back(h)
        elif h.deaf == 0:
            h.room *= h.knocked
        h.deaf = max(h.deaf, h.deaf_count)
    if h.deaf > 0:
        h.deaf -= 1
    elif gain > LEARN_ABOVE or swing < KNOCK_SHARE:
        _update(h, y, surprise)
        h.distrust = max(h.distrust - 1, h.distrust_least)
        if sample & 63 == 0:
            _fold(h)
        out = h.theta[0] <= h.theta_low[0] or h.theta[0] >= h.theta_high[0] or h.late_s >= h.late_max_s
        h.sitting = h.sitting + 1 if out else 0
        if h.sitting > h.sitting_count:
            _fall_back(h)


@native
def _update(h: Any, y: float, surprise: float) -> None:
    """The Kalman filter's step: θ and its covariance, which goes back to what it was before with time."""
    p, k, theta, z = h.spread, h.gain, h.theta, h.z
    h.noise_N2 += h.noise_share * (surprise * surprise - h.noise_N2)
    variance = h.doubt_N2 * (1.0 + h.quiet / (h.loud + 1e-12)) + (h.doubt * y) ** 2 + h.whiter * max(h.noise_N2, h.noise_least_N2)
    for i in range(COUNT + 2):
        k[i] = 0.0
        for j in range(COUNT + 2):
            k[i] += p[i, j] * z[j]
        variance += z[i] * k[i]
    forget = h.forget_played + (h.forget - h.forget_played) * 0.01 / (0.01 + h.loud)
    share, keep = 1.0 / variance, 1.0 - forget
    h.lag += k[COUNT] * surprise * share
    h.snap += k[COUNT + 1] * surprise * share
    for i in range(COUNT):
        theta[i] = min(max(theta[i] + k[i] * surprise * share, h.theta_low[i]), h.theta_high[i])
        off = theta[i] / h.nominal[i] - 1.0
        h.used[i] = h.nominal[i] * (1.0 + off * off * off / (off * off + h.slight2))
    for i in range(COUNT + 2):
        for j in range(i + 1):
            p[i, j] = p[j, i] = keep * (p[i, j] - k[i] * k[j] * share) + forget * h.spread_before[i, j]


@native
def _fall_back(h: Any) -> None:
    """Forget what was learnt: the handle counts as the nominal one, each time for longer."""
    h.lag = h.snap = 0.0
    h.late_s = h.believed_s
    set_late(h.force_late, h.late_s * h.rate_Hz)
    h.sitting = 0
    for i in range(COUNT):
        h.theta[i] = h.used[i] = h.nominal[i]
    for i in range(COUNT + 2):
        for j in range(COUNT + 2):
            h.spread[i, j] = h.spread_before[i, j]
    if h.deaf == 0:
        h.deaf = h.distrust
        h.distrust = min(2 * h.distrust, 1 << 40)


@native
def _fold(h: Any) -> None:
    """Take some of the lag that was found into the delay of the force, which knows no approximation."""
    found_s = 0.1 * h.lag * h.jerk / (h.theta[0] * h.rate_Hz)
    late_s = min(max(h.late_s + found_s, 0.0), h.late_max_s)
    h.lag -= (late_s - h.late_s) * h.theta[0] * h.rate_Hz / h.jerk
    h.late_s = late_s
    set_late(h.force_late, late_s * h.rate_Hz)


DESIRED_MAX_M_S2: Final = 1e6
"""Largest acceleration that is listened to [m/s²]: 20,000 times what the actuator can do. Keeps the filters finite."""


@native
def command_force(handle: Any, desired_m_s2: float) -> float:
    """The force to be commanded in the next sample [N], one `HANDLE`, for the acceleration that is asked for [m/s²].

    What is asked for is played `delay` samples later; what is not finite counts as 0.
    """
    h = handle
    if not math.isfinite(desired_m_s2):
        desired_m_s2 = 0.0
    wanted = _lead(h, min(max(desired_m_s2, -DESIRED_MAX_M_S2), DESIRED_MAX_M_S2))
    phi = _integrate(h, wanted) if h.kind >= 2 else (wanted, 0.0, 0.0, 0.0, 0.0)
    asked, needed, pushed = 0.0, 0.0, 0.0
    late, slot, due = h.late, h.count & MASK, (h.count - h.delay) & MASK
    for i in range(COUNT):
        asked += h.nominal[i] * phi[i]
        needed += h.used[i] * phi[i]
        late[slot, i] = phi[i]
        pushed += h.used[i] * late[due, i]
    advance(h.scout_step, h.plain_x, asked)
    gain = fade(h, foresee(h, needed, needed))
    h.due[slot], h.gain_due[slot] = gain * late[due, 0], gain
    h.count += 1
    h.squeezed += (1.0 - h.squeezed) * h.release
    command = h.squeezed * gain * pushed if h.kind > 0 else 0.0
    if abs(command) > h.force_limit_N:
        h.squeezed *= h.force_limit_N / abs(command)
        command = math.copysign(h.force_limit_N, command)
        h.clips += 1
    advance(h.scout_step, h.applied_x, command if h.kind > 0 else gain * pushed)
    return float(command)


@native
def vibrate(handle: Any, desired_m_s2: float) -> tuple[float, float, float]:
    """One sample of a simulated handle, one `HANDLE`, for the acceleration that is asked for [m/s²].

    Returns the handle's acceleration [m/s²] with this sample's force on, its displacement at the end of the sample [m],
    and the force [N].
    """
    h = handle
    command = command_force(h, desired_m_s2)
    force = amplify(h, command)
    acceleration = move(h, force)
    if h.kind == 3:
        learn(h, h.count - 1, force if h.force_measured == 1 else command, sense(h, acceleration))
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
