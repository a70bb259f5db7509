"""Friction of simulated recordings at 20 dB SNR, and reasons for missing coefficients."""

import numpy as np
import pytest
from scipy import stats

from hapscene.capture.fit.friction import (
    BEGUN_S,
    COMMON_ERROR,
    EDGE_S,
    STROKES_MIN,
    _best_scale,
    _Blocks,
    _blocks,
    _curve,
    _of_slips,
    _of_strokes,
    _robust_weight,
    _slips,
    _strokes,
    fit_friction,
    no_sliding,
)
from hapscene.capture.fit.segment import InteractionState, Segmentation, segment
from hapscene.capture.io.streams import Streams, clean

from ..natural_strokes import dragged
from ..signals import fit, noisy


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


def slides(tangential_N, speed_m_s, sliding, rate=1000.0):
    """A recording at 1 N with given runs of sliding."""
    count = len(tangential_N)
    states = np.where(sliding, InteractionState.SLIDING, InteractionState.AIR).astype(np.int8)
    streams = Streams(rate, np.zeros(count), np.ones(count), speed_m_s, tangential_N)
    return [(streams, Segmentation(rate, states, (), None, None))]


def test_the_reason_for_missing_sliding_has_the_threshold_and_the_highest_speed():
    speed = np.array([0.002, 0.0123, 0.001])
    parts = [
        (Streams(1000.0, speed, np.ones(3), scale * speed, speed), Segmentation(1000.0, np.zeros(3, np.int8), (), *on))
        for scale, on in ((1.0, (0.1, 0.05)), (0.5, (0.1, 0.04)), (1.0, (0.1, None)))
    ]
    assert "40 mm/s" in no_sliding(parts) and "12.3 mm/s" in no_sliding(parts) and no_sliding(parts[2:]) == ""


