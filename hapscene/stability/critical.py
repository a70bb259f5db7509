"""The stiffest wall that a device can touch and come to rest, found by touching it: `critical_stiffness`.

Nothing here knows a formula for the answer. A tool in contact is moved a little and let go, in the closed loop with the
real tick; the wall is made stiffer until that motion no longer dies.
"""

import math
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.loop.closed_loop import DELAY_MAX
from hapscene.stability.rig import Rig

__all__ = ["DEPTH_M", "comes_to_rest", "critical_stiffness", "growth", "limit_of_motion", "motion_growth"]

# How fast the slowest-dying mode of a small motion grows, read from the motion itself.
#
# A linear loop moves as a sum of modes, y_k = Σ c_i z_i^k. The shifts of such a signal span a space that one step
# forward maps onto itself; the map's eigenvalues are the z_i (Kung 1978; Roy & Kailath 1989, ESPRIT). Taken from motion
# that is exact to rounding, they are exact to about ten digits.


NOISE: Final = 1e-9
"""Parts of the signal weaker than this, over its strongest, are rounding [1]."""


def growth(y: NDArray[np.float64], order: int) -> float:
    """Natural logarithm of the largest |z_i|, per sample.

    Args:
        y: (n,) the motion about its rest, n > 2 order.
        order: most modes that there are.
    """
    space, count = _modes(y)
    space = space[:, : min(order, count)]
    step, *_ = np.linalg.lstsq(space[:-1], space[1:], rcond=None)
    return float(np.log(np.abs(np.linalg.eigvals(step)).max()))


def _modes(y: NDArray[np.float64], rounding: float = 0.0) -> tuple[NDArray[np.float64], int]:
    """The space that the shifts of a signal span, the strongest first, and of how many modes it is; `rounding` is what
    a sample is off by."""
    rows = len(y) // 2
    shifts = np.lib.stride_tricks.sliding_window_view(y, rows).T
    left, weight, _ = np.linalg.svd(shifts, full_matrices=False)
    return left, int(np.count_nonzero(weight > max(NOISE * weight[0], rounding * rows)))


DEPTH_M: Final = 1e-3
"""How deep the tool rests while small motion is looked at [m]: deep enough never to leave the sheet."""

SMALL: Final = 1e-3
"""The motion at first, over the depth [1]: a thousandth leaves it room to grow, and 13 digits above rounding."""

LARGE: Final = 0.3
"""Motion that is no longer small, over the depth [1]: what comes after is not looked at."""

SAMPLES: Final = 12
"""Samples of the motion that its modes are read from, for each mode [count]: half of them are as exact as rounding
allows, twice as many take twice the time."""

TURN: Final = 0.5
"""How far the motion turns between two samples [rad]: slow motion is not sampled every tick, or rounding hides whether
it grows. Near the largest damping of the wall there is a fast mode beside the slow ones, which turns by π in d + 1
ticks: samples are an odd number of such times apart, at which it alternates; at an even one it would look slow too."""

MODES: Final = 16
"""Most modes that are told apart where not all need be [count]: at a delay of 200 ticks there are 203."""

WAIT: Final = 40
"""How long the other modes are left to die where there are more [d + 1 ticks]: the 17th does by e in at most two such
times, but for overdamped devices at wall dampings near the largest."""

LONGER: Final = 6
"""How many times as long where they have not [1], as long as that is less than `TICKS_MAX`."""

FAINT: Final = 1e-6
"""What small motion has died to by then, over what it was, where it is not looked at any more [1]."""

ROUNDING: Final = 1e-13
"""Motion that is rounding, over the depth [1]."""

HALVINGS: Final = 16
"""How often the wall is made half as stiff in search of one at which the tool rests [count], before it is said that
there is none."""

TICKS_MAX: Final = 400_000
"""Most ticks that a motion is watched [count]: two seconds of computing. Fewer, and the growth of a mode that takes
more ticks to turn is known less well."""

DOUBLINGS: Final = 60
"""How often it is made twice as stiff in search of one that buzzes [count]."""

TOLERANCE: Final = 1e-9
"""To which the limit is found where motion is linear [1]."""

REST_TICKS: Final = 4000
"""How long the tool has to come to rest over an encoder's edge [ticks]."""

REST_TOLERANCE: Final = 1e-5
"""To which the limit is found where it is a question of rest [1]."""

RATIO_MIN: Final = 1e-6
RATIO_MAX: Final = 1e3
"""Damping times the tick over the mass that a limit of motion is looked for at [1]. Motion in a wall at its limit turns
by the root of that in a tick: below, it takes more than 10,000 ticks to be seen dying; above, a tick is far longer than
the time in which the device comes to rest."""

