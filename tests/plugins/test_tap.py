"""Tap transients: decaying sinusoids and recorded transients by approach speed."""

import numpy as np
import pytest

from hapscene.surface.effect import load_effect
from hapscene.surface.swatch import PLAIN
from hapscene.surface.taps import Taps

TAP = load_effect("tap")
TAPS = Taps(np.array([0.05, 0.3]), np.array([5.0, 30.0]), np.array([180.0, 260.0]), np.array([70.0, 90.0]))


def sinusoid(tap, count, rate_Hz=10_000.0):
    t_s = np.arange(count) / rate_Hz
    return tap.amplitude_m_s2 * np.exp(-tap.decay_1_s * t_s) * np.sin(2 * np.pi * tap.frequency_Hz * t_s)


def contact(ticks, count, speed_m_s, **fields):
    rows = ticks(count, approach_m_s=speed_m_s, **fields)
    rows["began"][0] = 1
    return rows


@pytest.mark.parametrize("speed_m_s", [0.01, 0.05, 0.13, 0.3])
def test_the_sinusoid_has_the_parameters_of_the_swatch(bench, ticks, swatch_of, speed_m_s):
    y = bench(TAP, swatch_of(taps=TAPS)).samples(contact(ticks, 60, speed_m_s))
    tap = TAPS.at(speed_m_s)
    np.testing.assert_allclose(y, sinusoid(tap, 600), atol=5e-3 * tap.amplitude_m_s2)


def test_speeds_above_the_highest_are_limited(bench, ticks, swatch_of):
    top, over = (bench(TAP, swatch_of(taps=TAPS)).samples(contact(ticks, 9, v)) for v in (0.3, 1e9))
    np.testing.assert_array_equal(top, over)


def test_no_tap_without_speed(bench, ticks, swatch_of):
    assert not bench(TAP, swatch_of(taps=TAPS)).samples(contact(ticks, 9, 0.0)).any()


def test_one_tap_per_contact(bench, ticks, swatch_of):
    """Three bounces give three superimposed transients."""
    rows = ticks(90)
    rows["began"][[0, 30, 60]] = 1
    rows["touching"] = np.arange(90) % 30 < 5
    rows["approach_m_s"] = np.repeat([0.3, 0.1, 0.05], 30)
    taps = Taps(TAPS.approach_m_s, TAPS.amplitude_m_s2, np.full(2, 200.0), np.full(2, 50.0))
    y = bench(TAP, swatch_of(taps=taps)).samples(rows)
    want = np.zeros(900)
    for start, speed in ((0, 0.3), (300, 0.1), (600, 0.05)):
        want[start:] += sinusoid(taps.at(speed), 900 - start)
    np.testing.assert_allclose(y, want, atol=1e-2)


def test_no_step_at_the_start_or_at_a_new_tap(bench, ticks, swatch_of):
    """The first sample of a transient is 0."""
    effect, alone = bench(TAP, swatch_of(taps=TAPS)), bench(TAP, swatch_of(taps=TAPS))
    assert effect.samples(contact(ticks, 3, 0.3))[0] == 0.0
    alone.samples(contact(ticks, 3, 0.3))
    effect.table = effect.table_of(swatch_of(taps=Taps([0.1], [80.0], [300.0], [40.0])))
    struck, ringing = effect.samples(contact(ticks, 3, 0.3)), alone.samples(ticks(3))
    assert struck[0] == ringing[0] != 0.0
    assert np.abs(struck).max() > 60.0


def test_the_output_ends_at_exactly_0(bench, ticks, swatch_of):
    effect = bench(TAP, swatch_of(taps=TAPS))
    y = effect.samples(contact(ticks, 1000, 0.3))
    assert not y[-1000:].any() and effect.s["real_m_s2"][0] == 0.0


def test_without_taps_silent(bench, ticks):
    assert not bench(TAP, PLAIN).samples(contact(ticks, 9, 0.3)).any()


def test_frequencies_above_nyquist_are_silent(bench, ticks, swatch_of):
    high = swatch_of(taps=Taps([0.1], [10.0], [900.0], [50.0]))
    assert not bench(TAP, high, rate_Hz=1000.0).samples(contact(ticks, 9, 0.1, rate_Hz=1000.0)).any()


def test_gain_scales(bench, ticks, swatch_of):
    once, twice = (bench(TAP, swatch_of(), params=dict(tap_gain=g)).samples(contact(ticks, 9, 0.1)) for g in (1.0, 2.0))
    np.testing.assert_array_equal(2.0 * once, twice)


