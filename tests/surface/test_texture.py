"""The texture: interpolation between models is stable and has the right power; resampling; invalid textures."""

from dataclasses import replace
from unittest.mock import ANY

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polymul, polypow
from scipy.signal import freqz, lfilter

from hapscene.constants import LEVEL_BOUND_DB, LIFE_MAX, ORDER_MAX
from hapscene.dsp.ar_filter import ar_from_lsf, ar_from_reflection, lsf_from_ar, power_gain, reflection_from_ar
from hapscene.errors import SwatchError
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.texture import GAIN_MAX, INTERPOLATIONS, Texture, close, filters, form, stabilised, triangulate
from hapscene.swatches.library import load_swatch


def make_texture(order: int = 20, count: int = 5, seed: int = 0, interpolation: str = "lsf") -> Texture:
    """Return random models at random points up to 3 N and 0.3 m/s."""
    rng = np.random.default_rng(seed)
    k = rng.uniform(-0.4, 0.4, (count, order)) * np.exp(-np.arange(order) / 20)
    k[:, 0] = rng.uniform(-0.98, -0.8, count)
    force, speed = rng.uniform(0.3, 3.0, count), rng.uniform(0.03, 0.3, count)
    variance = rng.uniform(0.1, 10.0, count)
    return Texture.from_models(
        10_000.0, force, speed, a=ar_from_reflection(k), variance_m2_s4=variance, interpolation=interpolation
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 120), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_blends_are_stable_with_interpolated_power(order: int, count: int, seed: int) -> None:
    texture = make_texture(order, count, seed)
    rng = np.random.default_rng(seed)
    force, slip = rng.uniform(0, 4, 200), rng.uniform(0, 0.4, 200)
    a, variance = texture.models(force, slip)
    assert np.all(np.abs(reflection_from_ar(a)) < 1.0)
    assert np.all(np.isfinite(variance) & (variance >= 0.0))
    assert np.allclose(variance * power_gain(a), texture.power(force, slip), rtol=1e-9)
    assert texture.power(force, slip).max() <= texture.model_power_m2_s4.max() * (1 + 1e-12)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_triangles_cover_the_rectangle(count: int, seed: int) -> None:
    texture = make_texture(4, count, seed)
    rng = np.random.default_rng(seed)
    force = rng.uniform(0, texture.force_max_N, 200)
    slip = rng.uniform(0, texture.speed_max_m_s, 200)
    corner, weight = texture.locate(force, slip)
    assert np.allclose(np.sum(weight * texture.force_N[corner], axis=1), force, atol=1e-5 * texture.force_max_N)
    assert np.allclose(np.sum(weight * texture.speed_m_s[corner], axis=1), slip, atol=1e-5 * texture.speed_max_m_s)


def test_a_silent_triangle_at_the_origin_is_opened() -> None:
    """Its corners are the origin and a silent model on each axis."""
    force, slip = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.2], [10.0, 1.0], [10.0, 0.0], [0.0, 1.0]]).T
    found = {frozenset(corners) for corners in triangulate(force, slip).tolist()}
    assert found == {frozenset(corners) for corners in ((0, 1, 3), (0, 2, 3), (1, 3, 4), (2, 3, 5))}


def test_models_that_close_the_rectangle() -> None:
    """Silent copies on the axes are of the model beside them, others of the nearest; none is within 2 % of another."""
    force, speed, source, sounding = close(np.array([20.0, 12.0, 11.8]), np.array([1.0, 0.5, 0.25]))
    found = {(round(f, 9), round(v, 9)): row for f, v, *row in zip(force, speed, source, sounding, strict=True)}
    assert found == {
        (20.0, 1.0): [0, 1.0], (12.0, 0.5): [1, 1.0], (11.8, 0.25): [2, 1.0],
        (0.0, 0.0): [2, 0.0], (0.0, 0.25): [2, 0.0], (0.0, 0.5): [1, 0.0], (0.0, 1.0): [0, 0.0],
        (12.0, 0.0): [1, 0.0], (20.0, 0.0): [0, 0.0],
        (20.0, 0.25): [2, 1.0], (20.0, 0.5): [1, 1.0], (12.0, 1.0): [0, 1.0],
    }  # fmt: skip


