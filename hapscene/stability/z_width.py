"""The Z-width of a device: the range of wall stiffness and damping at which it is stable, by rate and delay.

Real devices are stable at walls that are not passive, since friction stops small motion; the limit depends on the
motion of the hand. Each wall is therefore touched in simulation: a hand with a grip taps it at 0.5 m/s and continues to
press, three times with decreasing depth, since friction may or may not hold the tool between two encoder steps. A wall
counts as **stable** if in each trial

- the tool comes to rest: its speed over a tenth of a second is below 5 mm/s rms;
- the motors come to rest: their force varies by less than 0.07 N rms, which the tool speed may not show if the
  structure is elastic;
- the motors add at most 2 mJ of energy to the tool in total.

Colgate & Brown 1994 introduced the term.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import msgspec
import numpy as np

from hapscene.device.model import TOUCH_SPEED_M_S, device_named, limits_of
from hapscene.device.sim.hand import Grip
from hapscene.device.sim.omni import Omni
from hapscene.device.sim.point import PointMass
from hapscene.loop.result import ClosedLoopResult
from hapscene.parallel import Task, run_tasks
from hapscene.stability.closed_form import limit_of_small_motion
from hapscene.stability.rig import Rig
from hapscene.surface.swatch import Swatch

__all__ = ["DAMPINGS_NS_M", "STIFFNESS_N_M", "Point", "StableRegion", "describe", "place", "trace", "trace_all"]

REST_M_S: Final = 5e-3
"""Largest speed of a tool at rest [m/s rms]: half the noise of an encoder of 55 µm at 200 Hz, and below the
perception threshold of buzzing."""

WORK_J: Final = 2e-3
"""Largest energy that the motors may add to the tool [J]: a weak tap of 0.3 m/s with the Omni's 45 g."""

STILL_N: Final = 0.07
"""Largest variation of the motor force at rest [N rms]: 7 % of the pressing force of 1 N, the just-noticeable
difference (Pang, Tan & Durlach 1991)."""

ABOVE_M: Final = 5e-3
"""Start of the hand above the sheet [m]."""

BELOW_M: Final = (20e-3, 17.3e-3, 14.1e-3)
"""Target of the hand below the sheet in each trial [m]: 1.2 to 0.85 N with a light grip, and no two an integer
number of encoder steps apart. The hand moves there at the speed for which device limits are defined."""

PRESS_S: Final = 0.35
"""Duration of pressing [s]. If the tool is not yet at rest but becomes calmer, pressing is repeated."""

MORE: Final = 10
"""Most repetitions of pressing [count]: devices with little friction take seconds to come to rest in a light grip."""

CALMER: Final = 0.8
"""Ratio of the speed to that of the repetition before, up to which the tool counts as becoming calmer [1]."""

LATE_S: Final = 0.1
"""Final part of pressing, over which rest is evaluated [s]."""

STIFFNESS_N_M: Final = (50.0, 50_000.0)
"""Lowest and highest tested stiffness [N/m]."""

STEP: Final = 2.0
"""Ratio of stiffnesses in the search for an unstable one [1]."""

HALVINGS: Final = 5
"""Bisections between the last stable and the first unstable stiffness [count], to 2 %."""

DAMPINGS_NS_M: Final = (0.0, *(float(f"{B:.3g}") for B in np.geomspace(0.5, 128.0, 9)))
"""Wall dampings at which the region is traced [N·s/m]."""


@dataclass(frozen=True)
class Trial:
    """Result of touching a wall."""

    end_speed_m_s: float
    end_force_N: float
    work_J: float

    @property
    def stable(self) -> bool:
        return self.end_speed_m_s < REST_M_S and self.end_force_N < STILL_N and self.work_J <= WORK_J


@dataclass(frozen=True)
class StableRegion:
    """The stability region of a device at one rate and delay: stiffness below `limit_N_m` at each `damping_Ns_m`.

    Attributes:
        device: name of the device.
        rate_Hz: rate of the haptic tick.
        delay_ticks: delay of the force.
        damping_Ns_m: (n,) wall dampings.
        limit_N_m: (n,) lowest unstable stiffness; 0 if the lowest tested one is unstable, inf if none is.
        closed_N_m: (n,) limit of small motion without friction and encoder steps, including the damping of the hand.
    """

    device: str
    rate_Hz: float
    delay_ticks: int
    damping_Ns_m: tuple[float, ...]
    limit_N_m: tuple[float, ...]
    closed_N_m: tuple[float, ...]


