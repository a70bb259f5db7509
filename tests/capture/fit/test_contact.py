"""Damping, adhesion, leaving and breaking loose planted in noisy recordings, found within their intervals."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter1d

from hapscene.capture.fit.contact import ContactFit, _burst, _pull, _windows, fit_contact
from hapscene.capture.fit.segment import segment
from hapscene.capture.io.streams import HAND_CUTOFF_HZ, Streams, clean, filtered, part_of

RATE_HZ, STIFFNESS_N_M = 1000.0, 500.0
UP_M = 5e-3


def ring(count, at, amplitude, frequency_Hz, decay_1_s, rate_Hz):
    t_s = np.maximum(np.arange(count) / rate_Hz - at, 0.0)
    return amplitude * np.exp(-decay_1_s * t_s) * np.sin(2 * np.pi * frequency_Hz * t_s)


def presses(
    seed=0, damping=0.0, hunt_crossley=0.0, adhesion=0.0, reach_m=5e-4,
    late_s=0.0, noise_N=0.02, noise_m=1e-5, rings=0.0, has_depth=True, rate_Hz=RATE_HZ,
):  # fmt: skip
    """Eight presses of some 3 mm at 10 to 60 mm/s, from the air and back, of smooth turns."""
    rng = np.random.default_rng(seed)
    depth = []
    for speed in np.geomspace(0.01, 0.06, 8):
        top = 3e-3 * rng.uniform(0.6, 1.0)
        ramp = np.linspace(-UP_M, top, round(rate_Hz * (top + UP_M) / speed))
        depth += [np.full(round(0.2 * rate_Hz), -UP_M), ramp, np.full(round(0.1 * rate_Hz), top), ramp[::-1]]
    depth = np.concatenate([*depth, np.full(round(0.3 * rate_Hz), -UP_M)])
    turn = np.hanning(round(0.04 * rate_Hz) | 1)
    depth = np.convolve(np.pad(depth, len(turn) // 2, "edge"), turn / turn.sum(), "valid")
    rate = np.gradient(depth) * rate_Hz
    into, beyond = np.maximum(depth, 0.0), np.maximum(-depth, 0.0) / reach_m
    force = np.where(depth > 0.0, np.maximum(0.0, STIFFNESS_N_M * into + (damping + hunt_crossley * into) * rate), 0.0)
    force -= np.where(rate < 0.0, adhesion * beyond * np.exp(1.0 - beyond), 0.0)
    force = np.interp(np.arange(len(force)) - late_s * rate_Hz, np.arange(len(force)), force)
    a = 0.01 * rng.standard_normal(len(depth))
    for left in np.flatnonzero((depth[1:] <= 0.0) & (depth[:-1] > 0.0)):
        a += ring(len(a), left / rate_Hz, -rings * rate[left], 170.0, 80.0, rate_Hz)
    force, depth = (x + s * rng.standard_normal(len(x)) for x, s in ((force, noise_N), (depth, noise_m)))
    channels = clean(a, rate_Hz, force, *((0.0, None, depth) if has_depth else (np.abs(rate),)))
    return [(channels, segment(channels))]


@pytest.mark.parametrize(
    ("name", "truth", "more"),
    [
        ("damping_Ns_m", 3.0, {}),
        ("damping_Ns_m", 3.0, {"noise_N": 0.06, "noise_m": 3e-5, "rate_Hz": 10_000.0}),
        ("hunt_crossley_Ns_m2", 800.0, {}),
    ],
)
def test_damping_and_its_type_are_found(name, truth, more):
    planted = {"damping": truth} if name == "damping_Ns_m" else {"hunt_crossley": truth}
    found = [fit_contact(presses(seed, **planted, **more)) for seed in range(4)]
    assert all(one.numbers.keys() == {"stiffness_N_m", name} for one in found)
    for number, value in ((name, truth), ("stiffness_N_m", STIFFNESS_N_M)):
        hits = [low <= value <= high for low, high in (one.intervals[number] for one in found)]
        assert sum(hits) >= 3 and found[0].numbers[number] == pytest.approx(value, rel=0.15)


def test_missing_quantities_have_reasons():
    assert "not significantly" in fit_contact(presses()).absent["damping_Ns_m"]
    late = fit_contact(presses(late_s=2e-3))
    delay_ms = float(late.absent["damping_Ns_m"].partition("delayed by ")[2].split()[0])
    assert delay_ms == pytest.approx(2.0, abs=0.11)
    ((channels, states),) = presses()
    channels = clean(channels.acceleration_m_s2, RATE_HZ, channels.force_N, 0.0)
    assert fit_contact([(channels, states)]).absent.keys() == {
        *("damping_Ns_m", "adhesion_N", "leaving", "breakaway_1_kg"),
    }


def test_few_presses_have_no_damping():
    ((channels, _),) = presses(damping=5.0)
    end = int(np.flatnonzero(np.diff((channels.depth_m > 0.0).astype(int)) < 0)[2]) + 200
    first = part_of(channels, slice(end))
    assert "3 presses" in fit_contact([(first, segment(first))]).absent["damping_Ns_m"]


@pytest.mark.parametrize(("adhesion_N", "reach_m", "damping"), [(0.5, 5e-4, 0.0), (0.15, 1e-3, 0.0), (0.8, 3e-4, 3.0)])
def test_adhesion_is_within_its_interval(adhesion_N, reach_m, damping):
    found = [fit_contact(presses(seed, damping, 0.0, adhesion_N, reach_m)) for seed in range(4)]
    for name, truth in (("adhesion_N", adhesion_N), ("adhesion_range_m", reach_m)):
        assert all(one.numbers[name] == pytest.approx(truth, rel=0.05) for one in found)
        assert sum(one.intervals[name][0] <= truth <= one.intervals[name][1] for one in found) >= 3


def test_adhesion_without_recorded_depth_uses_the_speed():
    found = fit_contact(presses(adhesion=0.5, has_depth=False))
    assert found.numbers["adhesion_N"] == pytest.approx(0.5, rel=0.03)
    assert found.numbers["adhesion_range_m"] == pytest.approx(5e-4, rel=0.03)
    ((channels, states),) = presses(adhesion=0.5, has_depth=False)
    channels.speed_m_s[:] = 0.1  # it slides before and after it leaves
    channels.speed_m_s[0] = 0.0
    assert "adhesion_N" in fit_contact([(channels, states)]).absent


@pytest.mark.parametrize(("pressed_N", "pulled_N", "fits"), [(0.0, 0.0, True), (0.8, 0.0, False), (0.0, 1.5, False)])
def test_a_curve_that_spring_and_adhesion_do_not_explain_has_no_adhesion(pressed_N, pulled_N, fits):
    """With a wave in the force before or after the surface pulls: of the total, or of the pull, too much is left."""
    depth = np.linspace(2e-3, -3e-3, 500)
    beyond = np.maximum(-depth, 0.0) / 5e-4
    force = 1500.0 * np.maximum(depth, 0.0) - 1.5 * beyond * np.exp(1.0 - beyond)
    wave = np.sin(2.0 * np.pi * np.arange(500) / 100.0)
    found = _pull(force + np.where(depth > 0.0, pressed_N, pulled_N) * wave, depth, RATE_HZ, {})
    assert (found is not None) == fits
    assert not fits or found[0] == pytest.approx([1.5, 5e-4], rel=0.02)
    force[11:40] += 3.0  # unlike the first and last 10 ms, this counts
    assert _pull(force, depth, RATE_HZ, {}) is None


def test_the_error_of_adhesion_is_its_scatter():
    depth = np.linspace(1e-3, -3e-3, 400)
    beyond = np.maximum(-depth, 0.0) / 5e-4
    force = 1500.0 * np.maximum(depth, 0.0) - 1.5 * beyond * np.exp(1.0 - beyond)
    noise = filtered(np.random.default_rng(0).standard_normal((16, 400)), RATE_HZ, HAND_CUTOFF_HZ, "lowpass")
    found = np.array([_pull(force + 0.1 * row, depth, RATE_HZ, {}) for row in noise])
    np.testing.assert_allclose(found[:, 1].mean(axis=0), found[:, 0].std(axis=0), rtol=0.4)


def test_adhesion_is_fitted_to_the_last_30_ms_of_a_contact():
    ((channels, states),) = presses(adhesion=0.5, reach_m=1e-3)
    deep = (channels.depth_m > 1e-3) & (maximum_filter1d(channels.depth_m, 401) - channels.depth_m < 1e-4)
    channels.force_N[:] += np.roll(deep, -50) * 0.4 * np.sin(np.arange(len(deep)) / 2.0)  # until 50 ms before it rises
    assert fit_contact([(channels, states)]).numbers["adhesion_N"] == pytest.approx(0.5, rel=0.05)


def test_interval_of_a_parameter_is_not_negative():
    found = ContactFit()
    found.add(("one", "two"), np.array([1.0, 2.0]), np.array([3.0, 0.5]))
    assert found.numbers == {"one": 1.0, "two": 2.0} and found.intervals == {"one": (0.0, 4.0), "two": (1.5, 2.5)}


def pushed(depth_m, force_N):
    return Streams(RATE_HZ, depth_m, force_N, depth_m, None, depth_m)


def test_window_averages_of_a_steady_press():
    """Of a press at 10 mm/s: force, depth, speed, and their product; the zero of depth is where the spring begins."""
    depth, force = 1e-5 * np.arange(400), 500.0 * 1e-5 * np.arange(1, 401)
    mean, deep, speed, both = _windows(pushed(0.3 + depth, force), (0, 400)).T
    assert len(mean) == (380 - 31) // 15 + 1 and mean == pytest.approx(5e-3 * (10 + 15 + 15 * np.arange(24) + 1))
    assert deep == pytest.approx(mean / 500.0) and speed == pytest.approx(0.01, rel=0.002)
    assert both == pytest.approx(0.01 * deep, rel=0.002)
    mean, deep, speed, _ = _windows(pushed(0.3 - depth, force), (0, 400)).T  # no spring: from the smallest depth
    assert deep == pytest.approx(1e-5 * (389 - 25 - 15 * np.arange(24))) and speed == pytest.approx(-0.01, rel=0.002)
    for streams, run in ((pushed(0.0 * depth, force), (0, 400)), (pushed(depth, force), (0, 81))):
        assert _windows(streams, run).shape == (0, 4)


def test_bursts_are_stronger_than_the_vibration_around_them():
    a = ring(1000, 0.5, 20.0, 170.0, 80.0, RATE_HZ) + 0.01 * np.random.default_rng(0).standard_normal(1000)
    earlier = ring(1000, 0.3, 200.0, 170.0, 80.0, RATE_HZ)
    streams = [pushed(a + more, a) for more in (0.0, earlier, 8.0 * (np.arange(1000) > 560))]
    for channels, first in ((streams[0], 0), (streams[1], 200)):  # the earlier one is not within 20 ms
        tap = _burst(channels, first, 500, 0.1)
        assert tap.value == pytest.approx([20.0, 170.0, 80.0], rel=0.1)
    assert _burst(streams[2], 0, 500, 0.1) is None  # it goes on vibrating
    assert _burst(streams[0], 515, 520, 0.1) is None  # it began before the contact


def test_vibration_of_leaving_over_speed():
    found = fit_contact(presses(rings=40.0, rate_Hz=5000.0))
    taps = found.leaving
    assert taps is not None and len(taps.approach_m_s) >= 4
    np.testing.assert_allclose(taps.amplitude_m_s2 / taps.approach_m_s, 40.0, rtol=0.2)
    np.testing.assert_allclose(taps.frequency_Hz, 170.0, rtol=0.02)
    assert "leaving.frequency_Hz[0]" in found.intervals and "leaving" not in found.absent


def test_breakaway_vibration_over_released_force():
    rng, rate = np.random.default_rng(0), 5000.0
    t = np.arange(20_000) % 4000 / rate  # each 0.8 s: the pull grows, then it slides quietly
    normal = 1.0 + 0.5 * np.repeat(np.arange(5) % 2, 4000)
    pull = np.where((t > 0.1) & (t < 0.12), 0.9, np.where(t < 0.5, 1.0 * t, 0.3)) * normal  # a tug before it slides
    speed = np.where(t < 0.5, 0.0, 0.1)
    a = 0.02 * rng.standard_normal(len(t))
    for k in range(5):
        a += ring(len(a), 0.8 * k + 0.5, 30.0 * 0.2 * normal[4000 * k], 150.0, 90.0, rate)
    noisy = [x + 5e-3 * rng.standard_normal(len(t)) for x in (normal, pull)]
    channels = clean(a, rate, noisy[0], speed, noisy[1])
    found = fit_contact([(channels, segment(channels))])
    for name, truth in (("breakaway_1_kg", 30.0), ("breakaway_Hz", 150.0), ("breakaway_decay_1_s", 90.0)):
        assert found.numbers[name] == pytest.approx(truth, rel=0.1), name
