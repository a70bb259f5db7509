"""Friction of simulated recordings at 20 dB SNR, and reasons for missing coefficients."""

import numpy as np
import pytest

from hapscene.capture.fit.friction import COMMON_ERROR, EDGE_S, STROKES_MIN, _curve, _strokes, fit_friction
from hapscene.capture.fit.segment import InteractionState, Segmentation, segment
from hapscene.capture.fit.stiffness import fit_stiffness
from hapscene.capture.io.streams import Streams, clean

from ..simulated_tool import noisy

pytestmark = pytest.mark.nightly


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
    forces = [noisy(x, rng) for x in (normal, tangential)]
    return [part(rng.standard_normal(len(t)), rate, forces[0], speed, forces[1])]


@pytest.mark.parametrize("seed", range(3))
def test_dynamic_friction_within_2_percent(seed, handled_recording):
    found = fit_friction(3 * handled(handled_recording(seed)))
    assert found.dynamic == pytest.approx(0.35, rel=0.02)
    low, high = found.intervals["friction_dynamic"]
    assert low <= found.dynamic <= high and high - low < 0.02
    assert found.dynamic <= found.static < 0.38  # it slides off without a jerk


def broken_away(seed=0, times=4):
    """A pull that grows for a second, until the tool slides for another."""
    rng, rate = np.random.default_rng(seed), 2000.0
    t = np.arange(4000 * times) % 4000 / rate
    normal = 1.5 + 0.1 * np.sin(np.arange(len(t)) / 900)
    pull = np.where(t < 1.0, 0.6 * t, 0.4) * normal
    vibration = np.where(t < 1.0, 0.01, 1.0) * rng.standard_normal(len(t))
    forces = [noisy(x, rng) for x in (normal, pull)]
    return [part(vibration, rate, forces[0], np.where(t < 1.0, 0.0, 0.1), forces[1])]


def test_static_friction_at_breakaway():
    found = fit_friction(broken_away())
    assert found.dynamic == pytest.approx(0.4, rel=0.02)
    assert found.static == pytest.approx(0.6, rel=0.08)
    assert "friction_static" in found.intervals and "breakaways" in found.note


@pytest.mark.parametrize("seed", range(2))
def test_stribeck_curve(seed):
    found = fit_friction(stroke(lambda v: 0.3 + 0.15 * np.exp(-((v / 0.03) ** 2)), seed))
    assert found.dynamic == pytest.approx(0.30, rel=0.02)
    assert found.static == pytest.approx(0.45, rel=0.02)
    assert "decreases with speed" in found.note and "friction_stribeck" not in found.absent


@pytest.mark.parametrize("seed", range(2))
def test_stribeck_and_viscous_friction(seed):
    """Parameters are within their intervals plus 0.5 % for averaging over blocks, also with viscous growth only."""
    found = fit_friction(stroke(lambda v: 0.3 + 0.15 * np.exp(-((v / 0.02) ** 2)) + 0.8 * v, seed, 30.0))
    truth = {"friction_dynamic": 0.3, "friction_static": 0.45, "friction_stribeck_m_s": 0.02}
    for name, value in (truth | {"friction_viscous_s_m": 0.8}).items():
        low, high = found.intervals[name]
        assert 0.995 * low <= value <= 1.005 * high and high - low < 0.5 * value, name
    assert found.stribeck_m_s == pytest.approx(0.02, rel=0.2) and found.viscous_s_m == pytest.approx(0.8, rel=0.2)
    alone = fit_friction(stroke(lambda v: 0.3 + 0.8 * v, seed))
    assert alone.dynamic == pytest.approx(0.3, rel=0.02) and alone.stribeck_m_s == 0.0
    low, high = alone.intervals["friction_viscous_s_m"]
    assert 0.995 * low <= 0.8 <= 1.005 * high and "does not decrease" in alone.absent["friction_stribeck"]


