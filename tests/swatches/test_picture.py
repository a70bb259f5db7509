"""Pictures of swatches."""

import io

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch
from hapscene.swatches.picture import BALL_M, BALL_PX, _period_m, _slopes, ball_png


def pixels(swatch: Swatch, colour: tuple[float, float, float] | None = None) -> NDArray[np.float64]:
    content = ball_png(swatch, colour)
    assert len(content) < 8_000
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGBA"), np.float64) / 255.0


def test_colour() -> None:
    seen = pixels(Swatch("red", albedo_rgb=(0.8, 0.1, 0.1)))
    assert seen.shape == (BALL_PX, BALL_PX, 4) and seen[0, 0, 3] == 0.0 and seen[36, 36, 3] == 1.0
    assert seen[36, 36, 0] > 3 * seen[36, 36, 2]
    assert seen[20, 24].sum() > seen[55, 50].sum()  # lit from the left above
    other = pixels(Swatch("red", albedo_rgb=(0.8, 0.1, 0.1)), (0.1, 0.1, 0.8))
    assert other[36, 36, 2] > 3 * other[36, 36, 0]


def test_period() -> None:
    for name, period_m in (("grating-0.5mm-10um", 5e-4), ("grating-2mm-200um", 2e-3), ("ribs-6mm", 6e-3)):
        found = _period_m(load_swatch(name).texture, 1.0)
        assert found == pytest.approx(period_m, rel=0.03)
        slopes = _slopes(load_swatch(name).texture)
        assert not slopes[..., 1].any() and slopes[..., 0].std() == pytest.approx(1.0, rel=0.01)
        assert np.argmax(np.abs(np.fft.rfft(slopes[0, :, 0]))) == max(round(BALL_M / found), 1)  # grooves in the tile
    for name in ("wood", "epoxy", "sandpaper-p60", "steel-lapped", "rubber-soft"):
        assert _period_m(load_swatch(name).texture, 1.0) is None


@pytest.mark.parametrize("name", ["wood", "paper", "leather", "epoxy"])
def test_shipped_pictures_have_the_colour_of_the_swatch(name: str) -> None:
    swatch = load_swatch(name)
    assert swatch.look is not None
    albedo = swatch.look.albedo()
    assert albedo is not None
    np.testing.assert_allclose(albedo.mean(axis=(0, 1)), swatch.albedo_rgb, atol=0.02)
    assert albedo.std(axis=(0, 1)).max() > 0.01
    for axis in (0, 1):  # periodic: opposite borders differ no more than neighbours within
        step = np.abs(np.diff(albedo, axis=axis)).mean()
        seam = np.abs(np.take(albedo, 0, axis) - np.take(albedo, -1, axis)).mean()
        assert seam < 2.0 * step