def test_model_at_its_vertex() -> None:
    a = ar_from_reflection(np.array([[-0.9, 0.5], [-0.5, 0.2], [-0.8, 0.1]]))
    texture = Texture.from_models(5000.0, [1.0, 2.0, 2.0], [0.1, 0.1, 0.2], a=a, variance_m2_s4=[1.0, 2.0, 3.0])
    for i, (force, slip) in enumerate([(1.0, 0.1), (2.0, 0.1), (2.0, 0.2)]):
        got, variance = texture.model(force, slip)
        assert np.allclose(got, a[i], atol=1e-12)
        assert variance == pytest.approx(i + 1.0, rel=1e-12)


def test_silence_and_clamping() -> None:
    texture = make_texture()
    for force, slip in [(0.0, 0.1), (1.0, 0.0), (-1.0, 0.1), (1.0, -0.1), (np.nan, 0.1), (1.0, np.nan)]:
        assert texture.model(force, slip)[1] == 0.0
    a, variance = texture.model(100.0, 10.0)
    b, same = texture.model(texture.force_max_N, texture.speed_max_m_s)
    assert np.array_equal(a, b) and variance == same > 0.0


def test_invalid_textures_are_rejected() -> None:
    good = make_texture(3, 2)
    fields = {n: getattr(good, n) for n in ("rate_Hz", "force_N", "speed_m_s", "triangles", "lsf_rad")}
    fields["variance_m2_s4"] = good.variance_m2_s4
    falling = good.lsf_rad.copy()
    falling[1] = falling[1][::-1]
    tight = good.lsf_rad.copy()
    tight[0] = [1.0, 1.0 + 1e-13, 2.0]
    cases = {
        "model 1": {"lsf_rad": falling},
        "model 0": {"lsf_rad": tight},
        "rate_Hz": {"rate_Hz": 0.0},
        "speed_m_s": {"speed_m_s": [1.0]},
        "force_N": {"force_N": np.full_like(good.force_N, np.nan)},
        "triangle": {"triangles": [[0, 0, 1]]},
        "triangles": {"triangles": [[0, 1, 99]]},
        "interpolation": {"interpolation": "cubic"},
        "warp": {"warp": 1.0},
        "exponents": {"exponents": [1.0]},
        "nan": {"exponents": [np.nan, 0.0]},
        "modulation": {"modulation": {"spread": [0.3]}},
        "": {"variance_m2_s4": np.full_like(good.variance_m2_s4, 1e200)},
    }
    for field, change in cases.items():
        with pytest.raises(SwatchError, match=field or None):
            Texture(**(fields | change))
    count = len(good.force_N)
    for triangles in (
        [0, 1, 2],
        [[0, 1]],
        np.zeros((0, 3)),
        [[0, 1, -1]],
        [[0, 1, count]],
        [[0, 1, 2]] * (2 * count + 1),
    ):
        with pytest.raises(SwatchError, match=r"triangles (must|name)"):
            Texture(**(fields | {"triangles": triangles}))
    for lsf in (good.lsf_rad[0], good.lsf_rad[1:], good.lsf_rad[:, :0], np.ones((count, ORDER_MAX + 1))):
        with pytest.raises(SwatchError, match=r"lsf_rad must"):
            Texture(**(fields | {"lsf_rad": lsf}))


