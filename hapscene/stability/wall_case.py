"""The cases of walls with known answers, each found by simulation through the real tick: W1 to W8.

The answers are those of a file, `wall_cases.json`; what the file has no numbers for comes from `closed_form`.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy

from hapscene.device.model import DEVICES
from hapscene.device.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.files import parse_json, read_bytes
from hapscene.stability.answer import Answer
from hapscene.stability.closed_form import comes_to_rest as rests
from hapscene.stability.closed_form import limit_of_rest
from hapscene.stability.critical import comes_to_rest, critical_stiffness, limit_of_motion, motion_growth
from hapscene.stability.rig import AT_M, Rig

FILE_BYTES_MAX: Final = 1_000_000
"""Largest file of cases that is read [bytes]."""

NUMBER_MAX: Final = 1e9
"""Largest number of a case, of whatever unit [1]."""

LARGEST_BETA: Final = (2.0, 0.8284, 0.5359, 0.3978)
"""Largest BT/m at which any wall rests, at a delay of 0 to 3 ticks, for b = 0 [1]: reference table, W5."""

CYCLES: Final = 40
"""Cycles after which motion with friction is called growing or dying [count]: near the limit it changes slowly."""

PHASES: Final = 16
"""Bounces that a restitution is the mean of [count], the tool meeting the wall at as many instants of a tick."""


def wall_cases(path: str | Path, say: Callable[[str], None] = lambda _: None) -> list[Answer]:
    """Run the cases of a file, and after them those that it has no numbers for.

    Raises:
        HapsceneError: a file that holds no such cases.
        OSError: the file cannot be read.
    """
    rows: list[Answer] = []
    for case in read_cases(path):
        rows += run_case(case)
        say(f"{rows[-1].id}: {rows[-1].found:.6g}, expected {rows[-1].expected:.6g}\n")
    for row in own_cases():
        rows.append(row)
        say(f"{row.id}: {row.found:.6g}, expected {row.expected:.6g}\n")
    return rows


def read_cases(path: str | Path) -> list[dict[str, Any]]:
    """The cases of a file, checked for what `run_case` needs.

    Raises:
        HapsceneError: a file that holds no such cases.
        OSError: the file cannot be read.
    """
    path = Path(path)
    cases = parse_json(read_bytes(path, FILE_BYTES_MAX, "list of wall cases"), f"a list of wall cases ({path})")
    if not isinstance(cases, list):
        raise HapsceneError(f"{path}: expected a list of cases")
    for n, case in enumerate(cases):
        if not isinstance(case, dict) or {"id", "what", "setup", "expected", "rel_tol"} - set(case):
            raise HapsceneError(f"{path}: case {n} must have id, what, setup, expected and rel_tol")
        _check_case(f"{path}: case {n}", case)
        if case["id"][:2] not in _FOUND and not case["id"].startswith("W5-apex"):
            raise HapsceneError(f"{path}: case {case['id']!r}: its id must begin with one of {', '.join(_FOUND)}")
    return cases


def _check_case(where: str, case: dict[str, Any]) -> None:
    """Texts are texts, numbers are numbers, and what is divided by is above 0."""
    numbers, apex_case = case["setup"], str(case["id"]).startswith("W5-apex")
    if not isinstance(case["id"], str) or not isinstance(case["what"], str) or not isinstance(numbers, dict):
        raise HapsceneError(f"{where}: id and what must be texts, setup an object")
    expected = case["expected"] if apex_case else {"": case["expected"]}
    if not isinstance(expected, dict) or (apex_case and {"alpha", "beta"} - set(expected)):
        raise HapsceneError(f"{where}: what is expected of an apex must be alpha and beta")
    for name, value in {**numbers, "rel_tol": case["rel_tol"], **expected}.items():
        if type(value) not in (int, float) or not 0.0 <= value <= NUMBER_MAX:
            raise HapsceneError(f"{where}: {name or 'expected'} must be a number from 0 to {NUMBER_MAX:g}")
    kind = case["id"][:2]
    needed = ("delay",) if apex_case else _NEEDED.get(kind, ())
    for name in needed:
        if name not in numbers or (name in _POSITIVE.get(kind, ()) and numbers[name] == 0):
            raise HapsceneError(f"{where}: its setup must have {', '.join(needed)}, and no 0 where it is divided by")


def run_case(case: dict[str, Any]) -> list[Answer]:
    """Find the answer of one case of the file: two, stiffness and damping, for the apex of a region."""
    setup, expected, tolerance = case["setup"], case["expected"], case["rel_tol"]
    if case["id"].startswith("W5-apex"):
        alpha, beta = apex(setup["delay"])
        return [
            Answer(case["id"], "largest K T²/m [1]", expected["alpha"], alpha, tolerance),
            Answer(case["id"] + " at", "its B T/m [1]", expected["beta"], beta, tolerance),
        ]
    found = _FOUND[case["id"][:2]](setup)
    return [Answer(case["id"], case["what"], expected, found, min(tolerance, _TIGHTER.get(case["id"][:2], math.inf)))]


def own_cases() -> Iterator[Answer]:
    """The cases of the reference table that the file has no numbers for."""
    tick_s = 1e-3
    for name, named in DEVICES.items():
        if named.point is None:
            continue
        device = named.point
        c, quantum = device.c_N, device.quantum_m
        found = critical_stiffness(device.mass_kg, device.b_Ns_m, tick_s, coulomb_N=c, quantum_m=quantum)
        expected = limit_of_rest(c, quantum)
        yield Answer(f"W4-{name}", "K at which a tool rests over an encoder's edge [N/m]", expected, found, 1e-2)
        rig = Rig(device, tick_s)
        for share in (0.99, 1.01):
            stiffness = share * expected
            came, should = comes_to_rest(rig, stiffness, 0.0), rests(c, stiffness, quantum)
            yield Answer(f"W6-{name}-{share}", "comes to rest at half a step (1 yes, 0 no)", should, came, 0.0)
    for delay, expected in enumerate(LARGEST_BETA):
        yield Answer(f"W5-most-d{delay}", "largest B T/m of any wall [1]", expected, largest_beta(delay), 2e-4)


def apex(delay_ticks: int) -> tuple[float, float]:
    """The stiffest wall that any damping lets rest on a device of m = T = 1 and b = 0: K and its B.

    The top is found by a search, then as that of the polynomial through the limits beside it, which is smooth: from
    values alone its place would have half their digits.
    """

    def limit(damping_Ns_m: float) -> float:
        return limit_of_motion(rig, damping_Ns_m)

    rig = Rig(PointMass(1.0), 1.0, delay_ticks)
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
    """The largest B at which some wall rests, for m = T = 1 and b = 0: that of a wall of almost no stiffness."""
    rig, stiffness = Rig(PointMass(1.0), 1.0, delay_ticks), 1e-5
    return float(scipy.optimize.brentq(lambda B: motion_growth(rig, stiffness, B), 0.05, 3.0, xtol=1e-6))


def passivity_limit(setup: dict[str, float]) -> float:
    """The stiffness at which a triangle wave at half the tick rate gets no energy out of the wall [N/m] (W3).

    The real tick runs along the wave; its forces, held over a tick, do work on the tool, and the device's own damping
    takes what it takes at the wave's speed.
    """
    tick_s, b, amplitude = setup["T"], setup["b"], 1e-4
    rig = Rig(PointMass(setup["m"]), tick_s)
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
    """The speed up to which motion in contact dies by friction, where it would grow without [m/s] (W7)."""
    rig = Rig(PointMass(setup["m"], setup["b"], setup["c"]), setup["T"], int(setup.get("delay", 0)))
    stiffness = setup["K"]
    rig.tune(stiffness, setup.get("B", 0.0))
    turn_1_s = math.sqrt(stiffness / setup["m"])
    cycle = math.ceil(2.0 * math.pi / (turn_1_s * setup["T"]))

    def grows(speed_m_s: float) -> bool:
        depth = 3.0 * speed_m_s / turn_1_s
        felt = rig.let_go(depth, speed_m_s, stiffness * depth, CYCLES * cycle)
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
    """The speed at which a free mass leaves the wall, over that at which it met it [1] (W8)."""
    rig = Rig(PointMass(setup["m"], setup["b"]), setup["T"], int(setup["delay"]))
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


def _critical(setup: dict[str, float]) -> float:
    T, B, delay = setup["T"], setup["B"], int(setup["delay"])
    return critical_stiffness(setup["m"], setup["b"], T, delay_ticks=delay, wall_damping_Ns_m=B)


_FOUND: Final[dict[str, Callable[[dict[str, float]], float]]] = {
    "W1": _critical,
    "W2": _critical,
    "W3": passivity_limit,
    "W5": _critical,
    "W7": peak_speed,
    "W8": bounce,
}

_MOTION: Final = ("m", "b", "T", "delay", "B")

_NEEDED: Final = {
    "W1": _MOTION,
    "W2": _MOTION,
    "W3": ("m", "b", "T"),
    "W5": _MOTION,
    "W7": ("m", "b", "c", "T", "K"),
    "W8": ("m", "b", "T", "K", "B", "delay"),
}
"""Numbers that a case of each kind must give."""

_POSITIVE: Final = {"W3": ("m", "b", "T"), "W7": ("m", "c", "T", "K"), "W8": ("m", "T", "K")}
"""Those of them that may not be 0; `critical_stiffness` looks after its own."""

_TIGHTER: Final = {"W3": 1e-6}
"""Tolerances of the reference table where they are below those of its file."""
