"""The handle, one sample at a time: what is asked for, compensated, limited, amplified, and felt by a hand. Compiled.

`command_force`: the acceleration that is asked for → the force to command; all that a real handle needs to play, with
the record `new_handle(found.plant, found.plant, "adaptive", rate_Hz, sensor=found.sensor)` of its identification.

lead       make up for the amplifier's lag, where the compensator does
sum        the compensator's signals φ, weighted by θ: what will be needed               compensator.py
fade       the gain that keeps force and travel inside their limits, in time             governor.py
push       φ of a look-ahead ago, weighted by θ as known now, times the gain

`learn`: the force that acted and the acceleration that was read → θ, where the compensator learns it.

`vibrate` is a simulated handle between the two:

amplify    the current loop                                                              handle_dynamics.py
move       coil, handle and hand                                                         handle_dynamics.py
sense      the accelerometer                                                             handle_dynamics.py
"""

import math
from typing import Any, Final

from hapscene.compiled.native import inlined, native
from hapscene.handle.compensator import COUNT, differences, integrals, retune, section
from hapscene.handle.governor import fade, foresee, yield_corner
from hapscene.handle.handle_dynamics import MASK, RING, advance, amplify, delay, move, sense, set_late
from hapscene.handle.handle_record import ACCELEROMETER_HZ as ACCELEROMETER_HZ
from hapscene.handle.handle_record import ACCELEROMETER_NOISE_M_S2_RTHZ as ACCELEROMETER_NOISE_M_S2_RTHZ
from hapscene.handle.handle_record import HANDLE as HANDLE
from hapscene.handle.handle_record import new_handle as new_handle

__all__ = ["DESIRED_MAX_M_S2", "command_force", "learn", "vibrate"]

# The inverse learnt from the handle's accelerometer, while it plays. Compiled.
#
# The inverse is linear in θ (see `compensator`), and so is what is measured: s⁴/D · F = Σ θ_i φ_i(a) + e, whatever is
# played and wherever it comes from. θ is estimated by a Kalman filter (recursive least squares with the spread of
# handles as its prior): before anything is heard θ is that of the nominal handle, after a few samples of texture its
# mass is known, and the rest as far as it is excited.
#
# What is read is late, slow and noisy (`sensor.Sensor`). So the force goes through the pole and the delay that are
# believed of the accelerometer before the two are compared. What of them is mistaken shows as a force of its own: to
# second order, what is read is a + lag·ȧ + snap·ä too early. Both numbers are estimated with θ, and the lag is taken
# into the delay. Noise in φ would make the mass seem less the more of it there is (errors in variables). So the mass,
# lag and snap are not correlated with what was read, but with what the nominal handle would have done under the same
# force (instrumental variables: Söderström & Stoica 1983, "Instrumental Variable Methods for System Identification"),
# in which that noise is not. The rest of θ is heard below 50 Hz, where there is little noise and the nominal handle may
# swing otherwise; there the reading is its own instrument. What is left unexplained tells how much noise there is.
#
# Nothing measured is fed back into the force but through θ, which is kept inside bounds: the force is a stable filter
# of what is asked for, whatever the handle and the hand do. There is no loop whose gain could be too high. And where
# nothing explains what is read, or the answer lies at a bound, θ is the nominal one again, each time for longer.


LEARN_ABOVE: Final = 0.9
"""Gain of the governor above which it is learnt [1], and below only while the coil is far from its stops."""

FAR: Final = 0.5
"""Swing, over the room that there is, below which the coil is far from its stops [1]: what nothing explains there is no
knock of the coil, but a handle or a sensor that is none as believed."""

ROOM_LEAST: Final = 0.15
"""Least share of the travel that is left where knocks go on [1]: a handle whose numbers are all 30 % off swings up to
five times as far as the nominal one."""

SURE: Final = 4.0
"""A force that the model leaves unexplained is a knock where its square is above so much of the mean square of what is
played [1]: a handle of three times the nominal mass is not taken for one."""

NEAR: Final = 1.05
"""How near to its bound the mass sits there [1]: noise moves it a little."""

FOLD_SAMPLES: Final = 64
"""After how many samples some of the lag is taken into the delay [count], a power of two."""

FOLD: Final = 0.1
"""How much of it [1]: slowly, for what the filters hold was delayed as before."""


