"""The order of a participant's trials: balanced over participants by Latin squares, otherwise random by the seed.

The squares are those of Williams (1949): each condition has each position equally often, and follows each other
condition equally often. They have as many rows as conditions, or twice as many if that number is odd.
"""

import hashlib
import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import StudyError
from hapscene.study.plan import Block, ChoiceBlock, Plan, RatingBlock, StaircaseBlock, Stimulus

__all__ = ["Interval", "Staircase", "Trial", "trials"]


@dataclass(frozen=True)
class Interval:
    """One presentation of a stimulus."""

    stimulus: Stimulus
    seed: int
    """Seed of the noise of this presentation. It differs between presentations, so that the noise cannot be
    recognised."""


@dataclass(frozen=True)
class Trial:
    """One question to one participant."""

    number: int
    """Number in the sequence of this participant, from 0."""
    block: Block
    intervals: tuple[Interval, ...]
    """One interval to rate, or two to choose from."""
    choices: tuple[str, ...]
    correct: int | None
    """Index of the correct choice; None for a rating."""
    level: float | None = None
    """Distance from the reference, for a staircase."""


Answer = tuple[int, float | None]

BOTH: Final = ("first", "second")
"""The choices of a comparison of two intervals."""


def trials(plan: Plan, person: str, place: int) -> Generator[Trial, Answer, None]:
    """Generate the trials of a participant. Send the answer to each before the next is generated.

    An answer is the index of the choice, and the level that was played; None stands for the level of the trial.

    Args:
        plan: the plan.
        person: name of the participant; it seeds the random numbers together with the seed of the plan.
        place: number of participants who began before; selects the row of the squares.
    """
    if any(isinstance(block, StaircaseBlock) for block in plan.blocks):
        questplus_module()  # raises before the first answer if it is missing
    number = 0
    for index in order(len(plan.blocks), place, plan.seed):
        block = plan.blocks[index]
        rng = _generator(plan, person, block.name)
        if isinstance(block, StaircaseBlock):
            number = yield from _staircase(plan, block, rng, number)
        else:
            number = yield from _fixed(plan, block, rng, place, number)


def order(count: int, place: int, seed: int) -> list[int]:
    """Order of `count` conditions for a participant: a row of a Williams square, shuffled by the seed."""
    rng = np.random.default_rng([seed, count])
    rows = williams(count)
    name = rng.permutation(count)
    row = rows[rng.permutation(len(rows))[place % len(rows)]]
    return [int(name[one]) for one in row]


def williams(count: int) -> list[list[int]]:
    """A balanced Latin square (Williams 1949) of 0 … count − 1, one row per order."""
    first = [(place + 1) // 2 if place % 2 else -(place // 2) % count for place in range(count)]
    rows = [[(one + row) % count for one in first] for row in range(count)]
    return rows + [row[::-1] for row in rows] if count % 2 and count > 1 else rows


def _generator(plan: Plan, person: str, block: str) -> np.random.Generator:
    digest = hashlib.sha256(f"{plan.seed}/{person}/{block}".encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "big"))


def _interval(plan: Plan, name: str, rng: np.random.Generator) -> Interval:
    return Interval(plan.stimuli[name], int(rng.integers(2**31)))


