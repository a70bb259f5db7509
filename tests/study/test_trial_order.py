"""Orders are balanced over people, sides over trials, and the seed gives the same again."""

import sys
from collections import Counter
from itertools import pairwise

import pytest

from hapscene.errors import StudyError
from hapscene.study.plan import Plan, parse_plan
from hapscene.study.trial_order import Trial, trials, williams

from .plans import TEXT

PLAN = parse_plan(TEXT.replace("trials = 20", "trials = 5"))


def sequence(plan: Plan, person: str, place: int) -> list[Trial]:
    """Return all trials of a participant who always chooses the first interval."""
    asked = trials(plan, person, place)
    found = [next(asked)]
    try:
        while True:
            found.append(asked.send((0, None)))
    except StopIteration:
        return found


@pytest.mark.parametrize("count", [1, 2, 3, 6, 7])
def test_a_williams_square_is_balanced(count: int) -> None:
    rows = williams(count)
    assert len(rows) == (2 * count if count % 2 and count > 1 else count)
    for row in rows:
        assert sorted(row) == list(range(count))
    places = Counter((place, one) for row in rows for place, one in enumerate(row))
    assert set(places.values()) == {len(rows) // count} and len(places) == count**2
    follow = Counter(pair for row in rows for pair in pairwise(row))
    assert len(follow) == count * (count - 1)
    assert not follow or set(follow.values()) == {len(rows) // count}


def test_blocks_and_stimuli_are_balanced_over_participants() -> None:
    plan = parse_plan(TEXT.replace('"staircase"', '"rating"').split('stimulus = "alive"')[0] + 'stimuli = ["alive"]')
    people = [sequence(plan, f"P{place}", place) for place in range(12)]
    firsts = Counter(asked[0].block.name for asked in people)
    assert set(firsts.values()) == {3} and len(firsts) == 4
    for repeat in range(4):
        rated = [[t for t in asked if t.block.name == "real"][3 * repeat : 3 * repeat + 3] for asked in people]
        places = Counter((k, t.intervals[0].stimulus.name) for own in rated for k, t in enumerate(own))
        assert set(places.values()) == {4} and len(places) == 9


def test_correct_answers_are_balanced_over_sides() -> None:
    for place in range(3):
        asked = sequence(PLAN, "P", place)
        for trial in (t for t in asked if t.block.kind == "2ifc"):
            names = [i.stimulus.name for i in trial.intervals]
            assert tuple(names if trial.correct == 0 else names[::-1]) in PLAN.blocks[1].pairs + PLAN.blocks[2].pairs
        assert Counter(t.correct for t in asked if t.block.kind == "2ifc") == {0: 8, 1: 8}


def test_a_staircase_puts_the_level_into_the_correct_interval() -> None:
    plan = parse_plan(TEXT.replace("trials = 20", "trials = 6\nreference = -3.0"))
    for trial in (t for t in sequence(plan, "P", 0) if t.block.kind == "staircase"):
        gains = [i.stimulus.gain_dB for i in trial.intervals]
        assert gains[trial.correct] == pytest.approx(-3.0 + trial.level) and gains[1 - trial.correct] == -3.0


def test_a_missing_library_is_an_error_before_the_first_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "questplus", None)
    with pytest.raises(StudyError, match=r"pip install 'hapscene\[study\]'"):
        next(trials(PLAN, "P", 0))


def test_the_seed_determines_trials_and_distinct_noise() -> None:
    assert sequence(PLAN, "P01", 3) == sequence(PLAN, "P01", 3)
    other = parse_plan(TEXT.replace("seed = 1", "seed = 2").replace("trials = 20", "trials = 5"))
    seeds = [
        [i.seed for t in sequence(plan, person, 3) for i in t.intervals]
        for plan, person in ((PLAN, "P01"), (PLAN, "P02"), (other, "P01"))
    ]
    assert len({*seeds[0], *seeds[1], *seeds[2]}) == 3 * len(seeds[0])
    assert [t.number for t in sequence(PLAN, "P01", 0)] == list(range(len(sequence(PLAN, "P01", 0))))
