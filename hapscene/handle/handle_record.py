"""The memory of the compiled loop, filled in Python: a handle with its compensator as one record."""

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np

from hapscene.dsp.noise import seeded_state
from hapscene.errors import HandleError
from hapscene.handle.compensator import COUNT, find_compensator, weights
from hapscene.handle.governor import HIGH_HZ, LOOK_AHEAD_S, ONE, RELEASE_S, TRAVEL_SHARE
from hapscene.handle.handle_dynamics import RING, hold, set_late
from hapscene.handle.plant import Array, Plant
from hapscene.handle.sensor import ACCELEROMETER_HZ as ACCELEROMETER_HZ
from hapscene.handle.sensor import ACCELEROMETER_NOISE_M_S2_RTHZ as ACCELEROMETER_NOISE_M_S2_RTHZ
from hapscene.handle.sensor import Sensor

__all__ = ["HANDLE", "LATE", "RATE_MAX_HZ", "RATE_MIN_HZ", "SPREAD", "new_handle", "prior"]

RATE_MIN_HZ: Final = 2500.0
"""Lowest rate of a handle [Hz]: 1 kHz needs more than two samples."""

RATE_MAX_HZ: Final = (RING - 2) / LOOK_AHEAD_S
"""Highest rate of a handle [Hz]: the look-ahead has room for so many samples."""

LEARN_HZ: Final = 9.0
"""Corner of the signals from which θ is learnt, and for which it is scaled [Hz]; just under the band that is felt."""

HEARD_HZ: Final = (8.0, 350.0)
"""Band in which the accelerometer is heard, a pole at each end [Hz]. Below, gravity and the hand's own motion would be
taken for the handle's; above, there is more noise of the accelerometer than news of the handle."""

SPREAD: Final = dict(m_c_kg=0.3, k_s_N_m=0.3, b_s_Ns_m=0.5, m_h_kg=0.3, k_u_N_m=2.0, b_u_Ns_m=2.0)
"""How far each parameter may be from the nominal before anything is measured, as a standard deviation of its ratio [1].
The handle is known as well as it was identified, the grip changes by factors. Less for the grip, and a grip four times
as firm is learnt too late for a tap; less for the masses, and theirs is."""

BOUND: Final = ((0.4, 0.1, 0.4, 0.1, 0.1), (2.5, 5.0, 3.0, 10.0, 10.0))
"""Least and most of each θ, over the nominal [1]: all six parameters 30 % off and the grip four times as firm, or a
quarter, lie inside. θ₀, the mass, bounds the force at every frequency that is played."""

KNOCK: Final = 0.25
"""Force that neither the actuator nor an unlearnt handle explains, over the force limit [1]: the coil met a stop."""

KNOCKED: Final = 0.6
"""What a knock leaves of the travel that the governor gives out [1]."""

ROOM_BACK_S: Final = 5.0
"""Time constant at which that travel comes back [s]: longer than most strokes, so that it knocks once and not again."""

DEAF_S: Final = 0.2
"""How long nothing is learnt after a knock [s]: the filters still ring with it."""

QUIET_M_S2: Final = 1.0
"""Acceleration below which less and less is learnt [m/s²]: the accelerometer's noise, taken for a movement that no
force has caused, would make the handle seem lighter and lighter."""

LOUD_S: Final = 0.005
"""Time over which the mean square of what is played is taken [s]."""

DOUBT_N: Final = 0.05
"""Force on the handle that is not the actuator's, as a standard deviation of one sample [N]. Less learns faster, and is
led astray by the accelerometer's noise where little is played."""

DOUBT: Final = 0.03
"""Share of a force that the model does not explain, as a standard deviation [1]."""

LATE_S: Final = 1e-4
"""How much later than believed a reading may come, as a standard deviation [s]; three times that is a bound."""

SNAP_S2: Final = 3e-8
"""What of second order the sensor may do to a reading beside that, as a standard deviation [s²]: a pole at half the
frequency that is believed does 1.5e-8. Less, and a chirp's end is taken for a heavier handle."""

NOISE_WEIGHT: Final = 8.0
"""How much the noise that is seen weighs [1], over that of white noise of its density. Less, and noise ten times as
loud as believed costs 2 % of a quiet texture; more, and a handle is learnt later."""

NOISE_S: Final = 0.2
"""Time over which the noise is taken from what nothing explains [s]."""

SLIGHT: Final = 0.045
"""Deviation of a θ from the nominal that counts half [1]: noise alone makes as much of it."""

FORGET_S: Final = 0.5
"""Time after which what was learnt counts as doubtful again in silence [s]: the grip may have changed unheard."""