def test_largest_numbers_are_accepted() -> None:
    most = {"variance_m2_s4": [0.999e12], "warp": -0.99, "exponents": [8.0, -8.0]}
    texture = Texture.from_models(1e4, [1.0], [0.1], a=[[1.0, 0.0]], **most)
    fields = {n: getattr(texture, n) for n in ("force_N", "speed_m_s", "triangles", "lsf_rad", "variance_m2_s4")}
    with pytest.raises(ValueError, match="read-only"):
        texture.lsf_rad[0] = 1.0
    Texture(1e4, **(fields | {"triangles": np.resize(texture.triangles, (2 * len(texture.force_N), 3))}), warp=0.99)
    flat = {"force_N": [0.0, 1.0, 1.0], "speed_m_s": [0.0, 0.1, 0.1 + 1e-12], "triangles": [[0, 1, 2]]}
    three = {"lsf_rad": texture.lsf_rad[:3], "variance_m2_s4": np.zeros(3)}
    loud = [{"variance_m2_s4": share * texture.variance_m2_s4} for share in (1.01, -1.0)]
    for bad in (flat | three, *loud, {"rate_Hz": np.inf}, {"exponents": [8.1, 0.0]}, {"warp": -0.991}):
        with pytest.raises(SwatchError):
            Texture(**({"rate_Hz": 1e4} | fields | bad))


@pytest.mark.parametrize("warp", [0.75, -0.75])
def test_warp_and_order_at_another_rate(warp: float) -> None:
    """Low frequencies keep their phase if the warp keeps its sign and does not exceed its limit."""
    models = {"a": ar_from_reflection([-0.5, 0.3]), "variance_m2_s4": [1.0]}
    texture = Texture.from_models(1000.0, [1.0], [0.1], warp=warp, **models)
    for ratio, order in ((1 / 64, 2), (0.5, 2), (2.0, 3), (64.0, 3)):
        other, stretch = texture.resampled(1000.0 * ratio), ratio * (1.0 + warp) / (1.0 - warp)
        expected = np.clip((stretch - 1.0) / (stretch + 1.0), *((0.0, 0.99) if warp > 0.0 else (-0.99, 0.0)))
        assert (other.rate_Hz, other.order) == (1000.0 * ratio, order) and other.warp == pytest.approx(expected)
    for ratio in (1 / 65, 65.0, 0.0, np.nan):
        with pytest.raises(SwatchError, match="resampled"):
            texture.resampled(1000.0 * ratio)
    long = Texture.from_models(100.0, [1.0], [0.1], a=ar_from_reflection(np.full(20, 0.1)), variance_m2_s4=[1.0])
    assert long.resampled(3000.0).order == ORDER_MAX and long.resampled(100.0) is long


def test_nothing_is_added_above_the_band_of_a_low_pass() -> None:
    """There its density is the smallest of the model."""
    low = Texture.from_models(1000.0, [1.0], [0.1], a=[[1.0, -0.8] + [0.0] * 18], variance_m2_s4=[1.0])
    found = low.resampled(3000.0).density([1.0], [0.1], frequency_Hz=[100.0, 490.0, 700.0, 1400.0])[0]
    known = low.density([1.0], [0.1], frequency_Hz=[100.0, 500.0, 500.0, 500.0])[0]
    np.testing.assert_allclose(found, known, rtol=0.02)
    line = [1.0, -2.0 * np.cos(2.0 * np.pi * 6000.5 / 65_536), 1.0] * (1.0 - 1e-6) ** np.arange(
        3
    )  # narrower than a bin
    narrow = Texture.from_models(1000.0, [1.0], [0.1], a=[line], variance_m2_s4=[1.0])
    power = [one.power([1.0], [0.1])[0] for one in (narrow, narrow.resampled(500.0), narrow.resampled(2000.0))]
    assert power[1:] == pytest.approx(power[:1] * 2, rel=1e-4)


