"""What answers say: ratings, thresholds across people, and words that no interval belies."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import special, stats

from hapscene.errors import StudyError
from hapscene.study.plan import parse_plan
from hapscene.study.session import load_rows
from hapscene.study.statistics import (
    Analysis,
    Estimate,
    Finding,
    _choices,
    _ratings,
    _thresholds,
    analyse,
    analyse_rows,
    d_prime,
    d_prime_of,
    mean_of_people,
    verdict,
)

from .people import Truth, simulate
from .plans import TEXT


def test_mean_has_students_interval() -> None:
    values = [1.0, 2.0, 4.0, 3.5]
    known = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    found = mean_of_people(values)
    assert (found.low, found.high) == pytest.approx((known.low, known.high))
    assert mean_of_people([2.0]) == Estimate(2.0, -math.inf, math.inf)


def test_published_values_of_d_prime() -> None:
    """Green & Swets: d′ of 1 is 76 % in two intervals."""
    assert d_prime_of(76, 100).value == pytest.approx(1.0, abs=0.01)
    assert d_prime_of(30, 100).value == pytest.approx(-d_prime_of(70, 100).value)
    assert d_prime_of(10, 20).value == 0.0 and d_prime_of(20, 20).value == math.inf


@pytest.mark.parametrize(("mean", "spread", "answers"), [(0.0, 0.3, 16), (1.5, 0.4, 20), (2.5, 0.4, 16)])
def test_intervals_contain_the_d_prime_of_the_population(mean: float, spread: float, answers: int) -> None:
    """Twelve participants whose d′ is normally distributed; 200 studies: ± 3 % by chance."""
    rng, found = np.random.default_rng(1), 0
    for _ in range(200):
        chance = special.ndtr(rng.normal(mean, spread, 12) / math.sqrt(2.0))
        share = mean_of_people(rng.binomial(answers, chance) / answers, step=1.0 / answers)
        estimate = d_prime(Estimate(share.value, max(share.low, 0.0), min(share.high, 1.0)))
        found += estimate.low <= mean <= estimate.high
    assert 0.91 <= found / 200 <= 0.995


@pytest.mark.parametrize(
    ("low", "high", "margin", "expected"),
    [
        (0.2, 1.0, 0.0, "different"),
        (-1.0, -0.2, 0.5, "different"),
        (-0.2, 0.3, 0.0, "undecided"),
        (-0.2, 0.3, 0.5, "equivalent"),
        (0.0, 0.5, 0.5, "undecided"),
        (0.1, 0.3, 0.5, "equivalent"),
        (0.1, math.inf, 0.5, "different"),
        (0.0, math.inf, 0.5, "undecided"),
    ],
)
def test_verdicts(low: float, high: float, margin: float, expected: str) -> None:
    words = verdict(Estimate(0.5 * (low + min(high, 9.0)), low, high), margin, "d′")
    assert words.startswith(expected)


def answered(**shares: tuple[int, int]) -> list[dict[str, str]]:
    """Rows of each person: of several answers to the pair alive and steady, the first are right."""
    return [
        {"person": who, "stimulus_1": "steady", "stimulus_2": "alive", "correct": str(int(k < right))}
        for who, (right, count) in shares.items()
        for k in range(count)
    ]


def test_shares_of_correct_answers_are_averaged_over_people() -> None:
    block: Any = parse_plan(TEXT).blocks[1]
    right, d, first, second = _choices(block, answered(A=(4, 4), B=(3, 6)))
    assert right.estimate == Estimate(0.75, 0.0, 1.0) and right.answers == d.answers == 10
    assert d.estimate == d_prime(right.estimate) and d.verdict.startswith("undecided")
    for found, who, counts in ((first, "A", (4, 4)), (second, "B", (3, 6))):
        assert (found.person, found.answers) == (who, counts[1]) and found.estimate == d_prime_of(*counts)
    half = stats.t.ppf(0.975, 2) * (1.0 / 4.0) / math.sqrt(12.0 * 3.0)  # equal shares, in steps of 1/4 or finer
    right, *_ = _choices(block, answered(A=(2, 4), B=(3, 6), C=(4, 8)))
    assert (right.estimate.low, right.estimate.high) == pytest.approx((0.5 - half, 0.5 + half))


def test_differences_of_ratings_are_those_of_people_who_rated_both() -> None:
    rated = {
        "alive": {"A": (5, 6), "B": (7,), "C": (1,)},
        "steady": {"A": (2, 3), "B": (3, 4, 5)},
        "rough": {"A": (3,)},
    }
    rows = [
        {"person": who, "stimulus_1": name, "rating": str(one)}
        for name, people in rated.items()
        for who, values in people.items()
        for one in values
    ]
    *means, difference = _ratings(parse_plan(TEXT).blocks[0], rows)  # type: ignore[arg-type]
    assert [(one.what, one.answers) for one in means] == [("alive", 4), ("steady", 5), ("rough", 1)]
    assert [one.estimate.value for one in means] == pytest.approx([4.5, 3.25, 3.0])
    assert (difference.what, difference.answers) == ("alive − steady", 8)  # without the person who rated one of them
    half = stats.t.ppf(0.975, 1) * math.sqrt(2.0 / 12.0 / 2.0)  # both differ by 3: the rounding of two ratings
    assert vars(difference.estimate) == pytest.approx({"value": 3.0, "low": 3.0 - half, "high": 3.0 + half})


def test_an_open_threshold_has_no_mean() -> None:
    block: Any = parse_plan(TEXT).blocks[3]
    rows = [
        {"person": who, "level": repr(block.distances[k % 32]), "correct": str(int(who == "A" or k % 2))}
        for who in ("A", "B")
        for k in range(30)
    ]
    always, half = _thresholds(block, rows)
    assert always.estimate.low == -math.inf and math.isfinite(always.estimate.high) and always.answers == 30
    assert half.person == "B" and 0.25 <= half.estimate.value <= 8.0


PLAN = parse_plan(TEXT.replace("trials = 20", "trials = 30").replace("repeats = 8", "repeats = 16\nmargin = 0.8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four simulated people's answers to everything."""
    folder = tmp_path_factory.mktemp("study")
    truth = Truth(
        strength={"alive": 2.0, "steady": 0.0, "rough": 1.5},
        realism={"alive": 5.5, "steady": 2.5, "rough": 4.0},
        threshold={"gain": 1.5},
        slope=5.0,
        spread=0.2,
    )
    simulate(PLAN, folder, people=4, truth=truth, seed=3)
    return folder


