"""The record `HANDLE`: state and parameters of a handle and its compensator, for the compiled loop.

`new_handle` fills the record. `handle_loop` advances it, one sample at a time.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from hapscene.dsp.noise import seeded_state
from hapscene.errors import HandleError
from hapscene.handle.compensator import COUNT, Compensator, find_compensator, weights
from hapscene.handle.governor import HIGH_HZ, LOOK_AHEAD_S, ONE, RELEASE_S, TRAVEL_SHARE
from hapscene.handle.handle_dynamics import RING, hold, set_delay
from hapscene.handle.plant import Array, Plant, Sensor
from hapscene.records import Record, Records

__all__ = ["DELAY_LINE", "HANDLE", "RATE_MAX_HZ", "RATE_MIN_HZ", "SPREAD", "new_handle", "prior"]

RATE_MIN_HZ: Final = 2500.0
"""Lowest sample rate of a handle [Hz]. A signal of 1 kHz needs more than two samples a period."""

RATE_MAX_HZ: Final = (RING - 2) / LOOK_AHEAD_S
"""Highest sample rate of a handle [Hz], limited by the memory of the look-ahead."""

LEARN_HZ: Final = 9.0
"""Corner frequency of the filters that estimate θ, and for which θ is scaled [Hz]; just below the vibrotactile band."""

READING_BAND_HZ: Final = (8.0, 350.0)
"""Band in which the accelerometer is used for the estimate, one pole at each end [Hz]. Below it, gravity and hand
motion would be attributed to the handle; above it, sensor noise dominates."""

SPREAD: Final = dict(m_c_kg=0.3, k_s_N_m=0.3, b_s_Ns_m=0.5, m_h_kg=0.3, k_u_N_m=2.0, b_u_Ns_m=2.0)
"""Prior of each parameter: standard deviation of its ratio to the nominal value [1].

The handle is known from its identification; the grip changes by factors. With less for the grip, a grip four times as
firm is learnt too late for a tap. With less for the masses, the same holds for them."""

BOUND: Final = ((0.4, 0.1, 0.4, 0.1, 0.1), (2.5, 5.0, 3.0, 10.0, 10.0))
"""Lowest and highest value of each θ, relative to the nominal value [1].