def test_the_ends_of_sliding_are_omitted():
    """Slides of 0.15 s, which slip more easily in their first and last 50 ms: two thirds of all that slides."""
    cycle, edge = np.arange(100, 20_100) % 500, round(1000.0 * EDGE_S)
    sliding = (cycle >= 200) & (cycle < 350)
    middle = (cycle >= 200 + edge) & (cycle < 350 - edge)
    found = fit_friction(slides(np.where(middle, 0.3, 0.1) * sliding, np.full(len(cycle), 0.1), sliding))
    assert found.dynamic == pytest.approx(0.3, abs=1e-9)
    assert found.intervals["friction_dynamic"] == pytest.approx((0.3, 0.3), rel=2.0 * COMMON_ERROR)


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
    speed = 0.15 * np.sin(np.pi * t / 4) ** 2
    speed[speed < 0.002] = 0.0  # as of a sensor with a threshold
    pull = 0.3 + 0.15 * np.exp(-((speed / 0.03) ** 2)) + 0.002 * np.random.default_rng(0).standard_normal(len(t))
    caught = (speed < 0.03) & (t // 0.05 % 6 == 0)
    found = fit_friction(slides(np.where(caught, 3.0, 1.0) * pull, speed, np.ones(len(t), bool)))
    assert found.dynamic == pytest.approx(0.30, rel=0.02)
    assert found.static == pytest.approx(0.45, rel=0.04)  # by least squares 0.6


def test_the_error_of_a_curve_is_the_weighted_distance_of_the_outliers():
    normal, speed = np.linspace(0.5, 4.0, 40), np.linspace(0.01, 0.2, 40)
    ratio = 0.3 + 0.1 * np.exp(-((speed / 0.05) ** 2))
    ratio[[7, 30]] += 0.5, -0.2
    error, scale_m_s, weight = _curve(np.stack([ratio * normal, normal, speed]), 0.05)
    assert error == pytest.approx(0.5 * normal[7] + 0.2 * normal[30], rel=1e-3) and scale_m_s == 0.05
    assert weight[7] < 0.01 * weight[8] and weight[8] == pytest.approx(np.sqrt(normal[8]))


def test_outliers_have_hardly_any_weight():
    speed = np.linspace(0.005, 0.155, 60)
    ratio = 0.3 + 0.15 * np.exp(-((speed / 0.03) ** 2))
    ratio[5::10] += 0.5
    blocks = _Blocks(ratio, np.full(60, 4.0), speed, speed[:, None], np.zeros(60, int))
    weight = _robust_weight(blocks, np.geomspace(0.0025, 0.08, 24))
    assert weight[5::10].max() < 0.1 * np.median(weight) and np.quantile(weight, 0.5) == pytest.approx(2.0, rel=0.02)


def test_each_stroke_has_its_stribeck_speed():
    """The grid about the best speed of all rows is fine enough for the best speed of each."""
    speed = np.tile(np.linspace(0.005, 0.155, 40), 2)
    true_m_s, rows = np.repeat([0.02, 0.06], 40), np.ones((3, 80))
    rows[1, 40:] = rows[2, :40] = 0.0
    ratio = 0.3 + 0.15 * np.exp(-((speed / true_m_s) ** 2))
    blocks = _Blocks(ratio, np.ones(80), speed, speed[:, None], np.zeros(80, int))
    (level, drop), scale_m_s = _best_scale(blocks, rows, np.ones(80), np.geomspace(0.0025, 0.08, 24), np.ones(80))
    assert scale_m_s[1:] == pytest.approx([0.02, 0.06], rel=0.03)
    assert level[1:] == pytest.approx(0.3, rel=0.01) and drop[1:] == pytest.approx(0.15, rel=0.03)


def test_static_friction_needs_rest_and_force():
    """Three starts from rest: one after a rest too brief to count, one of a tool that hardly touches."""
    rate, cycle = 1000.0, np.arange(6000) % 1000
    states = np.where(cycle < 400, InteractionState.STILL, InteractionState.SLIDING).astype(np.int8)
    start = (cycle >= 380) & (cycle < 420)
    force, pull = np.ones(6000), np.where(start, 0.5, 0.3)
    pull[(cycle % 500 >= 100) & (cycle % 500 < 120)] = 0.7  # long before and long after a breakaway
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


def test_slips_start_at_the_static_and_move_at_the_dynamic_friction():
    """20 ms of rest, 40 ms of a growing pull, 20 ms of a slip; twenty times, with one lifted and one long slip."""
    rate, cycle, number = 2000.0, np.arange(3200) % 160, np.arange(3200) // 160
    slips = cycle >= 120
    speed = np.where(slips, 0.2 * np.sin(np.pi * (cycle - 120) / 40), 0.0)
    pull = np.where(slips, 0.3, 0.15 + 0.3 * np.maximum(cycle - 40, 0) / 80 + 1e-3 * (-1.0) ** cycle)
    states = np.where(slips, InteractionState.SLIDING, InteractionState.STILL).astype(np.int8)
    states[(number == 7) & (cycle > 20) & (cycle < 40)] = InteractionState.AIR
    speed[(number == 12) & ~slips] = 0.1
    normal = 1.0 + 0.05 * number
    recording = Streams(rate, 0.0 * speed, normal, speed, pull * normal), Segmentation(rate, states, (), 0.1, 0.02)
    found = _slips([recording])
    assert len(found) == 17  # without the first one, too
    np.testing.assert_allclose([one[:3] for one in found], [(0.45, 7.5 * BEGUN_S, 0.3)] * 17, rtol=0.02)
    friction = _of_slips(found)
    assert (friction.static, friction.dynamic) == pytest.approx((0.45, 0.3), rel=0.01)
    for name, value in (("friction_static", 0.45), ("friction_dynamic", 0.3)):
        low, high = friction.intervals[name]
        assert low <= value <= high and high - low < 0.1
    still = recording[0], Segmentation(rate, states, (), 0.1, 1.0)
    assert _slips([still]) == [] and "17 slips" in no_sliding([recording]) and "0.2" not in no_sliding([recording])


def test_intervals_of_slips():
    """Equal slips differ by their common uncertainty alone; static friction is never below dynamic friction."""
    friction = _of_slips([(0.45, 0.01, 0.3, 0.1)] * 5)
    assert friction.intervals["friction_static"] == pytest.approx((0.45 - 0.0196, 0.45 + 0.0196))
    assert friction.intervals["friction_dynamic"] == pytest.approx((0.3 - 1.96 * 0.015, 0.3 + 1.96 * 0.015))
    friction = _of_slips([(0.2, 0.01, 0.3, 0.1)] * 5)
    assert (friction.static, friction.dynamic) == (0.3, 0.3)
    assert friction.intervals["friction_dynamic"] == pytest.approx((0.3, 0.3))


def test_strokes_end_at_minima_of_the_speed_or_after_one_second():
    speed = np.array([0.1, 0.2, 0.05, 0.04, 0.07, 0.09, 0.2, 0.05, 0.2])
    assert _strokes(speed).tolist() == [0, 0, 0, 1, 1, 1, 1, 2, 2]
    assert _strokes(np.full(65, 0.1)).tolist() == [3 * i // 65 for i in range(65)]


def test_blocks_without_normal_force_are_omitted():
    force, speed = np.repeat([1.0, 2.0, 0.15, 0.25, 1.0], 50), np.linspace(0.1, 0.2, 250)
    streams = Streams(1000.0, speed, force, speed, -0.3 * force)
    found = _blocks([(streams, Segmentation(1000.0, np.full(250, InteractionState.SLIDING, np.int8), (), None, None))])
    assert found.ratio == pytest.approx([0.3] * 4) and found.normal == pytest.approx([1.0, 2.0, 0.25, 1.0])
    assert found.speed == pytest.approx(speed.reshape(5, 50).mean(axis=1)[[0, 1, 3, 4]])
    assert found.fine == pytest.approx(speed.reshape(5, 50)[[0, 1, 3, 4], 2::5]) and found.count == 1


def test_the_interval_of_strokes_is_that_of_their_mean():
    """Student's t of five strokes with equal forces, and the error that all have in common."""
    ratio = np.repeat([0.29, 0.31, 0.30, 0.28, 0.32], 4)
    blocks = _Blocks(ratio, np.ones(20), np.ones(20), np.ones((20, 1)), np.repeat(np.arange(5), 4))
    half = np.hypot(stats.t.ppf(0.975, 4) * np.std(ratio[::4], ddof=1) / np.sqrt(5.0), 1.96 * COMMON_ERROR * 0.3)
    assert _of_strokes(blocks, 0.3) == pytest.approx((0.3 - half, 0.3 + half))


@pytest.mark.nightly
def test_stick_slip_gives_friction_and_no_texture():
    """37 ms of rest, 23 ms of a slip."""
    rng, rate, count, fine = np.random.default_rng(0), 5000.0, 12_500, 8
    normal = 1.5 + 0.2 * np.sin(2.1 * np.arange(count) / rate)
    pulled = np.full(count * fine, 0.0115), np.repeat(normal, fine), 1.0 / (fine * rate)
    friction = {"static": 0.45, "dynamic": 0.3, "stribeck_m_s": 1e-9, "viscous_s_m": 0.0}
    moved = dragged(*pulled, **friction, mass_kg=0.05, spring_N_m=1000.0, damping_Ns_m=1.0)
    speed, tangential = moved.reshape(2, count, fine).mean(axis=2)
    acceleration = rng.standard_normal(count) * (0.02 + 20.0 * speed)
    streams = {"force_N": normal, "speed_m_s": speed, "tangential_force_N": tangential}
    recorded = {name: np.abs(noisy(stream, rng)) for name, stream in streams.items()}
    swatch = fit(acceleration, rate, **recorded)
    assert swatch.friction_static == pytest.approx(0.45, rel=0.06)
    assert swatch.friction_dynamic == pytest.approx(0.30, rel=0.03)
    for name, planted in (("friction_static", 0.45), ("friction_dynamic", 0.3)):
        low, high = swatch.intervals[name]
        assert low <= planted <= high and high - low < 0.1
    assert swatch.texture is None and "stick–slip" in swatch.absent["texture"]
