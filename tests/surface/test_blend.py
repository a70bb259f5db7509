"""Ways to blend models: stable in all of them, at the power that was asked for."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.surface.blend import GAIN_MAX, INTERPOLATIONS, filters, form, stabilised
from hapscene.surface.lsf import ar_from_lsf, ar_from_reflection, lsf_from_ar, power_gain, reflection_from_ar
from hapscene.surface.texture import Texture


def wild_pairs(order: int, count: int = 1000) -> tuple[np.ndarray, np.ndarray]:
    """Random stable filters (count, order+1), twice: any line spectral frequencies, hence any stable filter at all."""
    rng = np.random.default_rng(order)
    one, two = np.sort(rng.uniform(0.0, np.pi, (2, count, order)), axis=2)
    return ar_from_lsf(one), ar_from_lsf(two)


@pytest.mark.parametrize(("order", "share"), [(3, 0.13), (8, 0.73), (20, 0.99)])
def test_between_random_pairs_only_the_direct_form_is_unstable(order: int, share: float) -> None:
    """L1 of the reference (25, 75, 98 %; which random pairs it took is not stated), somewhere on the way between."""
    one, two = wild_pairs(order)
    unstable = np.zeros(len(one), bool)
    for weight in np.linspace(0.0, 1.0, 21):
        mean = (1 - weight) * one + weight * two
        gain = power_gain(mean)
        unstable |= ~np.isfinite(gain)
        made = stabilised(mean)
        assert np.all(power_gain(made) < GAIN_MAX)
        calm = gain < GAIN_MAX
        assert np.array_equal(made[calm], mean[calm])  # what is stable stays to the bit
        k = (1 - weight) * reflection_from_ar(one) + weight * reflection_from_ar(two)
        assert np.all(np.abs(k) < 1.0)
    assert unstable.mean() == pytest.approx(share, abs=0.04)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("order", [1, 2, 7, 20, 120])
def test_each_way_gives_back_the_models_themselves(interpolation: str, order: int) -> None:
    rng = np.random.default_rng(order)
    a = ar_from_reflection(rng.uniform(-0.7, 0.7, (4, order)) / np.sqrt(1 + np.arange(order) / 4))
    lsf = np.stack([lsf_from_ar(one) for one in a])
    assert np.abs(filters(interpolation, form(interpolation, lsf)) - a).max() < 1e-9


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_between_unlike_models_all_is_stable_and_the_power_is_right(interpolation: str) -> None:
    """Models of opposite spectra, the worst there is: asked for, synthesised, and compared."""
    rng = np.random.default_rng(3)
    k = rng.uniform(-0.8, 0.8, (6, 12))
    k[::2, 0], k[1::2, 0] = -0.98, 0.98
    a = ar_from_reflection(k)
    force, speed = rng.uniform(0.3, 3.0, 6), rng.uniform(0.03, 0.3, 6)
    texture = Texture.from_models(10_000.0, force, speed, a, 1.0 / power_gain(a), interpolation)
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


def test_coefficients_of_a_single_filter_are_told() -> None:
    a = ar_from_reflection([-0.9, 0.4])
    one = Texture.from_models(1000.0, [1.0, 2.0], [0.1, 0.2], [a, a], [1.0, 3.0])
    assert one.single
    k, power = one.lattice([2.0, 0.5, 0.0], [0.2, 0.1, 0.1])
    assert k.shape == (1, 2) and power[2] == 0.0 and power[0] == pytest.approx(3.0 * power_gain(a))
    two = Texture.from_models(1000.0, [1.0, 2.0], [0.1, 0.2], [a, ar_from_reflection([0.3, 0.1])], [1.0, 3.0])
    assert not two.single
    k, power = two.lattice([2.0, 0.5, 0.0], [0.2, 0.1, 0.1])
    assert k.shape == (3, 2)
    assert np.allclose(power, two.power([2.0, 0.5, 0.0], [0.2, 0.1, 0.1]))