@inlined
def learn(handle: Any, sample: int, force_N: float, read_m_s2: float) -> None:
    """Hear what a sample did, one `HANDLE`: the force that acted [N], the acceleration that was read with it [m/s²].

    Samples are counted as `command_force` gave them, from 0, and heard in order, up to 500 samples after they were
    given; where some are missing, or not finite, nothing is learnt for a while. Where the force is not measured
    (`Sensor.force_measured`), it is the command, as `command_force` gave it. By how much the reading is later than the
    force, `Sensor.delay_s` says. Compensators that do not learn ignore it.
    """
    h = handle
    if h.kind != 3:
        return
    in_time = sample == h.heard_count and 0 < h.count - sample < RING
    h.heard_count = sample + 1
    if not (in_time and math.isfinite(force_N) and math.isfinite(read_m_s2)):
        h.deaf = max(h.deaf, h.deaf_count)
        return
    due, gain = h.due_m_s2[sample & MASK], h.due_gain[sample & MASK]
    h.loud += h.loud_share * (due * due - h.loud)
    y = _hear(h, force_N, read_m_s2)
    surprise = y - h.lag * h.phi[COUNT] - h.snap * h.phi[COUNT + 1]
    for i in range(COUNT):
        surprise -= h.theta[i] * h.phi[i]
    h.room += h.room_back * (1.0 - h.room)
    r, v = h.applied_x[2], h.applied_x[3] / h.scout_rad_s
    far = math.sqrt(r * r + v * v) < FAR * h.room_m
    if surprise * surprise > h.knock_N**2 + SURE * h.nominal[0] ** 2 * h.loud:
        again = h.deaf > 0
        if far and h.deaf <= h.deaf_count:
            _fall_back(h)
        if h.struck == 0:
            if again or not far:  # a stop, though what is known of the handle may have the coil far from it
                h.room = max(h.knocked * h.room, min(h.room, ROOM_LEAST))
            h.struck = h.deaf_count
        h.deaf = max(h.deaf, h.deaf_count)
    h.struck = max(h.struck - 1, 0)
    if h.deaf > 0:
        h.deaf -= 1
    elif far or gain > LEARN_ABOVE:
        _update(h, y, surprise)
        _judge(h)
        if sample & (FOLD_SAMPLES - 1) == 0:
            _fold(h)


@inlined
def _hear(h: Any, force_N: float, read_m_s2: float) -> float:
    """Fill φ and its instruments z; returns the force that φ are to explain, s⁴/D · F [N]."""
    if h.force_measured == 0:
        command = force_N
        force_N += (h.command_N - command) * h.believed_mean
        h.command_N = command + (h.command_N - command) * h.believed_pole
    h.sensed_N += (1.0 - h.heard_pole) * (force_N - h.sensed_N)  # the accelerometer's own pole and delay, on the force
    f = section(h.heard, 0, h.heard_g, h.heard_d, delay(h.force_late, h.sensed_N))[1]
    a = section(h.heard, 2, h.heard_g, h.heard_d, read_m_s2)[1]
    nominal = h.model[4] * f
    for i in range(4):
        nominal += h.model[i] * h.model_x[i]
    advance(h.scout_step, h.model_x, f)
    phi, z = h.phi, h.z
    slow, fast = phi[0], phi[COUNT]
    phi[0], phi[1], phi[2], phi[3], phi[4] = integrals(h.felt, h.g, h.d1, h.d2, h.heard_d * a)
    phi[COUNT] = h.jerk * (phi[0] - slow)
    phi[COUNT + 1] = h.jerk * (phi[COUNT] - fast)
    slow, fast = z[0], z[COUNT]
    z[0] = differences(h.modelled, h.g, h.d1, h.d2, h.heard_d * nominal)
    z[1], z[2], z[3], z[4] = phi[1], phi[2], phi[3], phi[4]
    z[COUNT] = h.jerk * (z[0] - slow)
    z[COUNT + 1] = h.jerk * (z[COUNT] - fast)
    return float(differences(h.pushed, h.g, h.d1, h.d2, h.heard_d * f))


@inlined
def _update(h: Any, y: float, surprise: float) -> None:
    """The Kalman filter's step: θ, lag, snap and their covariance, which goes back to what it was before with time.

    `used` is θ as far as it is clearly not the nominal one: a deviation x counts as x³/(x² + `SLIGHT`²).
    """
    p, k, theta, z = h.spread, h.gain, h.theta, h.z
    h.noise_N2 += h.noise_share * (surprise * surprise - h.noise_N2)
    variance = h.doubt_N2 * (1.0 + h.quiet / (h.loud + 1e-12)) + (h.doubt * y) ** 2
    variance += h.noise_weight * max(h.noise_N2, h.noise_least_N2)
    for i in range(COUNT + 2):
        k[i] = _across(p[i], z)
    variance += _across(z, k)
    share = 1.0 / variance
    h.lag += k[COUNT] * surprise * share
    h.snap += k[COUNT + 1] * surprise * share
    for i in range(COUNT):
        theta[i] = min(max(theta[i] + k[i] * surprise * share, h.theta_low[i]), h.theta_high[i])
        off = theta[i] * (1.0 / h.nominal[i]) - 1.0
        h.used[i] = h.nominal[i] * (1.0 + off * (off * off / (off * off + h.slight)))
    forget = h.forget_played + (h.forget - h.forget_played) * h.hush / (h.hush + h.loud)
    keep = 1.0 - forget
    for i in range(COUNT + 2):
        x = keep * share * k[i]
        for j in range(i + 1):
            p[i, j] = p[j, i] = keep * p[i, j] - x * k[j] + forget * h.spread_before[i, j]


