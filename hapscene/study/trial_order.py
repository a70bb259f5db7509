"""The order of a participant's trials: balanced over participants by Latin squares, otherwise random by the seed.

The squares are those of Williams (1949): each condition has each position equally often, and follows each other
condition equally often. They have as many rows as conditions, or twice as many if that number is odd.
"""

import hashlib
from collections.abc import Generator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.study.plan import Block, ChoiceBlock, Plan, RatingBlock, StaircaseBlock, Stimulus
from hapscene.study.staircase import Staircase, questplus_module

__all__ = ["Interval", "Trial", "balanced", "order", "trials", "williams"]


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
