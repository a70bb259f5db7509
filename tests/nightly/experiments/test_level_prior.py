"""What is expected of the level over force and speed: against planted surfaces."""

import numpy as np
import pytest

from hapscene.capture.io.hatt import HattModels
from hapscene.dsp.ar_filter import lsf_from_ar
from hapscene_experiments.level_prior import Places, law, learn, left_out, recorded_places, report

MEAN, SD = np.array([0.5, 2.0]), np.array([0.3, 0.6])


@pytest.fixture(scope="module")
def surfaces() -> dict[str, Places]:
    """60 surfaces of known exponents, each known at 12 places to 2 dB."""
    rng, made = np.random.default_rng(3), {}
    for i in range(60):
        at = rng.uniform(np.log([0.5, 0.05]), np.log([5.0, 0.25]), (12, 2))
        power = at @ rng.normal(MEAN, SD) + rng.normal(0.0, 2.0 / 4.343, 12)
        made[f"surface {i}"] = Places(at, power)
    return made


def test_mean_and_spread_of_the_exponents_are_found_without_the_error_of_each(surfaces: dict[str, Places]) -> None:
    laws = [law(places) for places in surfaces.values()]
    prior = learn(laws)
    assert prior.mean == pytest.approx(MEAN, abs=0.2)
    assert np.sqrt(prior.covariance.diagonal()) == pytest.approx(SD, abs=0.12)
    assert np.all(np.std([one for one, _ in laws], axis=0) > np.sqrt(prior.covariance.diagonal()))


def test_what_was_learnt_predicts_a_surface_that_was_left_out(surfaces: dict[str, Places]) -> None:
    for off in left_out(surfaces).values():
        assert off["learnt"] < off["exponents 1 and 1"] < off["clamped"]
    assert "60 surfaces" in report(surfaces)


def test_places_are_those_recorded_at_the_power_that_the_toolkit_plays() -> None:
    """y = e − a y(t−1) has v/(1 − a²) of power, nearly all of it above 20 Hz."""
    force, speed = np.array([0.0, 1.0, 1.0, 2.0, 3.0]), np.array([0.1, 0.05, 0.05, 0.1, 0.2])
    a, variance = 0.5, np.array([0.0, 16.0, 16.0, 45.0, 54.0])
    ar = np.tile(lsf_from_ar(np.array([1.0, a, 0.0])), (5, 1))
    corners = np.array([[0, 1, 2]], np.int32)
    found = recorded_places(HattModels("made", 1000.0, None, force, speed, corners, ar, variance, ()))
    assert np.exp(found.at) == pytest.approx(np.array([[1.0, 0.05], [2.0, 0.1]]))  # no silence, copy or corner
    true = variance[[1, 3]] / (1.0 - a**2)
    assert np.exp(found.power) == pytest.approx(true, rel=0.04)