EDGE: Final = 64.5
"""How deep the encoder's edge lies at which the tool is tried [encoder steps]: a whole number and a half."""


def critical_stiffness(
    mass_kg: float,
    damping_Ns_m: float,
    tick_s: float,
    *,
    delay_ticks: int = 0,
    wall_damping_Ns_m: float = 0.0,
    coulomb_N: float = 0.0,
    quantum_m: float = 0.0,
) -> float:
    """The stiffness up to which a tool in contact with a wall comes to rest [N/m], by simulation through the real tick.

    Args:
        mass_kg: m of the device, at its tip, > 0.
        damping_Ns_m: b, its own viscous damping.
        tick_s: T, the period of the force channel; the force is held over it.
        delay_ticks: d, how many ticks later a force goes out.
        wall_damping_Ns_m: B, damping of the wall: backward difference of the depth.
        coulomb_N: c, the device's own Coulomb friction.
        quantum_m: Δ, step of its encoders.

    Returns:
        Without friction and encoder steps, the upper end of the stiffnesses at which small motion dies: 0.0 where it
        dies at none, as with b = B = 0.
        With both, the stiffness up to which a tool that is pushed at half a step (the worst case), and crosses the
        edge with a motion that friction would stop within a quarter of a step, comes to rest there. Viscous damping has
        little part in it: friction holds a tool at rest above 2b/T too, where larger motion would grow
        (`hapscene.stability.wall_case.peak_speed`), so this is not the limit of passivity of Abbott & Okamura 2005,
        which is the lower of 2b/T and 2c/Δ.
        With friction alone math.inf: friction stops every motion that is small enough, whatever the wall.
        With encoder steps alone 0.0: nothing holds the tool between two of them.

    Raises:
        HapsceneError: a number out of range, or dampers out of `RATIO_MIN` to `RATIO_MAX`.
    """
    dampers = {"damping_Ns_m": damping_Ns_m, "wall_damping_Ns_m": wall_damping_Ns_m}
    _check({"mass_kg": mass_kg, "tick_s": tick_s}, {**dampers, "coulomb_N": coulomb_N, "quantum_m": quantum_m})
    if not 0 <= delay_ticks < DELAY_MAX or delay_ticks != int(delay_ticks):
        raise HapsceneError(
            f"critical stiffness: delay_ticks must be a whole number from 0 to {DELAY_MAX - 1}, is {delay_ticks}"
        )
    ratio = max(dampers.values()) * (tick_s / mass_kg)
    if max(dampers.values()) > 0.0 and not RATIO_MIN <= ratio <= RATIO_MAX:
        raise HapsceneError(
            f"critical stiffness: damping · tick_s / mass_kg must lie between {RATIO_MIN:g} and {RATIO_MAX:g}, "
            f"is {ratio:.3g}; is a unit wrong?"
        )
    rig = Rig(PointMass(mass_kg, damping_Ns_m, coulomb_N, quantum_m), tick_s, delay_ticks)
    if quantum_m == 0.0:
        if coulomb_N > 0.0:
            return math.inf
        return limit_of_motion(rig, wall_damping_Ns_m)
    if coulomb_N == 0.0:
        return 0.0
    return _limit_of_rest(rig, wall_damping_Ns_m)


