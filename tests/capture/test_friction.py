"""Friction and stiffness whose truth is known, at 20 dB, and reasons where there is none."""

import numpy as np
import pytest

from hapscene.capture.friction import fit_friction
from hapscene.capture.segment import segment
from hapscene.capture.stiffness import fit_stiffness
from hapscene.capture.streams import clean


def part(acceleration, rate_Hz, *streams, **named):
    channels = clean(acceleration, rate_Hz, *streams, **named)
    return channels, segment(channels)


def handled(truth):
    names = ("force_N", "speed_m_s", "tangential_force_N", "depth_m")
    return [part(truth.acceleration_m_s2, truth.rate_Hz, **{name: getattr(truth, name) for name in names})]


def stroke(friction, seed=0, seconds=20.0, rate=2000.0):
    """A hand that strokes to and fro, 5 to 155 mm/s, 1 to 2 N; noise of 20 dB on both forces."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    speed, normal = 0.005 + 0.15 * np.sin(np.pi * t / 4) ** 2, 1.5 + 0.5 * np.sin(2.1 * t)
    tangential = friction(speed) * normal
    noisy = [x + 0.1 * np.sqrt(np.mean(x**2)) * rng.standard_normal(len(t)) for x in (normal, tangential)]
    return [part(rng.standard_normal(len(t)), rate, noisy[0], speed, noisy[1])]


@pytest.mark.parametrize("seed", range(3))
def test_dynamic_friction_within_2_percent(seed, handled_recording):
    found = fit_friction(handled(handled_recording(seed)))
    assert found.dynamic == pytest.approx(0.35, rel=0.02)
    low, high = found.intervals["friction_dynamic"]
    assert low <= found.dynamic <= high and high - low < 0.02
    assert found.dynamic <= found.static < 0.38  # it slides off without a jerk


def test_static_friction_is_the_pull_at_which_it_breaks_away():
    rng, rate = np.random.default_rng(0), 2000.0
    t = np.arange(16_000) % 4000 / rate  # each 2 s: the pull grows for 1 s, then it slides
    speed = np.where(t < 1.0, 0.0, 0.1)
    normal = 1.5 + 0.1 * np.sin(np.arange(16_000) / 900)
    pull = np.where(t < 1.0, 0.6 * t, 0.4) * normal
    vibration = np.where(speed > 0.0, 1.0, 0.01) * rng.standard_normal(len(t))
    noisy = [x + 0.1 * np.sqrt(np.mean(x**2)) * rng.standard_normal(len(t)) for x in (normal, pull)]
    found = fit_friction([part(vibration, rate, noisy[0], speed, noisy[1])])
    assert found.dynamic == pytest.approx(0.4, rel=0.02)
    assert found.static == pytest.approx(0.6, rel=0.08)
    assert "friction_static" in found.intervals and "starts from rest" in found.note


@pytest.mark.parametrize("seed", range(2))
def test_stribeck_where_the_speeds_allow(seed):
    found = fit_friction(stroke(lambda v: 0.3 + 0.15 * np.exp(-((v / 0.03) ** 2)), seed))
    assert found.dynamic == pytest.approx(0.30, rel=0.02)
    assert found.static == pytest.approx(0.45, rel=0.02)
    assert "falls with speed" in found.note and "friction_stribeck" not in found.absent


def test_where_friction_does_not_fall_there_is_no_curve():
    found = fit_friction(stroke(lambda v: 0.3 + 0.0 * v))
    assert found.static == found.dynamic == pytest.approx(0.30, rel=0.02)
    assert "does not fall" in found.absent["friction_stribeck"]
    assert "never starts from rest" in found.absent["friction_static"]


def test_what_is_not_recorded_is_absent_with_the_reason():
    noise = np.random.default_rng(0).standard_normal(20_000)
    nothing = [part(noise, 5000.0)]
    assert "no tangential force" in fit_friction(nothing).absent["friction_dynamic"]
    assert fit_friction(nothing).dynamic == 0.0
    assert fit_stiffness(nothing).reason == "the recording holds no depth"
    sliding = 1.0 + 0.1 * np.sin(np.arange(20_000) / 2000)
    assert "without sliding" in fit_stiffness([part(noise, 5000.0, sliding, depth_m=1e-3 * sliding)]).reason


@pytest.mark.parametrize("seed", range(3))
def test_stiffness(seed, handled_recording):
    found = fit_stiffness(handled(handled_recording(seed)))
    assert found.slope_N_m == pytest.approx(500.0, rel=0.03)
    assert found.interval is not None and found.interval[0] < found.slope_N_m < found.interval[1]


def test_force_that_does_not_follow_depth_is_no_stiffness(handled_recording):
    truth = handled_recording(0)
    truth.depth_m = np.random.default_rng(0).standard_normal(len(truth.depth_m)) * 1e-3
    found = fit_stiffness(handled(truth))
    assert found.slope_N_m is None and "no line" in found.reason
