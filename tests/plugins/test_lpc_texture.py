"""Texture effect: spectrum, level, transitions and stability."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import welch

from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.surface.effect import load_effect
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.swatch import PLAIN
from hapscene.surface.texture import Texture
from hapscene_plugins.effects.lpc_texture import GRID, HEADER, choose

LPC = load_effect("lpc_texture")
BAND_HZ = np.geomspace(20.0, 1000.0, 200)


def spectrum_dB(a, variance, rate_Hz=10_000.0):
    """Power spectra (n, 200) of filters a (n, p+1) with excitation of variance (n,), in dB."""
    turn = np.exp(-2j * np.pi * np.outer(np.arange(a.shape[1]), BAND_HZ / rate_Hz))
    return 10.0 * np.log10(variance[:, None] / np.abs(a @ turn) ** 2)


def chosen(table, force, speed):
    """Power and reflection coefficients (p,) from a table."""
    s = np.zeros(1, LPC.state_dtype)[0]
    power = choose(table, force, speed, s, True)
    return power, s["k"][1 : int(s["order"]) + 1].copy()


@pytest.mark.parametrize("order", [20, 40])
def test_interpolated_spectra_equal_those_of_the_texture(texture_of, swatch_of, order):
    """Interpolated filters and levels at random forces and speeds, compared with those of the texture."""
    texture = texture_of(3, order)
    table = LPC.table(swatch_of(texture=texture), 10_000.0)
    assert len(table) == HEADER + GRID * GRID * (order + 1)
    rng = np.random.default_rng(0)
    force, speed = rng.uniform(0.1, 2.0, 300), rng.uniform(0.01, 0.2, 300)
    power, k = zip(*(chosen(table, *place) for place in zip(force, speed, strict=True)), strict=True)
    a = ar_from_reflection(k)
    got, want = spectrum_dB(a, power / power_gain(a)), spectrum_dB(*texture.models(force, speed))
    error_dB = np.sqrt(np.mean((got - want) ** 2, axis=1))
    assert np.median(error_dB) < 0.1
    assert np.percentile(error_dB, 95) < 0.5


def test_synthesised_signal_has_spectrum_and_level(bench, ticks, texture_of, swatch_of):
    texture = texture_of(1, 12)
    effect = bench(LPC, swatch_of(texture=texture))
    force, speed = 1.37, 0.123
    y = effect.samples(ticks(20_000, force_N=force, slip_m_s=speed))[1000:]
    a, variance = texture.models([force], [speed])
    assert np.var(y) == pytest.approx(float(variance[0] * power_gain(a)[0]), rel=0.05)
    frequency_Hz, density = welch(y, 10_000.0, nperseg=1024)
    got_dB = 10 * np.log10(np.interp(BAND_HZ, frequency_Hz, density) * 5_000.0)
    assert np.sqrt(np.mean((got_dB - spectrum_dB(a, variance)[0]) ** 2)) < 0.7


def test_silent_at_rest_without_force_and_in_the_air(bench, ticks, swatch_of):
    effect = bench(LPC, swatch_of())
    for still in (dict(force_N=0.0, slip_m_s=0.1), dict(force_N=1.0, slip_m_s=0.0), dict(touching=0)):
        assert effect.samples(ticks(10, force_N=1.0, slip_m_s=0.1)).any()
        assert effect.samples(ticks(1, **still)).any()  # ramped down over one tick
        assert not effect.samples(ticks(10, **still)).any()


def test_without_texture_silent(bench, ticks):
    effect = bench(LPC, PLAIN)
    assert effect.table.size == 0
    assert not effect.samples(ticks(10, force_N=1.0, slip_m_s=0.1)).any()


def test_level_ramps_over_the_block(bench, ticks, swatch_of):
    """The ratio of the ramped output to the full output is 1/10, 2/10, … 1."""
    coming, full = bench(LPC, swatch_of()), bench(LPC, swatch_of())
    rows = ticks(1, force_N=1.0, slip_m_s=0.1)
    first = coming.samples(rows)
    full.s["level_m_s2"], full.s["gain"] = coming.s["level_m_s2"], 1.0
    np.testing.assert_allclose(first, full.samples(rows) * np.arange(1, 11) / 10, rtol=1e-12)


def test_crossing_does_not_click(bench, ticks, swatch_of):
    """The level changes over a block towards a swatch with 1000 times the level, and to one without texture."""
    quiet, loud = (swatch_of(5, texture=_scaled(swatch_of(5).texture, gain)) for gain in (1.0, 1000.0))
    effect = bench(LPC, quiet)
    rows = ticks(1, force_N=1.0, slip_m_s=0.1)
    before = [effect.samples(rows) for _ in range(100)]
    effect.table = effect.table_of(loud)
    after = effect.samples(rows)
    assert abs(after[0]) < 200 * np.std(before) * 4
    effect.table = np.empty(0)
    gone = effect.samples(rows)
    assert gone[0] != 0.0 and gone[-1] == 0.0
    assert not effect.samples(rows).any()


def _scaled(texture, gain):
    return Texture(
        texture.rate_Hz,
        texture.force_N,
        texture.speed_m_s,
        texture.triangles,
        texture.lsf_rad,
        texture.variance_m2_s4 * gain**2,
    )


def test_the_filter_is_constant_beyond_the_maxima(bench, ticks, swatch_of):
    top = bench(LPC, swatch_of()).samples(ticks(20, force_N=2.0, slip_m_s=0.2))
    over = bench(LPC, swatch_of()).samples(ticks(20, force_N=1e300, slip_m_s=1e300))
    np.testing.assert_array_equal(top, over)


def test_gain_scales(bench, ticks, swatch_of):
    rows = ticks(20, force_N=1.0, slip_m_s=0.1)
    once = bench(LPC, swatch_of()).samples(rows)
    twice = bench(LPC, swatch_of(), params=dict(texture_gain=2.0)).samples(rows)
    np.testing.assert_array_equal(2.0 * once, twice)


def _unlike(side, order, rng):
    """A narrow resonance of power 1 at a low (side 0) or high (side 1) frequency."""
    k = rng.uniform(-0.9, 0.9, order)
    k[0] = 0.98 if side else -0.98
    a = ar_from_reflection(k)
    return Texture.from_models(10_000.0, [1.0], [0.1], a=a[None], variance_m2_s4=[1.0 / power_gain(a)])


def test_resampling_preserves_the_level(bench, ticks, texture_of, swatch_of):
    texture = texture_of(1, 12, 5_000.0)
    effect = bench(LPC, swatch_of(texture=texture))
    y = effect.samples(ticks(5_000, force_N=1.0, slip_m_s=0.1))[1000:]
    assert np.var(y) == pytest.approx(float(texture.power([1.0], [0.1])[0]), rel=0.15)


def slow(swatch, ticks):
    return replace(swatch, effects={"lpc_texture": {"update_ticks": float(ticks)}})


def test_a_long_update_interval_gives_a_continuous_level(bench, ticks, swatch_of):
    """With updates at ticks 0, 4, 8 … the level is linear in between; for constant force and speed nothing changes."""
    swatch = swatch_of()
    seldom, always = bench(LPC, slow(swatch, 4)), bench(LPC, swatch)
    still = ticks(41, force_N=1.0, slip_m_s=0.1, began=[1] + [0] * 40)
    np.testing.assert_array_equal(seldom.samples(still), always.samples(still))
    levels, k = [], []
    for row in ticks(40, force_N=np.linspace(0.5, 2.0, 40), slip_m_s=0.1):
        seldom.run(np.array([row], row.dtype))
        levels.append(float(seldom.s["level_m_s2"][0]))
        k.append(seldom.s["k"][0].copy())
    changes = np.flatnonzero([(a != b).any() for a, b in pairwise(k)]) + 1
    assert set(np.diff(changes)) == {4}
    bend = np.abs(np.diff(levels, 2))
    assert np.median(bend[np.arange(1, 39) % 4 != changes[0] % 4]) < 1e-9 < bend.max()


# Alive: a slow gain, warped models, a level beyond what was recorded.

LIFE = GainModulation([0.4, 0.3], [30.0, 0.0], [0.0, 800.0])


def modulated(swatch_of, life=LIFE, **fields):
    swatch = swatch_of()
    return replace(swatch, texture=replace(swatch.texture, modulation=life, **fields))


def test_amplitude_modulation_preserves_the_mean_power(bench, ticks, swatch_of):
    """Levels of 50 ms: depth 0 equals the unmodulated texture, depth 2 has a larger spread than depth 1."""
    rows = ticks(60_000, force_N=1.0, slip_m_s=0.1)
    made = {
        life: bench(LPC, modulated(swatch_of), params={"texture_life": life}).samples(rows) for life in (0.0, 1.0, 2.0)
    }
    np.testing.assert_array_equal(made[0.0], bench(LPC, swatch_of()).samples(rows))
    power = {life: y.reshape(-1, 500).var(axis=1) for life, y in made.items()}
    assert np.mean(power[1.0]) == pytest.approx(np.mean(power[0.0]), rel=0.1)
    spread = [np.std(10 * np.log10(power[life])) for life in (0.0, 1.0, 2.0)]
    assert spread[1] > spread[0] + 1.0 and spread[2] > spread[1] + 2.0
    again = bench(LPC, modulated(swatch_of)).samples(rows)
    np.testing.assert_array_equal(again, made[1.0])
    assert not np.array_equal(bench(LPC, modulated(swatch_of), seed=1).samples(rows), again)


def test_a_changed_modulation_depth_is_faded_during_a_contact(bench, ticks, swatch_of):
    """A nearly constant gain changes to 1 and back without a step; at once in a new contact."""
    effect = bench(LPC, modulated(swatch_of, GainModulation([1.0], [1e-9], [0.0])))

    def gains(count, life, began=0):
        effect.p["texture_life"] = life
        rows = ticks(count, force_N=1.0, slip_m_s=0.1, began=[began] + [0] * (count - 1))
        found = []
        for i in range(count):
            effect.run(rows[i : i + 1])
            found.append(float(effect.s["gain"][0]))
        return found

    there = gains(2, 1.0, began=1)[-1]
    made = [there, *gains(300, 0.0), *gains(300, 1.0)]
    assert there != 1.0 and made[300] == 1.0 and made[-1] == pytest.approx(there, rel=1e-3)
    assert np.abs(np.diff(np.log(made))).max() < 0.03
    assert gains(1, 0.0, began=1) == [1.0]


def test_modulation_over_distance_stops_with_the_tool(bench, ticks, swatch_of):
    effect = bench(LPC, modulated(swatch_of, GainModulation([0.5], [0.0], [300.0])))
    gains = []
    for i, slip in enumerate((0.1, 0.1, 0.0, 0.0, 0.1)):
        effect.run(ticks(1, force_N=1.0, slip_m_s=slip, began=i == 0))
        gains.append(float(effect.s["gain"][0]))
    assert gains[1] == gains[2] == gains[3] and len(set(gains)) == 3


def test_a_warped_texture_has_its_spectrum_and_level(bench, ticks, swatch_of):
    plain = swatch_of(1, 12).texture
    texture = replace(plain, warp=0.6, variance_m2_s4=plain.variance_m2_s4 / 3.0)
    y = bench(LPC, swatch_of(texture=texture)).samples(ticks(20_000, force_N=1.37, slip_m_s=0.123))[1000:]
    assert np.var(y) == pytest.approx(float(texture.power([1.37], [0.123])[0]), rel=0.1)
    frequency_Hz, density = welch(y, 10_000.0, nperseg=1024)
    want = texture.density([1.37], [0.123], frequency_Hz=BAND_HZ)[0]
    off_dB = 10 * np.log10(np.interp(BAND_HZ, frequency_Hz, density) / want)
    assert np.sqrt(np.mean(off_dB**2)) < 0.8


def test_switching_between_allpass_coefficients_preserves_the_level(bench, ticks, swatch_of):
    """L3: unlike textures of power 1, switched at each tick (a direct form reached 3e8 σ)."""
    rng = np.random.default_rng(4)
    textures = [_unlike(side, order, rng) for side, order in ((0, 9), (1, 12), (0, 20))]
    warps = (0.75, 0.0, -0.6)
    unit = [replace(one, warp=warp) for one, warp in zip(textures, warps, strict=True)]
    unit = [replace(t, variance_m2_s4=t.variance_m2_s4 / t.power([1.0], [0.1])) for t in unit]
    effect = bench(LPC, swatch_of(texture=unit[0]))
    tables = [effect.table_of(swatch_of(texture=texture)) for texture in unit]
    y = []
    for _ in range(3000):
        effect.table = tables[rng.integers(3)]
        y.append(effect.samples(ticks(1, force_N=1.0, slip_m_s=0.1)))
    y = np.concatenate(y)
    assert np.abs(y).max() < 5.5 and 0.8 < np.std(y) < 1.2


def test_the_level_follows_the_exponents_beyond_the_maxima(bench, ticks, swatch_of):
    texture = replace(swatch_of().texture, exponents=(0.7, 1.9))
    effect = bench(LPC, swatch_of(texture=texture))
    for force, slip in [(3.0, 0.1), (2.0, 0.3), (3.0, 0.25), (2.0, 9.0), (9e9, 0.1)]:
        effect.run(ticks(2, force_N=force, slip_m_s=slip))
        assert effect.s["level_m_s2"][0] ** 2 == pytest.approx(texture.power([force], [slip])[0], rel=1e-3)
