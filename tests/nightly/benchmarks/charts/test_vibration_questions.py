"""The questions of vibration: their error sides against closed forms, planted surfaces and SciPy."""

import numpy as np
import pytest
from scipy.integrate import quad

from hapscene.capture.fit.windows import Pieces
from hapscene.constants import LEVEL_BOUND_DB
from hapscene.dsp.warped_prediction import warp_at
from hapscene.perception import band_edges_Hz, band_rms_m_s2
from hapscene.renderer import Renderer
from hapscene.stability.rig import sheet
from hapscene.surface.effect_registry import load_effect
from hapscene.surface.life import Life
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene_benchmarks.charts import acceleration_rate, level_law, life, tap_model, texture_domain, texture_order
from hapscene_benchmarks.charts.measuring import apart_jnd, bands_of, enough, model_bands, stroke_path, texture_bands
from hapscene_benchmarks.charts.question import Point
from hapscene_benchmarks.charts.texture_update import followed, held_error

EDGES_HZ = band_edges_Hz()


@pytest.mark.parametrize("held", [False, True])
def test_bands_of_white_noise_are_as_wide_as_they_are_and_droop_where_samples_are_held(held: bool) -> None:
    white = Texture.from_models(2000.0, [1.0], [0.1], a=[[1.0, 0.0]], variance_m2_s4=[3.0])
    found = texture_bands(white, [1.0], [0.1], held=held)[0]
    assert held or model_bands([1.0], 3.0, 2000.0) == pytest.approx(found)
    for low, high, rms in zip(EDGES_HZ[:-1], EDGES_HZ[1:], found, strict=True):
        power = quad(lambda f: 2.0 * 3.0 / 2000.0 * (np.sinc(f / 2000.0) ** 2 if held else 1.0), low, high)[0]
        assert rms == pytest.approx(np.sqrt(power), rel=1e-4)


def test_a_band_twice_as_loud_in_power_is_a_jnd_and_a_half() -> None:
    loud = np.full(12, 5.0)
    assert apart_jnd(np.sqrt(2.0) * loud, loud) == pytest.approx(20.0 * np.log10(np.sqrt(2.0)) / 2.0)


def test_enough_is_the_quickest_that_is_near_enough_or_else_the_best() -> None:
    points = [Point("m", str(us), us, us, {"e": e}) for us, e in ((1.0, 3.0), (2.0, 0.9), (3.0, 0.1))]
    cited = Point("other", "0", 0.1, 0.1, {"e": 0.0}, source="a paper")
    assert enough([*points, cited], "e", 1.0) is points[1] and enough([*points, cited], "e", 0.01) is points[2]


def test_the_known_surface_has_the_spectrum_that_is_said() -> None:
    heard, frequency, density = texture_order.planted_surface(400_000)
    measured = band_rms_m_s2(heard, 10_000.0, EDGES_HZ)
    np.testing.assert_allclose(measured[3:], bands_of(frequency, density)[3:], rtol=0.06)  # below 55 Hz Welch blurs


def test_more_coefficients_come_nearer_to_a_known_surface() -> None:
    found = [texture_order._planted(order) for order in (2, 30, 160)]
    assert found[0] > 3.0 > found[1] > 1.0 > found[2]


def test_a_warped_model_of_few_coefficients_is_as_near_as_a_plain_one_of_many() -> None:
    warp = warp_at(10_000.0)
    assert texture_order._planted(12, warp) < 0.6 * texture_order._planted(12)
    assert texture_order._planted(20, warp) < texture_order._planted(80)


def test_a_level_goes_on_by_its_law_to_its_bound_and_stays_where_it_is_clamped() -> None:
    force, speed = np.linspace(0.9, 1.1, 40), np.tile([0.1, 0.12], 20)
    known = Pieces(np.sqrt(force * speed)[:, None] * np.ones(2), force, speed, np.arange(40))  # exponents 1 and 1
    asked = np.array([1.0, 2.2]), np.array([0.1, 0.24])
    true = 10.0 * np.log10(asked[0] * asked[1])
    np.testing.assert_allclose(level_law.level_dB("exponents 1 and 1", known, *asked), true, atol=0.02)
    clamped = level_law.level_dB("clamped", known, *asked)
    assert clamped[1] == pytest.approx(true[1] - 20.0 * np.log10(2.0), abs=0.3)
    far = level_law.level_dB("exponents 1 and 1", known, np.array([1.0]), np.array([12.0]))
    edge = level_law.level_dB("exponents 1 and 1", known, np.array([1.0]), np.array([0.12]))
    assert far == pytest.approx(edge + LEVEL_BOUND_DB)


