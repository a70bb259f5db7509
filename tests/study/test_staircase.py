"""Staircases: QUEST+ asks where most is learnt, and finds planted thresholds in 40 trials."""

import math

import numpy as np
import pytest

from hapscene.study.trial_order import Staircase

LEVELS = np.geomspace(0.25, 8.0, 32)


def chance(level: float, threshold: float, slope: float, lapse: float) -> float:
    """To be right in two intervals."""
    return 1.0 - lapse - (0.5 - lapse) * math.exp(-((level / threshold) ** slope))


def run(threshold: float, slope: float, lapse: float, seed: int) -> Staircase:
    rng = np.random.default_rng(seed)
    staircase = Staircase(LEVELS)
    for _ in range(40):
        level = staircase.level
        staircase.add(level, bool(rng.random() < chance(level, threshold, slope, lapse)))
    return staircase


@pytest.mark.nightly
def test_a_known_threshold_is_found() -> None:
    """Eight people; one of them is 8 % off at the median (the long test below), their mean a third of that."""
    found = [run(2.0, 3.5, 0.02, seed) for seed in range(8)]
    assert abs(np.mean([math.log(one.quantile(0.5) / 2.0) for one in found])) < 0.1
    for one in found:
        assert one.quantile(0.025) < one.quantile(0.5) < one.quantile(0.975)


def test_answers_determine_the_state() -> None:
    """As in resuming and in the statistics: no level is asked for, and the posterior is the same to the bit."""
    rng = np.random.default_rng(1)
    first, again = Staircase(LEVELS), Staircase(LEVELS)
    for _ in range(12):
        level, right = first.level, bool(rng.random() < 0.7)
        first.add(level, right)
        again.add(float(repr(level)), right)  # as it went through a file
    assert again.level == first.level and again.quantile(0.1) == first.quantile(0.1)


def test_thresholds_are_between_the_levels() -> None:
    """From the lowest level, or a thousandth of the highest one, to the highest one."""
    for levels, lowest in ((LEVELS, 0.25), ([0.001, 1.0, 8.0], 0.008)):
        staircase = Staircase(levels)
        assert [staircase.quantile(share) for share in (0.0, 1.0)] == pytest.approx([lowest, 8.0])
        assert staircase.quantile(0.5) == pytest.approx(math.sqrt(8.0 * lowest), rel=0.05)


def test_participants_who_are_never_or_always_right() -> None:
    for right, end in ((True, 0.25), (False, 8.0)):
        staircase = Staircase(LEVELS)
        for _ in range(15):
            staircase.add(staircase.level, right)
        assert abs(math.log(staircase.quantile(0.5) / end)) < 0.7 and 0.25 <= staircase.quantile(0.5) <= 8.0 + 1e-9
        low, high = staircase.interval(0.95)
        assert math.isinf(low) == right and math.isinf(high) == (not right) and low < staircase.quantile(0.5) < high
    assert not any(map(math.isinf, Staircase(LEVELS).interval(0.95)))  # nothing is known: nothing is claimed open