def test_constant_friction_has_no_stribeck_curve():
    found = fit_friction(stroke(lambda v: 0.3 + 0.0 * v))
    assert found.static == found.dynamic == pytest.approx(0.30, rel=0.02)
    assert "does not decrease" in found.absent["friction_stribeck"]
    assert "never starts from rest" in found.absent["friction_static"]


def test_missing_streams_are_reasons():
    noise = np.random.default_rng(0).standard_normal(20_000)
    nothing = [part(noise, 5000.0)]
    assert "tangential force" in fit_friction(nothing).absent["friction_dynamic"]
    assert fit_friction(nothing).dynamic == 0.0
    assert fit_stiffness(nothing).reason == "the depth was not recorded"
    sliding = 1.0 + 0.1 * np.sin(np.arange(20_000) / 2000)
    assert "without sliding" in fit_stiffness([part(noise, 5000.0, sliding, depth_m=1e-3 * sliding)]).reason


@pytest.mark.parametrize("seed", range(3))
def test_stiffness(seed, handled_recording):
    found = fit_stiffness(handled(handled_recording(seed)))
    assert found.slope_N_m == pytest.approx(500.0, rel=0.03)
    assert found.interval is None and "2 presses" in found.reason


def test_uncorrelated_force_gives_no_stiffness(handled_recording):
    truth = handled_recording(0)
    truth.depth_m = np.random.default_rng(0).standard_normal(len(truth.depth_m)) * 1e-3
    found = fit_stiffness(handled(truth))
    assert found.slope_N_m is None and "not proportional" in found.reason


def slides(tangential_N, speed_m_s, sliding, rate=1000.0):
    """A recording at 1 N with given runs of sliding."""
    count = len(tangential_N)
    states = np.where(sliding, InteractionState.SLIDING, InteractionState.AIR).astype(np.int8)
    streams = Streams(rate, np.zeros(count), np.ones(count), speed_m_s, tangential_N)
    return [(streams, Segmentation(rate, states, (), None, None))]


def test_the_ends_of_sliding_are_omitted():
    """Slides of 0.15 s, which slip more easily in their first and last 50 ms: two thirds of all that slides."""
    cycle, edge = np.arange(100, 20_100) % 500, round(1000.0 * EDGE_S)
    sliding = (cycle >= 200) & (cycle < 350)
    middle = (cycle >= 200 + edge) & (cycle < 350 - edge)
    found = fit_friction(slides(np.where(middle, 0.3, 0.1) * sliding, np.full(len(cycle), 0.1), sliding))
    assert found.dynamic == pytest.approx(0.3, abs=1e-9)
    assert found.intervals["friction_dynamic"] == pytest.approx((0.3, 0.3), rel=2.0 * COMMON_ERROR)


def test_the_ends_of_the_recording_are_not_omitted():
    whole = slides(np.full(150, 0.3), np.full(150, 0.1), np.ones(150, bool))
    assert fit_friction(whole).dynamic == pytest.approx(0.3)
    inside = np.zeros(250, bool)
    inside[50:200] = True
    assert fit_friction(slides(np.full(250, 0.3), np.full(250, 0.1), inside)).dynamic == 0.0  # one block is left


def test_strokes_end_at_reversals_and_after_a_second():
    to_and_fro = np.abs(np.sin(np.pi * (np.arange(60) + 0.5) / 20.0))
    assert _strokes(to_and_fro).tolist() == sorted(20 * [0, 1, 2])
    assert _strokes(1.0 + 0.3 * to_and_fro).tolist() == sorted(20 * [0, 1, 2])  # steady: pieces of 1 s
    assert _strokes(to_and_fro[:20]).tolist() == 20 * [0]


@pytest.mark.parametrize("count", [STROKES_MIN - 1, STROKES_MIN])
def test_few_strokes_give_a_coefficient_and_no_interval(count):
    cycle = np.arange(500 * count) % 500
    found = fit_friction(slides(np.where(cycle >= 100, 0.3, 0.0), np.full(len(cycle), 0.1), cycle >= 100))
    assert found.dynamic == pytest.approx(0.3, abs=1e-9)
    assert ("friction_dynamic" in found.intervals) == (count >= STROKES_MIN)
    assert ("friction_dynamic.interval" in found.absent) == (count < STROKES_MIN)


