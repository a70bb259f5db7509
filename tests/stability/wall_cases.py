"""Walls with known limits, W1 to W8 of the reference table, each found by simulation with the real haptic tick."""

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import scipy

from hapscene.device.sim.point import PointMass
from hapscene.stability.rig import AT_M
from tests.stability.critical import critical_stiffness, limit_of_motion, motion_growth
from tests.stability.free_rig import FreeRig

CYCLES: Final = 40
"""Cycles after which motion with friction is classified [count]; near the limit it changes slowly."""

PHASES: Final = 16
"""Bounces averaged for a restitution [count], with contact at equally many phases of a tick."""


def found(case: dict[str, Any]) -> tuple[float, ...]:
    """The result of a case of wall_cases.json: a number, or for the apex of a region stiffness and damping."""
    if case["id"].startswith("W5-apex"):
        return apex(case["setup"]["delay"])
    return (_FOUND[case["id"][:2]](case["setup"]),)


def apex(delay_ticks: int) -> tuple[float, float]:
    """The stiffest wall that is stable with any damping on a device of m = T = 1 and b = 0: K and B. The maximum of
    a polynomial through limits near it; a direct search would lose half of the digits of B.
    """

    def limit(damping_Ns_m: float) -> float:
        return limit_of_motion(rig, damping_Ns_m)

    rig = FreeRig(PointMass(1.0), 1.0, delay_ticks)
    bounds = (0.1 / (1 + delay_ticks), 1.9 / (1 + 1.4 * delay_ticks))
    near = scipy.optimize.minimize_scalar(
        lambda B: -limit(B), bounds=bounds, method="bounded", options={"xatol": 0.02 * bounds[1]}
    ).x
    fit = np.polynomial.Chebyshev.interpolate(np.vectorize(limit), 8, (0.9 * near, 1.1 * near))
    tops = fit.deriv().roots()
    inside = tops[(abs(tops.imag) < 1e-9) & (abs(tops.real - near) < 0.1 * near)].real
    top = float(inside[np.argmax(fit(inside))])
    return float(fit(top)), top


def largest_beta(delay_ticks: int) -> float:
    """The largest B of a stable wall for m = T = 1 and b = 0, at nearly zero stiffness."""
    rig, stiffness = FreeRig(PointMass(1.0), 1.0, delay_ticks), 1e-5
    return float(scipy.optimize.brentq(lambda B: motion_growth(rig, stiffness, B), 0.05, 3.0, xtol=1e-6))


def passivity_limit(setup: dict[str, float]) -> float:
    """The stiffness at which a triangle wave at half the tick rate extracts no energy from the wall [N/m] (W3)."""
    tick_s, b, amplitude = setup["T"], setup["b"], 1e-4
    rig = FreeRig(PointMass(setup["m"]), tick_s)
    wave = 10.0 * amplitude + amplitude * (-1.0) ** np.arange(201)
    depth = np.concatenate(((-amplitude,), wave))  # from above the sheet, then in it
    path = np.stack([np.full(len(depth), AT_M[0]), np.full(len(depth), AT_M[1]), -depth], axis=1)

    def energy(stiffness_N_m: float) -> float:
        rig.tune(stiffness_N_m, setup.get("B", 0.0))
        rig.twin.renderer.reset(path[0])
        f_N = rig.twin.renderer.run(path).f_W_N[:-1, 2]
        way = np.diff(path[:, 2])
        return float(((f_N * way) - b * way**2 / tick_s)[101:].sum())  # 100 ticks: 50 whole cycles

    return float(scipy.optimize.brentq(energy, 0.0, 100.0 * b / tick_s, xtol=1e-9 * b / tick_s))


def peak_speed(setup: dict[str, float]) -> float:
    """The largest speed of motion in contact that friction damps, where it would grow without friction [m/s] (W7)."""
    rig = FreeRig(PointMass(setup["m"], setup["b"], setup["c"]), setup["T"], int(setup.get("delay", 0)))
    stiffness = setup["K"]
    rig.tune(stiffness, setup.get("B", 0.0))
    turn_1_s = math.sqrt(stiffness / setup["m"])
    cycle = math.ceil(2.0 * math.pi / (turn_1_s * setup["T"]))

    def grows(speed_m_s: float) -> bool:
        depth = 3.0 * speed_m_s / turn_1_s
        felt = rig.release(depth, speed_m_s, stiffness * depth, CYCLES * cycle)
        speed = np.abs(felt.v_W_m_s[:, 2])
        return bool(speed[-cycle:].max() > speed[:cycle].max() or not felt.recording.touching.all())

    low = high = setup["c"] / math.sqrt(stiffness * setup["m"])  # what friction takes in a quarter of a cycle
    while grows(low):
        low /= 2.0
    while not grows(high):
        high *= 2.0
    while high - low > 1e-4 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if grows(middle) else (middle, high)
    return 0.5 * (low + high)


def bounce(setup: dict[str, float]) -> float:
    """Speed of a free mass after contact with the wall over the speed before [1] (W8)."""
    rig = FreeRig(PointMass(setup["m"], setup["b"]), setup["T"], int(setup["delay"]))
    rig.tune(setup["K"], setup["B"])
    speed, contact = 0.1, math.pi * math.sqrt(setup["m"] / setup["K"]) / setup["T"]
    count = math.ceil(2.0 * contact) + rig.delay_ticks + 8
    after = []
    for phase in (np.arange(PHASES) + 0.5) / PHASES:
        felt = rig.throw((1.0 + phase) * speed * setup["T"], speed, count)
        touching = np.flatnonzero(felt.recording.touching)
        v = felt.v_W_m_s[:, 2]
        after.append(-v[touching[-1] + 1 + rig.delay_ticks] / v[touching[0]])
    return float(np.mean(after))


def critical(setup: dict[str, float]) -> float:
    T, B, delay = setup["T"], setup["B"], int(setup["delay"])
    return critical_stiffness(setup["m"], setup["b"], T, delay_ticks=delay, wall_damping_Ns_m=B)


_FOUND: Final[dict[str, Callable[[dict[str, float]], float]]] = {
    "W1": critical,
    "W2": critical,
    "W3": passivity_limit,
    "W5": critical,
    "W7": peak_speed,
    "W8": bounce,
}
