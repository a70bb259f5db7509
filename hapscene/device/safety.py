"""Safety layer between the haptic tick and a device. Compiled.

`protect` applies these steps in order. Each has its own flag.

    safety stop  outside of the workspace, faster than a hand, device not ready or without new data
    NaN          a force that is not finite is replaced by 0
    peak         limit of the magnitude; the direction is kept
    heat         thermal model of the motors, which derates the limit to the continuous force
    slew         limit of the rate of change
    ramp         the force rises from 0 at the start and after each safety stop

A safety stop also occurs without a heartbeat of the application, after the servo was suspended, and for a force that is
not finite. It reduces the force to 0 within `FALL_S`. All limits come from the driver when the servo starts: scenes,
swatches and clients cannot change them.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.constants import TINY
from hapscene.device.driver import Driver
from hapscene.flags import Flag
from hapscene.geometry import Vector
from hapscene.records import Records, records

__all__ = [
    "CALM_S",
    "FALL_S",
    "HEARTBEAT_AGE_S",
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
"""Time in which a safety stop reduces the full force to 0 [s]. A shorter time would cause a jolt."""

HEARTBEAT_AGE_S: Final = 0.012
"""Age of the last heartbeat at which the application counts as dead [s]. With `FALL_S` and one tick, the force is 0
within 20 ms. The application sends a heartbeat every 2 ms (`hapscene.loop.heartbeat`)."""

STATE_AGE_S: Final = 0.010
"""Age of the last device state that causes a safety stop [s]; four periods of the device if that is longer."""

STALL_S: Final = 0.02
"""Delay of a tick from which on the servo counts as suspended, and the force restarts at 0 [s]."""

CALM_S: Final = 0.5
"""Time without a cause before the force returns after a safety stop [s], to grasp a tool that was dropped."""

RAMP_S: Final = 2.0
"""Duration of the ramp to the full force [s], as in CHAI3D (src/tools/CGenericTool.cpp)."""

RESUME_S: Final = 0.1
"""Duration of the ramp after an order that stopped the loop for some ticks [s]. Avoids a jolt and a loss of contact."""

HEAT_SHARE: Final = 0.9
"""Motor temperature at which the force limit starts to fall [1]. At 1 it equals the continuous force."""

SAFETY: Final = np.dtype(
    [
        # limits of the device
        ("on", "i8"),  # 0: disabled, as for a simulated twin
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
        ("gain", "f8"),  # factor of the force, 0 … 1
        ("rise_s", "f8"),  # duration of the current ramp
        ("clear_s", "f8"),  # time without a cause of a safety stop
        ("heat", "f8"),  # motor temperature, 1: steady state at the continuous force
        ("sent_N", "f8", (3,)),  # last force, before the gain
        ("p_DT_m", "f8", (3,)),  # tool position in the last tick
        ("begun", "i8"),  # 1: at least one tick since the start
        ("count", "i8"),  # number of device states at the last tick
        ("count_s", "f8"),  # age of the last device state
        ("heartbeat", "i8"),  # number of the application's heartbeats at the last tick
        ("heartbeat_s", "f8"),  # age of the last heartbeat
        # set by the servo before each tick
        ("heartbeat_now", "i8"),  # number of heartbeats
        ("elapsed_s", "f8"),  # time since the previous tick by the clock; 0 without a clock: one period
        ("stopped", "i8"),  # 1: the application requests no force
        ("stalled", "i8"),  # 1: the servo was suspended before this tick
        ("late", "i8"),  # 1: this tick began more than one period after it was due
    ],
    align=True,
)
"""Limits and state of the safety layer of one device."""

_WORKSPACE, _FAST = int(Flag.OUT_OF_WORKSPACE), int(Flag.TOO_FAST)
_NAN, _PEAK, _HEAT = int(Flag.FORCE_NOT_FINITE), int(Flag.PEAK_LIMITED), int(Flag.HEAT_LIMITED)
_STEP, _RAMP = int(Flag.STEP_LIMITED), int(Flag.RAMPED)
_SILENT, _NOT_READY, _STALLED = int(Flag.APPLICATION_SILENT), int(Flag.DEVICE_NOT_READY), int(Flag.STALLED)


def no_safety() -> Records:
    """(1,) SAFETY that is disabled."""
    return records(1, SAFETY)


def simulated_safety() -> Records:
    """(1,) SAFETY of a simulated device, which needs no protection of a hand: only the heartbeat is checked."""
    safety = records(1, SAFETY)
    safety.on, safety.gain = 1, 1.0
    for name in ("force_N", "continuous_N", "slew_N_s", "speed_m_s", "high_D_m", "state_age_s"):
        safety[name] = math.inf
    safety.low_D_m, safety.heat_s = -math.inf, 1.0
    return safety


def safety_of(driver: Driver) -> Records:
    """(1,) SAFETY with the limits of a driver."""
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
    """Reset before the first tick and after each pause: the force ramps up from 0."""
    s.gain = 1.0 if s.ramp_s == 0.0 else 0.0
    s.clear_s, s.rise_s = s.calm_s, s.ramp_s
    s.begun, s.count_s, s.heartbeat_s, s.stalled, s.late = 0, 0.0, 0.0, 0, 0
    for i in range(3):
        s.sent_N[i] = 0.0


@native
def resume_safety(s: np.record) -> None:
    """Reset after an order that stopped the loop, with a short ramp: the force was 0, and the tool may have moved."""
    if s.ramp_s > 0.0:
        s.rise_s = RESUME_S if s.gain == 1.0 else s.rise_s
        s.gain = 0.0
    s.begun = 0


@native
def protect(
    s: np.record, p_DT: Vector, ready: int, count: int, f: Sequence[float], tick_s: float
) -> tuple[Vector, int]:
    """Limit the force `f` (3,) [N] of a tick. Returns the force for the device and flags.

    `p_DT` is the tool position in the device frame; `ready` and `count` are fields of `DEVICE_STATE`.
    """
    elapsed_s: float = s.elapsed_s if s.elapsed_s > 0.0 else tick_s
    causes = _stop_causes(s, p_DT, ready, count, tick_s, elapsed_s)
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
        s.gain, s.clear_s, s.rise_s = left if left > TINY else 0.0, 0.0, s.ramp_s
    else:
        s.clear_s += tick_s
        if s.clear_s >= s.calm_s and s.gain < 1.0:
            s.gain = min(1.0, s.gain + tick_s / s.rise_s) if s.rise_s > 0.0 else 1.0
    if s.gain < 1.0:
        flags |= _RAMP
    sent = (s.gain * force[0], s.gain * force[1], s.gain * force[2])
    if s.continuous_N < math.inf:
        share = (sent[0] * sent[0] + sent[1] * sent[1] + sent[2] * sent[2]) / (s.continuous_N * s.continuous_N)
        s.heat += (share - s.heat) * (1.0 - math.exp(-tick_s / s.heat_s))
    return sent, flags | causes


@native
def _stop_causes(s: np.record, p: Vector, ready: int, count: int, tick_s: float, elapsed_s: float) -> int:
    """Flags of the causes of a safety stop in this tick.

    The ages of the device state and of the heartbeat are measured by the clock. While a driver waits for a device that
    does not answer, every tick misses its deadline: counting periods would underestimate the silence.
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
    # the device may update its position less often than once a tick, and moves further during a late tick
    since_s = s.count_s + (tick_s if s.late == 0 else STALL_S)
    if s.begun == 1 and way > (s.speed_m_s * since_s) ** 2:
        causes |= _FAST
    s.count_s = 0.0 if count != s.count or s.begun == 0 else s.count_s + elapsed_s
    s.heartbeat_s = 0.0 if s.heartbeat_now != s.heartbeat or s.begun == 0 else s.heartbeat_s + elapsed_s
    s.count, s.heartbeat = count, s.heartbeat_now
    if ready == 0 or s.count_s > s.state_age_s:
        causes |= _NOT_READY
    if s.heartbeat_s > HEARTBEAT_AGE_S or s.stopped == 1:
        causes |= _SILENT
    if s.stalled == 1:
        causes |= _STALLED
        s.gain = 1.0 if s.ramp_s == 0.0 else 0.0
        s.stalled = 0
    s.begun = 1
    return causes


@native
def _limited(s: np.record, f: Vector, tick_s: float) -> tuple[Vector, int]:
    """Limit a force by peak, temperature and slew rate. Returns the force and flags."""
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
