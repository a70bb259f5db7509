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
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from hapscene.errors import HandleError
from hapscene.handle.adaptation import adapt
from hapscene.handle.basis import COUNT, integrals, weights
from hapscene.handle.compensator import find_compensator
from hapscene.handle.governor import LOOK_AHEAD_S, RELEASE_S, RING, fade, need
from hapscene.handle.motion import amplify, hold, move, sense
from hapscene.handle.plant import Array, Plant
from hapscene.native import native
from hapscene.surface.random import seeded_state

RATE_MIN_HZ: Final = 2500.0
"""Lowest rate of a handle [Hz]: 1 kHz needs more than two samples."""

RATE_MAX_HZ: Final = (RING - 2) / LOOK_AHEAD_S
"""Highest rate of a handle [Hz]: the look-ahead has room for so many samples."""

DESIRED_MAX_M_S2: Final = 1e6
"""Largest acceleration that is listened to [m/s²]: 20,000 times what the actuator can do. Keeps the filters finite."""

ACCELEROMETER_NOISE_M_S2_RTHZ: Final = 150e-6 * 9.80665
"""Noise density of the accelerometer [m/s²/√Hz]: 150 µg/√Hz, x and y of Analog Devices' ADXL312 (data sheet)."""

ACCELEROMETER_HZ: Final = 1600.0
"""Bandwidth of the accelerometer, one pole [Hz]: what the same sheet allows at its highest output rate. It is assumed
known; an error of it is taken for one of mass."""

COUPLING_HZ: Final = 8.0
"""Corner of the high-pass through which the accelerometer is heard [Hz]: gravity and the hand's own motion, not
caused by the force, would be taken for the handle's."""

SPREAD: Final[Mapping[str, float]] = {
    "m_c_kg": 0.3,
    "k_s_N_m": 0.3,
    "b_s_Ns_m": 0.5,
    "m_h_kg": 0.3,
    "k_u_N_m": 2.0,
    "b_u_Ns_m": 2.0,
}
"""How far each parameter may be from the nominal before anything is measured, as a standard deviation of its ratio [1].
The handle is known as well as it was identified, the grip changes by factors. Less for the grip, and a grip four times
as firm is learnt too late for a tap; less for the masses, and theirs is."""

BOUND: Final = (0.1, 10.0)
"""Least and most of each θ, over the nominal [1]."""

MASS_BOUND: Final = (0.4, 2.5)
"""Least and most of the mass θ₀, over the nominal [1]: what bounds the force at every frequency that is played."""

QUIET_M_S2: Final = 1.5
LOUD_S: Final = 0.005
DOUBT_N: Final = 0.08
"""Force on the handle that is not the actuator's, as a standard deviation [N]: hand and tool, above `COUPLING_HZ`."""

DOUBT: Final = 0.03
"""Share of a force that the model does not explain, as a standard deviation [1]."""

FORGET_S: Final = 0.5
"""Time after which what was learnt counts as doubtful again [s]: the grip may have changed."""

_LEAD_MAX: Final = 0.5
"""Bound of the lead's own pole [1]: above it what lies beyond 1 kHz would be amplified for nothing."""