def test_outliers_do_not_change_the_stribeck_curve():
    """Each sixth of the slow blocks pulls three times as much."""
    t = np.arange(20_000) / 1000.0
    speed = 0.005 + 0.15 * np.sin(np.pi * t / 4) ** 2
    pull = 0.3 + 0.15 * np.exp(-((speed / 0.03) ** 2)) + 0.002 * np.random.default_rng(0).standard_normal(len(t))
    caught = (speed < 0.03) & (t // 0.05 % 6 == 0)
    found = fit_friction(slides(np.where(caught, 3.0, 1.0) * pull, speed, np.ones(len(t), bool)))
    assert found.dynamic == pytest.approx(0.30, rel=0.02)
    assert found.static == pytest.approx(0.45, rel=0.04)  # by least squares 0.6


def test_the_curve_is_a_huber_estimate():
    """Against SciPy's own robust least squares, at the bound where the reweighting ends."""
    from scipy.optimize import least_squares

    rng = np.random.default_rng(0)
    speed = rng.uniform(0.005, 0.2, 200)
    ratio = 0.3 + 0.15 * np.exp(-((speed / 0.04) ** 2)) + 0.01 * rng.standard_normal(200)
    ratio[::9] += 0.5
    matrix = np.stack([np.ones(200), np.exp(-((speed / 0.04) ** 2))], axis=1)
    error, _, weight = _curve(np.stack([2.0 * ratio, np.full(200, 2.0), speed]), 0.04)
    found = np.linalg.lstsq(weight[:, None] * matrix, weight * ratio, rcond=None)[0]
    away = np.abs(ratio - matrix @ found)
    bound = 1.345 * 1.4826 * np.median(away)
    huber = least_squares(lambda x: matrix @ x - ratio, [0.0, 0.0], loss="huber", f_scale=bound)
    np.testing.assert_allclose(found, huber.x, atol=1e-4)
    assert error == pytest.approx(np.sum(2.0 * away), rel=1e-3)
    assert np.sum(weight**2 / 2.0 < 0.1) == len(ratio[::9])  # what is off counts for little, and nothing else


def test_static_friction_needs_rest_and_force():
    """Three starts from rest: one after a rest too brief to count, one of a tool that hardly touches."""
    rate, cycle = 1000.0, np.arange(6000) % 1000
    states = np.where(cycle < 400, InteractionState.STILL, InteractionState.SLIDING).astype(np.int8)
    start = (cycle >= 380) & (cycle < 420)
    force, pull = np.ones(6000), np.where(start, 0.5, 0.3)
    states[3000:3380] = InteractionState.SLIDING  # a rest of 20 ms is too short for a breakaway
    pull[3380:3420] = 0.8
    force[5200:5600] = 0.05
    pull[5200:5600] = 0.9 * 0.05
    streams = Streams(rate, np.zeros(6000), force, np.full(6000, 0.1), pull)
    found = fit_friction([(streams, Segmentation(rate, states, (), None, None))])
    assert (
        found.static == pytest.approx(0.5, rel=1e-6) and found.note == "Static friction is the median of 4 breakaways."
    )
    assert found.dynamic == pytest.approx(0.3, rel=1e-6)


def test_an_abrupt_breakaway_counts_fully():
    cycle = np.arange(4000) % 1000
    states = np.where(cycle < 400, InteractionState.STILL, InteractionState.SLIDING).astype(np.int8)
    pull = np.where(np.abs(cycle - 400) <= 6, 0.5, 0.3)
    streams = Streams(1000.0, np.zeros(4000), np.ones(4000), np.full(4000, 0.1), pull)
    found = fit_friction([(streams, Segmentation(1000.0, states, (), None, None))])
    assert found.static == pytest.approx(0.5, rel=1e-6)
