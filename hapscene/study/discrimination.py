"""Discriminability of two stimuli: d′ from the proportion correct in two intervals, p = Φ(d′ / √2).

Macmillan & Creelman (2005), Detection Theory, chapter 7.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

__all__ = ["CERTAINTY", "Estimate", "d_prime_of", "d_prime_of_people", "proportion"]

CERTAINTY: Final = 0.95
"""Confidence level of all intervals."""


@dataclass(frozen=True)
class Estimate:
    """A number and its interval of 95 %; the interval's ends may be infinite."""

    value: float
    low: float
    high: float


def proportion(right: int, count: int) -> Estimate:
    """A share of right answers with its exact interval (Clopper & Pearson 1934), at least 95 %."""
    tail, wrong = 0.5 * (1.0 - CERTAINTY), count - right
    low = float(stats.beta.ppf(tail, right, wrong + 1)) if right else 0.0
    high = float(stats.beta.isf(tail, right + 1, wrong)) if wrong else 1.0
    return Estimate(right / count, low, high)


def d_prime_of(right: int, count: int) -> Estimate:
    """d′ of one person: the share of right answers and its Wilson interval, as d′; infinite where all are right."""
    interval = stats.binomtest(right, count).proportion_ci(CERTAINTY, "wilson")
    shares = right / count, float(interval.low), float(interval.high)
    return Estimate(*(math.sqrt(2.0) * float(special.ndtri(one)) for one in shares))


MEANS: Final = np.linspace(-8.0, 8.0, 321)
"""Mean d′ that are tried [1]; between them the likelihood is interpolated. 8 is one wrong answer in 100 million."""

SPREADS: Final = np.concatenate([[0.0], np.geomspace(0.05, 3.0, 24)])
"""Standard deviations of d′ over people that are tried [1]."""


def d_prime_of_people(right: Sequence[int], count: Sequence[int]) -> Estimate:
    """Mean d′ of the population that the participants are drawn from.

    Each person's d′ is normal about the mean, their right answers are binomial: a mixed model. The profile of its
    likelihood over the spread between people gives the estimate and its interval. The fall to the interval's ends is
    that of the mean of so many normal numbers of unknown spread, where it gives Student's interval.

    Args:
        right: right answers of each person.
        count: answers of each.
    """
    if len(right) == 1:
        return d_prime_of(right[0], count[0])
    weights, log_right, log_wrong = _tables()
    likelihood = np.zeros(log_right.shape[:2])
    for (k, n), people in Counter(zip(right, count, strict=True)).items():
        most = float(special.xlogy(k, k / n) + special.xlogy(n - k, 1.0 - k / n))  # against underflow
        each = np.exp(k * log_right + (n - k) * log_wrong - most) @ weights
        likelihood += people * np.log(np.maximum(each, 1e-300))
    profile = likelihood.max(axis=1)
    t = float(stats.t.ppf(0.5 + 0.5 * CERTAINTY, len(right) - 1))
    fall = 0.5 * len(right) * math.log1p(t**2 / (len(right) - 1))
    best = int(np.argmax(profile))
    value = float(MEANS[best])
    if 0 < best < len(MEANS) - 1:  # the top of the parabola through three of them
        before, at, after = profile[best - 1 : best + 2]
        value += float((MEANS[1] - MEANS[0]) * 0.5 * (before - after) / (before - 2.0 * at + after))
    low, high = (_crossing(profile, best, step, fall) for step in (-1, 1))
    return Estimate(value, low, high)


@cache
def _tables() -> tuple[NDArray[np.float64], ...]:
    """Weights of what is drawn about the means, log chances to be right and wrong (means, spreads, drawn)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(31)
    d = MEANS[:, None, None] + SPREADS[None, :, None] * nodes
    p = np.clip(special.ndtr(d / math.sqrt(2.0)), 1e-12, 1.0 - 1e-12)
    return weights / weights.sum(), np.log(p), np.log1p(-p)


def _crossing(profile: NDArray[np.float64], best: int, step: int, fall: float) -> float:
    """Where the profile has fallen by so much from its maximum, going up or down; infinite beyond the grid."""
    least, at = profile[best] - fall, best
    while 0 <= at + step < len(MEANS):
        if profile[at + step] < least:
            share = (profile[at] - least) / (profile[at] - profile[at + step])
            return float(MEANS[at] + share * (MEANS[at + step] - MEANS[at]))
        at += step
    return step * math.inf
