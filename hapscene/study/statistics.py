"""What the answers of a study say: thresholds, d′, proportions and ratings, each with an interval of 95 %.

That two cannot be told apart is said only where the whole interval lies inside the block's margin; that nothing was
found says nothing.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

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
    """One number that the answers say."""

    block: str
    what: str
    """Of which stimuli: "alive", "alive − steady", "gain_dB of alive"."""
    person: str
    """Whose; "" for the people that these are drawn from."""
    quantity: str
    """threshold, d′, right, first, rating or difference of ratings."""
    unit: str
    method: str
    estimate: Estimate
    answers: int
    verdict: str = ""
    """Of a comparison: told apart, cannot be told apart, or not decided; in words."""


@dataclass(frozen=True)
class Analysis:
    """A study's findings."""

    plan: Plan
    people: tuple[str, ...]
    findings: tuple[Finding, ...]

    def find(self, block: str, quantity: str, person: str = "") -> tuple[Finding, ...]:
        """The findings of a block by quantity, of the people as a whole or of one."""
        return tuple(f for f in self.findings if (f.block, f.quantity, f.person) == (block, quantity, person))


def analyse(folder: str | Path) -> Analysis:
    """What the answers in a study's folder say, those of sittings that are not at their end included.

    Raises:
        StudyError: no study's folder, answers to another plan, or statsmodels is not installed.
    """
    folder = Path(folder)
    plan = load_plan(folder / PLAN)
    rows = load_rows(folder / RESULTS)
    with refusing(StudyError), naming(folder / RESULTS):
        return analyse_rows(plan, rows)


def analyse_rows(plan: Plan, rows: Sequence[Row]) -> Analysis:
    """What answers to a plan say.

    Args:
        plan: the plan.
        rows: answers by column, see `hapscene.study.results_file`.

    Raises:
        StudyError: answers to another plan, a field that is no number, or statsmodels is missing.
    """
    try:
        import statsmodels.stats.proportion  # noqa: F401
    except ImportError:
        raise StudyError("statistics need the package statsmodels: pip install 'hapscene[study]'") from None
    if any(row["plan_sha256"] != plan.sha256 for row in rows):
        raise StudyError("there are answers to another plan among them")
    _check(plan, rows)
    by_kind: dict[str, Callable[[Block, Sequence[Row]], Iterator[Finding]]] = {
        "rating": _ratings,
        "staircase": _thresholds,
        "2ifc": _choices,
        "abx": _choices,
    }
    findings: list[Finding] = []
    for block in plan.blocks:
        mine = [row for row in rows if row["block"] == block.name]
        try:
            findings += by_kind[block.kind](block, mine) if mine else ()
        except (ValueError, KeyError) as fault:
            raise StudyError(f"block {block.name}: an answer is not what it should be: {fault}") from None
    return Analysis(plan, tuple(dict.fromkeys(row["person"] for row in rows)), tuple(findings))


def _check(plan: Plan, rows: Sequence[Row]) -> None:
    """Answers are what they may be: a file may have been edited, and nothing is counted that says two things.

    Raises:
        StudyError: names the person and the trial.
    """
    blocks, seen = {block.name: block for block in plan.blocks}, set()
    for row in rows:
        where = f"{row['person']}, trial {row['trial']}"
        if (key := (row["person"], row["trial"])) in seen:
            raise StudyError(f"{where} stands twice")
        seen.add(key)
        block = blocks.get(row["block"])
        if block is None or row["kind"] != block.kind:
            raise StudyError(f"{where}: the plan has no block {short(row['block'])} of kind {short(row['kind'])}")
        asked = {*block.stimuli, *(name for pair in block.pairs for name in pair), block.stimulus} - {""}
        played = {row[name] for name in ("stimulus_1", "stimulus_2", "stimulus_3")} - {MISSING}
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
        staircase = Staircase(block.levels, linear=block.linear)
        for row in mine:
            staircase.add(float(row["level"]), row["correct"] == "1")
        threshold = Estimate(staircase.threshold, *staircase.interval(CERTAINTY))
        found.append(threshold)
        yield Finding(block.name, what, person, "threshold", unit, "QUEST+", threshold, len(mine))
    if len(found) > 1:
        values = np.array([one.value for one in found])
        known = all(math.isfinite(one.low) and math.isfinite(one.high) for one in found)
        if known:
            estimate = mean_of_people(values if block.linear else np.log(values))
            if not block.linear:
                estimate = Estimate(*(math.exp(one) for one in (estimate.value, estimate.low, estimate.high)))
            method = ("mean" if block.linear else "geometric mean") + " of the people's, Student's t"
        else:  # of one whose threshold may lie beyond all levels no mean knows anything
            estimate, method = median_of_people(found), "median of the people's, by ranks"
        yield Finding(block.name, what, "", "threshold", unit, method, estimate, len(rows))


