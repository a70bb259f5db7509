"""What the answers of a study say: thresholds, d′, right answers and ratings, each with an interval of 95 %.

Two stimuli are called equal only where the whole interval of their difference lies inside the block's margin. A
difference that was not found is not called equal.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hapscene.errors import StudyError
from hapscene.files import naming, refusing, short
from hapscene.study.discrimination import CERTAINTY, Estimate, d_prime_of, d_prime_of_people, proportion
from hapscene.study.plan import Block, Plan, load_plan
from hapscene.study.results_file import MISSING, load_rows
from hapscene.study.sitting import PLAN, RESULTS

Row = Mapping[str, str]


@dataclass(frozen=True)
class Finding:
    """One estimate."""

    block: str
    what: str
    """Of which stimuli: "alive", "alive − steady", "gain_dB of alive"."""
    person: str
    """Whose; "" for the population that the participants are drawn from."""
    quantity: str
    """threshold, d′, right, rating or difference of ratings."""
    unit: str
    method: str
    estimate: Estimate
    answers: int
    verdict: str = ""
    """Of a comparison, in words: told apart, cannot be told apart, or not decided."""


@dataclass(frozen=True)
class Analysis:
    """A study's findings."""

    plan: Plan
    people: tuple[str, ...]
    findings: tuple[Finding, ...]

    def find(self, block: str, quantity: str, person: str = "") -> tuple[Finding, ...]:
        """The findings of a block by quantity, of the population or of one person."""
        return tuple(f for f in self.findings if (f.block, f.quantity, f.person) == (block, quantity, person))


def analyse(folder: str | Path) -> Analysis:
    """Analyse the answers in a study's folder; unfinished sessions are included.

    Raises:
        StudyError: not a study's folder, or answers that do not fit its plan.
    """
    folder = Path(folder)
    plan = load_plan(folder / PLAN)
    rows = load_rows(folder / RESULTS)
    with refusing(StudyError), naming(folder / RESULTS):
        return analyse_rows(plan, rows)


def analyse_rows(plan: Plan, rows: Sequence[Row]) -> Analysis:
    """Analyse answers to a plan.

    Args:
        plan: the plan.
        rows: answers by column, see `hapscene.study.results_file`.

    Raises:
        StudyError: answers to another plan, or a field that is out of range.
    """
    _check(plan, rows)
    by_kind = {"rating": _ratings, "staircase": _thresholds, "2ifc": _choices}
    findings: list[Finding] = []
    for block in plan.blocks:
        if mine := [row for row in rows if row["block"] == block.name]:
            findings += by_kind[block.kind](block, mine)
    return Analysis(plan, tuple(dict.fromkeys(row["person"] for row in rows)), tuple(findings))


def _check(plan: Plan, rows: Sequence[Row]) -> None:
    """Refuse answers that do not fit the plan: a file may have been edited.

    Raises:
        StudyError: names the person and the trial.
    """
    blocks, seen = {block.name: block for block in plan.blocks}, set()
    for row in rows:
        where = f"{row['person']}, trial {row['trial']}"
        if row["plan_sha256"] != plan.sha256:
            raise StudyError(f"{where}: is an answer to another plan")
        if (key := (row["person"], row["trial"])) in seen:
            raise StudyError(f"{where} stands twice")
        seen.add(key)
        block = blocks.get(row["block"])
        if block is None or row["kind"] != block.kind:
            raise StudyError(f"{where}: the plan has no block {short(row['block'])} of kind {short(row['kind'])}")
        asked = {*block.stimuli, *(name for pair in block.pairs for name in pair), block.stimulus} - {""}
        played = {row["stimulus_1"], row["stimulus_2"]} - {MISSING}
        if not played <= asked or not played:
            raise StudyError(f"{where}: stimuli must be of {', '.join(sorted(asked))}; are {', '.join(sorted(played))}")
        low, high = block.scale
        if block.kind == "rating" and row["rating"] not in map(str, range(low, high + 1)):
            raise StudyError(f"{where}: rating must be a whole number from {low} to {high}, is {short(row['rating'])}")
        right = str(int(row["answer"] == row["correct_answer"]))
        two = {row["answer"], row["correct_answer"]} <= {"0", "1"}
        if block.kind != "rating" and not (two and row["correct"] == right):
            raise StudyError(f"{where}: correct is {short(row['correct'])}; by answer and correct_answer it is {right}")
        numbers = ("latency_s", "replays", *(("level",) if block.kind == "staircase" else ()))
        if wrong := next((name for name in numbers if not _is_number(row[name])), None):
            raise StudyError(f"{where}: {wrong} must be a number, is {short(row[wrong])}")


def _is_number(text: str) -> bool:
    try:
        return 0.0 <= float(text) < math.inf
    except ValueError:
        return False


def _by_person(rows: Sequence[Row]) -> dict[str, list[Row]]:
    people: dict[str, list[Row]] = {}
    for row in rows:
        people.setdefault(row["person"], []).append(row)
    return people


# Thresholds.