FORGET_PLAYED_S: Final = 3.0
"""The same while it plays, and a change is heard [s]. Less, and what is learnt follows the accelerometer's noise."""

HUSH_M_S2: Final = 0.1
"""Acceleration that lies between the two [m/s²], root mean square."""

SITTING_S: Final = 0.05
"""How long mass or delay sit at a bound before they are not believed [s]."""

DISTRUST_S: Final = (2.0, 3600.0)
"""How long the handle then counts as the nominal one, at first and at most [s]: a knock from outside costs so long."""

_LEAD_MAX: Final = 0.5
"""Bound of the lead's own pole [1]: above it what lies beyond 1 kHz would be amplified for nothing."""


def _fields(names: str, *layout: Any) -> list[tuple[Any, ...]]:
    """Fields of a record, one for each word, of one type and shape."""
    return [(name, *layout) for name in names.split()]


LATE: Final = np.dtype([*_fields("whole count", "i8"), ("taps", "f8", (4,)), ("last", "f8", (RING,))], align=True)
"""A delay: whole samples, and four weights from there on; how many came, and the last ones."""

HANDLE: Final = np.dtype(
    [
        # what is there, its limits, its state and force after a sample
        *_fields("m_c_kg k_s_N_m b_s_Ns_m m_h_kg k_u_N_m b_u_Ns_m force_limit_N travel_limit_m rate_Hz", "f8"),
        ("step", "f8", (5, 5)),
        ("x", "f8", (4,)),  # x_h, ẋ_h, r, ṙ [m, m/s]
        ("work", "f8", (2, 5, 5)),  # of the matrix exponential
        *_fields("hits clips", "i8"),  # how often the coil met a stop, and the command was cut at the force limit
        # amplifier and accelerometer: force at the end of the last sample, the last reading, poles
        *_fields("amplifier_N amplifier_pole amplifier_mean noise_m_s2 sensor_m_s2 sensor_pole", "f8"),
        ("rng", "u8", (4,)),
        ("sensor_late", LATE),
        ("kind", "i8"),  # 0 no force, 1 mass alone, 2 fixed θ, 3 learnt θ
        # tan(ω₀T/2) of the corner: at which is learnt, and for which θ is scaled; that is played at while there is
        # room; where there is none; now. And damping.
        *_fields("g g_low g_high g_now d1 d2", "f8"),
        ("lead", "f8", (3,)),  # its gain, zero and pole
        ("lead_m_s2", "f8", (2,)),  # its last input and output
        ("wanted", "f8", (6,)),  # integrals of the desired acceleration
        *_fields("nominal theta used", "f8", (COUNT,)),  # θ of the nominal handle, as known now, and as played [kg]
        *_fields("delay count", "i8"),  # look-ahead, and how many there were so far [samples]
        ("late", "f8", (RING, COUNT)),  # φ of the last samples
        # the governor. The scout is as if all that was asked for were played, `applied` as what is played is thought
        # to leave the coil; the free coil swings at scout_rad_s; `ahead` is the state after a look-ahead without force
        *_fields("force_share scout_rad_s", "f8"),
        ("scout_step", "f8", (5, 5)),
        ("scout_x", "f8", (4,)),
        *_fields("plain_x", "f8", (4,)),  # and as if the handle were the nominal one
        ("scouted", "f8", (RING, 4)),  # of the last samples
        ("applied_x", "f8", (4,)),
        ("ahead", "f8", (5, 5)),
        *_fields("released release squeezed", "f8"),  # squeezed: the force, at its limit since it was asked for [1]
        *_fields("first last", "i8"),  # ascending gains of the look-ahead lie at first … last−1
        ("least", "f8", (RING,)),
        *_fields("when gains", "i8", (RING,)),
        ("total", "i8"),
        ("share", "f8"),
        # what is known of a sample when it is heard: acceleration that was due, gain; number of the next to be heard
        *_fields("due_m_s2 due_gain", "f8", (RING,)),
        ("heard_count", "i8"),
        # what is believed: amplifier and accelerometer; delay now, as believed, and at most [s]; the nominal handle
        *_fields("believed_pole believed_mean heard_pole late_s believed_s late_most_s", "f8"),
        ("force_measured", "i8"),
        *_fields("command_N sensed_N", "f8"),
        ("force_late", LATE),
        ("model", "f8", (5,)),  # its acceleration from state and force
        ("model_x", "f8", (4,)),
        # what is heard and learnt, of force and reading, and of what the nominal handle would do
        ("heard", "f8", (4,)),
        *_fields("heard_g heard_d jerk", "f8"),
        *_fields("pushed modelled", "f8", (4,)),
        ("felt", "f8", (6,)),
        *_fields("lag snap", "f8"),  # mass times lag ω₀ and snap ω₀² [kg]
        *_fields("phi z gain", "f8", (COUNT + 2,)),
        *_fields("spread spread_before", "f8", (COUNT + 2, COUNT + 2)),  # covariance of θ, lag, snap, and before all
        *_fields("theta_low theta_high", "f8", (COUNT,)),
        *_fields("doubt_N2 doubt noise_N2 noise_least_N2 noise_share noise_weight", "f8"),
        *_fields("loud loud_share quiet hush slight", "f8"),  # loud: mean square of what is played [m²/s⁴]
        # share of the travel that knocks have left; travel that the governor gives out without knocks; over which the
        # corner yields
        *_fields("room room_m yield_m plain_m room_back knock_N knocked", "f8"),
        *_fields("sitting sitting_count distrust distrust_least distrust_most", "i8"),
        *_fields("deaf_count deaf struck", "i8"),  # samples until it is learnt again, and until a knock counts anew
        *_fields("forget forget_played", "f8"),
    ],
    align=True,
)
"""A handle with its compensator, at one rate."""