def _unit(parameter: str) -> str:
    return {"force_N": "N", "speed_m_s": "m/s", "seconds": "s", "gain_dB": "dB", "rate_Hz": "Hz"}.get(parameter, "")


def mean_of_people(values: Sequence[float] | NDArray[np.float64], step: float = 0.0) -> Estimate:
    """The mean of the people that these are drawn from, by Student's t; of one person without bounds.

    Args:
        values: of each person.
        step: what answers are rounded to: where people are all alike, they spread as such a rounding does.
    """
    mean = float(np.mean(values))
    if len(values) < 2:
        return Estimate(mean, -math.inf, math.inf)
    alike = np.ptp(values) < 1e-9  # means of the same ratings differ by what they are rounded to
    spread = step / math.sqrt(12.0) if alike else float(np.std(values, ddof=1))
    half = _t(len(values) - 1) * spread / math.sqrt(len(values))
    return Estimate(mean, mean - half, mean + half)


def median_of_people(found: Sequence[Estimate]) -> Estimate:
    """The median of the people that these are drawn from, by ranks: as often above a person's as below.

    An open end of somebody's counts as beyond everybody else's; of fewer than six people nothing is certain.
    """
    rank = int(stats.binom.ppf(0.5 - 0.5 * CERTAINTY, len(found), 0.5))
    lows = sorted(-math.inf if math.isinf(one.low) else one.value for one in found)
    highs = sorted(math.inf if math.isinf(one.high) else one.value for one in found)
    ends = (lows[rank - 1], highs[-rank]) if rank else (-math.inf, math.inf)
    return Estimate(float(np.median([one.value for one in found])), *ends)


def _t(freedom: float) -> float:
    return float(stats.t.ppf(0.5 + 0.5 * CERTAINTY, freedom))


# Choices: right answers and d′.


def _choices(block: Block, rows: Sequence[Row]) -> Iterator[Finding]:
    rules = ("2ifc",) if block.kind == "2ifc" else ("abx independent", "abx difference")
    for pair in block.pairs:
        mine = [row for row in rows if {row["stimulus_1"], row["stimulus_2"]} == set(pair)]
        if not mine:
            continue
        people = _by_person(mine)
        right = [sum(row["correct"] == "1" for row in own) for own in people.values()]
        count = [len(own) for own in people.values()]
        what, n = f"{pair[0]} − {pair[1]}", len(mine)
        exact = proportion(sum(right), n, method="exact")
        said = _exact_verdict(exact, block.kind)
        yield Finding(block.name, what, "", "right", "", "all answers, exact binomial", exact, n, said)
        first = proportion(sum(row["answer"] == "0" for row in mine), n)
        yield Finding(block.name, what, "", "first", "", "all answers, Wilson", first, n)
        for rule in rules:
            d = d_prime_of_people(right, count, rule)
            said = _mixed_up(exact, block.kind) or verdict(d, block.margin, "d′")
            yield Finding(block.name, what, "", "d′", "", f"mixed model, {rule}", d, n, said)
            for person, k, own in zip(people, right, count, strict=True):
                yield Finding(block.name, what, person, "d′", "", f"Wilson, {rule}", d_prime_of(k, own, rule), own)


