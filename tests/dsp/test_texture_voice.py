"""Texture synthesis: ramped levels, models per block, continuous memory."""

import numpy as np
import pytest

from hapscene.constants import BLOCK_MAX
from hapscene.dsp.lattice import advance
from hapscene.dsp.noise import normal, seeded_state
from hapscene.dsp.texture_voice import Stroke, log_power, run_texture, voice_fields


def voice(order: int, warp: float = 0.0, level: float = 0.0) -> np.void:
    fields = [(name, float, shape) for name, shape in voice_fields(order)]
    s = np.zeros(1, [*fields, ("rng", np.uint64, (4,))])[0]
    s["order"], s["warp"], s["level_m_s2"], s["gain"] = order, warp, level, 1.0
    s["rng"] = seeded_state(1, "texture")
    return s


def run(k: np.ndarray, level: np.ndarray, block: int, count: int, s: np.void | None = None) -> np.ndarray:
    out = np.zeros(count)
    stroke = Stroke(k, level, np.zeros(level.size), np.zeros(0), 1.0, block, 1)
    run_texture(voice(k.shape[1], level=1.0) if s is None else s, stroke, out)
    return out


def test_the_level_is_ramped_over_each_block() -> None:
    k, level = np.array([[0.5, -0.3]]), np.array([2.0, 2.0, 0.0, 3.0])
    ramp = np.interp(np.arange(1, 37), [0, 10, 20, 30, 40], [1.0, *level])  # the last block is cut off
    np.testing.assert_allclose(run(k, level, 10, 36), ramp * run(k, np.ones(4), 10, 36), atol=1e-12)


def test_models_change_per_block_with_a_continuous_memory() -> None:
    models = np.array([[0.9, -0.5], [-0.7, 0.2]])
    made = run(models, np.ones(2), 50, 100)
    rng, b = seeded_state(1, "texture"), np.zeros(3)
    rows = [(np.append(0.0, k), np.append(1.0, np.sqrt(1.0 - k**2))) for k in models]
    np.testing.assert_array_equal(made, [advance(*rows[t // 50], b, 2, normal(rng)) for t in range(100)])


def test_models_and_blocks_of_any_length() -> None:
    """A block longer than the longest of a tick; models that change every third block; samples are added."""
    k, level = np.array([[0.9, -0.5], [-0.7, 0.2]]), np.array([2.0])
    count = 2 * BLOCK_MAX + 90
    ramp = 1.0 + np.arange(1, count + 1) / count
    np.testing.assert_allclose(run(k[:1], level, count, count), ramp * run(k[:1], np.ones(1), count, count), atol=1e-12)
    np.testing.assert_array_equal(run(k[:1], np.ones(1), count, count), run(k[:1], np.ones(7), 100, count))
    out = np.full(60, 5.0)
    run_texture(voice(2, level=1.0), Stroke(k, np.ones(6), np.zeros(6), np.zeros(0), 1.0, 10, 3), out)
    np.testing.assert_array_equal(out, 5.0 + run(k, np.ones(2), 30, 60))


def test_the_gain_of_a_stroke() -> None:
    """A process that never changes gives a constant gain; without a spread it is 1."""
    k, level = np.array([[0.5]]), np.ones(3)
    s, out = voice(1, level=1.0), np.zeros(30)
    s["spread_scale"], s["processes"] = 2.0, 0.7
    run_texture(s, Stroke(k, level, np.zeros(3), np.array([0.1, 0.0, 9.0, 0.05, 0.0, 9.0]), 1.0, 10, 1), out)
    gain = np.exp(0.7 * 2.0 * 0.15 - log_power(2.0 * np.hypot(0.1, 0.05)))
    ramp = np.interp(np.arange(1, 31), [0, 10, 30], [1.0, gain, gain])
    np.testing.assert_allclose(out, ramp * run(k, level, 10, 30), atol=1e-12)
    assert s["gain"] == pytest.approx(gain) and s["level_m_s2"] == 1.0
    fresh = voice(1, level=1.0)
    fresh["spread_scale"] = 1.0
    run_texture(fresh, Stroke(k, level, np.ones(3), np.array([0.1, 0.0, 9.0]), 1.0, 10, 1), out)
    assert np.unique(fresh["processes"]).size == fresh["processes"].size and fresh["gain"] != 1.0


@pytest.mark.parametrize("warp", [0.0, 0.6])
def test_two_calls_equal_one_call(warp: float) -> None:
    k, level = np.array([[0.4, 0.8, -0.2]]), np.array([1.0, 2.0, 0.5, 1.5])
    s = voice(3, warp)
    parts = [run(k, level[2 * i : 2 * i + 2], 10, 20, s) for i in (0, 1)]
    np.testing.assert_array_equal(np.concatenate(parts), run(k, level, 10, 40, voice(3, warp)))
