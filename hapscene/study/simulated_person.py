"""People whose thresholds, d′ and ratings are known: what a study must find again.

They answer by signal detection: what each interval does inside is its stimulus's strength with normal noise, and the
choice follows from what was inside, by the rule that the listener has.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy import special

from hapscene.study.plan import Plan
from hapscene.study.sitting import Sitting
from hapscene.study.trial_order import Trial


@dataclass(frozen=True)
class Truth:
    """What people are like. `people_like` draws persons about it."""

    strength: Mapping[str, float] = field(default_factory=dict)
    """By stimulus, in units of d′: the d′ of two is their difference."""
    realism: Mapping[str, float] = field(default_factory=dict)
    """By stimulus: what it is rated at the mean, before it is rounded to the scale."""
    threshold: Mapping[str, float] = field(default_factory=dict)
    """By staircase's block: the level at which 82 % are right, without lapses."""
    slope: float = 3.5
    """Of the Weibull function of the level [1]."""
    lapse: float = 0.02
    """Share of right answers lost where all is clear [1]: guesses at twice as many trials."""
    rating_noise: float = 1.0
    """Standard deviation of one person's rating of one stimulus [points]."""
    abx_rule: str = "difference"
    """difference, or independent."""
    spread: float = 0.0
    """Standard deviation over people: of d′, of ratings [points], and relative of thresholds."""


class SimulatedPerson:
    """Somebody who answers trials."""

    def __init__(self, truth: Truth, seed: int) -> None:
        """Somebody who is like this to the letter; what they draw is of the seed."""
        self.truth = truth
        self._rng = np.random.default_rng(seed)

    def answer(self, trial: Trial) -> int:
        """The index of a choice."""
        truth, rng = self.truth, self._rng
        names = [str(interval.stimulus["name"]) for interval in trial.intervals]
        if trial.kind == "rating":
            least, most = int(trial.choices[0]), int(trial.choices[-1])
            felt = truth.realism[names[0]] + truth.rating_noise * rng.standard_normal()
            return round(min(max(felt, least), most)) - least
        if rng.random() < 2.0 * truth.lapse:
            return int(rng.integers(2))
        inside = rng.standard_normal(len(names))
        if trial.kind == "staircase":
            assert trial.correct is not None and trial.level is not None
            inside[trial.correct] += self.d_prime_at(trial.block, trial.level)
            return int(np.argmax(inside))
        strengths = np.array([truth.strength[name] for name in names])
        inside += strengths
        if trial.kind == "2ifc":
            return int(np.argmax(inside))
        if truth.abx_rule == "difference":
            return int(abs(inside[2] - inside[0]) > abs(inside[2] - inside[1]))
        middle = 0.5 * (strengths[0] + strengths[1])  # they know both: which is A, and which of them is X
        return int((inside[0] > inside[1]) != (inside[2] > middle))

    def d_prime_at(self, block: str, level: float) -> float:
        """d′ at a level of a staircase: such that the chance to be right in two intervals is the Weibull function."""
        wrong = 0.5 * np.exp(-((level / self.truth.threshold[block]) ** self.truth.slope))
        return float(-np.sqrt(2.0) * special.ndtri(max(wrong, 1e-12)))


TYPICAL: Final = Truth(spread=0.3)
"""Of what is not told otherwise."""


def typical(plan: Plan) -> Truth:
    """What people could be like who take part in a plan: each stimulus one d′ and a point over the one after it,
    thresholds in the middle of their levels."""
    names = list(plan.stimuli)
    above = {name: float(len(names) - 1 - index) for index, name in enumerate(names)}
    scales = {name: block.scale for block in plan.blocks for name in block.stimuli}
    middle = {name: 0.5 * sum(scales.get(name, (1, 7))) for name in names}
    share = 1.0 if len(names) < 4 else 3.0 / len(names)
    return replace(
        TYPICAL,
        strength=above,
        realism={name: middle[name] + share * (above[name] - 0.5 * (len(names) - 1)) for name in names},
        threshold={
            block.name: float(np.mean(block.levels)) if block.linear else float(np.exp(np.mean(np.log(block.levels))))
            for block in plan.blocks
            if block.kind == "staircase"
        },
    )


def people_like(truth: Truth, count: int, *, seed: int = 0) -> list[SimulatedPerson]:
    """People about a truth: each stimulus of each is drawn with its spread, and what they rate at all.

    Differences of d′ and of ratings between two stimuli have the spread √2 of it.
    """
    people = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])

        def drawn(means: Mapping[str, float], rng: np.random.Generator = rng) -> dict[str, float]:
            return {name: mean + truth.spread * rng.standard_normal() for name, mean in means.items()}

        own = rng.standard_normal() * truth.spread
        person = replace(
            truth,
            strength=drawn(truth.strength),
            realism={name: value + own for name, value in drawn(truth.realism).items()},
            threshold={n: t * float(np.exp(truth.spread * rng.standard_normal())) for n, t in truth.threshold.items()},
        )
        people.append(SimulatedPerson(person, int(rng.integers(2**31))))
    return people


def simulate(plan: Plan, folder: str | Path, *, people: int, truth: Truth | None = None, seed: int = 0) -> Truth:
    """Sits simulated people down to a plan, one after the other, into a folder as of a real study.

    Args:
        plan: the plan.
        folder: where their answers are kept.
        people: how many; they are called S001, S002 and so on.
        truth: what they are like; without, `typical` of the plan.
        seed: of the people and their noise.

    Returns:
        The truth, to hold what is found against.

    Raises:
        StudyError: see `Sitting`.
    """
    truth = typical(plan) if truth is None else truth
    for number, person in enumerate(people_like(truth, people, seed=seed), 1):
        with Sitting(plan, folder, f"S{number:03}") as sitting:
            while sitting.trial is not None:
                sitting.answer(person.answer(sitting.trial), latency_s=1.0)
    return truth
