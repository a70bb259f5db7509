"""Pictures of swatches."""

import io
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from hapscene.surface.look import Look
from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch
from hapscene.swatches.picture import BALL_PX, _period_m, ball_png


def pixels(swatch: Swatch, colour: tuple[float, float, float] | None = None) -> NDArray[np.float64]:
    content = ball_png(swatch, colour)
    assert len(content) < 8_000
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGBA"), np.float64) / 255.0


def grain(swatch: Swatch, axis: int) -> float:
    """How much the ball's middle changes from pixel to pixel along an axis."""
    middle = pixels(swatch)[20:52, 20:52, :3].mean(axis=2)
    return float(np.abs(np.diff(middle, axis=axis)).mean())


def test_colour() -> None:
    seen = pixels(Swatch("red", albedo_rgb=(0.8, 0.1, 0.1)))
    assert seen.shape == (BALL_PX, BALL_PX, 4) and seen[0, 0, 3] == 0.0 and seen[36, 36, 3] == 1.0
    assert seen[36, 36, 0] > 3 * seen[36, 36, 2]
    assert seen[20, 24].sum() > seen[55, 50].sum()  # lit from the left above
    other = pixels(Swatch("red", albedo_rgb=(0.8, 0.1, 0.1)), (0.1, 0.1, 0.8))
    assert other[36, 36, 2] > 3 * other[36, 36, 0]


@pytest.mark.parametrize("colour", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])
def test_rim(colour: tuple[float, float, float]) -> None:
    edge = pixels(Swatch("x", albedo_rgb=colour))[36, :5]
    assert np.any((np.abs(edge[:, :3] - 0.5).max(axis=1) < 0.2) & (edge[:, 3] > 0.9))


def test_relief() -> None:
    grating, paper = load_swatch("grating-1mm-50um"), load_swatch("sandpaper-p60")
    assert grain(grating, 1) > 4 * grain(grating, 0)
    assert 0.5 < grain(paper, 1) / grain(paper, 0) < 2.0
    assert grain(paper, 1) > 1.8 * grain(load_swatch("sandpaper-p800"), 1)


def test_period() -> None:
    for name, period_m in (("grating-0.5mm-10um", 5e-4), ("grating-2mm-200um", 2e-3), ("ribs-6mm", 6e-3)):
        found = _period_m(load_swatch(name).texture, 1.0)
        assert found == pytest.approx(period_m, rel=0.03)
    for name in ("wood", "epoxy", "sandpaper-p60", "steel-lapped", "rubber-soft"):
        assert _period_m(load_swatch(name).texture, 1.0) is None


def test_its_own_pictures_are_worn() -> None:
    def png(array: NDArray[np.uint8]) -> bytes:
        file = io.BytesIO()
        Image.fromarray(array).save(file, "PNG")
        return file.getvalue()

    chequered = np.kron([[1, 0], [0, 1]], np.ones((8, 8)))[..., None] * np.array([0, 255, 0])
    seen = pixels(replace(load_swatch("wood"), look=Look(0.9, 0.004, png(chequered.astype(np.uint8)))))
    middle = seen[30:42, 30:42]
    assert middle[..., 1].max() > 0.4 and middle[..., 1].min() < 0.1 and middle[..., 0].max() < 0.3
    tilted = np.full((4, 4, 3), (20, 127, 180), np.uint8)  # leans to the left, to the light
    plain = Swatch("x", look=Look(0.9))
    assert pixels(replace(plain, look=Look(0.9, normal_png=png(tilted))))[36, 50].sum() > pixels(plain)[36, 50].sum()


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