def motion_growth(rig: Rig, stiffness_N_m: float, wall_damping_Ns_m: float) -> float:
    """Natural logarithm, per tick, of how much the slowest-dying mode of small motion grows: below 0 where it dies.

    The rig's device has neither friction nor encoder steps. Of what has died to `FAINT` before its modes are told
    apart, or grows to `LARGE`, it is rough.
    """
    rig.tune(stiffness_N_m, wall_damping_Ns_m)
    late = rig.delay_ticks + 1
    modes = late + 2  # position, speed, the last depth, the forces on their way
    few = min(modes, MODES)
    wait, small = 0, SMALL
    if few < modes:
        wait, small = WAIT * late, min(SMALL, 0.1 * stiffness_N_m * rig.tick_s / max(wall_damping_Ns_m, 1e-300))
    first, turn = SAMPLES * few, rig.tick_s * math.sqrt(stiffness_N_m / rig.point.mass_kg)
    while True:
        count = wait + min(first * max(1, int(TURN / turn), late // MODES), TICKS_MAX)
        y, within = _small_motion(rig, stiffness_N_m * DEPTH_M, first, count, small)
        if within < wait + 2 * few + 2:
            return math.log(LARGE / small) / within
        y = y[wait:within]
        if wait > 0:
            y = y[: np.flatnonzero(np.abs(y) >= FAINT * np.abs(y).max())[-1] + 1]
            if np.abs(y).max() < FAINT * small * DEPTH_M or len(y) < first:
                return math.log(FAINT) / within
        stride = max(1, len(y) // first)
        if stride > late:
            stride = late * ((stride // late - 1) | 1)
        if wait == 0:
            return growth(y[::stride], few) / stride
        seen = _modes(y[::stride], ROUNDING * DEPTH_M)[1]
        if seen <= MODES or wait * LONGER > TICKS_MAX:
            return growth(y[::stride], min(seen, MODES)) / stride
        wait *= LONGER


def _small_motion(
    rig: Rig, push_N: float, first: int, count: int, small: float = SMALL
) -> tuple[NDArray[np.float64], int]:
    """Depths about the rest (n,) [m], and up to where they are small: `count` ticks, or fewer where they grow large."""
    y, within = np.zeros(0), 0
    felt = rig.let_go((1.0 + small) * DEPTH_M, 0.0, push_N, first)
    while True:
        y = np.concatenate((y, -felt.p_W_m[:, 2] - DEPTH_M))
        linear = (np.abs(y[within:]) < LARGE * DEPTH_M) & (felt.recording.f_W_N[:, 2] > 0.0)
        within += len(linear) if linear.all() else int(linear.argmin())
        if within < len(y) or within >= count:
            return y, within
        felt = rig.push_on(push_N, min(8 * len(y), count - len(y)))


def comes_to_rest(rig: Rig, stiffness_N_m: float, wall_damping_Ns_m: float) -> bool:
    """Whether a tool that is pushed at half an encoder step comes to rest after a small motion over the edge."""
    rig.tune(stiffness_N_m, wall_damping_Ns_m)
    device, wait_s = rig.point, rig.tick_s * (1 + rig.delay_ticks)
    edge = EDGE * device.quantum_m
    # friction stops it within a quarter of a step, and the wall answers before it has gone an eighth
    speed = min(math.sqrt(device.c_N * device.quantum_m / (2.0 * device.mass_kg)), device.quantum_m / (8.0 * wait_s))
    felt = rig.let_go(edge - device.quantum_m / 16.0, speed, stiffness_N_m * edge, REST_TICKS)
    last = rig.delay_ticks + 2
    return bool((felt.v_W_m_s[-last:, 2] == 0.0).all() and felt.recording.touching[-1])


def limit_of_motion(rig: Rig, wall_damping_Ns_m: float) -> float:
    """The largest stiffness at which small motion dies [N/m], 0.0 where there is none: where a mode's growth passes 0.

    The rig's device has neither friction nor encoder steps.
    """
    mass, T = rig.point.mass_kg, rig.tick_s
    damping = rig.point.b_Ns_m + wall_damping_Ns_m

    def grows(stiffness_N_m: float) -> float:
        return motion_growth(rig, stiffness_N_m, wall_damping_Ns_m)

    # only where to begin: far below where the delay of hold and loop feeds as much as the dampers take
    start = damping / (T * (4.0 + 8.0 * rig.delay_ticks)) if damping > 0.0 else 1e-3 * mass / T**2
    low = start
    for _ in range(HALVINGS):
        if grows(low) < 0.0:
            break
        low /= 2.0
    else:
        return 0.0
    high = 2.0 * low
    for _ in range(DOUBLINGS):
        if grows(high) >= 0.0:
            return float(scipy.optimize.brentq(grows, low, high, xtol=TOLERANCE * low, rtol=TOLERANCE))
        low, high = high, 2.0 * high
    return math.inf


def _limit_of_rest(rig: Rig, wall_damping_Ns_m: float) -> float:
    """Halve the stiffnesses between rest and no rest."""
    low = high = rig.point.c_N / rig.point.quantum_m
    for _ in range(HALVINGS):
        if comes_to_rest(rig, low, wall_damping_Ns_m):
            break
        low /= 2.0
    else:
        return 0.0
    for _ in range(DOUBLINGS):
        if not comes_to_rest(rig, high, wall_damping_Ns_m):
            break
        low, high = high, 2.0 * high
    while high - low > REST_TOLERANCE * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if comes_to_rest(rig, middle, wall_damping_Ns_m) else (low, middle)
    return 0.5 * (low + high)


def _check(above_0: dict[str, float], at_least_0: dict[str, float]) -> None:
    for name, value in above_0.items():
        if not 0.0 < value < math.inf:
            raise HapsceneError(f"critical stiffness: {name} must be finite and above 0, is {value}")
    for name, value in at_least_0.items():
        if not 0.0 <= value < math.inf:
            raise HapsceneError(f"critical stiffness: {name} must be finite and at least 0, is {value}")