def _exact_verdict(share: Estimate, kind: str) -> str:
    if share.low > 0.5:
        return "told apart: more answers are right than guessing gives"
    if share.high < 0.5 and kind == "2ifc":
        return "told apart, the other way round: fewer answers are right than guessing gives"
    return _mixed_up(share, kind) or "not decided: right answers alone do not exclude guessing"


def _mixed_up(share: Estimate, kind: str) -> str:
    """ABX has no d′ below 0: who is wrong more often than by guessing tells apart, and answers the other way round."""
    mixed = "not decided: fewer answers are right than guessing gives; were A and B mixed up?"
    return mixed if kind == "abx" and share.high < 0.5 else ""


def verdict(estimate: Estimate, margin: float | None, quantity: str) -> str:
    """What an interval of a difference says, in words.

    Args:
        estimate: of the difference.
        margin: up to which it does not matter; None: nothing can be called equal.
        quantity: what it is, for the words.
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
    by_stimulus = {name: _by_person([row for row in rows if row["stimulus_1"] == name]) for name in block.stimuli}
    means = {
        name: {person: float(np.mean([float(row["rating"]) for row in mine])) for person, mine in people.items()}
        for name, people in by_stimulus.items()
    }
    for name, of_people in means.items():
        if of_people:
            n = sum(map(len, by_stimulus[name].values()))
            mean = mean_of_people(list(of_people.values()), step=1.0)
            yield Finding(block.name, name, "", "rating", "", "mean of the people's, Student's t", mean, n)
    for a, b in combinations(block.stimuli, 2):
        both = [row for row in rows if row["stimulus_1"] in (a, b)]
        people = means[a].keys() & means[b].keys()
        both = [row for row in both if row["person"] in people]
        if len(people) < 2:
            continue
        ratings = np.array([float(row["rating"]) for row in both])
        paired = [means[a][one] - means[b][one] for one in sorted(people)]
        of_a, whose = np.array([row["stimulus_1"] == a for row in both]), [row["person"] for row in both]
        effects = {
            "paired, Student's t": mean_of_people(paired, step=math.sqrt(2.0)),
            "mixed model": mixed_effect(ratings, of_a, whose),
        }
        for method, effect in effects.items():
            if effect is not None:
                said = verdict(effect, block.margin, "rating")
                named = (block.name, f"{a} − {b}", "", "difference of ratings", "", method)
                yield Finding(*named, effect, len(both), said)


def mixed_effect(ratings: NDArray[np.float64], treated: NDArray[np.bool_], people: Sequence[str]) -> Estimate | None:
    """How much higher one stimulus is rated than another, by a linear mixed model.

    rating = (b₀ + u₀) + (b₁ + u₁) x + noise, x = ± ½, u₀ and u₁ normal over people, by restricted likelihood
    (statsmodels' MixedLM). The interval is Student's, one degree of freedom less than people: z would be too narrow for
    a dozen.

    Args:
        ratings: (n,).
        treated: (n,), of the one, not of the other.
        people: (n,), whose.

    Returns:
        b₁, or None where the model cannot be fitted: too few answers, all of them the same.
    """
    from statsmodels.regression.mixed_linear_model import MixedLM

    count = len(set(people))
    if count < 2 or len(ratings) <= 2 * count or not np.ptp(ratings):
        return None
    x = np.column_stack([np.ones(len(ratings)), np.where(treated, 0.5, -0.5)])
    for method in ("powell", "lbfgs"):  # where people are alike, a variance is 0, and one or the other ends badly
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                fit: Any = MixedLM(ratings, x, groups=np.array(people), exog_re=x).fit(reml=True, method=method)
                value, error = float(fit.fe_params[1]), float(fit.bse_fe[1])
            except np.linalg.LinAlgError:
                continue
        if fit.converged and math.isfinite(error):
            half = _t(count - 1) * error
            return Estimate(value, value - half, value + half)
    return None
