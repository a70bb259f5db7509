"""d′ from right answers: published values, simulated observers, and planted d′."""

import math

import numpy as np
import pytest
from scipy import special

from hapscene.study.statistics import d_prime_of, d_prime_of_people, proportion

from .plans import observers

pytestmark = pytest.mark.nightly


def test_published_values_of_d_prime() -> None:
    """Green & Swets: d′ of 1 is 76 % in two intervals."""
    assert d_prime_of(76, 100).value == pytest.approx(1.0, abs=0.01)
    assert d_prime_of(30, 100).value == pytest.approx(-d_prime_of(70, 100).value)
    assert d_prime_of(10, 20).value == 0.0 and d_prime_of(20, 20).value == math.inf


def test_interval_of_a_proportion() -> None:
    """Clopper & Pearson for 8 of 10, as R's binom.confint gives it."""
    found = proportion(8, 10)
    assert found.value == 0.8 and (found.low, found.high) == pytest.approx((0.444, 0.975), abs=6e-4)
    assert proportion(0, 5).low == 0.0 and proportion(5, 5).high == 1.0


def held(mean: float, spread: float, people: int, answers: int, studies: int, seed: int) -> float:
    """How often an interval holds what was planted."""
    rng = np.random.default_rng(seed)
    found = 0
    for _ in range(studies):
        chance = special.ndtr(rng.normal(mean, spread, people) / math.sqrt(2.0))
        right = [int(k) for k in rng.binomial(answers, chance)]
        estimate = d_prime_of_people(right, [answers] * people)
        found += estimate.low <= mean <= estimate.high
        assert estimate.low <= estimate.value <= estimate.high
    return found / studies


def test_coverage_of_intervals() -> None:
    assert 0.91 <= held(1.5, 0.4, 12, 20, 200, 1) <= 0.995  # 200 studies: ± 3 % by chance


def test_d_prime_of_simulated_observers() -> None:
    right, count = observers(d=1.5, people=30, repeats=40)
    estimate = d_prime_of_people(right, count)
    assert estimate.low < 1.5 < estimate.high and estimate.high - estimate.low < 0.5
    assert estimate.value == pytest.approx(1.5, rel=0.1)


def test_a_single_participant_has_an_interval() -> None:
    one = d_prime_of_people([16], [20])
    assert one == d_prime_of(16, 20) and one.value == pytest.approx(1.19, abs=0.01)
    assert 0.2 < one.low < one.value < one.high < 2.4


def test_perfect_participants_have_no_upper_end() -> None:
    estimate = d_prime_of_people([20] * 8, [20] * 8)
    assert estimate.high == math.inf and estimate.low > 1.5
    two = d_prime_of_people([15, 16], [20, 20])  # two people say next to nothing about others
    assert two.high - two.low > 3.0
