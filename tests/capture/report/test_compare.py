"""Comparison of surfaces with known differences."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hapscene.capture.fit.distance import BAND_EDGES_HZ, band_power
from hapscene.capture.report.compare import PLACES, Tap, _bands, compare, tap_energy
from hapscene.surface.swatch import PLAIN, Swatch, touched_with
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch

RATE = 5000.0


def textured(name: str = "a", frequency_Hz: float = 200.0, gain: float = 1.0, **more: object) -> Swatch:
    """A swatch of one resonance, everything in it."""
    a = [1.0, -2.0 * 0.97 * math.cos(2.0 * math.pi * frequency_Hz / RATE), 0.97**2]
    texture = Texture.from_models(RATE, [1.0], [0.1], a=[a], variance_m2_s4=[gain**2])
    taps = Taps([0.1], [10.0], [100.0], [60.0])
    base = Swatch(name, 500.0, 0.0, 0.5, 0.4, texture, taps)
    return replace(base, **more)  # type: ignore[arg-type]


def amplitude_of(frequency_Hz: float) -> float:
    """The amplitude [m/s²] at which a tap of that frequency has the energy of `textured`'s own."""

    def per_amplitude(f: float) -> float:
        return (2.0 * math.pi * f) ** 2 / (60.0**2 + (2.0 * math.pi * f) ** 2)

    return 10.0 * math.sqrt(per_amplitude(100.0) / per_amplitude(frequency_Hz))


def test_a_surface_equals_itself() -> None:
    comparison = compare(textured(), textured())
    assert comparison.distance_jnd == 0.0 and comparison.verdict == "cannot be distinguished"
    assert len(comparison.differences) == 7 and not comparison.skipped


@pytest.mark.parametrize(
    ("change", "quantity", "amount"),
    [
        ({"friction_dynamic": 0.44, "friction_static": 0.5}, "dynamic friction", 100 * 0.04 / 0.42),
        ({"friction_static": 0.75}, "static friction", 40.0),
        ({"stiffness_N_m": 250.0}, "compliance", 100 * 2 / 3),
        ({"taps": Taps([0.1], [20.0], [100.0], [60.0])}, "tap level", 20 * math.log10(2)),
        # of the same energy A² ω² / (4 β (β² + ω²)) at twice the frequency
        ({"taps": Taps([0.1], [amplitude_of(200.0)], [200.0], [60.0])}, "tap frequency", 100 * 2 / 3),
    ],
)
def test_a_known_change_is_found_and_nothing_else(change: dict[str, object], quantity: str, amount: float) -> None:
    comparison = compare(textured(), textured("b", **change))
    found = {d.quantity.name: d.change for d in comparison.differences}
    assert found.pop(quantity) == pytest.approx(amount)
    assert all(value == pytest.approx(0.0, abs=1e-9) for value in found.values())


def test_level_and_spectrum_are_separated() -> None:
    louder = {d.quantity.name: d for d in compare(textured(), textured("b", gain=2.0)).differences}
    assert louder["vibration level"].change == pytest.approx(20 * math.log10(2), abs=1e-6)
    assert louder["vibration level"].verdict == "is clearly different"
    assert louder["vibration spectrum"].change == pytest.approx(0.0, abs=1e-6)
    higher = {d.quantity.name: d for d in compare(textured(), textured("b", 400.0)).differences}
    assert higher["vibration spectrum"].verdict == "is clearly different"


def test_comparing_is_symmetric() -> None:
    one, two = textured(), textured("b", 300.0, 1.5, stiffness_N_m=800.0, friction_static=0.6)
    there, back = compare(one, two), compare(two, one)
    assert there.distance_jnd == pytest.approx(back.distance_jnd)
    for d, e in zip(there.differences, back.differences, strict=True):
        assert d.distance_jnd == pytest.approx(e.distance_jnd)