HANDLE: Final = np.dtype(
    [
        *((name, "f8") for name in ("m_c_kg", "k_s_N_m", "b_s_Ns_m", "m_h_kg", "k_u_N_m", "b_u_Ns_m")),  # what is there
        ("force_limit_N", "f8"),
        ("travel_limit_m", "f8"),
        ("rate_Hz", "f8"),
        ("step", "f8", (5, 5)),  # state and force after a sample
        ("x", "f8", (4,)),  # x_h, ẋ_h, r, ṙ [m, m/s]
        ("work", "f8", (2, 5, 5)),  # of the matrix exponential
        ("hits", "i8"),  # how often the coil met a stop
        ("clips", "i8"),  # how often the command had to be cut at the force limit
        ("amplifier_N", "f8"),  # force at the end of the last sample
        ("amplifier_pole", "f8"),
        ("amplifier_mean", "f8"),
        ("noise_m_s2", "f8"),
        ("sensor_m_s2", "f8"),
        ("sensor_pole", "f8"),
        ("rng", "u8", (4,)),
        ("kind", "i8"),  # 0 no force, 1 mass alone, 2 fixed θ, 3 learnt θ
        ("g", "f8"),  # tan(ω₀T/2)
        ("d1", "f8"),
        ("d2", "f8"),
        ("lead", "f8", (3,)),  # its gain, zero and pole
        ("lead_m_s2", "f8", (2,)),  # its last input and output
        ("wanted", "f8", (6,)),  # integrals of the desired acceleration
        ("nominal", "f8", (COUNT,)),  # θ of the nominal handle [kg]
        ("theta", "f8", (COUNT,)),  # θ as known now [kg]
        ("delay", "i8"),  # look-ahead [samples]
        ("count", "i8"),  # samples so far
        ("late", "f8", (RING, COUNT)),  # φ of the last samples
        ("force_share", "f8"),
        ("scout_rad_s", "f8"),  # how fast the free coil swings
        ("scout_step", "f8", (5, 5)),
        ("scout_x", "f8", (4,)),
        ("released", "f8"),
        ("release", "f8"),
        ("first", "i8"),  # ascending gains of the look-ahead lie at first … last−1
        ("last", "i8"),
        ("least", "f8", (RING,)),
        ("when", "i8", (RING,)),
        ("gains", "i8", (RING,)),
        ("sum", "i8"),
        ("coupling", "f8", (4,)),
        ("coupling_g", "f8"),
        ("sensed_N", "f8"),
        ("pushed", "f8", (4,)),
        ("felt", "f8", (6,)),
        ("spread", "f8", (COUNT, COUNT)),  # covariance of θ
        ("spread_before", "f8", (COUNT, COUNT)),  # of θ before anything is measured
        ("gain", "f8", (COUNT,)),
        ("theta_low", "f8", (COUNT,)),
        ("theta_high", "f8", (COUNT,)),
        ("doubt_N2", "f8"),
        ("doubt", "f8"),
        ("loud", "f8"),  # mean square of what is played [m²/s⁴]
        ("loud_share", "f8"),
        ("quiet", "f8"),
        ("forget", "f8"),
    ],
    align=True,
)
"""A handle with its compensator, at one rate."""


def new_handle(plant: Plant, nominal: Plant, compensator: str, rate_Hz: float, seed: int = 0) -> Any:
    """A record (1,) `HANDLE` at rest: the handle `plant`, driven as if it were `nominal`; `seed` of the sensor's noise.

    Raises:
        HandleError: no such compensator, or a rate out of range.
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
    _set_electronics(h, plant, nominal, chosen.leads, seed)
    h.kind = 0 if compensator == "none" else 1 if chosen.mass_only else 3 if chosen.adapts else 2
    h.g = math.tan(math.pi * chosen.corner_Hz / rate_Hz)
    h.d1, h.d2 = chosen.damping
    h.force_share = chosen.force_share
    h.nominal = h.theta = weights(nominal, chosen.corner_Hz)
    if chosen.mass_only:
        h.nominal[1:] = h.theta[1:] = 0.0
    h.delay = round(LOOK_AHEAD_S * rate_Hz)
    h.released, h.release = 1.0, -math.expm1(-1.0 / (RELEASE_S * rate_Hz))
    h.gains[:] = 2**40
    h.sum = (h.delay + 1) * 2**40
    _set_adaptation(h, nominal, chosen.corner_Hz)
    return handle


def _set_plant(h: Any, plant: Plant) -> None:
    for name in ("m_c_kg", "k_s_N_m", "b_s_Ns_m", "m_h_kg", "k_u_N_m", "b_u_Ns_m"):
        setattr(h, name, getattr(plant, name))


def _set_electronics(h: Any, plant: Plant, nominal: Plant, leads: bool, seed: int) -> None:
    """Amplifier as it is, the lead for the nominal one, and the accelerometer."""
    h.amplifier_pole, h.amplifier_mean = _lag(plant.amplifier_Hz, h.rate_Hz)
    pole, mean = _lag(nominal.amplifier_Hz, h.rate_Hz)
    zero = min((mean - pole) / (1.0 - mean), _LEAD_MAX)
    h.lead = ((1.0 + zero) / (1.0 - pole), pole, zero) if leads else (1.0, 0.0, 0.0)
    h.sensor_pole = math.exp(-2.0 * math.pi * ACCELEROMETER_HZ / h.rate_Hz)
    h.noise_m_s2 = ACCELEROMETER_NOISE_M_S2_RTHZ * math.sqrt(0.5 * h.rate_Hz)
    h.rng = seeded_state(seed, "accelerometer")


def _lag(bandwidth_Hz: float, rate_Hz: float) -> tuple[float, float]:
    """What is left of a step's distance at the end of a sample, and as a mean over it [1]."""
    lag = 2.0 * math.pi * bandwidth_Hz / rate_Hz
    return math.exp(-lag), -math.expm1(-lag) / lag


