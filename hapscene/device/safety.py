"""What stands between the tick's force and a device, in this order, each with a flag of its own. Compiled.

    trip       out of the workspace, faster than a hand, a device that is not ready or says nothing new
    NaN        no force
    peak       the magnitude is cut, the direction kept
    heat       a model of the motors' warmth: ever nearer to what they bear for long
    slew       no faster than the device may be made to change
    ramp       from nothing to all of it, at the start and after every cause to stop
    heartbeat  an application that is gone, stopped, or no longer asks ends the force

A cause takes the force away within `FALL_S`, whatever its direction then is. The numbers are the driver's, set once as
the servo starts: no scene, swatch or client can change them.
"""

import math
from typing import Any, Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.constants import TINY
from hapscene.device.driver import Driver
from hapscene.flags import Flag
from hapscene.geometry import Vector
from hapscene.records import records

__all__ = [
    "CALM_S",
    "FALL_S",
    "PULSE_AGE_S",
    "RAMP_S",
    "RESUME_S",
    "STALL_S",
    "begin_safety",
    "no_safety",
    "protect",
    "resume_safety",
    "safety_of",
    "simulated_safety",
]

FALL_S: Final = 0.005
"""How fast a cause takes the whole force away [s]. Shorter, and letting go is itself a knock."""

PULSE_AGE_S: Final = 0.012
"""After how long without a pulse the application counts as gone [s]: with `FALL_S` and a tick the force is 0 within 20
ms. Its pulse comes every 2 ms (`hapscene.loop.heartbeat`)."""

STATE_AGE_S: Final = 0.010
"""After how long without a new state the device counts as silent [s], or four of its periods where those are longer."""

STALL_S: Final = 0.02
"""How late a tick may be before the force begins anew [s]."""

CALM_S: Final = 0.5
"""How long a cause must be over before the force comes back [s]: who lost the tool has time to take it again."""

RAMP_S: Final = 2.0
"""How long the force then takes to be whole [s]: as CHAI3D's tools have it (src/tools/CGenericTool.cpp)."""

RESUME_S: Final = 0.1
"""And how long after an order for which the loop stood still for some ticks [s]: no knock, and no loss of touch."""

HEAT_SHARE: Final = 0.9
"""Warmth from which less than the peak force is allowed [1]; at 1 it is the continuous force."""

SAFETY: Final = np.dtype(
    [
        # of the device
        ("on", "i8"),  # 0: nothing is done: the twin of a recording
        ("force_N", "f8"),
        ("continuous_N", "f8"),
        ("heat_s", "f8"),
        ("slew_N_s", "f8"),
        ("speed_m_s", "f8"),
        ("low_D_m", "f8", (3,)),
        ("high_D_m", "f8", (3,)),
        ("ramp_s", "f8"),
        ("calm_s", "f8"),
        ("state_age_s", "f8"),
        # state
        ("gain", "f8"),  # share of the force that is sent, 0 … 1
        ("rise_s", "f8"),  # how long that takes from 0 to 1, this time
        ("rested_s", "f8"),  # how long no cause has been there
        ("heat", "f8"),  # warmth of the motors, 1: as after long at the continuous force
        ("sent_N", "f8", (3,)),  # before the gain
        ("p_DT_m", "f8", (3,)),  # tool in the last tick
        ("begun", "i8"),
        ("count", "i8"),  # of the device's states, when last looked at
        ("count_s", "f8"),  # how long it has been that
        ("pulse", "i8"),  # the application's, likewise
        ("pulse_s", "f8"),
        # by the servo, before each tick
        ("pulse_now", "i8"),
        ("elapsed_s", "f8"),  # time since the tick before, by the clock; 0 where no clock runs: one period
        ("stopped", "i8"),  # 1: the application asks for no force
        ("stalled", "i8"),  # the loop stood still before this tick
        ("late", "i8"),  # this tick began more than one period after it was due
    ],
    align=True,
)
"""Safety of one device: its numbers, its state."""

_WORKSPACE, _FAST = int(Flag.OUT_OF_WORKSPACE), int(Flag.TOO_FAST)
_NAN, _PEAK, _HEAT = int(Flag.FORCE_NOT_FINITE), int(Flag.PEAK_LIMITED), int(Flag.HEAT_LIMITED)
_STEP, _RAMP = int(Flag.STEP_LIMITED), int(Flag.RAMPED)
_SILENT, _NOT_READY, _STALLED = int(Flag.APPLICATION_SILENT), int(Flag.DEVICE_NOT_READY), int(Flag.STALLED)


def no_safety() -> Any:
    """(1,) SAFETY that lets everything through."""
    return records(1, SAFETY)


def simulated_safety() -> Any:
    """(1,) SAFETY of a simulated device: nobody's hand is on it, so only an application that is gone ends its force."""
    safety = records(1, SAFETY)
    safety.on, safety.gain = 1, 1.0
    for name in ("force_N", "continuous_N", "slew_N_s", "speed_m_s", "high_D_m", "state_age_s"):
        safety[name] = math.inf
    safety.low_D_m, safety.heat_s = -math.inf, 1.0
    return safety


def safety_of(driver: Driver) -> Any:
    """(1,) SAFETY of a device."""
    safety = simulated_safety()
    if driver.simulated:
        return safety
    if driver.model is not None:
        safety.force_N, safety.slew_N_s = driver.model.limits.force_N, driver.model.limits.slew_N_s
    safety.continuous_N, safety.heat_s = driver.continuous_N, driver.heat_s
    safety.speed_m_s, safety.low_D_m, safety.high_D_m = driver.speed_m_s, driver.low_D_m, driver.high_D_m
    safety.ramp_s, safety.calm_s = RAMP_S, CALM_S
    safety.state_age_s = max(STATE_AGE_S, 4.0 / driver.rate_Hz if driver.rate_Hz > 0.0 else 0.0)
    return safety