@dataclass(frozen=True)
class Point:
    """A swatch in the region, without and with the limits of the device.

    Attributes:
        swatch: name of the swatch.
        stiffness_N_m, damping_Ns_m: its own stiffness and damping.
        capped_N_m, capped_Ns_m: the same, restricted to the limits of the device.
        stable: whether it is stable without limits.
        capped_stable: whether it is stable with all measures of the haptic tick: limits, damping, passivity controller.
    """

    swatch: str
    stiffness_N_m: float
    damping_Ns_m: float
    capped_N_m: float
    capped_Ns_m: float
    stable: bool
    capped_stable: bool


def try_wall(rig: Rig, stiffness_N_m: float, damping_Ns_m: float, grip: Grip) -> Trial:
    """Tap a wall, and press on it."""
    rig.tune(stiffness_N_m, damping_Ns_m)
    return touch(rig, grip)


def touch(rig: Rig, grip: Grip) -> Trial:
    """Tap the present wall and press on it; return the first trial that is not stable, or the last."""
    press = round(PRESS_S / rig.tick_s)
    for below in BELOW_M:
        lower = round((ABOVE_M + below) / TOUCH_SPEED_M_S / rig.tick_s)
        depth = np.concatenate((np.linspace(-ABOVE_M, below, lower), np.full(press, below)))
        trial = _judged(rig.follow(depth, grip), rig.tick_s, 0.0)
        for _ in range(MORE):
            if trial.stable or trial.work_J > WORK_J:
                break
            before, trial = trial, _judged(rig.stay(below, press, grip), rig.tick_s, trial.work_J)
            if trial.end_speed_m_s > CALMER * before.end_speed_m_s:
                break
        if not trial.stable:
            break
    return trial


def _judged(felt: ClosedLoopResult, tick_s: float, work_J: float) -> Trial:
    """Evaluate the end of a motion, and add its energy to `work_J`."""
    late = round(LATE_S / tick_s)
    speed2 = np.sum(felt.v_W_m_s[-late:] ** 2, axis=1)
    f_N = felt.f_motor_W_N[-late:, 2]
    return Trial(float(np.sqrt(speed2.mean())), float(f_N.std()), work_J + float(felt.work_J.sum()))


def trace(
    name: str,
    device: PointMass | Omni,
    point: PointMass,
    rate_Hz: float,
    delay_ticks: int,
    grip: Grip,
    dampings_Ns_m: Sequence[float] = DAMPINGS_NS_M,
) -> StableRegion:
    """Trace the stability region of a device; `point` is the device as a point mass, for the closed form."""
    rig, tick_s = Rig(device, 1.0 / rate_Hz, delay_ticks), 1.0 / rate_Hz
    mass, damping = point.mass_kg + grip.mass_kg, point.b_Ns_m + grip.b_Ns_m
    return StableRegion(
        name,
        rate_Hz,
        delay_ticks,
        tuple(dampings_Ns_m),
        tuple(_limit(rig, B, grip) for B in dampings_Ns_m),
        tuple(limit_of_small_motion(mass, damping, tick_s, delay_ticks, B) for B in dampings_Ns_m),
    )


def place(
    name: str, device: PointMass | Omni, rate_Hz: float, delay_ticks: int, grip: Grip, swatches: Sequence[Swatch]
) -> list[Point]:
    """Test each swatch, without and with the limits of the named device."""
    tick_s = 1.0 / rate_Hz
    limits = limits_of(name, tick_s, delay_ticks)
    free = Rig(device, tick_s, delay_ticks)
    points = []
    for swatch in swatches:
        K, B = swatch.stiffness_N_m, swatch.damping_Ns_m
        within = Rig(device, tick_s, delay_ticks, limits, stiffness_N_m=K, damping_Ns_m=B)
        points.append(
            Point(
                swatch=swatch.name,
                stiffness_N_m=K,
                damping_Ns_m=B,
                capped_N_m=min(K, limits.stiffness_N_m),
                capped_Ns_m=min(B, limits.damping_Ns_m),
                stable=try_wall(free, K, B, grip).stable,
                capped_stable=touch(within, grip).stable,
            )
        )
    return points


