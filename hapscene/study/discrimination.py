"""How well two things are told apart: d′ from right answers, by the models of signal detection.

Macmillan & Creelman (2005), Detection Theory, chapters 7 and 9. In two intervals p = Φ(d′ / √2). In ABX with
independent observations, where the two stay the same and the listener knows what they are like,
p = Φ(d′ / √2) Φ(d′ / 2) + Φ(−d′ / √2) Φ(−d′ / 2); by differences, where X goes to the nearer one,
p = Φ(d′ / √2) Φ(d′ / √6) + Φ(−d′ / √2) Φ(−d′ / √6).
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats

RULES: Final = ("2ifc", "abx independent", "abx difference")

D_MOST: Final = 8.0
"""Largest d′ that is looked at [1]: one wrong answer in 100 million."""

CERTAINTY: Final = 0.95
"""Of all intervals."""


@dataclass(frozen=True)
class Estimate:
    """A number and its interval of 95 %; the interval's ends may be infinite."""

    value: float
    low: float
    high: float


def chance_right(d: ArrayLike, rule: str) -> NDArray[np.float64]:
    """Share of right answers of a person with this d′, any shape; below 0 in two intervals is the other way round."""
    d = np.asarray(d, dtype=np.float64)
    first = special.ndtr(d / math.sqrt(2.0))
    if rule == "2ifc":
        return np.asarray(first)
    second = special.ndtr(d / {"abx independent": 2.0, "abx difference": math.sqrt(6.0)}[rule])
    return np.asarray(first * second + (1.0 - first) * (1.0 - second))


def d_prime(share: float, rule: str) -> float:
    """d′ of a share of right answers; 0 for what is below chance in ABX, ±∞ where the share says none."""
    if rule == "2ifc":
        return math.sqrt(2.0) * float(special.ndtri(share))
    if share <= 0.5:
        return 0.0
    if share >= float(chance_right(D_MOST, rule)):
        return math.inf
    grid = np.linspace(0.0, D_MOST, 4001)
    return float(np.interp(share, chance_right(grid, rule), grid))


def proportion(right: int, count: int, *, method: str = "wilson") -> Estimate:
    """A share of right answers with its interval: "wilson", or "exact" (Clopper & Pearson, at least 95 %)."""
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(right, count, alpha=1.0 - CERTAINTY, method={"exact": "beta"}.get(method, method))
    return Estimate(right / count, float(low), float(high))


def d_prime_of(right: int, count: int, rule: str) -> Estimate:
    """d′ of one person: Wilson's interval of their right answers, as d′."""
    share = proportion(right, count)
    return Estimate(*(d_prime(one, rule) for one in (share.value, share.low, share.high)))


MEANS: Final = 161
"""Mean d′ that are tried [count]; between them the likelihood is interpolated."""

SPREADS: Final = np.concatenate([[0.0], np.geomspace(0.05, 3.0, 24)])
"""Standard deviations of d′ over people that are tried [1]."""


def d_prime_of_people(right: Sequence[int], count: Sequence[int], rule: str) -> Estimate:
    """Mean d′ of the people that these are drawn from.

    Each person's d′ is normal about the mean, their right answers are binomial: a mixed model. Its likelihood, the
    greatest over the spread between people, gives the estimate and an interval; how far it may fall at its ends is
    Student's t² for so many people, not χ², as few people say little about their spread.

    Args:
        right: right answers of each person.
        count: answers of each.
        rule: one of `RULES`.
    """
    if len(right) == 1:
        return d_prime_of(right[0], count[0], rule)
    means, weights, log_right, log_wrong = _tables(rule)
    likelihood = np.zeros(log_right.shape[:2])
    for (k, n), people in Counter(zip(right, count, strict=True)).items():
        most = float(special.xlogy(k, k / n) + special.xlogy(n - k, 1.0 - k / n))  # so that nothing underflows
        each = np.exp(k * log_right + (n - k) * log_wrong - most) @ weights
        likelihood += people * np.log(np.maximum(each, 1e-300))
    profile = likelihood.max(axis=1)
    fall = 0.5 * float(stats.t.ppf(0.5 + 0.5 * CERTAINTY, len(right) - 1)) ** 2
    best = int(np.argmax(profile))
    value = float(means[best])
    if 0 < best < len(means) - 1:  # the top of the parabola through three of them
        before, at, after = profile[best - 1 : best + 2]
        value += float((means[1] - means[0]) * 0.5 * (before - after) / (before - 2.0 * at + after))
    low, high = (_crossing(means, profile, best, step, fall) for step in (-1, 1))
    return Estimate(value, low, high)


@cache
def _tables(rule: str) -> tuple[NDArray[np.float64], ...]:
    """Means, weights of what is drawn about them, log chances to be right and wrong (means, spreads, drawn)."""
    means = np.linspace(-D_MOST, D_MOST, 2 * MEANS - 1)[0 if rule == "2ifc" else MEANS - 1 :]
    nodes, weights = np.polynomial.hermite_e.hermegauss(31)
    p = np.clip(chance_right(means[:, None, None] + SPREADS[None, :, None] * nodes, rule), 1e-12, 1.0 - 1e-12)
    return means, weights / weights.sum(), np.log(p), np.log1p(-p)


def _crossing(means: NDArray[np.float64], profile: NDArray[np.float64], best: int, step: int, fall: float) -> float:
    """Where the profile has fallen so far below its most, going up or down; what lies beyond the grid is open."""
    least, at = profile[best] - fall, best
    while 0 <= at + step < len(means):
        if profile[at + step] < least:
            share = (profile[at] - least) / (profile[at] - profile[at + step])
            return float(means[at] + share * (means[at + step] - means[at]))
        at += step
    return float(means[at]) if means[at] == 0.0 else step * math.inf
