"""What answers say: ratings, thresholds across people, and words that no interval belies."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import special, stats

from hapscene.errors import StudyError
from hapscene.study.plan import Plan, parse_plan
from hapscene.study.session import load_rows
from hapscene.study.statistics import (
    Analysis,
    Estimate,
    analyse,
    analyse_rows,
    d_prime,
    d_prime_of,
    mean_of_people,
    verdict,
)
from hapscene.study.trial_order import Trial

from .people import Truth, simulate
from .plans import TEXT, asked, one_block

pytestmark = pytest.mark.nightly


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
    (threshold,) = analysis.find("gain", "threshold")
    assert threshold.estimate.low < 1.5 < threshold.estimate.high and threshold.unit == "dB"
    assert threshold.estimate.value == pytest.approx(1.5, rel=0.25)
    (rated,) = [f for f in analysis.find("real", "difference of ratings") if "alive − st" in f.what]
    assert rated.estimate.value == pytest.approx(3.0, abs=0.7) and rated.verdict.startswith("different")
    (life,) = analysis.find("life", "d′")
    assert life.estimate.value == pytest.approx(2.0, abs=0.7) and life.verdict.startswith("different")
    assert analysis.find("life", "right")[0].answers == 64
    louder = {f.what: f.estimate for f in analysis.find("louder", "d′")}
    assert louder["alive − steady"].low < 2.0 < louder["alive − steady"].high
    assert louder["rough − steady"].low < 1.5 < louder["rough − steady"].high


def test_answers_to_another_plan_are_refused(folder: Path) -> None:
    rows = load_rows(folder / "results.csv")
    with pytest.raises(StudyError, match="trial 0: the answer belongs to another plan"):
        analyse_rows(parse_plan(TEXT), rows)


def test_pandas_and_r_read_the_same_numbers(folder: Path, analysis: Analysis) -> None:
    """Of the file as it is: R's read.csv takes the same text, plain header and NA."""
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(folder / "results.csv")
    assert len(frame) == sum(1 for _ in load_rows(folder / "results.csv"))
    means = frame[frame.kind == "rating"].groupby(["stimulus_1", "person"]).rating.mean().groupby("stimulus_1").mean()
    for finding in analysis.find("real", "rating"):
        assert means[finding.what] == pytest.approx(finding.estimate.value)
    assert frame[frame.block == "life"].correct.mean() == analysis.find("life", "right")[0].estimate.value
    times = pandas.to_datetime(frame.time, format="ISO8601")
    assert times.is_monotonic_increasing and str(times.dt.tz) == "UTC"
    numbers = ("place", "trial", "answer", "replays", "latency_s", "level", "rating", "correct", "correct_answer")
    assert all(pandas.api.types.is_numeric_dtype(frame[name]) for name in numbers)


@pytest.mark.parametrize(
    ("kind", "change", "expected"),
    [
        ("2ifc", {"correct": "TRUE"}, "correct is 'TRUE'"),
        ("2ifc", {"stimulus_2": "nope"}, "stimulus_2 is 'nope'"),
        ("2ifc", {"block": "nope"}, "no block 'nope'"),
        ("rating", {"kind": "2ifc"}, "no block 'real'"),
        ("rating", {"rating": "99"}, "rating is '99'"),
        ("rating", {"latency_s": "nan"}, "latency_s is"),
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


def same(plan: Plan, people: int, answer: Callable[[Trial], int]) -> Analysis:
    """What people who answer by one rule are found to say."""
    rows = []
    for k in range(people):
        for trial, choice in asked(plan, f"P{k}", k, answer):
            names = [one.stimulus.name for one in trial.intervals] + ["NA"] * (3 - len(trial.intervals))
            shown = {f"stimulus_{n}": name for n, name in enumerate(names, 1)}
            right = "NA" if trial.correct is None else int(choice == trial.correct)
            shown |= {"answer": choice, "correct_answer": trial.correct, "correct": right}
            shown |= {"person": f"P{k}", "trial": trial.number, "block": trial.block.name, "kind": trial.block.kind}
            shown |= {"level": trial.level, "latency_s": "2.0", "replays": 0, "plan_sha256": plan.sha256}
            shown["rating"] = trial.choices[choice] if trial.block.kind == "rating" else "NA"
            rows.append({name: str(value) for name, value in shown.items()})
    return analyse_rows(plan, rows)


def test_thresholds_beyond_the_levels() -> None:
    """Participants who are always or never right have an open interval, and the population has no estimate."""
    text = TEXT.split("[[blocks]]")[0] + "[[blocks]]" + TEXT.split("[[blocks]]")[-1]
    for wrong in (False, True):
        analysis = same(parse_plan(text), 2, lambda trial, wrong=wrong: int(trial.correct == (not wrong)))
        assert not analysis.find("gain", "threshold")
        (found,) = analysis.find("gain", "threshold", "P0")
        assert (found.estimate.high if wrong else -found.estimate.low) == math.inf


def test_two_participants_with_equal_ratings() -> None:
    plan = parse_plan(one_block("rating", 4).content.decode() + "margin = 0.5\n")
    for steps, few, many in ((0, "undecided", "equivalent"), (1, "undecided", "different")):

        def answer(trial: Trial, steps: int = steps) -> int:
            return 3 + steps * (trial.intervals[0].stimulus.name == "alive")

        for people, expected in ((2, few), (12, many)):
            (found,) = same(plan, people, answer).find("one", "difference of ratings")
            assert found.estimate.value == steps and found.verdict.startswith(expected)
    thirds = mean_of_people([7 / 3 - 4 / 3, 1.0], step=math.sqrt(2.0))  # equal up to rounding
    assert thirds.low == pytest.approx(mean_of_people([1.0, 1.0], step=math.sqrt(2.0)).low) and thirds.low < -1.0
