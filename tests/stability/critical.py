"""The largest stiffness of a wall at which a device comes to rest, found by simulation: `critical_stiffness`.

No formula for the result is used. A tool in contact is displaced slightly and released, in the closed loop with the
real haptic tick; the stiffness is increased until the motion no longer decays.
"""

import math
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.device.sim.point import PointMass
from tests.stability.free_rig import FreeRig

# Growth of the slowest-decaying mode of small motion.
#
# The motion of a linear loop is a sum of modes, y_k = Σ c_i z_i^k. The shifts of such a signal span a space that one
# step forward maps onto itself; the eigenvalues of the map are the z_i (Kung 1978; Roy & Kailath 1989, ESPRIT). With
# motion that is exact up to rounding, they are accurate to about ten digits.


NOISE: Final = 1e-9
"""Singular values below this fraction of the largest are rounding [1]."""


def growth(y: NDArray[np.float64], order: int) -> float:
    """Natural logarithm of the largest |z_i|, per sample.

    Args:
        y: (n,) motion about the equilibrium, n > 2 order.
        order: largest number of modes.
    """
    shifts = np.lib.stride_tricks.sliding_window_view(y, len(y) // 2).T
    left, weight, _ = np.linalg.svd(shifts, full_matrices=False)
    space = left[:, : min(order, np.count_nonzero(weight > NOISE * weight[0]))]
    step, *_ = np.linalg.lstsq(space[:-1], space[1:], rcond=None)
    return float(np.log(np.abs(np.linalg.eigvals(step)).max()))


DEPTH_M: Final = 1e-3
"""Depth of the equilibrium [m], large enough that small motion never leaves the sheet."""

SMALL: Final = 1e-3
"""Initial motion relative to the depth [1]: a factor of 1000 is left to grow, and 13 digits above rounding."""

LARGE: Final = 0.3
"""Motion that no longer counts as small, relative to the depth [1]. Later samples are not used."""

SAMPLES: Final = 12
"""Samples from which the modes are computed, per mode [count]. Half as many are as accurate as rounding allows;
twice as many take twice the time."""

TURN: Final = 0.5
"""Phase of the motion between two samples [rad]. Slow motion is not sampled at every tick, since rounding would
hide its growth. Near the largest wall damping there is also a fast mode that turns by π in d + 1 ticks. Samples
are an odd multiple of that apart, at which it alternates; at an even multiple it would look slow."""

HALVINGS: Final = 16
"""Most halvings of the stiffness in search of a stable wall [count]."""

TICKS_MAX: Final = 400_000
"""Most ticks for which a motion is observed [count]: two seconds of computing. With fewer, the growth of slow modes
is less accurate."""

DOUBLINGS: Final = 60
"""Most doublings of the stiffness in search of an unstable wall [count]."""

TOLERANCE: Final = 1e-9
"""Relative tolerance of the limit for linear motion [1]."""

REST_TICKS: Final = 4000
"""Time for the tool to come to rest at the edge of an encoder step [ticks]."""

REST_TOLERANCE: Final = 1e-5
"""Relative tolerance of the limit of rest [1]."""

EDGE: Final = 64.5
"""Depth of the edge between two encoder steps at which rest is tested [encoder steps]: an integer and a half."""


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
    """Largest stiffness at which a tool in contact with a wall comes to rest [N/m], by simulation with the real haptic
    tick.

    Args:
        mass_kg: mass m of the device at its tip, above 0.
        damping_Ns_m: viscous damping b of the device.
        tick_s: period T of the haptic tick; the force is held over it.
        delay_ticks: delay d of the force.
        wall_damping_Ns_m: damping B of the wall, by the backward difference of the depth.
        coulomb_N: Coulomb friction c of the device.
        quantum_m: encoder step Δ.

    Returns:
        Without friction and encoder steps: the upper end of the stiffnesses at which small motion decays; 0.0 if it
            decays at none, as for b = B = 0.
        With both: the largest stiffness at which a tool that is pushed to the middle of an encoder step, the worst
            case, comes to rest there after a motion that friction would stop within a quarter of a step. Viscous
            damping has little influence: friction holds a tool at rest above 2b/T too, where larger motion would grow.
            This is therefore not the limit of passivity of Abbott & Okamura 2005, the lower of 2b/T and 2c/Δ.
        With friction alone: math.inf, since friction stops every sufficiently small motion.
        With encoder steps alone: 0.0, since nothing holds the tool between two steps.
    """
    rig = FreeRig(PointMass(mass_kg, damping_Ns_m, coulomb_N, quantum_m), tick_s, delay_ticks)
    if quantum_m == 0.0:
        if coulomb_N > 0.0:
            return math.inf
        return limit_of_motion(rig, wall_damping_Ns_m)
    if coulomb_N == 0.0:
        return 0.0
    return _limit_of_rest(rig, wall_damping_Ns_m)


def motion_growth(rig: FreeRig, stiffness_N_m: float, wall_damping_Ns_m: float) -> float:
    """Natural logarithm of the growth of the slowest-decaying mode of small motion per tick; below 0 if it decays.

    The device must have neither friction nor encoder steps. The result is rough if the motion grows to `LARGE`.
    """
    rig.tune(stiffness_N_m, wall_damping_Ns_m)
    delay = rig.delay_ticks + 1
    modes = delay + 2  # position, speed, the last depth, the delayed forces
    first, turn = SAMPLES * modes, rig.tick_s * math.sqrt(stiffness_N_m / rig.device.mass_kg)
    y, within = _small_motion(rig, stiffness_N_m * DEPTH_M, first, min(first * max(1, int(TURN / turn)), TICKS_MAX))
    if within < 2 * modes + 2:
        return math.log(LARGE / SMALL) / within
    stride = max(1, within // first)
    if stride > delay:
        stride = delay * ((stride // delay - 1) | 1)
    return growth(y[:within:stride], modes) / stride


def _small_motion(rig: FreeRig, push_N: float, first: int, count: int) -> tuple[NDArray[np.float64], int]:
    """Depths relative to the equilibrium (n,) [m], and the number of them that are small: `count` ticks, or fewer
    if they grow."""
    y, within = np.zeros(0), 0
    felt = rig.release((1.0 + SMALL) * DEPTH_M, 0.0, push_N, first)
    while True:
        y = np.concatenate((y, -felt.p_W_m[:, 2] - DEPTH_M))
        linear = (np.abs(y[within:]) < LARGE * DEPTH_M) & (felt.recording.f_W_N[:, 2] > 0.0)
        within += len(linear) if linear.all() else int(linear.argmin())
        if within < len(y) or within >= count:
            return y, within
        felt = rig.push_on(push_N, min(8 * len(y), count - len(y)))


def comes_to_rest(rig: FreeRig, stiffness_N_m: float, wall_damping_Ns_m: float) -> bool:
    """Whether a tool that is pushed to the middle of an encoder step comes to rest there after a small motion."""
    rig.tune(stiffness_N_m, wall_damping_Ns_m)
    device, wait_s = rig.device, rig.tick_s * (1 + rig.delay_ticks)
    edge = EDGE * device.quantum_m
    # friction stops the tool within a quarter of a step, and the wall reacts before it has moved an eighth
    speed = min(math.sqrt(device.c_N * device.quantum_m / (2.0 * device.mass_kg)), device.quantum_m / (8.0 * wait_s))
    felt = rig.release(edge - device.quantum_m / 16.0, speed, stiffness_N_m * edge, REST_TICKS)
    last = rig.delay_ticks + 2
    return bool((felt.v_W_m_s[-last:, 2] == 0.0).all() and felt.recording.touching[-1])


def limit_of_motion(rig: FreeRig, wall_damping_Ns_m: float) -> float:
    """Largest stiffness at which small motion decays [N/m], or 0.0: the zero of the growth of a mode.

    The device must have neither friction nor encoder steps.
    """
    mass, T = rig.device.mass_kg, rig.tick_s
    damping = rig.device.b_Ns_m + wall_damping_Ns_m

    def grows(stiffness_N_m: float) -> float:
        return motion_growth(rig, stiffness_N_m, wall_damping_Ns_m)

    # start of the search: far below the stiffness at which the delays add as much energy as the dampers dissipate
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


def _limit_of_rest(rig: FreeRig, wall_damping_Ns_m: float) -> float:
    """Bisect the stiffness between rest and motion."""
    low = high = rig.device.c_N / rig.device.quantum_m
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