def _set_adaptation(h: Any, nominal: Plant, corner_Hz: float) -> None:
    h.coupling_g = math.tan(math.pi * COUPLING_HZ / h.rate_Hz)
    h.spread_before = h.spread = prior(nominal, corner_Hz)
    h.theta_low, h.theta_high = BOUND[0] * h.nominal, BOUND[1] * h.nominal
    h.theta_low[0], h.theta_high[0] = MASS_BOUND[0] * h.nominal[0], MASS_BOUND[1] * h.nominal[0]
    h.doubt_N2, h.doubt = DOUBT_N**2, DOUBT
    h.quiet, h.loud_share = QUIET_M_S2**2, -math.expm1(-1.0 / (LOUD_S * h.rate_Hz))
    h.forget = -math.expm1(-1.0 / (FORGET_S * h.rate_Hz))


def prior(nominal: Plant, corner_Hz: float) -> Array:
    """Covariance (5, 5) of θ [kg²] where the parameters are off by `SPREAD`, to first order."""
    step = 1e-4
    base = weights(nominal, corner_Hz)
    rows = []
    for name, spread in SPREAD.items():
        there = replace(nominal, **{name: getattr(nominal, name) * (1.0 + step)})
        rows.append((weights(there, corner_Hz) - base) * (spread / step))
    return np.asarray(np.transpose(rows) @ rows)


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
    if h.kind >= 2:
        phi = integrals(h.wanted, h.g, h.d1, h.d2, wanted)
    else:
        phi = (wanted, 0.0, 0.0, 0.0, 0.0)
    needed, pushed = 0.0, 0.0
    late, slot, due = h.late, h.count % RING, (h.count - h.delay) % RING
    for i in range(COUNT):
        needed += h.nominal[i] * phi[i]
        late[slot, i] = phi[i]
        pushed += h.theta[i] * late[due, i]
    gain = fade(h, need(h, needed))
    h.count += 1
    command = gain * pushed if h.kind > 0 else 0.0
    if abs(command) > h.force_limit_N:  # the last net
        command = math.copysign(h.force_limit_N, command)
        h.clips += 1
    force = amplify(h, command)
    acceleration = move(h, force)
    if h.kind == 3:
        adapt(h, force, sense(h, acceleration), gain * late[due, 0])
    return acceleration, h.x[0], force


@native
def _lead(h: Any, a: float) -> float:
    """What the amplifier makes a of: gain (1 − pole z⁻¹)/(1 + zero z⁻¹)."""
    h.lead_m_s2[1] = h.lead[0] * (a - h.lead[1] * h.lead_m_s2[0]) - h.lead[2] * h.lead_m_s2[1]
    h.lead_m_s2[0] = a
    return float(h.lead_m_s2[1])