def describe(point: Point, rate_Hz: float, delay_ticks: int) -> str:
    """The verdict on a swatch: "wood: 5000 N/m is unstable at 1 kHz; the device limits it to 700 N/m, which is
    stable"."""
    where = f"at {rate_Hz / 1e3:g} kHz" + (f" with a delay of {delay_ticks} tick" if delay_ticks else "")
    damped = f", {point.damping_Ns_m:g} N·s/m" if point.damping_Ns_m else ""
    verdict = "is stable" if point.stable else "is unstable"
    text = f"{point.swatch}: {point.stiffness_N_m:g} N/m{damped} {verdict} {where}"
    if (point.capped_N_m, point.capped_Ns_m) == (point.stiffness_N_m, point.damping_Ns_m):
        if point.stable or point.capped_stable:
            return text + ("" if point.stable else "; with the damping that the haptic tick adds, it is stable")
        return text + "; it is within the limits of the device"
    cap = f"{point.capped_N_m:g} N/m" + (f", {point.capped_Ns_m:.3g} N·s/m" if point.capped_Ns_m else "")
    return f"{text}; the device limits it to {cap}, which is {'stable' if point.capped_stable else 'also unstable'}"


def trace_all(
    device: str,
    rates_Hz: Sequence[float],
    delays: Sequence[int],
    grip: Grip,
    say: Callable[[str], None] = lambda _: None,
    dampings_Ns_m: Sequence[float] = DAMPINGS_NS_M,
    **workers: Any,
) -> list[StableRegion]:
    """Trace a region for each delay, rate and model of the device: as a point mass, and for the Omni also as an arm.

    Args:
        device, rates_Hz, delays, grip, dampings_Ns_m: as in `trace`.
        say: called with lines of progress.
        workers: journal, jobs and scheduler of `hapscene.parallel.run_tasks`.
    """
    asked = {"device": device, "grip": asdict(grip), "dampings_Ns_m": list(dampings_Ns_m)}
    pieces = [
        Task(
            f"{NAMES[arm]} at {rate / 1e3:g} kHz, delay {delay}",
            trace_piece,
            asked | {"arm": arm, "rate_Hz": rate, "delay_ticks": delay},
        )
        for delay in delays
        for rate in rates_Hz
        for arm in ((True, False) if device == "omni" else (False,))
    ]
    found = run_tasks(pieces, after=lambda done, of, key: say(f"Z-width {done} of {of}: {key}\n"), **workers)
    return [msgspec.convert(found[piece.key], StableRegion) for piece in pieces]


NAMES: Final = {True: "Omni", False: "as a point mass"}
"""Name of a region, by whether the device is modelled as an arm."""


def trace_piece(
    device: str, arm: bool, rate_Hz: float, delay_ticks: int, grip: Mapping[str, float], dampings_Ns_m: Sequence[float]
) -> dict[str, object]:
    """`trace` with arguments and result as plain values, for another process."""
    point = device_named(device).point
    assert point is not None
    return asdict(trace(NAMES[arm], Omni() if arm else point, point, rate_Hz, delay_ticks, Grip(**grip), dampings_Ns_m))


def _limit(rig: Rig, damping_Ns_m: float, grip: Grip) -> float:
    """The lowest unstable stiffness, by increasing the stiffness, then bisection."""
    low, high = 0.0, STIFFNESS_N_M[0]
    while try_wall(rig, high, damping_Ns_m, grip).stable:
        if high > STIFFNESS_N_M[1]:
            return math.inf
        low, high = high, STEP * high
    if low == 0.0:
        return 0.0
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if try_wall(rig, middle, damping_Ns_m, grip).stable else (low, middle)
    return math.sqrt(low * high)