def test_verdicts_follow_the_thresholds() -> None:
    base = textured()
    for percent, verdict in ((10.0, "cannot"), (12.0, "can be"), (21.0, "can be"), (23.0, "is clearly")):
        ratio = (2 + percent / 100) / (2 - percent / 100)
        other = replace(base, friction_static=0.5 * ratio)
        assert compare(base, other).verdict.startswith(verdict)


def test_missing_quantities_are_skipped_with_a_reason() -> None:
    comparison = compare(PLAIN, textured())
    assert comparison.skipped["vibration level"] == "texture of plain: not measured"
    assert comparison.skipped["tap level"] == "taps of plain: not measured"
    assert compare(PLAIN, PLAIN).skipped["tap frequency"] == "taps of plain and plain: not measured"
    assert compare(PLAIN, replace(PLAIN, stiffness_N_m=0.0)).skipped["compliance"]
    mute = compare(textured(), textured("b", taps=Taps([0.1], [0.0], [100.0], [60.0])))
    assert mute.skipped.keys() == {"tap level", "tap frequency"} and len(mute.differences) == 5
    silent = textured("b", gain=0.0)
    assert "silent" in compare(textured(), silent).skipped["vibration level"]
    assumed = replace(textured(), absent={"stiffness_N_m": "no depth"})
    assert compare(assumed, textured("b")).skipped == {"compliance": "a: no depth"}


def test_textures_of_different_rates_are_compared_below_both_nyquists() -> None:
    slow = Texture.from_models(1000.0, [1.0], [0.1], a=[[1.0, -0.5]], variance_m2_s4=[1.0])
    found = compare(textured(), textured("b", texture=slow)).differences
    assert all(math.isfinite(d.change) for d in found)


def test_textures_are_compared_over_their_common_range() -> None:
    """Of force, speed and frequency: up to 1 N, 0.1 m/s and 500 Hz."""
    one = Texture.from_models(RATE, [2.0], [0.1], a=[[1.0, -0.5]], variance_m2_s4=[1.0], exponents=(0.5, 2.0))
    two = Texture.from_models(1000.0, [1.0], [0.3], a=[[1.0, -0.5]], variance_m2_s4=[1.0])
    frequency = np.arange(20.0, 1001.0)
    edges = [edge for edge in BAND_EDGES_HZ if edge <= 500.0]
    density = [one.density([f], [0.1 * v], frequency_Hz=frequency)[0] for f in PLACES for v in PLACES]
    np.testing.assert_allclose(_bands(one, two), band_power(density, frequency, edges))
    assert _bands(two, one).shape == (len(PLACES) ** 2, len(edges) - 1)


def test_tools_are_stated_if_both_are_known_and_differ() -> None:
    steel, brass = textured(tool="steel probe", tip="ball"), textured(tool="brass probe", tip="ball")
    assert compare(steel, brass).tools == (touched_with(steel), touched_with(brass))
    for other in (steel, textured(), textured(tip="ball")):
        assert compare(steel, other).tools is compare(other, steel).tools is None


def test_tap_energy_is_its_integral() -> None:
    tap = Tap(12.0, 80.0, 70.0)
    t = np.arange(0.0, 1.0, 1e-6)
    a = tap.amplitude_m_s2 * np.exp(-tap.decay_1_s * t) * np.sin(2 * np.pi * tap.frequency_Hz * t)
    assert tap_energy(tap) == pytest.approx(np.sum(a**2) * 1e-6, rel=1e-5)


def test_measured_taps_are_compared_by_their_own_energy() -> None:
    t = np.arange(800) / RATE
    wave = 10.0 * np.exp(-60.0 * t) * np.sin(2.0 * np.pi * 100.0 * t)
    stored = Taps([0.1], [10.0], [100.0], [60.0], wave[None], RATE)
    found = {d.quantity.name: d.change for d in compare(textured(), textured("b", taps=stored)).differences}
    assert found["tap level"] == pytest.approx(0.0, abs=0.05)


def test_an_assumed_level_is_stated() -> None:
    wood, leather = load_swatch("wood"), load_swatch("leather")
    comparison = compare(wood, replace(leather, absent={}))
    assert comparison.assumed == {"wood": wood.absent["texture.level"]}