@native
def begin_safety(s: np.record) -> None:
    """Before the first tick, and after every pause: the force begins anew."""
    s.gain = 1.0 if s.ramp_s == 0.0 else 0.0
    s.rested_s, s.rise_s = s.calm_s, s.ramp_s
    s.begun, s.count_s, s.pulse_s, s.stalled, s.late = 0, 0.0, 0.0, 0, 0
    for i in range(3):
        s.sent_N[i] = 0.0


@native
def resume_safety(s: np.record) -> None:
    """After an order for which the loop stood still: the force was 0 meanwhile, and the tool went on."""
    if s.ramp_s > 0.0:
        s.rise_s = RESUME_S if s.gain == 1.0 else s.rise_s
        s.gain = 0.0
    s.begun = 0


@native
def protect(s: np.record, p_DT: Vector, ready: int, count: int, f: Any, tick_s: float) -> tuple[Vector, int]:
    """The force that may go to the device instead of `f` (3,) [N], and flags.

    `p_DT` is the tool in the device's frame, `ready` and `count` are as in `DEVICE_STATE`.
    """
    elapsed_s: float = s.elapsed_s if s.elapsed_s > 0.0 else tick_s
    causes = _trips(s, p_DT, ready, count, tick_s, elapsed_s)
    if not (math.isfinite(f[0]) and math.isfinite(f[1]) and math.isfinite(f[2])):
        wanted = (0.0, 0.0, 0.0)
        causes |= _NAN
        for i in range(3):
            s.sent_N[i] = 0.0
    else:
        wanted = (f[0], f[1], f[2])
    force, flags = _limited(s, wanted, tick_s)
    if causes != 0:
        left = s.gain - max(tick_s, elapsed_s) / FALL_S
        s.gain, s.rested_s, s.rise_s = left if left > TINY else 0.0, 0.0, s.ramp_s
    else:
        s.rested_s += tick_s
        if s.rested_s >= s.calm_s and s.gain < 1.0:
            s.gain = min(1.0, s.gain + tick_s / s.rise_s) if s.rise_s > 0.0 else 1.0
    if s.gain < 1.0:
        flags |= _RAMP
    sent = (s.gain * force[0], s.gain * force[1], s.gain * force[2])
    if s.continuous_N < math.inf:
        share = (sent[0] * sent[0] + sent[1] * sent[1] + sent[2] * sent[2]) / (s.continuous_N * s.continuous_N)
        s.heat += (share - s.heat) * (1.0 - math.exp(-tick_s / s.heat_s))
    return sent, flags | causes


@native
def _trips(s: np.record, p: Vector, ready: int, count: int, tick_s: float, elapsed_s: float) -> int:
    """The causes to give no force.

    Silence of the device and of the application is measured by the clock: ticks that miss their deadline, as all do
    while a driver waits for a device that does not answer, count with their true duration.
    """
    causes = 0
    if not (math.isfinite(p[0]) and math.isfinite(p[1]) and math.isfinite(p[2])):
        return _NOT_READY
    way = 0.0
    for i in range(3):
        if p[i] < s.low_D_m[i] or p[i] > s.high_D_m[i]:
            causes |= _WORKSPACE
        way += (p[i] - s.p_DT_m[i]) ** 2
        s.p_DT_m[i] = p[i]
    # a device may say less often where it is than there are ticks, and a late tick finds it farther on
    since_s = s.count_s + (tick_s if s.late == 0 else STALL_S)
    if s.begun == 1 and way > (s.speed_m_s * since_s) ** 2:
        causes |= _FAST
    s.count_s = 0.0 if count != s.count or s.begun == 0 else s.count_s + elapsed_s
    s.pulse_s = 0.0 if s.pulse_now != s.pulse or s.begun == 0 else s.pulse_s + elapsed_s
    s.count, s.pulse = count, s.pulse_now
    if ready == 0 or s.count_s > s.state_age_s:
        causes |= _NOT_READY
    if s.pulse_s > PULSE_AGE_S or s.stopped == 1:
        causes |= _SILENT
    if s.stalled == 1:
        causes |= _STALLED
        s.gain = 1.0 if s.ramp_s == 0.0 else 0.0
        s.stalled = 0
    s.begun = 1
    return causes


@native
def _limited(s: np.record, f: Vector, tick_s: float) -> tuple[Vector, int]:
    """A force inside peak, warmth and slew, and flags."""
    flags = 0
    magnitude = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    most = s.force_N
    if magnitude > most:
        flags |= _PEAK
    if s.heat > HEAT_SHARE:
        cool = max(0.0, (1.0 - s.heat) / (1.0 - HEAT_SHARE))
        most = min(most, s.continuous_N + cool * max(0.0, most - s.continuous_N))
        if magnitude > most:
            flags |= _HEAT
    if magnitude > most:
        share = most / magnitude
        f = (share * f[0], share * f[1], share * f[2])
    last = s.sent_N
    way = (f[0] - last[0], f[1] - last[1], f[2] - last[2])
    change, step = math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]), s.slew_N_s * tick_s
    if change > step:
        flags |= _STEP
        share = step / change
        f = (last[0] + share * way[0], last[1] + share * way[1], last[2] + share * way[2])
    last[0], last[1], last[2] = f[0], f[1], f[2]
    return f, flags
