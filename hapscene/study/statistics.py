"""Analysis of a study: thresholds, d′, proportions correct and ratings, each with a 95 % confidence interval.

Two stimuli count as equivalent only if the whole interval of their difference lies within the margin of the block. A
difference that is not significant does not count as equivalence.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from hapscene.errors import StudyError
from hapscene.io.files import naming, refusing, short
from hapscene.study.plan import ChoiceBlock, Plan, RatingBlock, StaircaseBlock, load_plan
from hapscene.study.session import MISSING, PLAN, RESULTS, load_rows
from hapscene.study.trial_order import Staircase

__all__ = ["Analysis", "Estimate", "Finding", "Row", "analyse"]

Row = Mapping[str, str]

CERTAINTY: Final = 0.95
"""Confidence level of all intervals."""


@dataclass(frozen=True)
class Estimate:
    """An estimate and its 95 % confidence interval, whose ends may be infinite."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Finding:
    """One estimate."""

    block: str
    what: str
    """Stimuli concerned: "alive", "alive − steady", "gain_dB of alive"."""
    person: str
    """Participant; "" for the population that the participants are a sample of."""
    quantity: str
    """threshold, d′, right (proportion correct), rating or difference of ratings."""
    unit: str
    method: str
    estimate: Estimate
    answers: int
    verdict: str = ""
    """Result of a comparison: different, equivalent or undecided, with the reason."""


@dataclass(frozen=True)
class Analysis:
    """The findings of a study."""

    plan: Plan
    people: tuple[str, ...]
    findings: tuple[Finding, ...]


def analyse(folder: str | Path) -> Analysis:
    """Analyse the answers in the folder of a study, including unfinished sessions.

    Raises:
        StudyError: the folder does not belong to a study, or its answers do not fit the plan.
    """
    folder = Path(folder)
    plan = load_plan(folder / PLAN)
    rows = load_rows(folder / RESULTS)
    with refusing(StudyError), naming(folder / RESULTS):
        return analyse_rows(plan, rows)


def analyse_rows(plan: Plan, rows: Sequence[Row]) -> Analysis:
    """Analyse answers to a plan, by column. Raises StudyError: they belong to another plan, or a field is out of
    range."""
    _check(plan, rows)
    findings: list[Finding] = []
    for block in plan.blocks:
        mine = [row for row in rows if row["block"] == block.name]
        if isinstance(block, RatingBlock):
            findings += _ratings(block, mine)
        elif isinstance(block, ChoiceBlock):
            findings += _choices(block, mine)
        else:
            findings += _thresholds(block, mine)
    return Analysis(plan, tuple(dict.fromkeys(row["person"] for row in rows)), tuple(findings))


def _check(plan: Plan, rows: Sequence[Row]) -> None:
    """Check that the answers fit the plan; the file may have been edited."""
    blocks, seen = {block.name: block for block in plan.blocks}, set()
    for row in rows:
        where = f"{row['person']}, trial {row['trial']}"
        if row["plan_sha256"] != plan.sha256:
            raise StudyError(f"{where}: the answer belongs to another plan")
        if (key := (row["person"], row["trial"])) in seen:
            raise StudyError(f"{where}: there are two answers to this trial; expected one")
        seen.add(key)
        block = blocks.get(row["block"])
        if block is None or row["kind"] != block.kind:
            raise StudyError(f"{where}: the plan has no block {short(row['block'])} of kind {short(row['kind'])}")
        names = {"stimulus_1": block.used, "stimulus_2": (*block.used, MISSING), "correct": ("0", "1")}
        if isinstance(block, RatingBlock):
            names |= {"correct": (MISSING,), "rating": tuple(map(str, range(block.scale[0], block.scale[1] + 1)))}
        if wrong := next((name for name, allowed in names.items() if row[name] not in allowed), None):
            raise StudyError(f"{where}: {wrong} is {short(row[wrong])}; expected one of {', '.join(names[wrong])}")
        for name in ("latency_s", "replays", *(("level",) if isinstance(block, StaircaseBlock) else ())):
            try:
                in_range = 0.0 <= float(row[name]) < math.inf
            except ValueError:
                in_range = False
            if not in_range:
                raise StudyError(f"{where}: {name} is {short(row[name])}; expected a number of at least 0")


def _by_person(rows: Sequence[Row]) -> dict[str, list[Row]]:
    people: dict[str, list[Row]] = {}
    for row in rows:
        people.setdefault(row["person"], []).append(row)
    return people


def _thresholds(block: StaircaseBlock, rows: Sequence[Row]) -> Iterator[Finding]:
    what, unit = f"{block.parameter} of {block.stimulus}", UNITS[block.parameter]
    found = []
    for person, mine in _by_person(rows).items():
        staircase = Staircase(block.distances)
        for row in mine:
            staircase.add(float(row["level"]), row["correct"] == "1")
        threshold = Estimate(staircase.quantile(0.5), *staircase.interval(CERTAINTY))
        found.append(threshold)
        yield Finding(block.name, what, person, "threshold", unit, "QUEST+", threshold, len(mine))
    if len(found) > 1 and all(math.isfinite(one.low) and math.isfinite(one.high) for one in found):
        log = mean_of_people(np.log([one.value for one in found]))
        mean = Estimate(*(math.exp(one) for one in (log.value, log.low, log.high)))
        method = "geometric mean of the participants', Student's t"
        yield Finding(block.name, what, "", "threshold", unit, method, mean, len(rows))