@pytest.mark.parametrize("rate_Hz", [5000.0, 44_100.0])
def test_resampling_keeps_the_common_band(rate_Hz: float) -> None:
    texture = make_texture(order=20)
    other = texture.resampled(rate_Hz)
    assert other.rate_Hz == rate_Hz and other.order == (20 if rate_Hz < 1e4 else 89)
    frequency = np.linspace(20.0, 1000.0, 500)
    nyquist = min(rate_Hz, 10_000.0) / 2
    fine = (np.arange(20_000) + 0.5) * nyquist / 20_000
    for force, slip in ((texture.force_N[0], texture.speed_m_s[0]), (texture.force_N[1], texture.speed_m_s[1])):
        in_band, in_whole = [], []
        for t in (texture, other):
            a, variance = t.model(force, slip)
            for grid, into in ((frequency, in_band), (fine, in_whole)):
                _, h = freqz([1.0], a, worN=grid, fs=t.rate_Hz)
                into.append(2 * variance * np.abs(h) ** 2 / t.rate_Hz)
        assert np.sqrt(np.mean((10 * np.log10(in_band[0] / in_band[1])) ** 2)) < 0.5
        assert abs(10 * np.log10(in_whole[0].sum() / in_whole[1].sum())) < 0.1


@pytest.mark.parametrize("rate_Hz", [5000.0, 48_000.0])
@pytest.mark.parametrize("name", ["wood", "epoxy"])
def test_resampling_shipped_swatches(name: str, rate_Hz: float) -> None:
    texture = load_swatch(name).texture
    assert texture is not None
    other = texture.resampled(rate_Hz)
    frequency = np.linspace(20.0, 1000.0, 500)
    place = [texture.force_max_N], [texture.speed_max_m_s]
    density = [t.density(*place, frequency_Hz=frequency)[0] for t in (texture, other)]
    off_dB = 10 * np.log10(density[0] / density[1])
    assert np.sqrt(np.mean(off_dB**2)) < 0.1 and np.abs(off_dB).max() < 0.2  # of warped models, see texture.py
    assert other.resampled(rate_Hz) is other


# Interpolations: all are stable and have the right power.


def wild_pairs(order: int, count: int = 1000) -> tuple[np.ndarray, np.ndarray]:
    """Return two sets of random stable filters (count, order+1), from random line spectral frequencies."""
    rng = np.random.default_rng(order)
    one, two = np.sort(rng.uniform(0.0, np.pi, (2, count, order)), axis=2)
    return ar_from_lsf(one), ar_from_lsf(two)


@pytest.mark.parametrize(("order", "share"), [(3, 0.13), (8, 0.73), (20, 0.99)])
def test_between_random_pairs_only_the_direct_form_is_unstable(order: int, share: float) -> None:
    """Share of pairs that are unstable somewhere between; the reference has 25, 75, 98 % for unspecified pairs."""
    one, two = wild_pairs(order)
    unstable = np.zeros(len(one), bool)
    for weight in np.linspace(0.0, 1.0, 21):
        mean = (1 - weight) * one + weight * two
        gain = power_gain(mean)
        unstable |= ~np.isfinite(gain)
        made = stabilised(mean)
        assert np.all(power_gain(made) < GAIN_MAX)
        calm = gain < GAIN_MAX
        assert np.array_equal(made[calm], mean[calm])  # stable filters are unchanged
        k = (1 - weight) * reflection_from_ar(one) + weight * reflection_from_ar(two)
        assert np.all(np.abs(k) < 1.0)
    assert unstable.mean() == pytest.approx(share, abs=0.04)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("order", [1, 2, 7, 20, 120])
