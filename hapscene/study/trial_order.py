"""What one person is asked, in which order: balanced over people by Latin squares, everything else by the seed.

Squares are those of Williams (1949): in as many rows as there are things (twice as many where their number is odd),
each stands in each place equally often, and follows each other one equally often.
"""

import hashlib
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hapscene.study.plan import Block, Plan


@dataclass(frozen=True)
class Interval:
    """One thing that is felt or heard."""

    stimulus: Mapping[str, object]
    """Its parameters by name, as in the plan, with its name, and the block's varied one put in."""
    seed: int
    """Of the noise of this presentation: each has its own, so that nobody compares the noise."""


@dataclass(frozen=True)
class Trial:
    """One question to one person."""

    number: int
    """In this person's sequence, from 0."""
    block: str
    kind: str
    """rating, 2ifc or staircase."""
    question: str
    intervals: tuple[Interval, ...]
    """One to rate, or two to choose from."""
    choices: tuple[str, ...]
    correct: int | None
    """Index of the right choice; None where none is right."""
    level: float | None
    """Of a staircase: the distance from the reference."""
    labels: tuple[str, ...] = ()
    """Of a rating: what its ends mean."""


Answers = tuple[int, float | None]


def trials(plan: Plan, person: str, place: int) -> Generator[Trial, Answers, None]:
    """The trials of a person, one after the other; each is sent its answer before the next one comes.

    Sent is the index of the choice, and the level that was played, None where that is the trial's own: a staircase
    goes on from what was truly played.

    Args:
        plan: the plan.
        person: their name, which with the plan's seed seeds all that is drawn.
        place: the how-manieth person of the study this is, from 0: their row in the squares.
    """
    if any(block.kind == "staircase" for block in plan.blocks):
        from hapscene.study.staircase import library

        library()  # where it is missing, this is said before the first answer, not in the middle
    number = 0
    for index in order(len(plan.blocks), place, plan.seed):
        block = plan.blocks[index]
        rng = _generator(plan, person, block.name)
        if block.kind == "staircase":
            number = yield from _staircase(plan, block, rng, number)
            continue
        for intervals, choices, correct in _fixed(plan, block, rng, place):
            yield Trial(number, block.name, block.kind, block.question, intervals, choices, correct, None, block.labels)
            number += 1


def order(count: int, place: int, seed: int) -> list[int]:
    """The order of `count` things for the person at a place: a row of a Williams square, shuffled by the seed."""
    rng = np.random.default_rng([seed, count])
    rows = williams(count)
    name = rng.permutation(count)  # which thing is which of the square's
    row = rows[rng.permutation(len(rows))[place % len(rows)]]
    return [int(name[one]) for one in row]


def williams(count: int) -> list[list[int]]:
    """A balanced Latin square (Williams 1949) of 0 … count − 1: a row for each order, twice as many if odd."""
    first = [(place + 1) // 2 if place % 2 else -(place // 2) % count for place in range(count)]
    rows = [[(one + row) % count for one in first] for row in range(count)]
    return rows + [row[::-1] for row in rows] if count % 2 and count > 1 else rows


def _generator(plan: Plan, person: str, block: str) -> np.random.Generator:
    said = hashlib.sha256(f"{plan.seed}/{person}/{block}".encode()).digest()
    return np.random.default_rng(int.from_bytes(said[:16], "big"))


def _interval(plan: Plan, name: str, rng: np.random.Generator) -> Interval:
    return Interval(plan.stimuli[name], int(rng.integers(2**31)))


Question = tuple[tuple[Interval, ...], tuple[str, ...], int | None]


def _fixed(plan: Plan, block: Block, rng: np.random.Generator, place: int) -> Generator[Question, None, None]:
    """The questions of a block that does not depend on answers: as often as it repeats, all in a balanced order."""
    things: Sequence[str | tuple[str, str]] = block.stimuli or block.pairs
    sides = [balanced(block.repeats, 2, rng) for _ in things]
    for repeat in range(block.repeats):
        for index in order(len(things), place + repeat, plan.seed):
            thing, side = things[index], int(sides[index][repeat])
            if isinstance(thing, str):
                choices = tuple(str(step) for step in range(block.scale[0], block.scale[1] + 1))
                yield (_interval(plan, thing, rng),), choices, None
                continue
            intervals = tuple(_interval(plan, name, rng) for name in (thing if side == 0 else thing[::-1]))
            yield intervals, ("first", "second"), side


def balanced(count: int, sides: int, rng: np.random.Generator) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Sides 0 … sides − 1, (count,): equally often up to one, in an order that cannot be guessed."""
    rounds = [rng.permutation(sides) for _ in range(-(-count // sides))]
    return rng.permutation(np.concatenate(rounds)[:count])


def _staircase(plan: Plan, block: Block, rng: np.random.Generator, number: int) -> Generator[Trial, Answers, int]:
    from hapscene.study.staircase import Staircase

    staircase = Staircase(block.levels)
    for side in balanced(block.trials, 2, rng):
        level = staircase.level
        intervals = tuple(
            Interval(block.varied(plan.stimuli[block.stimulus], distance), int(rng.integers(2**31)))
            for distance in ((level, 0.0) if side == 0 else (0.0, level))
        )
        choices = ("first", "second")
        trial = Trial(number, block.name, block.kind, block.question, intervals, choices, int(side), level)
        choice, played = yield trial
        number += 1
        staircase.add(level if played is None else played, choice == side)
    return number
