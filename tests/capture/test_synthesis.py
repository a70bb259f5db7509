"""Synthesis along a stroke."""

import numpy as np
import pytest

from hapscene.capture import metric, synthesize
from hapscene.errors import CaptureError
from hapscene.surface.swatch import PLAIN
from hapscene.surface.swatch_file import load_swatch, shipped_swatches


@pytest.mark.parametrize("name", shipped_swatches())
@pytest.mark.parametrize("rate_Hz", [None, 5000.0])
def test_shipped_swatches_play_at_their_power(name: str, rate_Hz: float | None) -> None:
    swatch = load_swatch(name)
    texture = swatch.texture
    assert texture is not None
    count = int(20 * (rate_Hz or texture.rate_Hz))
    force, slip = np.full(count, texture.force_max_N), np.full(count, texture.speed_max_m_s)
    made = synthesize(swatch, force, slip, rate_Hz, seed=1)
    expected = texture.power(force[:1], slip[:1])[0]
    assert abs(10 * np.log10(made.var() / expected)) < 0.5  # all of it is below 2.5 kHz, so 5 kHz keeps it
    assert np.array_equal(made, synthesize(swatch, force, slip, rate_Hz, seed=1))


def test_wild_walks_stay_finite_and_no_louder_than_the_model() -> None:
    rng = np.random.default_rng(0)
    for name in shipped_swatches():
        swatch = load_swatch(name)
        assert swatch.texture is not None
        force, slip = rng.uniform(-0.5, 4.0, 30_000), rng.uniform(-0.05, 0.5, 30_000)
        made = synthesize(swatch, force, slip)
        assert np.all(np.isfinite(made))
        assert made.var() < 2.0 * swatch.texture.model_power_m2_s4.max()


def test_silence_and_refusals() -> None:
    wood = load_swatch("wood")
    assert not np.any(synthesize(wood, np.zeros(100), np.ones(100)))
    assert len(synthesize(wood, [], [])) == 0
    with pytest.raises(CaptureError, match="no texture"):
        synthesize(PLAIN, [1.0], [1.0])
    with pytest.raises(CaptureError, match="one shape"):
        synthesize(wood, [1.0], [1.0, 2.0])
    assert metric.WINDOW_S > 0.0