UNITS: Final = {"force_N": "N", "speed_m_s": "m/s", "seconds": "s", "gain_dB": "dB"}
"""Unit of each parameter that a staircase can vary."""


def mean_of_people(values: Sequence[float] | NDArray[np.float64], step: float = 0.0) -> Estimate:
    """Mean of the population with Student's interval; unbounded for a single participant.

    If all participants give equal values, the spread of rounding to `step` is used.
    """
    mean = float(np.mean(values))
    if len(values) < 2:
        return Estimate(mean, -math.inf, math.inf)
    equal = np.ptp(values) < 1e-9  # means of equal ratings may differ by rounding
    spread = step / math.sqrt(12.0) if equal else float(np.std(values, ddof=1))
    half = float(stats.t.ppf(0.5 + 0.5 * CERTAINTY, len(values) - 1)) * spread / math.sqrt(len(values))
    return Estimate(mean, mean - half, mean + half)


def _choices(block: ChoiceBlock, rows: Sequence[Row]) -> Iterator[Finding]:
    for pair in block.pairs:
        mine = [row for row in rows if {row["stimulus_1"], row["stimulus_2"]} == set(pair)]
        if not mine:
            continue
        people = _by_person(mine)
        right = [sum(row["correct"] == "1" for row in own) for own in people.values()]
        count = [len(own) for own in people.values()]
        what, n = f"{pair[0]} − {pair[1]}", len(mine)
        mean = mean_of_people(np.divide(right, count), step=1.0 / min(count))
        share = Estimate(mean.value, max(mean.low, 0.0), min(mean.high, 1.0))
        yield Finding(block.name, what, "", "right", "", "mean of the participants', Student's t", share, n)
        d = d_prime(share)
        yield Finding(block.name, what, "", "d′", "", "of the mean share", d, n, verdict(d, block.margin, "d′"))
        for person, k, own in zip(people, right, count, strict=True):
            yield Finding(block.name, what, person, "d′", "", "Wilson", d_prime_of(k, own), own)


def verdict(estimate: Estimate, margin: float, quantity: str) -> str:
    """State the result of a comparison, from the estimate of a difference. Differences up to `margin` count as
    equivalent; 0 disables that test."""
    apart = estimate.low > 0.0 or estimate.high < 0.0
    most = max(abs(estimate.low), abs(estimate.high))
    if most < margin:
        also = ", but a difference was found" if apart else ""
        return f"equivalent: the interval of {quantity} lies within ±{margin:g}{also}"
    if apart:
        return f"different: the interval of {quantity} excludes 0"
    could = f"as large as {most:.2g}" if math.isfinite(most) else "of any size"
    return f"undecided: the interval of {quantity} contains 0; the difference may be {could}"


def _ratings(block: RatingBlock, rows: Sequence[Row]) -> Iterator[Finding]:
    means = {}
    for name in block.stimuli:
        mine = [row for row in rows if row["stimulus_1"] == name]
        of_person = _by_person(mine).items()
        means[name] = {who: float(np.mean([float(row["rating"]) for row in own])) for who, own in of_person}
        if mine:
            mean = mean_of_people(list(means[name].values()), step=1.0)
            yield Finding(block.name, name, "", "rating", "", "mean of the participants', Student's t", mean, len(mine))
    for a, b in combinations(block.stimuli, 2):
        people = means[a].keys() & means[b].keys()
        if len(people) > 1:
            n = sum(row["stimulus_1"] in (a, b) and row["person"] in people for row in rows)
            paired = mean_of_people([means[a][one] - means[b][one] for one in sorted(people)], step=math.sqrt(2.0))
            named = (block.name, f"{a} − {b}", "", "difference of ratings", "", "paired, Student's t")
            yield Finding(*named, paired, n, verdict(paired, block.margin, "rating"))


# Discriminability of two stimuli: d′ from the proportion correct in two intervals, p = Φ(d′ / √2) (Macmillan & Creelman
# 2005, Detection Theory, chapter 7).


def d_prime(share: Estimate) -> Estimate:
    """d′ from a proportion correct, 0 … 1; infinite where it is 0 or 1."""
    return Estimate(*(math.sqrt(2.0) * float(special.ndtri(one)) for one in vars(share).values()))


def d_prime_of(right: int, count: int) -> Estimate:
    """d′ of one participant, from the proportion correct and its Wilson interval."""
    interval = stats.binomtest(right, count).proportion_ci(CERTAINTY, "wilson")
    return d_prime(Estimate(right / count, float(interval.low), float(interval.high)))