def test_a_known_gain_is_found_and_a_steady_texture_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(life, "DRAWS", 1)
    monkeypatch.setattr(life, "PLANTED_S", 4.0)
    assert life._planted(0, "") == 1.0
    assert life._planted(2, "time") < 0.5
    both = life.covariance(Life([0.3, 0.4], [10.0, 0.0], [0.0, 50.0]), 0.2)  # 10 a second, and 50 a metre at 0.2 m/s
    np.testing.assert_allclose(both, 0.25 * np.exp(-10.0 * life.LAGS_S))
    four = Life([0.1, 0.2, 0.3, 0.4], [60.0, 20.0, 8.0, 3.0], np.zeros(4))
    for count, over in ((1, "time"), (2, "distance")):
        less = life.joined(four, count, over, 0.2)
        rate = less.decay_1_s + 0.2 * less.decay_1_m
        assert len(rate) == count and less.log_spread == pytest.approx(four.log_spread)
        assert np.sum(less.spread**2 / rate) == pytest.approx(np.sum(four.spread**2 / four.decay_1_s))


def test_warped_models_blend_as_plain_ones_do() -> None:
    texture = texture_domain.planted_texture("warped", 2)
    true = model_bands(*texture_domain.surface_at(0.3, 0.04), 10_000.0)
    assert apart_jnd(texture_domain.asked(texture, "warped", 0.3, 0.04), true) < 0.1
    assert texture_domain.error("warped", 3)["planted"] < 0.5 * texture_domain.error("warped", 2)["planted"]


@pytest.mark.parametrize("domain", ["lsf", "reflection", "direct", "hatt"])
def test_a_blend_is_the_surface_itself_at_a_model_and_nearer_than_the_nearest_between(domain: str) -> None:
    texture = texture_domain.planted_texture(domain, 2)
    for force, speed in ((0.3, 0.04), (2.0, 0.25)):
        true = model_bands(*texture_domain.surface_at(force, speed), 10_000.0)
        assert apart_jnd(texture_domain.asked(texture, domain, force, speed), true) < 1e-3
    assert texture_domain.error(domain, 2)["planted"] < 0.5 * texture_domain.error("nearest", 2)["planted"]
    assert texture_domain.error(domain, 3)["planted"] < 0.5 * texture_domain.error(domain, 2)["planted"]


def test_a_level_is_followed_as_the_tick_follows_it() -> None:
    texture = Texture.from_models(10_000.0, [2.0], [0.2], a=[[1.0, -0.5]], variance_m2_s4=[1e2])
    effects = {"lpc_texture": {"update_ticks": 4.0}}
    renderer = Renderer(sheet(Swatch("rough", texture=texture, effects=effects)), ("wall", "lpc_texture"))
    effect, start = load_effect("lpc_texture"), renderer.surface.state_start[1]
    state = renderer.surface.states[start : start + effect.state_dtype.itemsize].view(effect.state_dtype)
    seen, touch = [], renderer.surface.touch
    for place in stroke_path(120):
        renderer.step(place)
        seen.append((touch["force_N"][0], touch["slip_m_s"][0], state["level_m_s2"][0]))
    force, slip, level = np.array(seen[1:]).T  # from the first tick in contact on
    expected = followed(np.sqrt(texture.power(force, slip)), 4)
    np.testing.assert_allclose(level[8:], expected[8:], rtol=0.01)


def test_a_level_that_is_looked_at_each_tick_is_its_own() -> None:
    texture = Texture.from_models(10_000.0, [2.0], [0.2], a=[[1.0, -0.5]], variance_m2_s4=[1e6])
    force, speed = 1.01 ** np.arange(64), np.full(64, 0.2)
    assert held_error(texture, force, speed, 1)["p95"] < 1e-9
    # a look each four ticks, of what grows by 1 % in power a tick: 3 ticks' growth off in the last tick of each
    least = 3.0 * 10.0 * np.log10(1.01) / 2.0
    assert held_error(texture, force, speed, 4)["median"] == pytest.approx(least, rel=0.02)


def test_a_faster_channel_is_nearer_and_the_reference_is_itself() -> None:
    found = [acceleration_rate.error(rate, "held")["texture"] for rate in (2000.0, 5000.0)]
    assert found[0] > found[1] > 0.0
    assert acceleration_rate.error(acceleration_rate.REFERENCE_HZ, "filtered") == {"texture": 0.0, "tap": 0.0}


def test_the_bands_of_a_tap_hold_its_energy() -> None:
    """A decaying sine has ∫a² = A² ω²/(4β(β² + ω²))."""
    a, beta, omega, rate = 20.0, 60.0, 2.0 * np.pi * 250.0, 10_000.0
    time_s = np.arange(2000) / rate
    tap = a * np.exp(-beta * time_s) * np.sin(omega * time_s)
    energy = a**2 * omega**2 / (4.0 * beta * (beta**2 + omega**2))
    assert np.sum(acceleration_rate.tap_bands(tap, rate) ** 2) * 0.1 == pytest.approx(energy, rel=0.01)


def test_modes_are_found_and_rung_as_they_are() -> None:
    found = tap_model.fitted(tap_model.true_tap(0.1), 3)
    expected = np.array(tap_model.MODES) * (tap_model.LOUD_M_S2 * 0.1, 1.0, 1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    assert tap_model.error(3, True)["planted"] < 0.5 < 1.0 < tap_model.error(0, False)["planted"]
