"""Staircases: QUEST+ asks where most is learnt, and finds planted thresholds in 40 trials."""

import math

import numpy as np
import pytest

from hapscene.study.trial_order import LAPSES, SLOPES, Staircase

pytestmark = pytest.mark.nightly

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


def test_the_next_level_is_the_most_informative() -> None:
    """Against the same expected otherwise: the level whose answer has most mutual information with the parameters."""
    threshold, slope, lapse = (
        one.ravel() for one in np.meshgrid(np.geomspace(0.25, 8.0, 80), SLOPES, LAPSES, indexing="ij")
    )
    p = 1.0 - lapse - (0.5 - lapse) * np.exp(-((LEVELS[:, None] / threshold) ** slope))
    p = np.clip(p, 1e-12, 1.0 - 1e-12)
    posterior = np.full(threshold.size, 1.0 / threshold.size)

    def entropy(share: np.ndarray) -> np.ndarray:
        return -(share * np.log(share) + (1.0 - share) * np.log1p(-share))

    staircase = Staircase(LEVELS)
    for right in (True, True, False, True, False, False, True, True, True, False):
        shown = entropy(p @ posterior) - entropy(p) @ posterior
        index = int(np.argmax(shown))
        assert shown[int(np.argmin(abs(LEVELS - staircase.level)))] == pytest.approx(shown[index], rel=1e-9)
        staircase.add(staircase.level, right)
        posterior *= p[index] if right else 1.0 - p[index]
        posterior /= posterior.sum()
    marginal = posterior.reshape(80, -1).sum(axis=1)
    below = np.interp(math.log(staircase.quantile(0.3)), np.log(np.geomspace(0.25, 8.0, 80)), np.cumsum(marginal))
    assert below == pytest.approx(0.3, abs=0.06)  # the grid's half step


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


def test_participants_who_are_never_or_always_right() -> None:
    for right, end in ((True, 0.25), (False, 8.0)):
        staircase = Staircase(LEVELS)
        for _ in range(15):
            staircase.add(staircase.level, right)
        assert abs(math.log(staircase.quantile(0.5) / end)) < 0.7 and 0.25 <= staircase.quantile(0.5) <= 8.0 + 1e-9
        low, high = staircase.interval(0.95)
        assert math.isinf(low) == right and math.isinf(high) == (not right) and low < staircase.quantile(0.5) < high
    assert not any(map(math.isinf, Staircase(LEVELS).interval(0.95)))  # nothing is known: nothing is claimed open


@pytest.mark.soak
@pytest.mark.parametrize("slope", [3.5, 5.0])
def test_thresholds_of_200_participants_within_10_percent(slope: float) -> None:
    """Thresholds from 0.6 to 4, 40 trials each. Flatter slopes are less accurate."""
    planted = np.exp(np.random.default_rng(1).uniform(np.log(0.6), np.log(4.0), 200))
    found = [run(float(one), slope, 0.02, seed) for seed, one in enumerate(planted)]
    ratio = np.array([one.quantile(0.5) for one in found]) / planted
    held = np.mean([a.quantile(0.025) <= b <= a.quantile(0.975) for a, b in zip(found, planted, strict=True)])
    error = np.abs(ratio - 1.0)
    print(
        f"slope {slope}: found / planted {np.median(ratio):.3f} at the median; error {np.median(error):.3f} at the "
        f"median, {np.quantile(error, 0.9):.3f} at the 90th percentile; intervals held {held:.3f}"
    )
    assert np.median(error) < 0.1 and abs(np.median(ratio) - 1.0) < 0.05 and held > 0.92