def new_handle(
    plant: Plant,
    nominal: Plant,
    compensator: str,
    rate_Hz: float,
    seed: int = 0,
    sensor: Sensor | None = None,
    believed: Sensor | None = None,
) -> Any:
    """A record (1,) `HANDLE` at rest: the handle `plant`, driven as if it were `nominal`; `seed` of the sensor's noise.

    `sensor` is what is heard of it, `believed` what the compensator takes it for: `Sensor()`, and the same.

    Raises:
        HandleError: no such compensator, a rate out of range, or a sensor too late for that rate.
    """
    chosen = find_compensator(compensator)
    if not RATE_MIN_HZ <= rate_Hz <= RATE_MAX_HZ:
        raise HandleError(f"rate_Hz of a handle must be {RATE_MIN_HZ:g} to {RATE_MAX_HZ:g}, is {rate_Hz!r}")
    handle = np.zeros(1, HANDLE).view(np.recarray)
    h = handle[0]
    h.rate_Hz = rate_Hz
    _set_plant(h, nominal)
    hold(h, h.scout_step)
    h.scout_rad_s = math.sqrt(nominal.k_s_N_m * (1.0 / nominal.m_c_kg + 1.0 / nominal.m_h_kg))
    _set_plant(h, plant)
    hold(h, h.step)
    h.force_limit_N = min(plant.force_limit_N, nominal.force_limit_N)
    h.travel_limit_m = plant.travel_limit_m
    travel_m = min(plant.travel_limit_m, nominal.travel_limit_m)
    h.room, h.room_m = 1.0, chosen.travel_share * travel_m
    h.yield_m, h.plain_m = chosen.yield_share * travel_m, TRAVEL_SHARE * travel_m
    sensor = Sensor() if sensor is None else sensor
    believed = sensor if believed is None else believed
    _set_electronics(h, plant, nominal, chosen.leads, seed)
    _set_sensor(h, sensor, believed)
    h.kind = 0 if compensator == "none" else 1 if chosen.mass_only else 3 if chosen.adapts else 2
    h.g = math.tan(math.pi * LEARN_HZ / rate_Hz)
    h.g_low = h.g_now = math.tan(math.pi * chosen.corner_Hz / rate_Hz)
    h.g_high = math.tan(math.pi * HIGH_HZ / rate_Hz)
    h.d1, h.d2 = chosen.damping
    h.force_share = chosen.force_share
    h.nominal = h.theta = h.used = weights(nominal, LEARN_HZ)
    if chosen.mass_only:
        h.nominal[1:] = h.theta[1:] = h.used[1:] = 0.0
    h.delay = round(LOOK_AHEAD_S * rate_Hz)
    h.ahead = np.linalg.matrix_power(h.scout_step, h.delay)
    h.ahead[:, 4] = 0.0
    h.released, h.squeezed, h.release = 1.0, 1.0, -math.expm1(-1.0 / (RELEASE_S * rate_Hz))
    h.gains[:] = ONE
    h.total = (h.delay + 1) * ONE
    h.share = 1.0 / float(h.total)
    _set_adaptation(h, nominal, believed, LEARN_HZ)
    return handle


def _set_plant(h: Any, plant: Plant) -> None:
    for name in SPREAD:  # all that the equation of the handle holds
        setattr(h, name, getattr(plant, name))


