"""A tap is a decaying sinusoid by speed of approach; it rings on in the air, and taps add up."""

import numpy as np
import pytest

from hapscene.surface.registry import load_effect
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
def test_rings_as_the_taps_say(bench, ticks, swatch_of, speed_m_s):
    y = bench(TAP, swatch_of(taps=TAPS)).samples(contact(ticks, 60, speed_m_s))
    tap = TAPS.at(speed_m_s)
    np.testing.assert_allclose(y, sinusoid(tap, 600), atol=5e-3 * tap.amplitude_m_s2)


def test_faster_is_clamped(bench, ticks, swatch_of):
    top, over = (bench(TAP, swatch_of(taps=TAPS)).samples(contact(ticks, 9, v)) for v in (0.3, 1e9))
    np.testing.assert_array_equal(top, over)


def test_no_speed_no_tap(bench, ticks, swatch_of):
    assert not bench(TAP, swatch_of(taps=TAPS)).samples(contact(ticks, 9, 0.0)).any()


def test_one_tap_a_contact_each_by_its_speed(bench, ticks, swatch_of):
    """Bounces of a light hand: three contacts, three transients, the later on top of what still rings."""
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


def test_no_step_at_start_or_crossing(bench, ticks, swatch_of):
    """The first sample of a tap is zero, that of a new one on another swatch is as if there were none."""
    effect, alone = bench(TAP, swatch_of(taps=TAPS)), bench(TAP, swatch_of(taps=TAPS))
    assert effect.samples(contact(ticks, 3, 0.3))[0] == 0.0
    alone.samples(contact(ticks, 3, 0.3))
    effect.table = effect.table_of(swatch_of(taps=Taps([0.1], [80.0], [300.0], [40.0])))
    struck, ringing = effect.samples(contact(ticks, 3, 0.3)), alone.samples(ticks(3))
    assert struck[0] == ringing[0] != 0.0
    assert np.abs(struck).max() > 60.0


def test_comes_to_rest_exactly(bench, ticks, swatch_of):
    effect = bench(TAP, swatch_of(taps=TAPS))
    y = effect.samples(contact(ticks, 1000, 0.3))
    assert not y[-1000:].any() and effect.s["real_m_s2"][0] == 0.0


def test_without_taps_silent(bench, ticks):
    assert not bench(TAP, PLAIN).samples(contact(ticks, 9, 0.3)).any()


def test_above_the_channel_s_band_silent(bench, ticks, swatch_of):
    high = swatch_of(taps=Taps([0.1], [10.0], [900.0], [50.0]))
    assert not bench(TAP, high, rate_Hz=1000.0).samples(contact(ticks, 9, 0.1, rate_Hz=1000.0)).any()


def test_gain_scales(bench, ticks, swatch_of):
    once, twice = (bench(TAP, swatch_of(), params=dict(tap_gain=g)).samples(contact(ticks, 9, 0.1)) for g in (1.0, 2.0))
    np.testing.assert_array_equal(2.0 * once, twice)
