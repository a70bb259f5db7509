"""The Z-width of a device: the stiffness and damping of the walls at which it is still, for rates and delays.

Real devices hold walls that are not passive, because friction stops small motion; how much depends on what the hand
does. So each wall is tried: a hand with a grip taps it at 0.5 m/s and goes on pressing, three times, each time a little
less hard, since whether friction holds a tool between two encoder steps is a matter of where it stops. **Stable** means
here that each time
- the tool comes to rest: over a tenth of a second its speed is under 5 mm/s rms;
- the motors do too: their force varies by less than 0.07 N rms, for a structure that gives can hide them from the tool;
- they put no more than 2 mJ into the tool in all.
Colgate & Brown 1994 named the region.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any, Final

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

__all__ = [
    "DAMPINGS_NS_M",
    "REST_M_S",
    "STIFFNESS_N_M",
    "WORK_J",
    "Point",
    "StableRegion",
    "place",
    "say_of",
    "trace",
    "trace_all",
    "try_wall",
]

REST_M_S: Final = 5e-3
"""Speed of a tool at rest, at most [m/s rms]: half the noise of an encoder of 55 µm at 200 Hz, below what a hand feels
as buzz."""

WORK_J: Final = 2e-3
"""What the motors may put into the tool in all [J]: a weak tap of 0.3 m/s by the Omni's 45 g."""

STILL_N: Final = 0.07
"""How much the motors' force may vary at rest [N rms]: 7 % of the newton that is pressed with, the least difference
that is felt (Pang, Tan & Durlach 1991)."""

ABOVE_M: Final = 5e-3
"""Where the hand begins, above the sheet [m]."""

BELOW_M: Final = (20e-3, 17.3e-3, 14.1e-3)
"""Where it means the tool to be in the end, each time, below the sheet [m]: 1.2 to 0.85 N with a light grip, no two a
whole number of encoder steps apart. It moves there at the speed that the limits of devices are made for."""

PRESS_S: Final = 0.35
"""How long it stays there [s]. Where the tool is not at rest yet, but calmer each time, it stays as long again."""

MORE: Final = 10
"""How often it does [count]: devices with little friction take seconds to rest in a light hand."""

CALMER: Final = 0.8
"""Ratio of its speed to that of last time up to which the tool is getting calmer [1]."""

LATE_S: Final = 0.1
"""The end of it, over which the tool has to be at rest [s]."""

STIFFNESS_N_M: Final = (50.0, 50_000.0)
"""Softest and stiffest wall that is tried [N/m]."""

STEP: Final = 2.0
"""Ratio of the stiffnesses at which the first that buzzes is looked for [1]."""

HALVINGS: Final = 5
"""How often the way from the last stable stiffness to the first that buzzes is halved: to 2 % [count]."""

DAMPINGS_NS_M: Final = (0.0, *(float(f"{B:.3g}") for B in np.geomspace(0.5, 128.0, 9)))
"""Wall dampings at which the region is traced [N·s/m]."""


@dataclass(frozen=True)
class Trial:
    """What a hand felt at one wall."""

    late_m_s: float
    late_N: float
    work_J: float

    @property
    def stable(self) -> bool:
        return self.late_m_s < REST_M_S and self.late_N < STILL_N and self.work_J <= WORK_J


@dataclass(frozen=True)
class StableRegion:
    """The stable region of one device at one rate and delay: below `limit_N_m` over `damping_Ns_m`.

    Attributes:
        device: its name.
        rate_Hz: of the force channel.
        delay_ticks: of the loop.
        damping_Ns_m: (n,) of the wall.
        limit_N_m: (n,) the lowest stiffness that buzzes: 0 where the softest does, inf where none does.
        closed_N_m: (n,) the limit of small motion without friction and encoder steps, the hand's damping counted.
    """

    device: str
    rate_Hz: float
    delay_ticks: int
    damping_Ns_m: tuple[float, ...]
    limit_N_m: tuple[float, ...]
    closed_N_m: tuple[float, ...]


@dataclass(frozen=True)
class Point:
    """A swatch in the region: as it is, and as the device's limits make it.

    Attributes:
        swatch: its name.
        stiffness_N_m, damping_Ns_m: its own.
        capped_N_m, capped_Ns_m: at most the device's limits.
        stable: whether the tool rests at it as it is.
        capped_stable: whether it does with all that the tick has for the device: limits, damping, passivity controller.
    """

    swatch: str
    stiffness_N_m: float
    damping_Ns_m: float
    capped_N_m: float
    capped_Ns_m: float
    stable: bool
    capped_stable: bool


def try_wall(rig: Rig, stiffness_N_m: float, damping_Ns_m: float, grip: Grip) -> Trial:
    """Tap a wall and press on it."""
    rig.tune(stiffness_N_m, damping_Ns_m)
    return touch(rig, grip)