def _set_electronics(h: Any, plant: Plant, nominal: Plant, leads: bool, seed: int) -> None:
    """Amplifier as it is, the lead for the nominal one, and the accelerometer."""
    h.amplifier_pole, h.amplifier_mean = _lag(plant.amplifier_Hz, h.rate_Hz)
    pole, mean = _lag(nominal.amplifier_Hz, h.rate_Hz)
    zero = min((mean - pole) / (1.0 - mean), _LEAD_MAX)
    h.lead = ((1.0 + zero) / (1.0 - pole), pole, zero) if leads else (1.0, 0.0, 0.0)
    h.believed_pole, h.believed_mean = pole, mean
    h.rng = seeded_state(seed, "accelerometer")


def _set_sensor(h: Any, sensor: Sensor, believed: Sensor) -> None:
    """The accelerometer as it is, and as it is believed to be."""
    h.sensor_pole = math.exp(-2.0 * math.pi * sensor.bandwidth_Hz / h.rate_Hz)
    h.noise_m_s2 = sensor.noise_m_s2_rtHz * math.sqrt(0.5 * h.rate_Hz)
    h.force_measured = sensor.force_measured and believed.force_measured
    h.heard_pole = math.exp(-2.0 * math.pi * believed.bandwidth_Hz / h.rate_Hz)
    h.late_s = h.believed_s = believed.delay_s
    h.late_most_s = believed.delay_s + 3.0 * LATE_S
    most_s = (RING - 4) / h.rate_Hz - 3.0 * LATE_S
    if max(sensor.delay_s, believed.delay_s) > most_s:
        raise HandleError(f"sensor: delay_s must be at most {most_s:.3g} at {h.rate_Hz:g} Hz")
    set_late(h.sensor_late, sensor.delay_s * h.rate_Hz)
    set_late(h.force_late, believed.delay_s * h.rate_Hz)


def _lag(bandwidth_Hz: float, rate_Hz: float) -> tuple[float, float]:
    """What is left of a step's distance at the end of a sample, and as a mean over it [1]."""
    lag = 2.0 * math.pi * bandwidth_Hz / rate_Hz
    return math.exp(-lag), -math.expm1(-lag) / lag


def _set_adaptation(h: Any, nominal: Plant, believed: Sensor, corner_Hz: float) -> None:
    middle_Hz, omega = math.sqrt(HEARD_HZ[0] * HEARD_HZ[1]), 2.0 * math.pi * corner_Hz
    h.heard_g, h.heard_d = math.tan(math.pi * middle_Hz / h.rate_Hz), sum(HEARD_HZ) / middle_Hz
    h.jerk = h.rate_Hz / omega
    h.model = np.append(nominal.state_space()[2][0], 1.0 / nominal.m_h_kg)
    h.spread_before[:COUNT, :COUNT] = prior(nominal, corner_Hz)
    h.spread_before[COUNT, COUNT] = (nominal.m_h_kg * omega * LATE_S) ** 2
    h.spread_before[COUNT + 1, COUNT + 1] = (nominal.m_h_kg * omega**2 * SNAP_S2) ** 2
    h.spread = h.spread_before
    h.theta_low, h.theta_high = np.multiply(BOUND, h.nominal)

    def share(time_s: float) -> float:
        return -math.expm1(-1.0 / (time_s * h.rate_Hz))

    h.room_back, h.knocked = share(ROOM_BACK_S), KNOCKED
    h.knock_N, h.deaf_count = KNOCK * nominal.force_limit_N, round(DEAF_S * h.rate_Hz)
    h.doubt_N2, h.doubt, h.slight = DOUBT_N**2, DOUBT, SLIGHT**2
    heard_Hz = 0.5 * math.pi * HEARD_HZ[1]  # of white noise, through one pole
    h.noise_N2 = h.noise_least_N2 = (nominal.m_h_kg * believed.noise_m_s2_rtHz) ** 2 * heard_Hz
    h.noise_weight, h.noise_share = NOISE_WEIGHT * 0.5 * h.rate_Hz / heard_Hz, share(NOISE_S)
    h.quiet, h.hush, h.loud_share = QUIET_M_S2**2, HUSH_M_S2**2, share(LOUD_S)
    h.forget, h.forget_played = share(FORGET_S), share(FORGET_PLAYED_S)
    h.sitting_count = round(SITTING_S * h.rate_Hz)
    h.distrust_least, h.distrust_most = (round(time_s * h.rate_Hz) for time_s in DISTRUST_S)
    h.distrust = h.distrust_least


def prior(nominal: Plant, corner_Hz: float) -> Array:
    """Covariance (5, 5) of θ [kg²] where the parameters are off by `SPREAD`, to first order."""
    step = 1e-4
    base = weights(nominal, corner_Hz)
    rows = []
    for name, spread in SPREAD.items():
        there = replace(nominal, **{name: getattr(nominal, name) * (1.0 + step)})
        rows.append((weights(there, corner_Hz) - base) * (spread / step))
    return np.asarray(np.transpose(rows) @ rows)