The range includes handles with all six parameters 30 % off, and grips from a quarter of to four times the nominal
firmness. θ₀, the mass, bounds the force at every frequency that is played."""

IMPACT: Final = 0.25
"""Unexplained force that counts as an impact of the coil on its stop, relative to the force limit [1]."""

IMPACT_TRAVEL: Final = 0.6
"""Factor by which an impact reduces the travel that the governor allows [1]."""

TRAVEL_RETURN_S: Final = 5.0
"""Time constant of the return to the full travel [s]. Longer than most strokes, so that one impact is not followed by
the next."""

PAUSE_S: Final = 0.2
"""Pause of the estimate after an impact [s], while the filters still ring."""

QUIET_M_S2: Final = 1.0
"""Acceleration below which the estimate slows down [m/s²]. Otherwise sensor noise would count as motion without force,
and the estimated mass would decrease."""

POWER_S: Final = 0.005
"""Averaging time of the power of the played signal [s]."""

FORCE_NOISE_N: Final = 0.05
"""Standard deviation, for one sample, of force on the handle that is not the actuator's [N]. A smaller value learns
faster, but follows sensor noise where little is played."""

MODEL_ERROR: Final = 0.03
"""Share of a force that the model does not explain, as a standard deviation [1]."""

DELAY_SPREAD_S: Final = 1e-4
"""Standard deviation of the error of the assumed sensor delay [s]. The estimate is limited to three times this."""

SECOND_ORDER_S2: Final = 3e-8
"""Standard deviation of the sensor's second-order error [s²]. A pole at half of the assumed frequency causes 1.5e-8.
With a smaller value, the end of a chirp is mistaken for a heavier handle."""

NOISE_WEIGHT: Final = 8.0
"""Weight of the observed noise, relative to white noise of the same density [1]. With less, ten times the assumed noise
costs 2 % of a quiet texture; with more, the handle is learnt later."""

NOISE_S: Final = 0.2
"""Averaging time of the noise estimate [s], which is the force that the model does not explain."""

SHRINK: Final = 0.045
"""Deviation of θ from the nominal value at which half of it is used [1]. Noise alone causes deviations of this size."""

FORGET_S: Final = 0.5
"""Time constant at which the covariance returns to the prior in silence [s]: the grip may change unobserved."""

FORGET_PLAYED_S: Final = 3.0
"""The same time constant while a signal is played, when a change of grip is observed [s]. With less, the estimate
follows sensor noise."""

FORGET_LEVEL_M_S2: Final = 0.1
"""Acceleration between silence and playing, root mean square [m/s²]."""

AT_BOUND_S: Final = 0.05
"""Time after which an estimate of mass or delay at its bound is rejected [s]."""

FALLBACK_S: Final = (2.0, 3600.0)
"""Time for which the nominal handle is then used [s]: the first time, and at most. An impact from outside costs the
first."""

_LEAD_MAX: Final = 0.5
"""Upper bound of the pole of the lead filter [1]. Above it, frequencies above 1 kHz would be amplified for nothing."""


def _fields(names: str, *layout: object) -> list[tuple[object, ...]]:
    """Fields of a record with the same type and shape, one for each word."""
    return [(name, *layout) for name in names.split()]


DELAY_LINE: Final = np.dtype([*_fields("whole count", "i8"), ("taps", "f8", (4,)), ("last", "f8", (RING,))], align=True)
"""A delay line: integer delay, number of inputs, interpolation weights of the fractional delay, the last inputs."""

HANDLE: Final = np.dtype(
    [
        # the simulated plant: parameters, limits, state and force after a sample
        *_fields("m_c_kg k_s_N_m b_s_Ns_m m_h_kg k_u_N_m b_u_Ns_m force_limit_N travel_limit_m rate_Hz", "f8"),
        ("step", "f8", (5, 5)),
        ("x", "f8", (4,)),  # x_h, ẋ_h, r, ṙ [m, m/s]
        ("work", "f8", (2, 5, 5)),  # scratch memory of the matrix exponential
        *_fields("hits clips", "i8"),  # impacts of the coil on a stop; commands that were cut at the force limit
        # amplifier and accelerometer: force at the end of the last sample, last reading, poles
        *_fields("amplifier_N amplifier_pole amplifier_mean noise_m_s2 sensor_m_s2 sensor_pole", "f8"),
        ("rng", "u8", (4,)),
        ("sensor_delay", DELAY_LINE),
        ("kind", "i8"),  # compensator: 0 no force, 1 mass only, 2 fixed θ, 3 learnt θ
        # tan(ω₀T/2) of four corners: of the estimate and of the scaling of θ; lowest and highest while playing;
        # current. Then the damping.
        *_fields("g g_low g_high g_now d1 d2", "f8"),
        ("lead", "f8", (3,)),  # gain, zero and pole of the lead filter
        ("lead_m_s2", "f8", (2,)),  # its last input and output
        ("desired_filter", "f8", (6,)),  # state of the filters of the desired acceleration
        *_fields("nominal theta used", "f8", (COUNT,)),  # θ: nominal, estimated, used for the force [kg]
        *_fields("delay count", "i8"),  # look-ahead; samples so far
        ("delayed_phi", "f8", (RING, COUNT)),  # φ of the last samples
        # the governor: `demand_x` is the model state if everything that is asked for were played, `applied_x` the state
        # under the force that is played, `ahead` the transition over the look-ahead without force
        *_fields("force_share swing_rad_s", "f8"),
        ("nominal_step", "f8", (5, 5)),
        ("demand_x", "f8", (4,)),
        *_fields("nominal_x", "f8", (4,)),  # as `demand_x`, with the nominal θ
        ("past_demand", "f8", (RING, 4)),  # `demand_x` of the last samples
        ("applied_x", "f8", (4,)),
        ("ahead", "f8", (5, 5)),
        *_fields("released release backoff", "f8"),  # backoff: factor of a command that met the force limit [1]
        *_fields("first last", "i8"),  # ascending gains of the look-ahead are at first … last−1
        ("least", "f8", (RING,)),
        *_fields("when gains", "i8", (RING,)),
        ("total", "i8"),
        ("share", "f8"),
        # samples that are played but not yet measured: desired acceleration, gain; number of the next sample
        *_fields("due_m_s2 due_gain", "f8", (RING,)),
        ("next_sample", "i8"),
        # assumed sensor and amplifier: poles; current, assumed and highest delay [s]; the nominal handle
        *_fields("nominal_pole nominal_mean reading_pole delay_s assumed_delay_s delay_most_s", "f8"),
        ("force_measured", "i8"),
        *_fields("command_N sensed_N", "f8"),
        ("force_delay", DELAY_LINE),
        ("model", "f8", (5,)),  # acceleration of the nominal handle from its state and force
        ("model_x", "f8", (4,)),
        # filter states of the estimate: measured force and acceleration, and the nominal handle's acceleration
        ("reading_filter", "f8", (4,)),
        *_fields("band_g band_d jerk", "f8"),
        *_fields("force_filter model_filter", "f8", (4,)),
        ("phi_filter", "f8", (6,)),
        *_fields("lag snap", "f8"),  # mass times lag·ω₀ and snap·ω₀² [kg]
        *_fields("phi z gain", "f8", (COUNT + 2,)),
        *_fields("spread spread_before", "f8", (COUNT + 2, COUNT + 2)),  # covariance of θ, lag, snap; its prior
        *_fields("theta_low theta_high", "f8", (COUNT,)),
        *_fields("force_noise_N2 model_error noise_N2 noise_least_N2 noise_share noise_weight", "f8"),
        *_fields("power power_share quiet_power forget_power shrink", "f8"),  # power: mean square played [m²/s⁴]
        # share of the travel that is left after impacts; travel for the governor without impacts; travel over which the
        # corner rises, for the learnt and for the nominal handle
        *_fields("room room_m yield_m nominal_m room_return impact_N impact_travel", "f8"),
        *_fields("at_bound at_bound_count fallback fallback_least fallback_most", "i8"),
        *_fields("pause_count pause impact_pause", "i8"),  # samples until estimation resumes; until an impact counts
        *_fields("forget forget_played", "f8"),
    ],
    align=True,
)
"""A handle with its compensator, at one sample rate."""


def new_handle(
    plant: Plant,
    nominal: Plant,
    compensator: str,
    rate_Hz: float,
    seed: int = 0,
    sensor: Sensor | None = None,
    nominal_sensor: Sensor | None = None,
) -> Records:
    """Create a record (1,) `HANDLE` at rest. The arguments are those of `hapscene.handle.play`, without defaults for
    plants.

    Raises:
        HandleError: unknown compensator, rate out of range, or a sensor delay too long for the rate.
    """
    chosen = find_compensator(compensator)
    if not RATE_MIN_HZ <= rate_Hz <= RATE_MAX_HZ:
        raise HandleError(f"rate_Hz of a handle must be {RATE_MIN_HZ:g} to {RATE_MAX_HZ:g}, is {rate_Hz!r}")
    sensor = Sensor() if sensor is None else sensor
    nominal_sensor = sensor if nominal_sensor is None else nominal_sensor
    handle = np.zeros(1, HANDLE).view(np.recarray)
    h = handle[0]
    h.rate_Hz = rate_Hz
    _set_plant(h, nominal)
    hold(h, h.nominal_step)
    _set_plant(h, plant)
    hold(h, h.step)
    _set_amplifier(h, plant, nominal, chosen.leads)
    h.rng = seeded_state(seed, "accelerometer")
    _set_sensor(h, sensor, nominal_sensor)
    h.kind = 0 if compensator == "none" else 1 if chosen.mass_only else 3 if chosen.adapts else 2
    _set_inverse(h, nominal, chosen)
    _set_governor(h, plant, nominal, chosen)
    _set_adaptation(h, nominal, nominal_sensor, LEARN_HZ)
    return handle


def _set_inverse(h: Record, nominal: Plant, chosen: Compensator) -> None:
    """Set the corners and weights of the inverse."""
    h.g = math.tan(math.pi * LEARN_HZ / h.rate_Hz)
    h.g_low = h.g_now = math.tan(math.pi * chosen.corner_Hz / h.rate_Hz)
    h.g_high = math.tan(math.pi * HIGH_HZ / h.rate_Hz)
    h.d1, h.d2 = chosen.damping
    h.nominal = h.theta = h.used = weights(nominal, LEARN_HZ)
    if chosen.mass_only:
        h.nominal[1:] = h.theta[1:] = h.used[1:] = 0.0


def _set_governor(h: Record, plant: Plant, nominal: Plant, chosen: Compensator) -> None:
    """Set the limits of force and travel, and the look-ahead."""
    h.force_limit_N = min(plant.force_limit_N, nominal.force_limit_N)
    h.force_share, h.travel_limit_m = chosen.force_share, plant.travel_limit_m
    travel_m = min(plant.travel_limit_m, nominal.travel_limit_m)
    h.room, h.room_m = 1.0, chosen.travel_share * travel_m
    h.yield_m, h.nominal_m = chosen.yield_share * travel_m, TRAVEL_SHARE * travel_m
    h.swing_rad_s = math.sqrt(nominal.k_s_N_m * (1.0 / nominal.m_c_kg + 1.0 / nominal.m_h_kg))
    h.delay = round(LOOK_AHEAD_S * h.rate_Hz)
    h.ahead = np.linalg.matrix_power(h.nominal_step, h.delay)
    h.ahead[:, 4] = 0.0
    h.released, h.backoff, h.release = 1.0, 1.0, -math.expm1(-1.0 / (RELEASE_S * h.rate_Hz))
    h.gains[:] = ONE
    h.total = (h.delay + 1) * ONE
    h.share = 1.0 / float(h.total)


def _set_plant(h: Record, plant: Plant) -> None:
    for name in SPREAD:  # its keys are the parameters of the handle's equation
        setattr(h, name, getattr(plant, name))


def _set_amplifier(h: Record, plant: Plant, nominal: Plant, leads: bool) -> None:
    """Set the amplifier that is simulated, and the lead filter for the nominal one."""
    h.amplifier_pole, h.amplifier_mean = _lag(plant.amplifier_Hz, h.rate_Hz)
    pole, mean = _lag(nominal.amplifier_Hz, h.rate_Hz)
    zero = min((mean - pole) / (1.0 - mean), _LEAD_MAX)
    h.lead = ((1.0 + zero) / (1.0 - pole), pole, zero) if leads else (1.0, 0.0, 0.0)
    h.nominal_pole, h.nominal_mean = pole, mean


def _set_sensor(h: Record, sensor: Sensor, nominal_sensor: Sensor) -> None:
    """Set the accelerometer that is simulated, and the one that the compensator assumes."""
    h.sensor_pole = math.exp(-2.0 * math.pi * sensor.bandwidth_Hz / h.rate_Hz)
    h.noise_m_s2 = sensor.noise_m_s2_rtHz * math.sqrt(0.5 * h.rate_Hz)
    h.force_measured = sensor.force_measured and nominal_sensor.force_measured
    h.reading_pole = math.exp(-2.0 * math.pi * nominal_sensor.bandwidth_Hz / h.rate_Hz)
    h.delay_s = h.assumed_delay_s = nominal_sensor.delay_s
    h.delay_most_s = nominal_sensor.delay_s + 3.0 * DELAY_SPREAD_S
    most_s = (RING - 4) / h.rate_Hz - 3.0 * DELAY_SPREAD_S
    if max(sensor.delay_s, nominal_sensor.delay_s) > most_s:
        raise HandleError(f"sensor: delay_s must be at most {most_s:.3g} at {h.rate_Hz:g} Hz")
    set_delay(h.sensor_delay, sensor.delay_s * h.rate_Hz)
    set_delay(h.force_delay, nominal_sensor.delay_s * h.rate_Hz)


def _lag(bandwidth_Hz: float, rate_Hz: float) -> tuple[float, float]:
    """Remaining share of a step through one pole: at the end of a sample, and as a mean over the sample [1]."""
    lag = 2.0 * math.pi * bandwidth_Hz / rate_Hz
    return math.exp(-lag), -math.expm1(-lag) / lag


def _set_adaptation(h: Record, nominal: Plant, nominal_sensor: Sensor, corner_Hz: float) -> None:
    """Set the parameters of the estimate of θ."""
    middle_Hz, omega = math.sqrt(READING_BAND_HZ[0] * READING_BAND_HZ[1]), 2.0 * math.pi * corner_Hz
    h.band_g, h.band_d = math.tan(math.pi * middle_Hz / h.rate_Hz), sum(READING_BAND_HZ) / middle_Hz
    h.jerk = h.rate_Hz / omega
    h.model = np.append(nominal.state_space()[2][0], 1.0 / nominal.m_h_kg)
    h.spread_before[:COUNT, :COUNT] = prior(nominal, corner_Hz)
    h.spread_before[COUNT, COUNT] = (nominal.m_h_kg * omega * DELAY_SPREAD_S) ** 2
    h.spread_before[COUNT + 1, COUNT + 1] = (nominal.m_h_kg * omega**2 * SECOND_ORDER_S2) ** 2
    h.spread = h.spread_before
    h.theta_low, h.theta_high = np.multiply(BOUND, h.nominal)

    def share(time_s: float) -> float:
        """Weight of a new sample in an average with this time constant."""
        return -math.expm1(-1.0 / (time_s * h.rate_Hz))

    h.room_return, h.impact_travel = share(TRAVEL_RETURN_S), IMPACT_TRAVEL
    h.impact_N, h.pause_count = IMPACT * nominal.force_limit_N, round(PAUSE_S * h.rate_Hz)
    h.force_noise_N2, h.model_error, h.shrink = FORCE_NOISE_N**2, MODEL_ERROR, SHRINK**2
    noise_Hz = 0.5 * math.pi * READING_BAND_HZ[1]  # bandwidth of white noise through one pole
    h.noise_N2 = h.noise_least_N2 = (nominal.m_h_kg * nominal_sensor.noise_m_s2_rtHz) ** 2 * noise_Hz
    h.noise_weight, h.noise_share = NOISE_WEIGHT * 0.5 * h.rate_Hz / noise_Hz, share(NOISE_S)
    h.quiet_power, h.forget_power, h.power_share = QUIET_M_S2**2, FORGET_LEVEL_M_S2**2, share(POWER_S)
    h.forget, h.forget_played = share(FORGET_S), share(FORGET_PLAYED_S)
    h.at_bound_count = round(AT_BOUND_S * h.rate_Hz)
    h.fallback_least, h.fallback_most = (round(time_s * h.rate_Hz) for time_s in FALLBACK_S)
    h.fallback = h.fallback_least


def prior(nominal: Plant, corner_Hz: float) -> Array:
    """Covariance (5, 5) of θ [kg²] for parameters that deviate by `SPREAD`, to first order."""
    step = 1e-4
    base = weights(nominal, corner_Hz)
    rows = []
    for name, spread in SPREAD.items():
        changed = replace(nominal, **{name: getattr(nominal, name) * (1.0 + step)})
        rows.append((weights(changed, corner_Hz) - base) * (spread / step))
    return np.asarray(np.transpose(rows) @ rows)