def transient_taps(rate_Hz=10_000.0, count=600):
    t_s = np.arange(count) / rate_Hz
    rows = [(5.0, 180.0, 70.0), (12.0, 200.0, 80.0), (30.0, 260.0, 90.0)]
    waves = np.array([a * np.exp(-b * t_s) * np.sin(2 * np.pi * f * t_s) * np.cos(300 * t_s) for a, f, b in rows])
    return Taps([0.05, 0.1, 0.3], *np.array(rows).T, waves, rate_Hz)


@pytest.mark.parametrize("speed_m_s", [0.01, 0.05, 0.07, 0.13, 0.3, 1.0])
def test_recorded_transients_are_interpolated_over_speed(bench, ticks, swatch_of, speed_m_s):
    taps = transient_taps()
    y = bench(TAP, swatch_of(taps=taps)).samples(contact(ticks, 100, speed_m_s))
    np.testing.assert_allclose(y[:600], taps.transient(speed_m_s, 10_000.0), atol=1e-12)
    assert not y[600:].any()


def test_recorded_transients_are_superimposed_and_continue_on_another_swatch(bench, ticks, swatch_of):
    taps = transient_taps()
    rows = ticks(80)
    rows["began"][[0, 30]] = 1
    rows["approach_m_s"] = np.repeat([0.3, 0.1], [30, 50])
    want = np.zeros(800)
    want[:600] += taps.transient(0.3, 10_000.0)
    want[300:] += taps.transient(0.1, 10_000.0)[:500]
    effect = bench(TAP, swatch_of(taps=taps))
    np.testing.assert_allclose(effect.samples(rows), want, atol=1e-12)
    effect = bench(TAP, swatch_of(taps=taps))
    first = effect.samples(contact(ticks, 3, 0.3))
    effect.table = effect.table_of(PLAIN)
    both = np.concatenate([first, effect.samples(ticks(57))])
    np.testing.assert_allclose(both, taps.transient(0.3, 10_000.0), atol=1e-12)


def test_resampled_and_long_transients(bench, ticks, swatch_of):
    coarse = Taps([0.1], [1.0], [100.0], [80.0], transient_taps(1000.0, 100).wave_m_s2[:1], 1000.0)
    y = bench(TAP, swatch_of(taps=coarse)).samples(contact(ticks, 100, 0.1))
    np.testing.assert_allclose(y, coarse.transient(0.1, 10_000.0), atol=1e-12)
    long = Taps([0.1], [1.0], [100.0], [80.0], np.ones((1, 1000)), 1000.0)
    y = bench(TAP, swatch_of(taps=long)).samples(contact(ticks, 1000, 0.1))
    assert not y[4096:].any()
    whole = long.waves_at(10_000.0)[0, :4096]
    np.testing.assert_array_equal(y[:3584], whole[:3584])
    fade = y[3584:4096] / whole[3584:]
    np.testing.assert_allclose(fade, 0.5 + 0.5 * np.cos(np.pi * (np.arange(512) + 0.5) / 512), atol=1e-9)
    assert (np.diff(fade) < 0.0).all() and fade[0] > 0.99999 and fade[-1] < 1e-5


def test_superimposed_transients_are_bounded(bench, ticks, swatch_of):
    """A contact at each tick for a second gives at most the sum of all transients, and ends."""
    taps = transient_taps()
    rows = ticks(1200, approach_m_s=0.3)
    rows["began"][:1000] = 1
    y = bench(TAP, swatch_of(taps=taps)).samples(rows)
    wave = taps.transient(0.3, 10_000.0)
    assert np.abs(y).max() <= np.abs(wave).reshape(-1, 10).sum(axis=0).max() + 1e-9
    assert not y[10_600:].any()


@pytest.mark.parametrize("taps", [None, TAPS])
def test_leaving_by_speed(bench, ticks, swatch_of, taps):
    leaving = transient_taps()
    rows = ticks(200, leaving_m_s=0.07, approach_m_s=0.1, touching=np.arange(200) < 100)
    rows["began"][0] = rows["ended"][100] = 1
    swatch, struck = swatch_of(taps=taps, leaving=leaving), swatch_of(taps=taps)
    y, without = (bench(TAP, one).samples(rows) for one in (swatch, struck))
    np.testing.assert_allclose((y - without)[1000:1600], leaving.transient(0.07, 10_000.0), atol=1e-12)
    np.testing.assert_array_equal(y[:1000], without[:1000])
