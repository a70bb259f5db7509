"""d′ from right answers: the models against observers who answer by the rule, published values, and planted d′."""

import math

import numpy as np
import pytest

from hapscene.study.discrimination import (
    RULES,
    chance_right,
    d_prime,
    d_prime_of,
    d_prime_of_people,
    proportion,
)

from .plans import observers

DRAWN = 400_000


@pytest.mark.parametrize("d", [0.0, 0.7, 1.5, 3.0])
@pytest.mark.parametrize("rule", RULES)
def test_chances_are_those_of_observers_who_follow_the_rule(rule: str, d: float) -> None:
    """A and B stand at 0 and d, X is like A; what is inside has normal noise. Nothing but the rule is used."""
    a, b, x = np.random.default_rng(4).standard_normal((3, DRAWN)) + np.array([[0.0], [d], [0.0]])
    right = {
        "2ifc": b > a,
        "abx independent": (a < b) == (x < d / 2.0),  # which of the two is the lower one, and whether X is
        "abx difference": np.abs(x - a) < np.abs(x - b),
    }[rule]
    share = float(np.mean(right))
    assert abs(share - float(chance_right(d, rule))) < 4.0 * math.sqrt(0.25 / DRAWN)


def test_it_is_the_inverse() -> None:
    for rule in RULES:
        for d in (0.2, 1.0, 2.5, 4.0):
            assert d_prime(float(chance_right(d, rule)), rule) == pytest.approx(d, abs=2e-3)
        assert d_prime(0.5, rule) == 0.0 and d_prime(1.0, rule) == math.inf
    assert d_prime(0.3, "2ifc") == pytest.approx(-d_prime(0.7, "2ifc")) and d_prime(0.3, "abx difference") == 0.0
    assert d_prime(0.76, "2ifc") == pytest.approx(1.0, abs=0.01)  # Green & Swets: d′ of 1 is 76 % in two intervals


@pytest.mark.parametrize(("right", "count", "wilson", "exact"), [(8, 10, (0.490, 0.943), (0.444, 0.975))])
def test_intervals_of_a_share_are_the_known_ones(
    right: int, count: int, wilson: tuple[float, float], exact: tuple[float, float]
) -> None:
    """Wilson and Clopper & Pearson for 8 of 10, as R's binom.confint gives them."""
    for method, ends in (("wilson", wilson), ("exact", exact)):
        found = proportion(right, count, method=method)
        assert found.value == 0.8 and (found.low, found.high) == pytest.approx(ends, abs=6e-4)


def held(rule: str, mean: float, spread: float, people: int, answers: int, studies: int, seed: int) -> float:
    """How often an interval holds what was planted."""
    rng = np.random.default_rng(seed)
    found = 0
    for _ in range(studies):
        chance = chance_right(rng.normal(mean, spread, people), rule)
        right = [int(k) for k in rng.binomial(answers, chance)]
        estimate = d_prime_of_people(right, [answers] * people, rule)
        found += estimate.low <= mean <= estimate.high
        assert estimate.low <= estimate.value <= estimate.high
    return found / studies


@pytest.mark.parametrize("rule", RULES)
def test_intervals_hold_what_was_planted(rule: str) -> None:
    assert 0.91 <= held(rule, 1.5, 0.4, 12, 20, 200, 1) <= 0.995  # 200 studies: ± 3 % by chance


@pytest.mark.soak
@pytest.mark.parametrize("mean", [0.0, 1.0, 2.0])
@pytest.mark.parametrize(("people", "answers"), [(6, 30), (12, 20), (20, 40)])
@pytest.mark.parametrize("rule", RULES)
def test_intervals_hold_what_was_planted_in_1000_studies(rule: str, people: int, answers: int, mean: float) -> None:
    if rule != "2ifc" and not mean:
        pytest.skip("at the border of what can be: the interval then always begins at 0")
    share = held(rule, mean, 0.4, people, answers, 1000, 2)
    print(f"{rule}, d′ {mean:g} ± 0.4, {people} people, {answers} answers: {share:.3f}")
    assert 0.92 <= share <= 0.985


@pytest.mark.parametrize(("rule", "abx_rule"), [("abx independent", "independent"), ("abx difference", "difference")])
def test_observers_of_a_study_show_the_d_prime_they_have(rule: str, abx_rule: str) -> None:
    right, count = observers("abx", d=1.5, people=30, repeats=40, abx_rule=abx_rule)
    estimate = d_prime_of_people(right, count, rule)
    assert estimate.low < 1.5 < estimate.high and estimate.high - estimate.low < 0.5
    assert estimate.value == pytest.approx(1.5, rel=0.1)


def test_one_person_alone_has_an_interval() -> None:
    one = d_prime_of_people([16], [20], "2ifc")
    assert one == d_prime_of(16, 20, "2ifc") and one.value == pytest.approx(1.19, abs=0.01)
    assert 0.2 < one.low < one.value < one.high < 2.4
    assert d_prime_of(20, 20, "abx difference").high == math.inf
    assert d_prime_of(10, 20, "abx difference").low == 0.0


def test_people_who_never_err_have_no_upper_end() -> None:
    estimate = d_prime_of_people([20] * 8, [20] * 8, "2ifc")
    assert estimate.high == math.inf and estimate.low > 1.5
    two = d_prime_of_people([15, 16], [20, 20], "2ifc")  # two people say next to nothing about others
    assert two.high - two.low > 3.0