def _thresholds(block: Block, rows: Sequence[Row]) -> Iterator[Finding]:
    from hapscene.study.staircase import Staircase

    what, unit = f"{block.parameter} of {block.stimulus}", _unit(block.parameter)
    found = []
    for person, mine in _by_person(rows).items():
        staircase = Staircase(block.levels)
        for row in mine:
            staircase.add(float(row["level"]), row["correct"] == "1")
        threshold = Estimate(staircase.threshold, *staircase.interval(CERTAINTY))
        found.append(threshold)
        yield Finding(block.name, what, person, "threshold", unit, "QUEST+", threshold, len(mine))
    if len(found) > 1:
        if all(math.isfinite(one.low) and math.isfinite(one.high) for one in found):
            log = mean_of_people(np.log([one.value for one in found]))
            estimate = Estimate(*(math.exp(one) for one in (log.value, log.low, log.high)))
            method = "geometric mean of the people's, Student's t"
        else:  # a threshold beyond all levels has no mean
            estimate, method = median_of_people(found), "median of the people's, by ranks"
        yield Finding(block.name, what, "", "threshold", unit, method, estimate, len(rows))


def _unit(parameter: str) -> str:
    return {"force_N": "N", "speed_m_s": "m/s", "seconds": "s", "gain_dB": "dB"}.get(parameter, "")


def mean_of_people(values: Sequence[float] | NDArray[np.float64], step: float = 0.0) -> Estimate:
    """The mean of the population, by Student's t; of one person without bounds.

    Args:
        values: of each person.
        step: what answers are rounded to: the spread of people who are all alike is that of the rounding.
    """
    mean = float(np.mean(values))
    if len(values) < 2:
        return Estimate(mean, -math.inf, math.inf)
    alike = np.ptp(values) < 1e-9  # means of the same ratings differ by rounding
    spread = step / math.sqrt(12.0) if alike else float(np.std(values, ddof=1))
    half = float(stats.t.ppf(0.5 + 0.5 * CERTAINTY, len(values) - 1)) * spread / math.sqrt(len(values))
    return Estimate(mean, mean - half, mean + half)


def median_of_people(found: Sequence[Estimate]) -> Estimate:
    """The median of the population, by ranks (sign test).

    Somebody's infinite end counts as beyond everybody else's; fewer than six people give no interval.
    """
    rank = int(stats.binom.ppf(0.5 - 0.5 * CERTAINTY, len(found), 0.5))
    lows = sorted(-math.inf if math.isinf(one.low) else one.value for one in found)
    highs = sorted(math.inf if math.isinf(one.high) else one.value for one in found)
    ends = (lows[rank - 1], highs[-rank]) if rank else (-math.inf, math.inf)
    return Estimate(float(np.median([one.value for one in found])), *ends)


# Right answers and d′.


def _choices(block: Block, rows: Sequence[Row]) -> Iterator[Finding]:
    for pair in block.pairs:
        mine = [row for row in rows if {row["stimulus_1"], row["stimulus_2"]} == set(pair)]
        if not mine:
            continue
        people = _by_person(mine)
        right = [sum(row["correct"] == "1" for row in own) for own in people.values()]
        count = [len(own) for own in people.values()]
        what, n = f"{pair[0]} − {pair[1]}", len(mine)
        exact = proportion(sum(right), n)
        yield Finding(block.name, what, "", "right", "", "all answers, exact binomial", exact, n)
        d = d_prime_of_people(right, count)
        yield Finding(block.name, what, "", "d′", "", "mixed model", d, n, verdict(d, block.margin, "d′"))
        for person, k, own in zip(people, right, count, strict=True):
            yield Finding(block.name, what, person, "d′", "", "Wilson", d_prime_of(k, own), own)


def verdict(estimate: Estimate, margin: float | None, quantity: str) -> str:
    """What the interval of a difference says, in words.

    Args:
        estimate: of the difference.
        margin: below which two count as equal; None: never.
        quantity: its name, for the words.
    """
    apart = estimate.low > 0.0 or estimate.high < 0.0
    most = max(abs(estimate.low), abs(estimate.high))
    if margin is not None and most < margin:
        also = ", though a difference was found" if apart else ""
        return f"cannot be told apart by {quantity} {margin:g}: the interval lies inside{also}"
    if apart:
        return f"told apart: the interval of {quantity} excludes 0"
    could = f"may be as large as {most:.2g}" if math.isfinite(most) else "may be of any size"
    return f"not decided: the interval of {quantity} holds 0, and the difference {could}"


# Ratings.


def _ratings(block: Block, rows: Sequence[Row]) -> Iterator[Finding]:
    means = {}
    for name in block.stimuli:
        mine = [row for row in rows if row["stimulus_1"] == name]
        of_person = _by_person(mine).items()
        means[name] = {who: float(np.mean([float(row["rating"]) for row in own])) for who, own in of_person}
        if mine:
            mean = mean_of_people(list(means[name].values()), step=1.0)
            yield Finding(block.name, name, "", "rating", "", "mean of the people's, Student's t", mean, len(mine))
    for a, b in combinations(block.stimuli, 2):
        people = means[a].keys() & means[b].keys()
        if len(people) > 1:
            n = sum(row["stimulus_1"] in (a, b) and row["person"] in people for row in rows)
            paired = mean_of_people([means[a][one] - means[b][one] for one in sorted(people)], step=math.sqrt(2.0))
            named = (block.name, f"{a} − {b}", "", "difference of ratings", "", "paired, Student's t")
            yield Finding(*named, paired, n, verdict(paired, block.margin, "rating"))
