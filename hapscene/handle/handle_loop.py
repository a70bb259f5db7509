"""The haptography handle, one sample at a time. Compiled.

`command_force` computes the force command for a desired acceleration, in four steps:

lead       compensate the lag of the amplifier
sum        weight the compensator's signals φ by θ: the force that will be needed        compensator.py
fade       the gain that keeps force and travel within their limits                      governor.py
delay      weight φ of one look-ahead ago by the current θ, times the gain

A real handle needs no more than this, with the record of its identification:
`new_handle(found.plant, found.plant, "adaptive", rate_Hz, sensor=found.sensor)`.

`learn` estimates θ from the force that acted and the measured acceleration, for the adaptive compensator.

`vibrate` connects both by a simulated handle:

amplify    current loop of the amplifier                                                 handle_dynamics.py
move       coil, handle and hand                                                         handle_dynamics.py
sense      accelerometer                                                                 handle_dynamics.py
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import inlined, native
from hapscene.dsp.spectrogram import row_of
from hapscene.dsp.spectrogram import (
    spectrogram_error as spectrogram_error,
)  # public as hapscene.handle.spectrogram_error
from hapscene.handle.compensator import COUNT, differences, integrals, retune, section
from hapscene.handle.governor import fade, foresee, yield_corner
from hapscene.handle.handle_dynamics import MASK, RING, advance, amplify, delay, move, sense, set_delay
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import Array, Plant, Sensor
from hapscene.records import Record

__all__ = ["DESIRED_MAX_M_S2", "PlaybackResult", "command_force", "learn", "play", "run", "vibrate"]

# Online identification of the inverse from the handle's accelerometer.
#
# The inverse is linear in θ (see `compensator`), and so is the measurement: s⁴/D · F = Σ θ_i φ_i(a) + e, for every
# signal that is played. A Kalman filter (recursive least squares whose prior is the spread of handles) estimates θ. It
# starts at the nominal handle. A few samples of texture determine the mass; the other parameters follow as far as the
# signal excites them.
#
# The measured acceleration is delayed, low-pass filtered and noisy (`sensor.Sensor`). Therefore the force passes
# through the assumed pole and delay of the accelerometer before both are compared. An error of that assumption appears
# as a force: to second order, the reading is a + lag·ȧ + snap·ä too early. Lag and snap are estimated with θ, and the
# lag is moved into the delay. Noise in φ would bias the estimated mass downwards (errors in variables). Therefore mass,
# lag and snap are correlated not with the measurement but with the response of the nominal handle to the same force,
# which is free of that noise (instrumental variables: Söderström & Stoica 1983, "Instrumental Variable Methods for
# System Identification"). The other elements of θ are observed below 50 Hz, where there is little noise and where the
# nominal handle may respond differently; there the measurement itself is the instrument. The force that the
# model does not explain is the estimate of the noise.
#
# Measurements act on the force through θ alone, and θ is bounded. The force is therefore a stable filter of the desired
# acceleration, whatever handle and hand do: there is no feedback loop that could become unstable. Where the model does
# not explain the measurement, or where an estimate stays at its bound, θ returns to the nominal value, each time for
# longer.


LEARN_ABOVE: Final = 0.9
"""Gain of the governor above which θ is estimated [1]. Below it, θ is estimated only while the coil is far from its
stops."""

FAR: Final = 0.5
"""Swing, relative to the allowed travel, below which the coil counts as far from its stops [1]. An unexplained force
there is not an impact of the coil; handle or sensor differ from the assumed ones."""

ROOM_LEAST: Final = 0.15
"""Lowest share of the travel after repeated impacts [1]. A handle whose parameters are all 30 % off swings up to five
times as far as the nominal one."""

SURE: Final = 4.0
"""An unexplained force counts as an impact where its square exceeds this multiple of the played power [1]. A handle of
three times the nominal mass does not."""

NEAR: Final = 1.05
"""Ratio to its bound within which a mass counts as at the bound [1]. Noise moves the estimate by less."""

FOLD_SAMPLES: Final = 64
"""Interval at which a part of the lag is moved into the delay [samples], a power of two."""

FOLD: Final = 0.1
"""Part of the lag that is moved [1]. Small, since the filters still hold samples with the previous delay."""


@inlined
def learn(handle: Record, sample: int, force_N: float, read_m_s2: float) -> None:
    """Update the estimate of one `HANDLE` by the force [N] and acceleration [m/s²] of one sample.

    Samples are numbered from 0 in the order of `command_force`, and must arrive in this order, at most 500 samples
    after their command. Missing samples and values that are not finite pause the estimate. Where the force is not
    measured (`Sensor.force_measured`), pass the command of `command_force`. `Sensor.delay_s` is the delay of the
    acceleration behind the force. Compensators without adaptation ignore the call.
    """
    h = handle
    if h.kind != 3:
        return
    in_time = sample == h.next_sample and 0 < h.count - sample < RING
    h.next_sample = sample + 1
    if not (in_time and math.isfinite(force_N) and math.isfinite(read_m_s2)):
        h.pause = max(h.pause, h.pause_count)
        return
    due, gain = h.due_m_s2[sample & MASK], h.due_gain[sample & MASK]
    h.power += h.power_share * (due * due - h.power)
    y = _filter_measurement(h, force_N, read_m_s2)
    surprise = y - h.lag * h.phi[COUNT] - h.snap * h.phi[COUNT + 1]
    for i in range(COUNT):
        surprise -= h.theta[i] * h.phi[i]
    h.room += h.room_return * (1.0 - h.room)
    r, v = h.applied_x[2], h.applied_x[3] / h.swing_rad_s
    far = math.sqrt(r * r + v * v) < FAR * h.room_m
    if surprise * surprise > h.impact_N**2 + SURE * h.nominal[0] ** 2 * h.power:
        again = h.pause > 0
        if far and h.pause <= h.pause_count:
            _fall_back(h)
        if h.impact_pause == 0:
            if again or not far:  # probably a stop, even if the model has the coil far from it
                h.room = max(h.impact_travel * h.room, min(h.room, ROOM_LEAST))
            h.impact_pause = h.pause_count
        h.pause = max(h.pause, h.pause_count)
    h.impact_pause = max(h.impact_pause - 1, 0)
    if h.pause > 0:
        h.pause -= 1
    elif far or gain > LEARN_ABOVE:
        _update(h, y, surprise)
        _check_plausible(h)
        if sample & (FOLD_SAMPLES - 1) == 0:
            _move_lag_to_delay(h)


@inlined
def _filter_measurement(h: Record, force_N: float, read_m_s2: float) -> float:
    """Update φ and its instruments z. Returns the force that φ must explain, s⁴/D · F [N]."""
    if h.force_measured == 0:
        command = force_N
        force_N += (h.command_N - command) * h.nominal_mean
        h.command_N = command + (h.command_N - command) * h.nominal_pole
    h.sensed_N += (1.0 - h.reading_pole) * (force_N - h.sensed_N)  # the accelerometer's pole and delay, for the force
    f = section(h.reading_filter, 0, h.band_g, h.band_d, delay(h.force_delay, h.sensed_N))[1]
    a = section(h.reading_filter, 2, h.band_g, h.band_d, read_m_s2)[1]
    nominal = h.model[4] * f
    for i in range(4):
        nominal += h.model[i] * h.model_x[i]
    advance(h.nominal_step, h.model_x, f)
    phi, z = h.phi, h.z
    slow, fast = phi[0], phi[COUNT]
    phi[0], phi[1], phi[2], phi[3], phi[4] = integrals(h.phi_filter, h.g, h.d1, h.d2, h.band_d * a)
    phi[COUNT] = h.jerk * (phi[0] - slow)
    phi[COUNT + 1] = h.jerk * (phi[COUNT] - fast)
    slow, fast = z[0], z[COUNT]
    z[0] = differences(h.model_filter, h.g, h.d1, h.d2, h.band_d * nominal)
    z[1], z[2], z[3], z[4] = phi[1], phi[2], phi[3], phi[4]
    z[COUNT] = h.jerk * (z[0] - slow)
    z[COUNT + 1] = h.jerk * (z[COUNT] - fast)
    return float(differences(h.force_filter, h.g, h.d1, h.d2, h.band_d * f))


@inlined
def _update(h: Record, y: float, surprise: float) -> None:
    """Kalman update of θ, lag, snap and their covariance. The covariance returns to its prior with time.

    `used` is θ shrunk towards its nominal value: a deviation x becomes x³/(x² + `SHRINK`²).
    """
    p, k, theta, z = h.spread, h.gain, h.theta, h.z
    h.noise_N2 += h.noise_share * (surprise * surprise - h.noise_N2)
    variance = h.force_noise_N2 * (1.0 + h.quiet_power / (h.power + 1e-12)) + (h.model_error * y) ** 2
    variance += h.noise_weight * max(h.noise_N2, h.noise_least_N2)
    for i in range(COUNT + 2):
        k[i] = _dot(p[i], z)
    variance += _dot(z, k)
    share = 1.0 / variance
    h.lag += k[COUNT] * surprise * share
    h.snap += k[COUNT + 1] * surprise * share
    for i in range(COUNT):
        theta[i] = min(max(theta[i] + k[i] * surprise * share, h.theta_low[i]), h.theta_high[i])
        off = theta[i] * (1.0 / h.nominal[i]) - 1.0
        h.used[i] = h.nominal[i] * (1.0 + off * (off * off / (off * off + h.shrink)))
    forget = h.forget_played + (h.forget - h.forget_played) * h.forget_power / (h.forget_power + h.power)
    keep = 1.0 - forget
    for i in range(COUNT + 2):
        x = keep * share * k[i]
        for j in range(i + 1):
            p[i, j] = p[j, i] = keep * p[i, j] - x * k[j] + forget * h.spread_before[i, j]


@native
def _check_plausible(h: Record) -> None:
    """Fall back where mass or delay stayed at a bound; shorten the next fallback while they do not."""
    h.fallback = max(h.fallback - 1, h.fallback_least)
    mass = h.theta[0]
    at_bound = mass < NEAR * h.theta_low[0] or NEAR * mass > h.theta_high[0] or h.delay_s >= h.delay_most_s
    h.at_bound = h.at_bound + 1 if at_bound else 0
    if h.at_bound > h.at_bound_count:
        _fall_back(h)


@native
def _fall_back(h: Record) -> None:
    """Return to the nominal handle and forget the estimate; each time for twice as long."""
    h.lag = h.snap = 0.0
    h.delay_s, h.at_bound = h.assumed_delay_s, 0
    set_delay(h.force_delay, h.delay_s * h.rate_Hz)
    for i in range(COUNT):
        h.theta[i] = h.used[i] = h.nominal[i]
    for i in range(COUNT + 2):
        for j in range(COUNT + 2):
            h.spread[i, j] = h.spread_before[i, j]
    if h.pause == 0:
        h.pause = h.fallback
        h.fallback = min(2 * h.fallback, h.fallback_most)


@native
def _move_lag_to_delay(h: Record) -> None:
    """Move a part of the estimated lag into the delay of the force: a delay is exact, the lag is of first order."""
    lag_s = h.lag * h.jerk / (h.theta[0] * h.rate_Hz)
    delay_s = min(max(h.delay_s + FOLD * lag_s, 0.0), h.delay_most_s)
    h.lag -= (delay_s - h.delay_s) * h.theta[0] * h.rate_Hz / h.jerk
    h.delay_s = delay_s
    set_delay(h.force_delay, delay_s * h.rate_Hz)


DESIRED_MAX_M_S2: Final = 1e6
"""Limit of the desired acceleration [m/s²]: 20,000 times what the actuator can do. Keeps the filters finite."""


@inlined
def command_force(handle: Record, desired_m_s2: float) -> float:
    """Compute the force command of the next sample [N] of one `HANDLE` for a desired acceleration [m/s²].

    The acceleration is played `delay` samples later. A value that is not finite counts as 0. The force is within its
    limit. Each call is one sample, in the numbering of `learn`.
    """
    h = handle
    if not math.isfinite(desired_m_s2):
        desired_m_s2 = 0.0
    desired = _lead(h, min(max(desired_m_s2, -DESIRED_MAX_M_S2), DESIRED_MAX_M_S2))
    phi = _integrate(h, desired) if h.kind >= 2 else (desired, 0.0, 0.0, 0.0, 0.0)
    past, slot, due = h.delayed_phi, h.count & MASK, (h.count - h.delay) & MASK
    past[slot, 0], past[slot, 1], past[slot, 2], past[slot, 3], past[slot, 4] = phi
    nominal, needed = _weighted(h.nominal, phi), _weighted(h.used, phi)
    pushed = _weighted(h.used, (past[due, 0], past[due, 1], past[due, 2], past[due, 3], past[due, 4]))
    advance(h.nominal_step, h.nominal_x, nominal)
    gain = fade(h, foresee(h, needed))
    h.due_m_s2[slot], h.due_gain[slot] = gain * past[due, 0], gain
    h.count += 1
    h.backoff += (1.0 - h.backoff) * h.release
    command = h.backoff * gain * pushed if h.kind > 0 else 0.0
    if abs(command) > h.force_limit_N:  # θ was learnt since the governor fixed the gain for this sample
        h.backoff *= h.force_limit_N / abs(command)
        command = math.copysign(h.force_limit_N, command)
        h.clips += 1
    advance(h.nominal_step, h.applied_x, command if h.kind > 0 else gain * pushed)
    return float(command)


@native
def _dot(a: Array, b: Array) -> float:
    """Σ a_i b_i over the estimated quantities. Summed in pairs, since a serial sum waits for each of its terms."""
    first, second = a[0] * b[0] + a[1] * b[1], a[2] * b[2] + a[3] * b[3]
    return float((first + second) + ((a[4] * b[4] + a[5] * b[5]) + a[6] * b[6]))


@native
def _weighted(theta: Array, phi: tuple[float, float, float, float, float]) -> float:
    """Σ θ_i φ_i [N]."""
    first, second = theta[0] * phi[0] + theta[1] * phi[1], theta[2] * phi[2] + theta[3] * phi[3]
    return float((first + second) + theta[4] * phi[4])


@native
def vibrate(handle: Record, desired_m_s2: float) -> tuple[float, float, float]:
    """Advance a simulated handle, one `HANDLE`, by one sample with a desired acceleration [m/s²].

    Returns the acceleration of the handle under this sample's force [m/s²], its displacement at the end of the sample
    [m], and the force [N].
    """
    h = handle
    command = command_force(h, desired_m_s2)
    force = amplify(h, command)
    acceleration = move(h, force)
    if h.kind == 3:  # only the adaptive compensator needs the accelerometer and its noise
        learn(h, h.count - 1, force if h.force_measured == 1 else command, sense(h, acceleration))
    return acceleration, h.x[0], force


@native
def _integrate(h: Record, desired_m_s2: float) -> tuple[float, float, float, float, float]:
    """φ of a sample, with the corner that the travel allows, scaled to the corner `LEARN_HZ` as θ is."""
    g = yield_corner(h)
    if g != h.g_now:
        retune(h.desired_filter, g / h.g_now)
        h.g_now = g
    phi = integrals(h.desired_filter, g, h.d1, h.d2, desired_m_s2)
    r = h.g / g
    return phi[0], r * phi[1], r * r * phi[2], r * r * r * phi[3], r * r * r * r * phi[4]


@native
def _lead(h: Record, a: float) -> float:
    """Invert the lag of the amplifier: gain (1 − pole z⁻¹)/(1 + zero z⁻¹)."""
    h.lead_m_s2[1] = h.lead[0] * (a - h.lead[1] * h.lead_m_s2[0]) - h.lead[2] * h.lead_m_s2[1]
    h.lead_m_s2[0] = a
    return float(h.lead_m_s2[1])


# Play an acceleration through a simulated handle.


@dataclass(frozen=True, eq=False)
class PlaybackResult:
    """Motion and force of a handle, sample by sample, aligned with the desired acceleration.

    Attributes:
        acceleration_m_s2: (n,) acceleration of the handle.
        force_N: (n,) force of the actuator, +F on the handle and −F on the coil, constant over each sample.
        travel_m: (n,) travel of the coil in the handle, at the end of each sample.
        displacement_m: (n,) displacement of the handle, at the end of each sample.
        latency_s: delay of the handle behind the desired acceleration. The arrays are shifted back by it.
        hits: impacts of the coil on a stop [count].
        clips: commands that were cut at the force limit [count].
    """

    acceleration_m_s2: Array
    force_N: Array
    travel_m: Array
    displacement_m: Array
    latency_s: float
    hits: int
    clips: int

    def __repr__(self) -> str:
        return (
            f"<PlaybackResult: {len(self.acceleration_m_s2):,} samples, latency {1e3 * self.latency_s:.3g} ms; "
            f"{self.hits} impacts on a stop, {self.clips} clipped commands>"
        )


def play(
    acceleration_m_s2: ArrayLike,
    rate_Hz: float,
    plant: Plant | None = None,
    *,
    compensator: str = "adaptive",
    nominal: Plant | None = None,
    seed: int = 0,
    sensor: Sensor | None = None,
    nominal_sensor: Sensor | None = None,
) -> PlaybackResult:
    """Play a desired acceleration through a simulated handle that starts at rest.

    Force and travel stay within the limits of the plant: the governor reduces the gain before a limit is reached
    (`hapscene.handle.governor`).

    Args:
        acceleration_m_s2: (n,) desired acceleration [m/s²]. Samples that are not finite count as 0.
        rate_Hz: sample rate [Hz].
        plant: the handle that is simulated; `Plant()` by default.
        compensator: a name of `COMPENSATORS`. With "none" no force acts, and the handle stays at rest.
        nominal: the handle that the compensator assumes; `Plant()` by default.
        seed: seed of the accelerometer noise.
        sensor: the accelerometer that is simulated; `Sensor()` by default.
        nominal_sensor: the accelerometer that the compensator assumes; `sensor` by default.

    Raises:
        HandleError: unknown compensator, rate out of range, sensor delay too long for the rate, or an acceleration that
            is not a one-dimensional array of numbers.
    """
    desired = row_of(acceleration_m_s2, "acceleration_m_s2")
    plant = Plant() if plant is None else plant
    nominal = Plant() if nominal is None else nominal
    handle = new_handle(plant, nominal, compensator, rate_Hz, seed, sensor, nominal_sensor)
    delay = int(handle[0].delay)
    out = np.zeros((4, len(desired) + delay))
    run(handle[0], np.concatenate([desired, np.zeros(delay)]), out)
    acceleration, displacement, force, travel = (row[delay:].copy() for row in out)
    h = handle[0]
    return PlaybackResult(acceleration, force, travel, displacement, delay / rate_Hz, int(h.hits), int(h.clips))


@native
def run(handle: Record, desired_m_s2: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Fill `out` (4, n) with acceleration, displacement, force and travel of one `HANDLE` for a desired
    acceleration."""
    for k in range(len(desired_m_s2)):
        out[0, k], out[1, k], out[2, k] = vibrate(handle, desired_m_s2[k])
        out[3, k] = handle.x[2]