@pytest.fixture(scope="module")
def analysis(folder: Path) -> Analysis:
    return analyse(folder)


def test_parameters_of_simulated_participants_are_found(analysis: Analysis) -> None:
    assert analysis.people == ("S001", "S002", "S003", "S004")

    def find(block: str, quantity: str) -> list[Finding]:
        return [f for f in analysis.findings if (f.block, f.quantity, f.person) == (block, quantity, "")]

    (threshold,) = find("gain", "threshold")
    assert threshold.estimate.low < 1.5 < threshold.estimate.high and threshold.unit == "dB"
    assert threshold.estimate.value == pytest.approx(1.5, rel=0.25)
    (rated,) = [f for f in find("real", "difference of ratings") if "alive − st" in f.what]
    assert rated.estimate.value == pytest.approx(3.0, abs=0.7) and rated.verdict.startswith("different")
    (life,) = find("life", "d′")
    assert life.estimate.value == pytest.approx(2.0, abs=0.7) and life.verdict.startswith("different")
    assert find("life", "right")[0].answers == 64
    louder = {f.what: f.estimate for f in find("louder", "d′")}
    assert louder["alive − steady"].low < 2.0 < louder["alive − steady"].high
    assert louder["rough − steady"].low < 1.5 < louder["rough − steady"].high


def test_answers_to_another_plan_are_refused(folder: Path) -> None:
    rows = load_rows(folder / "results.csv")
    with pytest.raises(StudyError, match="trial 0: the answer belongs to another plan"):
        analyse_rows(parse_plan(TEXT), rows)


@pytest.mark.parametrize(
    ("kind", "change", "expected"),
    [
        ("2ifc", {"correct": "TRUE"}, "correct is 'TRUE'"),
        ("rating", {"kind": "2ifc"}, "no block 'real'"),
        ("staircase", {"level": "x"}, "level is"),
        ("staircase", {}, "two answers"),
    ],
)
def test_invalid_answers_are_refused(folder: Path, kind: str, change: dict[str, str], expected: str) -> None:
    rows = load_rows(folder / "results.csv")
    found = next(k for k, row in enumerate(rows) if row["kind"] == kind)
    edited = [*rows[:found], rows[found] | change, *rows[found + 1 :]] if change else [*rows, rows[found]]
    with pytest.raises(StudyError, match="S001, trial .*" + expected):
        analyse_rows(PLAN, edited)
