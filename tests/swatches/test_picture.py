"""Pictures of swatches."""

import io
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from hapscene.surface.swatch import Look, Swatch
from hapscene.surface.swatch_summary import figures
from hapscene.swatches.library import load_swatch
from hapscene.swatches.picture import (
    BALL_M,
    BALL_PX,
    LINE_DB,
    ROUGH_M_S2,
    SLOPE,
    _bent,
    _peaks,
    _period_m,
    _slopes,
    ball_png,
    relief,
)


def pixels(swatch: Swatch, colour: tuple[float, float, float] | None = None) -> NDArray[np.float64]:
    content = ball_png(swatch, colour)
    assert len(content) < 8_000
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGBA"), np.float64) / 255.0


def test_colour() -> None:
    seen = pixels(Swatch("red", albedo_rgb=(0.8, 0.1, 0.1)))
    assert seen.shape == (BALL_PX, BALL_PX, 4) and seen[0, 0, 3] == 0.0 and seen[36, 36, 3] == 1.0
    assert seen[36, 36, 0] > 3 * seen[36, 36, 2]
    border = seen[(seen[..., 3] > 0.0) & (seen[..., 3] < 1.0), :3]
    assert len(border) > 50 and np.abs(border - 0.5).max() < 0.1  # grey, however little of a pixel it covers
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


def test_peaks_have_a_prominence() -> None:
    """Above the higher one of the two lowest levels on the way to a higher peak or to the end."""
    level = LINE_DB * np.array([0.0, 1.01, 0.0, 0.2, 1.2, 0.5, 3.0, 1.5, 2.45, 1.0, 2.6, 1.55])
    assert _peaks(level) == [1, 6, 10]
    assert _peaks(level[::-1]) == [1, 5, 10]


def test_slopes_tilt_the_normal_along_the_tangents() -> None:
    for normal, right, up in (
        ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((0.0, 0.6, 0.8), (1.0, 0.0, 0.0), (0.0, 0.8, -0.6)),
        ((0.6, 0.0, 0.8), (0.8, 0.0, -0.6), (0.0, 1.0, 0.0)),
    ):
        known = np.array(normal) - 0.3 * np.array(right) + 0.2 * np.array(up)
        found = _bent(np.array([[normal]]), np.array([[[0.3, -0.2]]]))[0, 0]
        assert found == pytest.approx(known / np.linalg.norm(known))


def test_the_relief_grows_with_the_roughness_up_to_a_limit() -> None:
    wood = replace(load_swatch("wood"), look=None)
    roughness = figures(wood)["roughness_m_s2"]
    for share, factor in ((0.25, 0.5), (1.0, 1.0), (100.0, 1.7)):
        gain = share * ROUGH_M_S2 / roughness
        slopes, size_m = relief(replace(wood, effects={"lpc_texture": {"texture_gain": gain}}))
        assert np.sqrt((slopes**2).sum(axis=2).mean()) == pytest.approx(factor * SLOPE) and size_m == BALL_M
        assert np.abs(slopes.mean(axis=(0, 1))).max() < 0.01 * SLOPE
    assert relief(Swatch("plain"))[0].tolist() == [[[0.0, 0.0]]]


def test_a_smooth_ball_has_a_highlight() -> None:
    """Where the normal is halfway between light and viewer; with a roughness of 0.5 it is wide."""
    black = [pixels(Swatch("a", look=Look(roughness=r), albedo_rgb=(0.0,) * 3))[..., 0] for r in (0.01, 0.3, 0.5, 1.0)]
    inside = np.hypot(*np.meshgrid(*[(np.arange(BALL_PX) + 0.5) / BALL_PX * 2 - 1] * 2)) < 0.8
    assert [float(one[inside].max()) for one in black[1:]] == pytest.approx([0.63, 0.45, 0.0], abs=0.06)  # 0.9 (1 − r)
    wide = [np.count_nonzero(one[inside] > 0.05) for one in black]
    assert 0 < wide[0] < 0.2 * wide[1] < 0.1 * wide[2]