def test_interpolations_reproduce_the_models(interpolation: str, order: int) -> None:
    rng = np.random.default_rng(order)
    a = ar_from_reflection(rng.uniform(-0.7, 0.7, (4, order)) / np.sqrt(1 + np.arange(order) / 4))
    lsf = np.stack([lsf_from_ar(one) for one in a])
    assert np.abs(filters(interpolation, form(interpolation, lsf)) - a).max() < 1e-9


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_interpolation_between_opposite_spectra(interpolation: str) -> None:
    """Models of opposite spectra, the worst case: the synthesised level is compared."""
    rng = np.random.default_rng(3)
    k = rng.uniform(-0.8, 0.8, (6, 12))
    k[::2, 0], k[1::2, 0] = -0.98, 0.98
    a = ar_from_reflection(k)
    force, speed = rng.uniform(0.3, 3.0, 6), rng.uniform(0.03, 0.3, 6)
    texture = Texture.from_models(
        10_000.0, force, speed, a=a, variance_m2_s4=1.0 / power_gain(a), interpolation=interpolation
    )
    places = rng.uniform(0.05, 1.1, (300, 2)) * (texture.force_max_N, texture.speed_max_m_s)
    filters_a, variance = texture.models(*places.T)
    gain = power_gain(filters_a)
    assert np.all(np.isfinite(gain))
    if interpolation != "hatt":
        assert np.allclose(variance * gain, texture.power(*places.T), rtol=1e-8)
    for place in (0, 1, 2):
        noise = np.sqrt(variance[place]) * rng.standard_normal(400_000)
        level_dB = 10 * np.log10(lfilter([1.0], filters_a[place], noise)[5000:].var() / (variance[place] * gain[place]))
        assert abs(level_dB) < 1.0
    if interpolation == "direct":
        assert np.all(gain < GAIN_MAX)


def test_lattice_of_a_single_filter() -> None:
    a = ar_from_reflection([-0.9, 0.4])
    one = Texture.from_models(1000.0, [1.0, 2.0], [0.1, 0.2], a=[a, a], variance_m2_s4=[1.0, 3.0])
    assert one.single
    k, power = one.lattice([2.0, 0.5, 0.0], [0.2, 0.1, 0.1])
    assert k.shape == (1, 2) and power[2] == 0.0 and power[0] == pytest.approx(3.0 * power_gain(a))
    two = Texture.from_models(
        1000.0, [1.0, 2.0], [0.1, 0.2], a=[a, ar_from_reflection([0.3, 0.1])], variance_m2_s4=[1.0, 3.0]
    )
    assert not two.single
    k, power = two.lattice([2.0, 0.5, 0.0], [0.2, 0.1, 0.1])
    assert k.shape == (3, 2)
    assert np.allclose(power, two.power([2.0, 0.5, 0.0], [0.2, 0.1, 0.1]))


def test_equality_of_textures() -> None:
    texture = make_texture()
    assert texture == make_texture() and hash(texture) == hash(make_texture())
    assert texture != 5 and texture == ANY  # `ANY` decides
    assert texture != replace(texture, rate_Hz=9_000.0) and texture != replace(texture, interpolation="reflection")
    for name in ("force_N", "speed_m_s", "lsf_rad", "variance_m2_s4"):
        assert texture != replace(texture, **{name: 0.999 * getattr(texture, name)}), name
    assert texture != replace(texture, triangles=texture.triangles[::-1])
    more = {"warp": 0.5, "exponents": (1.0, 0.0), "modulation": GainModulation([0.3], [20.0], [0.0])}
    changed = replace(texture, **more)
    assert changed == replace(texture, **more)
    for name in more:
        kept = {key: value for key, value in more.items() if key != name}
        assert changed != replace(texture, **kept), name


def test_invalid_modulation_is_rejected() -> None:
    good = {"spread": [0.3, 0.2], "decay_1_s": [20.0, 0.0], "decay_1_m": [0.0, 300.0]}
    assert GainModulation(**good) == GainModulation(**good) and hash(GainModulation(**good)) == hash(
        GainModulation(**good)
    )
    assert GainModulation(**good).log_spread == pytest.approx(np.sqrt(0.13))
    assert GainModulation([1.5] + [0.0] * (LIFE_MAX - 1), [1e4] * LIFE_MAX, [1e6] * LIFE_MAX).log_spread == 1.5
    for change in (
        {"spread": []},
        {"decay_1_m": [0.0]},
        {"spread": [np.nan, 0.1]},
        {"decay_1_s": [-1.0, 0.0]},
        {"spread": [1.2, 1.2]},
        {"decay_1_m": [0.0, 0.0]},
        {"spread": [-0.1, 0.1]},
        {"decay_1_s": [1.001e4, 0.0]},
        {name: [1e-3] * (LIFE_MAX + 1) for name in good},
    ):
        with pytest.raises(SwatchError):
            GainModulation(**(good | change))


