"""Simulated people answer as often right as signal detection says, and are as different as they are told to be."""

import math

import numpy as np
import pytest

from hapscene.study.discrimination import chance_right
from hapscene.study.plan import parse_plan
from hapscene.study.simulated_person import SimulatedPerson, Truth, people_like, typical
from hapscene.study.trial_order import Interval, Trial

from .plans import TEXT

TRIALS = 20_000


def trial(kind: str, names: str, correct: int | None, level: float | None = None) -> Trial:
    choices = tuple("1234567") if kind == "rating" else ("first", "second")
    intervals = tuple(Interval({"name": name}, 0) for name in names)
    return Trial(0, "block", kind, "", intervals, choices, correct, level)


def share(truth: Truth, asked: Trial) -> float:
    person = SimulatedPerson(truth, 1)
    return float(np.mean([person.answer(asked) == asked.correct for _ in range(TRIALS)]))


NEAR = 4.0 * math.sqrt(0.25 / TRIALS)


@pytest.mark.parametrize(("names", "correct"), [("ba", 0), ("ab", 1)])
def test_two_intervals(names: str, correct: int) -> None:
    truth = Truth(strength={"a": 0.3, "b": 1.5}, lapse=0.0)
    assert share(truth, trial("2ifc", names, correct)) == pytest.approx(float(chance_right(1.2, "2ifc")), abs=NEAR)


@pytest.mark.parametrize("rule", ["independent", "difference"])
@pytest.mark.parametrize(("names", "correct"), [("aba", 0), ("abb", 1), ("baa", 1), ("bab", 0)])
def test_abx(rule: str, names: str, correct: int) -> None:
    truth = Truth(strength={"a": -0.5, "b": 1.0}, lapse=0.0, abx_rule=rule)
    known = float(chance_right(1.5, f"abx {rule}"))
    assert share(truth, trial("abx", names, correct)) == pytest.approx(known, abs=NEAR)


@pytest.mark.parametrize("level", [0.5, 1.0, 2.0, 3.0, 8.0])
def test_a_staircase_is_the_weibull_function_with_lapses(level: float) -> None:
    truth = Truth(threshold={"block": 2.0}, slope=3.5, lapse=0.04)
    known = 1.0 - 0.04 - 0.46 * math.exp(-((level / 2.0) ** 3.5))
    assert share(truth, trial("staircase", "xx", 1, level)) == pytest.approx(known, abs=NEAR)


def test_ratings_have_the_mean_and_the_noise_and_stay_on_the_scale() -> None:
    for realism, mean, noise in ((4.0, 3.0, 1.0), (4.4, 3.4, 1.0)):
        person = SimulatedPerson(Truth(realism={"a": realism}, rating_noise=noise), 1)
        given = [person.answer(trial("rating", "a", None)) for _ in range(TRIALS)]
        assert np.mean(given) == pytest.approx(mean, abs=0.04) and min(given) >= 0 and max(given) <= 6
        assert np.std(given) == pytest.approx(math.hypot(noise, 1.0 / math.sqrt(12.0)), abs=0.04)
    high = SimulatedPerson(Truth(realism={"a": 20.0}), 1)
    assert high.answer(trial("rating", "a", None)) == 6


def test_people_differ_as_told() -> None:
    truth = Truth(strength={"a": 1.0}, realism={"a": 4.0, "b": 3.0}, threshold={"block": 2.0}, spread=0.3)
    people = [person.truth for person in people_like(truth, 2000)]
    assert np.std([one.strength["a"] for one in people]) == pytest.approx(0.3, rel=0.1)
    effect = [one.realism["a"] - one.realism["b"] for one in people]
    assert np.mean(effect) == pytest.approx(1.0, abs=0.04)
    assert np.std(effect) == pytest.approx(0.3 * math.sqrt(2.0), rel=0.1)
    logs = np.log([one.threshold["block"] for one in people])
    assert np.mean(logs) == pytest.approx(math.log(2.0), abs=0.03) and np.std(logs) == pytest.approx(0.3, rel=0.1)
    assert [one.truth for one in people_like(truth, 3)] == people[:3]


def test_typical_people_are_told_of_every_part_of_a_plan() -> None:
    truth = typical(parse_plan(TEXT))
    assert set(truth.strength) == set(truth.realism) == {"alive", "steady", "rough"}
    assert truth.threshold == {"gain": pytest.approx(math.sqrt(0.25 * 8.0))}
    assert truth.strength["alive"] - truth.strength["steady"] == 1.0
