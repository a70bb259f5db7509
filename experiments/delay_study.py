"""What delay does to the position–position controller, and to wave variables: rest, energy, and stiffness felt.

Each scheme lands on the plate and swings in the air, in light and firm hands, over a line that only delays and over a
bad one. Two questions are put to each run: does all come to rest where a hand is still, and did the motors give out
energy? A passive scheme can, at most, give out its allowances, of 1 mJ each.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hapscene.device.hand import Grip
from hapscene.device.point import PointMass
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.endpoint import SCHEMES, Coupling
from hapscene.teleoperation.link import Impairment
from hapscene.teleoperation.operation import Operated, Operation
from hapscene.teleoperation.test_plate import land, plate, swing
from hapscene.twin.hand_intent import Intent

DELAYS_S: Final = (0.0, 0.005, 0.010, 0.020, 0.050, 0.100)
"""Delays of the study, one way [s]."""

BAD: Final = {"jitter_s": 0.005, "loss": 0.05, "reorder": 0.05}
"""The bad line: what comes to each delay."""

GRIPS: Final = ("light", "firm")

CASES: Final[dict[str, Callable[[str], Intent]]] = {"land": land, "swing": swing}

REST_MAX_M_S: Final = 0.005
"""Speed of the faster tool, root mean square over the last second, above which it is not at rest [m/s]."""

ENERGY_MAX_J: Final = 2e-3
"""Energy given out above which a run is not passive [J]: the allowances of both ends."""

WALL_N_M: Final = 500.0
"""Stiffness of the plate where the stiffness felt is measured [N/m]."""


@dataclass(frozen=True)
class DelayOutcome:
    """One run of the study."""

    scheme: str
    delay_s: float
    bad: bool
    case: str
    grip: str
    rest_m_s: float
    energy_out_J: float

    @property
    def stable(self) -> bool:
        """Whether it came to rest without giving out energy."""
        return self.rest_m_s <= REST_MAX_M_S and self.energy_out_J <= ENERGY_MAX_J


def study_delays(
    seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
    delays_s: Iterable[float] = DELAYS_S,
    schemes: Iterable[str] = SCHEMES,
) -> list[DelayOutcome]:
    """All runs: schemes, delays, lines, cases and grips."""
    outcomes = []
    for delay_s in delays_s:
        say(f"delay {delay_s * 1e3:g} ms\n")
        for scheme in schemes:
            for bad in (False, True):
                for case in CASES:
                    for grip in GRIPS:
                        operated = operate_case(scheme, delay_s, bad, case, grip, seed)
                        found = (operated.rest_m_s, operated.energy_out_J)
                        outcomes.append(DelayOutcome(scheme, delay_s, bad, case, grip, *found))
    return outcomes


def operate_case(scheme: str, delay_s: float, bad: bool, case: str, grip: str, seed: int = 0) -> Operated:
    """One run of the study."""
    intent = CASES[case](grip)
    line = Impairment(delay_s, **BAD) if bad else Impairment(delay_s)
    start = intent.target_W_m[0]
    operation = Operation(plate("wood"), start, coupling=Coupling(scheme), line=line, compensator="none", seed=seed)
    return operation.run(intent)


def trace_delay(seed: int = 0, delay_s: float = 0.05) -> dict[str, Operated]:
    """Both schemes landing in a light hand, over a line that only delays."""
    return {scheme: operate_case(scheme, delay_s, False, "land", "light", seed) for scheme in SCHEMES}


def summarise_delays(outcomes: list[DelayOutcome]) -> dict[str, Any]:
    """The worst of each scheme at each delay."""
    rows: dict[str, Any] = {}
    for outcome in outcomes:
        line = "bad" if outcome.bad else "clean"
        row = rows.setdefault(outcome.scheme, {}).setdefault(f"{outcome.delay_s * 1e3:g} ms", {})
        worst = row.setdefault(line, {"rest_mm_s": 0.0, "energy_out_mJ": 0.0, "stable": True})
        worst["rest_mm_s"] = max(worst["rest_mm_s"], round(outcome.rest_m_s * 1e3, 3))
        worst["energy_out_mJ"] = max(worst["energy_out_mJ"], round(outcome.energy_out_J * 1e3, 3))
        worst["stable"] = worst["stable"] and outcome.stable
    return rows


def study_stiffness(delays_s: Iterable[float] = DELAYS_S) -> list[dict[str, float]]:
    """Stiffness that a hand feels through waves, against its closed form, by delay.

    At rest the line is a spring of b/d: the totals of what is under way are the delay times the waves, so that
    x_leader − x_desired = d F/b. In a row with the follower's spring and the wall, 1/K = 1/K_wall + 1/K_c + d/b.
    Measured without friction, from the rests that two forces of the hand lead to.
    """
    rows = []
    for delay_s in delays_s:
        felt_N_m, line_s = measure_stiffness(Coupling("wave"), delay_s)
        predicted_N_m = predict_stiffness(line_s)
        rows.append({"delay_s": delay_s, "line_s": line_s, "felt_N_m": felt_N_m, "predicted_N_m": predicted_N_m})
    return rows


def predict_stiffness(delay_s: float, coupling: Coupling | None = None) -> float:
    """The closed form of `study_stiffness` [N/m]; at no delay it is that of the position–position controller."""
    tied = coupling or Coupling()
    return 1.0 / (1.0 / WALL_N_M + 1.0 / tied.stiffness_N_m + delay_s / tied.impedance_Ns_m)


def measure_stiffness(coupling: Coupling, delay_s: float) -> tuple[float, float]:
    """Stiffness felt at the leader [N/m], and how long a wave was under way, mean of both ways [s]."""
    scene = plate(Swatch("wall", stiffness_N_m=WALL_N_M))
    start = (0.0, 0.0, 0.002)
    operation = Operation(
        scene,
        start,
        coupling=coupling,
        line=Impairment(delay_s),
        device=PointMass(0.045, 0.1),
        compensator="none",
        effects=("wall",),
    )
    found = []
    for push_N in (-0.5, -1.0):
        operated = operation.run(Intent.hold(start, 6000, Grip(0.0, 2.0), (0.0, 0.0, push_N)))
        found.append((push_N, operated.leader_W_m[-1, 2]))
    queues = [end.queue[0] for end in (operation.leader.end, operation.follower.end)]
    lag_s = float(np.mean([int(queue.lag_ticks) for queue in queues])) * 1e-3
    (f0, z0), (f1, z1) = found
    return float((f1 - f0) / (z1 - z0)), lag_s