@native
def _judge(h: Any) -> None:
    """Fall back where mass or delay have sat at a bound for long; trust what has been learnt for long again."""
    h.distrust = max(h.distrust - 1, h.distrust_least)
    mass = h.theta[0]
    at_bound = mass < NEAR * h.theta_low[0] or NEAR * mass > h.theta_high[0] or h.late_s >= h.late_most_s
    h.sitting = h.sitting + 1 if at_bound else 0
    if h.sitting > h.sitting_count:
        _fall_back(h)


@native
def _fall_back(h: Any) -> None:
    """Forget what was learnt: the handle counts as the nominal one, each time for twice as long."""
    h.lag = h.snap = 0.0
    h.late_s, h.sitting = h.believed_s, 0
    set_late(h.force_late, h.late_s * h.rate_Hz)
    for i in range(COUNT):
        h.theta[i] = h.used[i] = h.nominal[i]
    for i in range(COUNT + 2):
        for j in range(COUNT + 2):
            h.spread[i, j] = h.spread_before[i, j]
    if h.deaf == 0:
        h.deaf = h.distrust
        h.distrust = min(2 * h.distrust, h.distrust_most)


@native
def _fold(h: Any) -> None:
    """Take some of the lag that was found into the delay of the force, which is exact and not of first order."""
    lag_s = h.lag * h.jerk / (h.theta[0] * h.rate_Hz)
    late_s = min(max(h.late_s + FOLD * lag_s, 0.0), h.late_most_s)
    h.lag -= (late_s - h.late_s) * h.theta[0] * h.rate_Hz / h.jerk
    h.late_s = late_s
    set_late(h.force_late, late_s * h.rate_Hz)


DESIRED_MAX_M_S2: Final = 1e6
"""Largest acceleration that is listened to [m/s²]: 20,000 times what the actuator can do. Keeps the filters finite."""


@inlined
def command_force(handle: Any, desired_m_s2: float) -> float:
    """The force to be commanded in the next sample [N], one `HANDLE`, for the acceleration that is asked for [m/s²].

    What is asked for is played `delay` samples later; what is not finite counts as 0. The force is inside the limit.
    Each call is a sample more, of which `learn` may be told.
    """
    h = handle
    if not math.isfinite(desired_m_s2):
        desired_m_s2 = 0.0
    wanted = _lead(h, min(max(desired_m_s2, -DESIRED_MAX_M_S2), DESIRED_MAX_M_S2))
    phi = _integrate(h, wanted) if h.kind >= 2 else (wanted, 0.0, 0.0, 0.0, 0.0)
    late, slot, due = h.late, h.count & MASK, (h.count - h.delay) & MASK
    late[slot, 0], late[slot, 1], late[slot, 2], late[slot, 3], late[slot, 4] = phi
    asked, needed = _weighted(h.nominal, phi), _weighted(h.used, phi)
    pushed = _weighted(h.used, (late[due, 0], late[due, 1], late[due, 2], late[due, 3], late[due, 4]))
    advance(h.scout_step, h.plain_x, asked)
    gain = fade(h, foresee(h, needed))
    h.due_m_s2[slot], h.due_gain[slot] = gain * late[due, 0], gain
    h.count += 1
    h.squeezed += (1.0 - h.squeezed) * h.release
    command = h.squeezed * gain * pushed if h.kind > 0 else 0.0
    if abs(command) > h.force_limit_N:  # more was learnt to be needed than when it was asked for
        h.squeezed *= h.force_limit_N / abs(command)
        command = math.copysign(h.force_limit_N, command)
        h.clips += 1
    advance(h.scout_step, h.applied_x, command if h.kind > 0 else gain * pushed)
    return float(command)


@native
def _across(a: Any, b: Any) -> float:
    """Σ a_i b_i over what is estimated, in pairs: a long sum would wait for each of its terms in turn."""
    first, second = a[0] * b[0] + a[1] * b[1], a[2] * b[2] + a[3] * b[3]
    return float((first + second) + ((a[4] * b[4] + a[5] * b[5]) + a[6] * b[6]))


@native
def _weighted(theta: Any, phi: tuple[float, float, float, float, float]) -> float:
    """Σ θ_i φ_i [N]."""
    first, second = theta[0] * phi[0] + theta[1] * phi[1], theta[2] * phi[2] + theta[3] * phi[3]
    return float((first + second) + theta[4] * phi[4])


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
    if h.kind == 3:  # no other draws the accelerometer's noise
        learn(h, h.count - 1, force if h.force_measured == 1 else command, sense(h, acceleration))
    return acceleration, h.x[0], force


@native
def _integrate(h: Any, wanted_m_s2: float) -> tuple[float, float, float, float, float]:
    """φ of a sample, its corner as high as the coil's travel asks for; scaled as θ is, for the corner of learning."""
    g = yield_corner(h)
    if g != h.g_now:
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
