"""Simulated people whose thresholds, d′ and ratings are known: what a study must find again."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy import special

from hapscene.study.plan import Plan
from hapscene.study.session import Session
from hapscene.study.trial_order import Trial


@dataclass(frozen=True)
class Truth:
    """What people are like."""

    strength: Mapping[str, float] = field(default_factory=dict)
    """By stimulus, in units of d′: the d′ of two is their difference."""
    realism: Mapping[str, float] = field(default_factory=dict)
    """By stimulus: its mean rating, before it is rounded to the scale."""
    threshold: Mapping[str, float] = field(default_factory=dict)
    """By staircase's block: the level at which 82 % are right, without lapses."""
    slope: float = 3.5
    """Of the Weibull function of the level [1]."""
    lapse: float = 0.02
    """Share of right answers lost where all is clear [1]."""
    rating_noise: float = 1.0
    """Standard deviation of one person's rating of one stimulus [points]."""
    spread: float = 0.0
    """Standard deviation over people: of strengths, of ratings [points], and relative of thresholds."""


class SimulatedPerson:
    """Somebody who answers trials by signal detection."""

    def __init__(self, truth: Truth, seed: int) -> None:
        self.truth = truth
        self._rng = np.random.default_rng(seed)

    def answer(self, trial: Trial) -> int:
        """The index of a choice."""
        truth, rng = self.truth, self._rng
        names = [interval.stimulus.name for interval in trial.intervals]
        if trial.block.kind == "rating":
            least, most = int(trial.choices[0]), int(trial.choices[-1])
            felt = truth.realism[names[0]] + truth.rating_noise * rng.standard_normal()
            return round(min(max(felt, least), most)) - least
        if rng.random() < 2.0 * truth.lapse:
            return int(rng.integers(2))
        inside = rng.standard_normal(2)
        if trial.block.kind == "staircase":
            wrong = 0.5 * np.exp(-((trial.level / truth.threshold[trial.block.name]) ** truth.slope))
            inside[trial.correct] -= np.sqrt(2.0) * special.ndtri(max(wrong, 1e-12))
        else:
            inside += [truth.strength[name] for name in names]
        return int(np.argmax(inside))


def people_like(truth: Truth, count: int, *, seed: int = 0) -> list[SimulatedPerson]:
    """People about a truth: each stimulus of each is drawn with its spread, and what they rate at all."""
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


def simulate(plan: Plan, folder: str | Path, *, people: int, truth: Truth, seed: int = 0) -> None:
    """Have simulated people, S001 and so on, answer a plan, one after the other."""
    for number, person in enumerate(people_like(truth, people, seed=seed), 1):
        with Session(plan, folder, f"S{number:03}") as session:
            while session.trial is not None:
                session.answer(person.answer(session.trial), latency_s=1.0)
