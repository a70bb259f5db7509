"""The trials of a participant in their order: balanced over participants by Latin squares, the rest by the seed.

The squares are those of Williams (1949): in as many rows as there are conditions (twice as many if their number is
odd), each condition has each place equally often, and follows each other one equally often.
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
    """Of the noise of this presentation: each has its own, so that nobody compares the noise."""


@dataclass(frozen=True)
class Trial:
    """One question to one participant."""

    number: int
    """In this participant's sequence, from 0."""
    block: Block
    intervals: tuple[Interval, ...]
    """One to rate, or two to choose from."""
    choices: tuple[str, ...]
    correct: int | None
    """Index of the right choice; None of a rating."""
    level: float | None = None
    """Of a staircase: the distance from the reference."""


Answer = tuple[int, float | None]

BOTH: Final = ("first", "second")
"""The choices between two intervals."""


def trials(plan: Plan, person: str, place: int) -> Generator[Trial, Answer, None]:
    """The trials of a participant, one after the other; each is sent its answer before the next one comes.

    Sent is the index of the choice, and the level that was played, None for the trial's own.

    Args:
        plan: the plan.
        person: name of the participant, which with the plan's seed seeds all that is random.
        place: number of participants who began before: the row in the squares.
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
    """The order of `count` conditions for a participant: a row of a Williams square, shuffled by the seed."""
    rng = np.random.default_rng([seed, count])
    rows = williams(count)
    name = rng.permutation(count)
    row = rows[rng.permutation(len(rows))[place % len(rows)]]
    return [int(name[one]) for one in row]


def williams(count: int) -> list[list[int]]:
    """A balanced Latin square (Williams 1949) of 0 … count − 1: a row for each order, twice as many if odd."""
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
    """Random sides 0 and 1 (count,), equally often up to one."""
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
