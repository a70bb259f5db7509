"""Long random sequences of force, speed and swatch: the texture remains finite and at its level."""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.dsp.noise import normal, seeded_state, uniform
from hapscene.records import OUTPUT
from hapscene.surface.effect_compile import call_effect, compile_effect
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import INTERPOLATIONS, Texture
from hapscene.swatches.library import load_swatch, shipped_swatches
from hapscene_plugins.effects.lpc_texture import EFFECT

WINDOW = 5000
"""Ticks per level."""

STEP = 0.05
"""Step of a random walk, relative to the largest force and speed [1]."""


@njit
def walk(address, row, params, tables, starts, tops, mode, states, out, count, rng, seen):
    """`count` ticks, random ones: fills seen (count, 4): swatch, force, speed, power. Returns the peak."""
    x, y, which, peak = 0.5, 0.5, 0, 0.0
    for i in range(count):
        if mode == 0:  # a walk that bounces off the axes and goes beyond the hull
            x = min(abs(x + STEP * normal(rng)), 1.5)
            y = min(abs(y + STEP * normal(rng)), 1.5)
        elif mode == 1:  # anywhere at all, with every tick
            x, y = 1.5 * uniform(rng), 1.5 * uniform(rng)
        else:  # along the hull and off it again
            x, y = (1.0, 1.2 * uniform(rng)) if uniform(rng) < 0.5 else (1.2 * uniform(rng), 1.0)
        if len(starts) > 2:
            which = int(uniform(rng) * (len(starts) - 1))
        row.force_N, row.slip_m_s = x * tops[which, 0], y * tops[which, 1]
        for j in range(row.block):
            out.a_m_s2[j] = 0.0
        call_effect(address, row, params, 0, tables[starts[which] : starts[which + 1]], states, 0, out)
        power = 0.0
        for j in range(row.block):
            power += out.a_m_s2[j] ** 2
            peak = max(peak, abs(out.a_m_s2[j]))
        seen[i, 0], seen[i, 1], seen[i, 2], seen[i, 3] = which, row.force_N, row.slip_m_s, power / row.block
    return peak


def soak(bench, ticks, swatches: list[Swatch], mode: int, count: int, seed: int = 0) -> tuple[float, float, float]:
    """Level relative to the models [dB], largest deviation of a window [dB], and peak relative to the largest σ."""
    one = bench(EFFECT, swatches[0], seed=seed)
    tables = [EFFECT.table(swatch, 10_000.0) for swatch in swatches]
    textures = [swatch.texture for swatch in swatches]
    seen = np.empty((count, 4))
    peak = walk(
        compile_effect(EFFECT),
        ticks(1)[0],
        one.p.view(np.uint8),
        np.concatenate(tables),
        np.concatenate([[0], np.cumsum([len(table) for table in tables])]),
        np.array([(texture.force_max_N, texture.speed_max_m_s) for texture in textures]),
        mode,
        one.s.view(np.uint8),
        np.zeros(1, OUTPUT)[0],
        count,
        seeded_state(seed, "walk"),
        seen,
    )
    should = np.zeros(count)
    for i, texture in enumerate(textures):
        of = seen[:, 0] == i
        should[of] = texture.power(seen[of, 1], seen[of, 2])
    assert np.all(np.isfinite(seen))
    windows = (seen[:, 3].reshape(-1, WINDOW).mean(axis=1), should.reshape(-1, WINDOW).mean(axis=1))
    apart = 10 * np.log10(windows[0] / windows[1])
    sigma = np.sqrt(max(texture.model_power_m2_s4.max() for texture in textures))
    return float(10 * np.log10(seen[:, 3].mean() / should.mean())), float(np.abs(apart).max()), peak / sigma


def adversary(interpolation: str) -> Swatch:
    """Two models with opposite spectra."""
    rng = np.random.default_rng(1)
    k = rng.uniform(-0.9, 0.9, (9, 12))
    k[::2, 0], k[1::2, 0] = -0.98, 0.98
    a = ar_from_reflection(k)
    force, speed = (grid.ravel() for grid in np.meshgrid([0.5, 1.0, 2.0], [0.05, 0.1, 0.2]))
    texture = Texture.from_models(
        10_000.0, force, speed, a=a, variance_m2_s4=1.0 / power_gain(a), interpolation=interpolation
    )
    return Swatch(interpolation, texture=texture)


def steady(name: str) -> Swatch:
    """A shipped swatch without amplitude modulation, which would scatter the levels."""
    swatch = load_swatch(name)
    assert swatch.texture is not None
    return replace(swatch, texture=replace(swatch.texture, modulation=None))


SHIPPED = shipped_swatches()
CASES = [[name] for name in SHIPPED] + [SHIPPED]


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize("names", CASES, ids=["+".join(case) for case in CASES])
def test_walks_through_shipped_swatches(bench, ticks, names: list[str], mode: int) -> None:
    whole, window, peak = soak(bench, ticks, [steady(name) for name in names], mode, 20_000)
    assert abs(whole) < 1.0 and window < 3.0 and peak < 12.0


@pytest.mark.parametrize("interpolation", [name for name in INTERPOLATIONS if name != "hatt"])
def test_walks_through_opposite_models(bench, ticks, interpolation: str) -> None:
    for mode in (0, 1, 2):
        whole, window, peak = soak(bench, ticks, [adversary(interpolation)], mode, 20_000)
        assert abs(whole) < 1.0 and window < 3.0 and peak < 6.0