def touch(rig: Rig, grip: Grip) -> Trial:
    """Tap the rig's wall as it is, and press on it: the first time that it is not stable, or the last."""
    press = round(PRESS_S / rig.tick_s)
    for below in BELOW_M:
        lower = round((ABOVE_M + below) / TOUCH_SPEED_M_S / rig.tick_s)
        depth = np.concatenate((np.linspace(-ABOVE_M, below, lower), np.full(press, below)))
        trial = _judged(rig.follow(depth, grip), rig.tick_s, 0.0)
        for _ in range(MORE):
            if trial.stable or trial.work_J > WORK_J:
                break
            before, trial = trial, _judged(rig.stay(below, press, grip), rig.tick_s, trial.work_J)
            if trial.late_m_s > CALMER * before.late_m_s:
                break
        if not trial.stable:
            break
    return trial


def _judged(felt: ClosedLoopResult, tick_s: float, work_J: float) -> Trial:
    """The end of what was felt, and the work of all of it, beside that of before."""
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
    """The stable region of a device; the closed form is that of `point`, the device as a point mass."""
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
    """Try each swatch, as it is and within the limits that the tick has for the named device."""
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


def say_of(point: Point, rate_Hz: float, delay_ticks: int) -> str:
    """A swatch's verdict in words: "wood: 5000 N/m buzzes at 1 kHz; the device's cap makes it 700 N/m, which rests"."""
    where = f"at {rate_Hz / 1e3:g} kHz" + (f", {delay_ticks} tick late" if delay_ticks else "")
    damped = f", {point.damping_Ns_m:g} N·s/m" if point.damping_Ns_m else ""
    said = f"{point.swatch}: {point.stiffness_N_m:g} N/m{damped} {'rests' if point.stable else 'buzzes'} {where}"
    if (point.capped_N_m, point.capped_Ns_m) == (point.stiffness_N_m, point.damping_Ns_m):
        if point.stable or point.capped_stable:
            return said + ("" if point.stable else "; with the damping that the tick gives it for the device it rests")
        return said + "; the device's limits let it"
    cap = f"{point.capped_N_m:g} N/m" + (f", {point.capped_Ns_m:.3g} N·s/m" if point.capped_Ns_m else "")
    return f"{said}; the device's cap makes it {cap}, which {'rests' if point.capped_stable else 'buzzes too'}"


def trace_all(
    device: str,
    rates_Hz: Sequence[float],
    delays: Sequence[int],
    grip: Grip,
    say: Callable[[str], None] = lambda _: None,
    dampings_Ns_m: Sequence[float] = DAMPINGS_NS_M,
    **workers: Any,
) -> list[StableRegion]:
    """A region for each delay, rate and model of the named device: as a point mass, and where there is one as an arm.

    Args:
        device, rates_Hz, delays, grip, dampings_Ns_m: as of `trace`.
        say: told how far it is.
        workers: journal, jobs, scheduler: of `hapscene.parallel.run_tasks`.
    """
    asked = {"device": device, "grip": asdict(grip), "dampings_Ns_m": list(dampings_Ns_m)}
    pieces = [
        Task(
            f"{NAMES[arm]} at {rate / 1e3:g} kHz, {delay} late",
            trace_piece,
            asked | {"arm": arm, "rate_Hz": rate, "delay_ticks": delay},
        )
        for delay in delays
        for rate in rates_Hz
        for arm in ((True, False) if device == "omni" else (False,))
    ]
    found = run_tasks(pieces, after=lambda done, of, key: say(f"Z-width {done} of {of}: {key}\n"), **workers)
    return [_region(*found[piece.key]) for piece in pieces]


def _region(device: str, rate_Hz: float, delay_ticks: int, *rows: Sequence[float]) -> StableRegion:
    damping, limit, closed = (tuple(row) for row in rows)
    return StableRegion(device, rate_Hz, delay_ticks, damping, limit, closed)


NAMES: Final = {True: "Omni", False: "as a point mass"}
"""How a region is called, by whether the device is an arm in it."""


def trace_piece(
    device: str, arm: bool, rate_Hz: float, delay_ticks: int, grip: Mapping[str, float], dampings_Ns_m: Sequence[float]
) -> tuple[Any, ...]:
    """`trace` in numbers and names, for a process that is elsewhere."""
    point = device_named(device).point
    assert point is not None
    return astuple(
        trace(NAMES[arm], Omni() if arm else point, point, rate_Hz, delay_ticks, Grip(**grip), dampings_Ns_m)
    )


def _limit(rig: Rig, damping_Ns_m: float, grip: Grip) -> float:
    """The lowest stiffness that buzzes: stiffer and stiffer walls, then halves of the last step."""
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