@pytest.mark.parametrize("warp", [0.75, -0.4])
def test_power_and_spectrum_of_a_warped_model(warp: float) -> None:
    """Against the rational filter of order 3 that A(D(z)) is, worked out by polynomials."""
    a = np.poly([0.6, 0.7 * np.exp(1j), 0.7 * np.exp(-1j)]).real
    texture = Texture.from_models(1000.0, [2.0], [0.2], a=a, variance_m2_s4=[3.0], warp=warp)
    over, under = (-warp, 1.0), (1.0, -warp)  # D = over/under, both in ascending powers of 1/z
    numerator = polypow(under, 3)
    whole = sum(a[i] * polymul(polypow(over, i), polypow(under, 3 - i)) for i in range(4))
    impulse = lfilter(numerator, whole, np.eye(1, 4000)[0])
    assert texture.power([2.0], [0.2])[0] == pytest.approx(3.0 * np.sum(impulse**2), rel=1e-9)
    frequency = np.linspace(1.0, 499.0, 50)
    _, response = freqz(numerator, whole, worN=frequency, fs=1000.0)
    density = texture.density([2.0], [0.2], frequency_Hz=frequency)[0]
    np.testing.assert_allclose(density, 2 * 3.0 * np.abs(response) ** 2 / 1000.0, rtol=1e-9)


def test_level_beyond_the_recorded_range() -> None:
    texture = replace(make_texture(), exponents=(0.5, 2.0))
    force, speed = texture.force_max_N, texture.speed_max_m_s
    most = 10 ** (0.1 * LEVEL_BOUND_DB)
    forces, speeds = np.transpose([(1, 1), (2, 1), (2, 1.5), (0, 1), (np.nan, 99), (np.inf, 1), (1, -np.inf)])
    factor = texture.beyond(force * forces, speed * speeds)
    np.testing.assert_allclose(factor, [1.0, 2**0.5, 2**0.5 * 1.5**2, 1.0, most, most, 1.0])
    assert np.all(replace(texture, exponents=(0.0, 0.0), force_N=0.1 * texture.force_N).beyond([np.inf], [0.1]) == 1.0)
    power = texture.power([force, 2 * force], [speed, 1.5 * speed])
    assert power[1] == pytest.approx(power[0] * factor[2])
    np.testing.assert_allclose(texture.lattice([force, 2 * force], [speed, 1.5 * speed])[1], power)
    for interpolation in INTERPOLATIONS:
        _, variance = replace(texture, interpolation=interpolation).models([force, 2 * force], [speed, 1.5 * speed])
        assert variance[1] == pytest.approx(variance[0] * factor[2])
    clamped = replace(texture, exponents=(0.0, 0.0))
    assert clamped.power([9 * force], [speed])[0] == power[0]


def test_truncated_warped_texture() -> None:
    texture = replace(load_swatch("wood").texture, modulation=None)
    short = texture.truncated(5)
    assert texture.truncated(texture.order) is texture
    for order in (0, 0.5, 5.5, np.nan):
        with pytest.raises(SwatchError, match="order"):
            texture.truncated(order)
    assert short.order == 5 and short.warp == texture.warp > 0.0
    place = [texture.force_max_N], [texture.speed_max_m_s]
    assert short.power(*place) == pytest.approx(texture.power(*place))
    modulated = replace(texture, modulation=GainModulation([0.3], [20.0], [0.0]))
    for made in (modulated.truncated(5), modulated.resampled(5000.0)):
        assert made.modulation == modulated.modulation
