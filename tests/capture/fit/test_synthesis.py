"""Synthesis along a stroke: spectrum and power are those of the models."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from hapscene.capture import synthesize
from hapscene.capture.fit import distance as spectral
from hapscene.capture.fit.synthesis import _Synthesizer
from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.errors import CaptureError
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.surface.swatch_file import swatch_from_json, swatch_to_json
from hapscene.surface.texture import INTERPOLATIONS, Texture
from hapscene.swatches.library import load_swatch, shipped_swatches
from hapscene_plugins.effects.lpc_texture import EFFECT, choose

EDGES_HZ = np.geomspace(20.0, 1000.0, 9)


def unlike(interpolation: str) -> Swatch:
    """A swatch with five different, well-damped models."""
    rng = np.random.default_rng(4)
    k = rng.uniform(-0.5, 0.5, (5, 16))
    k[:, 0] = np.linspace(-0.95, -0.5, 5)
    a = ar_from_reflection(k)
    force, speed = rng.uniform(0.5, 3.0, 5), rng.uniform(0.05, 0.3, 5)
    variance = rng.uniform(0.5, 3.0, 5) / power_gain(a)
    return Swatch(
        "unlike",
        texture=Texture.from_models(10_000.0, force, speed, a=a, variance_m2_s4=variance, interpolation=interpolation),
    )


SWATCHES = [load_swatch(name) for name in shipped_swatches()] + [unlike(name) for name in INTERPOLATIONS]
EACH = pytest.mark.parametrize("swatch", SWATCHES, ids=[*shipped_swatches(), *INTERPOLATIONS])


def bands_dB(frequency: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Level in each band of `EDGES_HZ`."""
    return np.asarray(10 * np.log10(spectral.band_power(density, frequency, EDGES_HZ)))


@EACH
def test_spectrum_and_power_of_a_long_synthesis(swatch: Swatch) -> None:
    """At constant force and speed between models: 0.3 dB per band and 0.2 dB in total, plus scatter."""
    texture = swatch.texture
    assert texture is not None
    force, slip = 0.63 * texture.force_max_N, 0.41 * texture.speed_max_m_s
    count = 2_000_000
    made = synthesize(swatch, np.full(count, force), np.full(count, slip), seed=3, modulation=0.0)
    a, variance = texture.model(force, slip)
    assert a[0] == 1.0
    frequency, density = welch(made, texture.rate_Hz, nperseg=8192)
    model = spectral.model_spectrum(a, variance, texture.rate_Hz, frequency, texture.warp)
    assert np.abs(bands_dB(frequency, density) - bands_dB(frequency, model)).max() < 0.3
    assert abs(10 * np.log10(made.var() / (variance * power_gain(a, texture.warp)))) < 0.2


@EACH
def test_the_table_of_the_effect_equals_the_texture(swatch: Swatch) -> None:
    """Level and filter of the renderer between grid points, compared with `Texture.model`."""
    texture = swatch.texture
    assert texture is not None
    table = EFFECT.table(swatch, texture.rate_Hz)
    rng = np.random.default_rng(0)
    s = np.zeros(1, EFFECT.state_dtype)[0]
    frequency = np.linspace(20.0, 1000.0, 200)
    spectrum, level = [], []
    for share in rng.uniform(0.3, 1.0, (60, 2)):
        force, slip = share * (texture.force_max_N, texture.speed_max_m_s)
        power = choose(table, force, slip, s, True)
        a, variance = texture.model(force, slip)
        looked_up = ar_from_reflection(s["k"][1 : texture.order + 1])
        unit_gain = power_gain(looked_up, texture.warp)
        got = spectral.model_spectrum(looked_up, power / unit_gain, 1e4, frequency, texture.warp)
        want = spectral.model_spectrum(a, variance, 1e4, frequency, texture.warp)
        spectrum.append(np.sqrt(np.mean((10 * np.log10(got / want)) ** 2)))
        level.append(abs(10 * np.log10(power / (variance * power_gain(a, texture.warp)))))
    assert np.median(spectrum) < 0.1 and np.percentile(spectrum, 90) < 0.5
    assert np.median(level) < 0.05 and np.max(level) < 0.7


def test_a_saved_swatch_gives_the_same_output() -> None:
    for swatch in SWATCHES:
        again = swatch_from_json(swatch_to_json(swatch))
        assert again.texture == swatch.texture
        assert np.array_equal(
            synthesize(again, np.ones(500), np.full(500, 0.1)), synthesize(swatch, np.ones(500), np.full(500, 0.1))
        )
    one, two = (synthesize(SWATCHES[0], np.ones(500), np.full(500, 0.1), seed=seed) for seed in (1, 2))
    assert not np.array_equal(one, two)


def test_silence_and_invalid_input() -> None:
    wood = load_swatch("wood")
    assert not np.any(synthesize(wood, np.zeros(100), np.ones(100)))
    assert not np.any(synthesize(wood, np.full(100, np.nan), np.ones(100)))
    assert len(synthesize(wood, [], [])) == 0
    with pytest.raises(CaptureError, match="no texture"):
        synthesize(PLAIN, [1.0], [1.0])
    with pytest.raises(CaptureError, match="shapes"):
        synthesize(wood, [1.0], [1.0, 2.0])


# Amplitude modulation.


def modulated(**fields) -> Swatch:
    swatch = unlike("lsf")
    return replace(
        swatch,
        texture=replace(swatch.texture, modulation=GainModulation([0.3, 0.4], [40.0, 0.0], [0.0, 300.0]), **fields),
    )


def test_a_slow_gain_spreads_the_levels_and_keeps_the_power() -> None:
    force, speed = np.full(1_000_000, 1.0), np.full(1_000_000, 0.1)
    steady, made = (synthesize(modulated(), force, speed, modulation=depth) for depth in (0.0, 1.0))
    np.testing.assert_array_equal(steady, synthesize(unlike("lsf"), force, speed))
    power = [y.reshape(-1, 500).var(axis=1) for y in (steady, made)]
    assert np.mean(power[1]) == pytest.approx(np.mean(power[0]), rel=0.08)
    log = np.log(power[1] / np.mean(power[1])) / 2.0
    assert np.std(log) == pytest.approx(0.4, abs=0.08)  # both together have 0.5; the fast one is half gone in 50 ms
    with pytest.raises(CaptureError, match="modulation"):
        synthesize(modulated(), force, speed, modulation=np.nan)


def test_the_gain_changes_along_the_way_of_the_stroke() -> None:
    force, speed = np.ones(4000), np.full(4000, 0.1)
    stopped = np.where(np.arange(4000) < 2000, speed, 0.02)
    moved, slowed = (synthesize(modulated(), force, v) for v in (speed, stopped))
    np.testing.assert_array_equal(moved[:1800], slowed[:1800])
    assert not np.allclose(moved[2200:], slowed[2200:])


@pytest.mark.parametrize("warp", [0.0, 0.5])
def test_batches_do_not_change_the_output(warp: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Synthesis in one batch and in many gives the same samples."""
    swatch = modulated(warp=warp)
    made = _Synthesizer(swatch.texture, 1.0, 0)
    assert (made.step, made.hold, made.block, made.step_s) == (10, 10, 100, 1e-3)  # 1 ms and 10 ms
    force = np.linspace(0.5, 2.0, 40_000)
    whole = synthesize(swatch, force, np.full(40_000, 0.1))
    monkeypatch.setattr("hapscene.capture.fit.synthesis._BATCH", 7)
    np.testing.assert_allclose(synthesize(swatch, force, np.full(40_000, 0.1)), whole, atol=1e-9 * whole.std())