def _fixed(
    plan: Plan, block: RatingBlock | ChoiceBlock, rng: np.random.Generator, place: int, number: int
) -> Generator[Trial, Answer, int]:
    sides = [balanced(block.repeats, rng) for _ in range(block.trial_count // block.repeats)]
    for repeat in range(block.repeats):
        for index in order(len(sides), place + repeat, plan.seed):
            side = int(sides[index][repeat])
            if isinstance(block, RatingBlock):
                choices = tuple(str(step) for step in range(block.scale[0], block.scale[1] + 1))
                yield Trial(number, block, (_interval(plan, block.stimuli[index], rng),), choices, None)
            else:
                pair = block.pairs[index] if side == 0 else block.pairs[index][::-1]
                yield Trial(number, block, tuple(_interval(plan, name, rng) for name in pair), BOTH, side)
            number += 1
    return number


def balanced(count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Random sides 0 and 1 (count,), each equally often; for an odd count, one side once more."""
    rounds = [rng.permutation(2) for _ in range((count + 1) // 2)]
    return rng.permutation(np.concatenate(rounds)[:count])


def _staircase(
    plan: Plan, block: StaircaseBlock, rng: np.random.Generator, number: int
) -> Generator[Trial, Answer, int]:
    staircase = Staircase(block.distances)
    for side in balanced(block.trials, rng):
        level = staircase.level
        intervals = tuple(
            Interval(block.varied(plan.stimuli[block.stimulus], distance), int(rng.integers(2**31)))
            for distance in ((level, 0.0) if side == 0 else (0.0, level))
        )
        choice, played = yield Trial(number, block, intervals, BOTH, int(side), level)
        number += 1
        staircase.add(level if played is None else played, choice == side)
    return number


# Adaptive thresholds by QUEST+ (Watson 2017, J. Vision 17(3):10): each trial uses the most informative level.
#
# The probability of a correct answer in two intervals is a Weibull function of the level (Watson & Pelli 1983): 1 − λ
# − (½ − λ) exp(−(level / threshold)^slope), with threshold, slope and lapse rate λ. At the threshold it is 0.82,
# slightly less with lapses. The library questplus estimates the joint posterior of the three parameters.

SLOPES: Final = (1.4, 2.0, 2.8, 4.0, 5.6)
"""Slopes of the grid [1]: 1.3 if d′ is proportional to the level, 3.5 for detection (Watson & Pelli 1983). With fewer
values, intervals contain the thresholds of people with other slopes less often; with more, each trial is less
informative."""

LAPSES: Final = (0.0, 0.02, 0.05)
"""Lapse rates of the grid [1]; those of most people are below 0.05 (Wichmann & Hill 2001)."""

THRESHOLDS: Final = 80
"""Number of thresholds between the lowest and the highest level [count]."""


class Staircase:
    """One staircase: `level` is the next level to play, `add` takes the answer."""

    def __init__(self, levels: Sequence[float]) -> None:
        """Begin with a uniform prior for levels above 0, ascending. Raises StudyError: questplus is not installed."""
        self._levels = np.asarray(levels, dtype=np.float64)
        self._thresholds = np.geomspace(max(float(levels[0]), 1e-3 * float(levels[-1])), float(levels[-1]), THRESHOLDS)
        self._quest = questplus_module().QuestPlus(
            stim_domain={"intensity": self._levels},
            param_domain={
                "threshold": self._thresholds,
                "slope": np.array(SLOPES),
                "lower_asymptote": np.array([0.5]),
                "lapse_rate": np.array(LAPSES),
            },
            outcome_domain={"response": ["right", "wrong"]},
            func="weibull",
            stim_scale="linear",
        )

    @property
    def level(self) -> float:
        """The next level: the one with the least expected entropy of the posterior."""
        return float(self._quest.next_stim["intensity"])

    def add(self, level: float, right: bool) -> None:
        """Add the answer to a level; a level that is not on the grid counts as the nearest one."""
        nearest = float(self._levels[np.argmin(np.abs(self._levels - level))])
        self._quest.update(stim={"intensity": nearest}, outcome={"response": "right" if right else "wrong"})

    def quantile(self, share: float) -> float:
        """A quantile of the posterior of the threshold, in the unit of the levels."""
        scale = np.log(self._thresholds)
        half = 0.5 * (scale[1] - scale[0])
        edges = np.concatenate([[scale[0] - half], scale + half])
        marginal = self._quest.marginal_posterior["threshold"]
        found = float(np.interp(share, np.concatenate([[0.0], np.cumsum(marginal)]), edges))
        return math.exp(min(max(found, float(scale[0])), float(scale[-1])))

    def interval(self, certainty: float) -> tuple[float, float]:
        """The credible interval of the threshold, in the unit of the levels.

        An end beyond the range of the levels is infinite: a participant who is never or always right has a threshold
        outside it.
        """
        tail = 0.5 * (1.0 - certainty)
        low, high = self.quantile(tail), self.quantile(1.0 - tail)
        least, most = float(self._thresholds[0]), float(self._thresholds[-1])
        return -math.inf if low <= least * (1.0 + 1e-9) else low, math.inf if high >= most * (1.0 - 1e-9) else high


def questplus_module() -> Any:
    """Import the module questplus. Raises StudyError: it is not installed."""
    try:
        import questplus
    except ImportError:
        raise StudyError("staircase blocks need the package questplus; run: pip install 'hapscene[study]'") from None
    return questplus
