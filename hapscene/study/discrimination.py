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
    """An estimate and its 95 % confidence interval, whose ends may be infinite."""

    value: float
    low: float
    high: float


def proportion(right: int, count: int) -> Estimate:
    """Proportion of correct answers with its exact interval (Clopper & Pearson 1934)."""
    tail, wrong = 0.5 * (1.0 - CERTAINTY), count - right
    low = float(stats.beta.ppf(tail, right, wrong + 1)) if right else 0.0
    high = float(stats.beta.isf(tail, right + 1, wrong)) if wrong else 1.0
    return Estimate(right / count, low, high)


def d_prime_of(right: int, count: int) -> Estimate:
    """d′ of one participant, from the proportion correct and its Wilson interval; infinite if all are correct."""
    interval = stats.binomtest(right, count).proportion_ci(CERTAINTY, "wilson")
    shares = right / count, float(interval.low), float(interval.high)
    return Estimate(*(math.sqrt(2.0) * float(special.ndtri(one)) for one in shares))


MEANS: Final = np.linspace(-8.0, 8.0, 321)
"""Grid of population means of d′ [1], between which the likelihood is interpolated. At 8, one answer in 100 million is
wrong."""

SPREADS: Final = np.concatenate([[0.0], np.geomspace(0.05, 3.0, 24)])
"""Grid of standard deviations of d′ between people [1]."""


def d_prime_of_people(right: Sequence[int], count: Sequence[int]) -> Estimate:
    """Mean d′ of the population that the participants are a sample of.

    Mixed model: d′ is normally distributed over people, the number of correct answers is binomial. The likelihood,
    maximised over the spread between people, gives the estimate and its interval. The interval ends where the log
    likelihood has fallen as much as it does at the ends of Student's interval for the mean of as many normal values of
    unknown spread.

    Args:
        right: number of correct answers of each participant.
        count: number of answers of each participant.
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
    """Quadrature weights, and log probabilities of correct and wrong answers (means, spreads, nodes)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(31)
    d = MEANS[:, None, None] + SPREADS[None, :, None] * nodes
    p = np.clip(special.ndtr(d / math.sqrt(2.0)), 1e-12, 1.0 - 1e-12)
    return weights / weights.sum(), np.log(p), np.log1p(-p)


def _crossing(profile: NDArray[np.float64], best: int, step: int, fall: float) -> float:
    """Where the profile has fallen by `fall` from its maximum in the direction `step`; infinite beyond the grid."""
    least, at = profile[best] - fall, best
    while 0 <= at + step < len(MEANS):
        if profile[at + step] < least:
            share = (profile[at] - least) / (profile[at] - profile[at + step])
            return float(MEANS[at] + share * (MEANS[at + step] - MEANS[at]))
        at += step
    return step * math.inf
