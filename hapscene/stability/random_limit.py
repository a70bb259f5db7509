"""Limits of random devices at random walls, simulated against predicted."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from hapscene.stability.closed_form import limit_of_rest, limit_of_small_motion
from hapscene.stability.closed_form import peak_speed as predicted_speed
from hapscene.stability.critical import critical_stiffness
from hapscene.stability.wall_case import peak_speed

KINDS: Final = ("device's damping", "… and delay", "… and wall damping", "friction, encoder steps", "friction, at K")
"""What holds the tool: the first three are limits of small motion, the fourth of rest over an encoder's edge, the last
the peak speed at a given stiffness."""


@dataclass(frozen=True)
class RandomLimit:
    """One random case: its numbers, and its limit as predicted and as simulated, of stiffness [N/m] or speed [m/s]."""

    kind: str
    mass_kg: float
    damping_Ns_m: float
    coulomb_N: float
    quantum_m: float
    tick_s: float
    delay_ticks: int
    stiffness_N_m: float  # given, where the limit is one of speed; else 0
    wall_damping_Ns_m: float
    predicted: float
    found: float

    @property
    def error(self) -> float:
        """Relative."""
        return abs(self.found / self.predicted - 1.0)


def random_limits(count: int, seed: int = 4, say: Callable[[str], None] = lambda _: None) -> list[RandomLimit]:
    """`count` cases, the kinds in turn.

    Masses are of 20 to 500 g, ticks of 0.1 to 2 ms, dampings such that bT/m is 1e-4 to 0.3, delays up to 4 ticks, wall
    dampings up to nine tenths of the largest at which any wall rests, friction of 20 to 500 mN, encoder steps of 5 to
    100 µm; stiffnesses are such that ωT is 0.05 to 0.25, where the prediction of the speed holds.
    """
    rng = np.random.default_rng(seed)
    cases = []
    for n in range(count):
        cases.append(_case(KINDS[n % len(KINDS)], rng))
        if (n + 1) % 20 == 0:
            say(f"random limits: {n + 1} of {count}\n")
    return cases


def _case(kind: str, rng: np.random.Generator) -> RandomLimit:
    def drawn(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    mass, tick = drawn(0.02, 0.5), drawn(1e-4, 2e-3)
    damping = drawn(1e-4, 0.3) * mass / tick
    delay = 0 if kind == KINDS[0] else int(rng.integers(0, 5))
    coulomb, quantum = drawn(0.02, 0.5), drawn(5e-6, 1e-4)
    most = mass / tick * (2.0 if delay == 0 else 0.75 / delay)  # somewhat below the largest of each delay
    wall = drawn(0.02, 0.9) * most if kind == KINDS[2] else 0.0
    stiffness = 0.0
    if kind in KINDS[:3]:
        coulomb = quantum = 0.0
        predicted = limit_of_small_motion(mass, damping, tick, delay, wall)
        found = critical_stiffness(mass, damping, tick, delay_ticks=delay, wall_damping_Ns_m=wall)
    elif kind == KINDS[3]:
        predicted = limit_of_rest(coulomb, quantum)
        found = critical_stiffness(mass, damping, tick, delay_ticks=delay, coulomb_N=coulomb, quantum_m=quantum)
    else:
        delay, quantum = 0, 0.0
        stiffness = mass * (drawn(0.05, 0.25) / tick) ** 2
        damping = drawn(1e-3, 0.9) * 0.5 * stiffness * tick  # less than what the wall feeds
        predicted = predicted_speed(coulomb, stiffness, tick, damping)
        setup = {"m": mass, "b": damping, "c": coulomb, "T": tick, "K": stiffness}
        found = peak_speed(setup)
    return RandomLimit(kind, mass, damping, coulomb, quantum, tick, delay, stiffness, wall, predicted, found)
