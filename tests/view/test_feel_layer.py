"""Grains of swatches, and the squares that they fill on a body."""

import io

import numpy as np
import pytest
from PIL import Image

from hapscene.surface.look import Look
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.swatches.picture import BALL_M, LIGHT
from hapscene.view.feel_layer import CONTRAST, SHADE, TILES_MAX, box_uv, grain_of


def png(pixels: np.ndarray) -> bytes:
    content = io.BytesIO()
    Image.fromarray(np.rint(255 * pixels).astype(np.uint8)).save(content, "PNG")
    return content.getvalue()


def test_grain_of_pictures_is_lit_by_its_normals_and_keeps_the_mean_of_a_colour() -> None:
    leaning = [[(0.6, 0.0, 0.8), (0.0, 0.6, 0.8)], [(-0.96, 0.0, 0.28), (0.0, 0.0, 1.0)]]
    albedo = np.array([[(0.2, 0.4, 0.6), (0.6, 0.4, 0.2)], [(0.4, 0.4, 0.4), (0.02, 0.01, 0.0)]])
    fine = np.repeat(np.repeat(leaning, 2, axis=0), 2, axis=1)  # of twice the resolution
    grain = grain_of(Swatch("tiles", look=Look(0.3, 0.02, png(albedo), png((fine + 1.0) / 2.0))))
    assert (grain.size_m, grain.roughness, grain.flat) == (0.02, 0.3, False)
    np.testing.assert_allclose(grain.normal, leaning, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(grain.normal, axis=2), 1.0, rtol=1e-12)
    shade = np.clip(1.0 + CONTRAST * (grain.normal @ LIGHT / LIGHT[2] - 1.0), *SHADE)
    np.testing.assert_allclose(grain.shade, shade)
    expected = 255.0 * np.clip(shade[..., None] * albedo / albedo.mean(axis=(0, 1)) / SHADE[1], 0.0, 1.0)
    np.testing.assert_allclose(grain.pattern, expected, atol=1.5)
    assert grain.gain * (grain.pattern.mean() / 255.0) ** 2.2 == pytest.approx(1.0)


def test_a_swatch_without_relief_and_picture_is_flat() -> None:
    grain = grain_of(PLAIN)
    assert grain.flat and grain.albedo is None and grain.size_m == BALL_M and grain.shade.tolist() == [[1.0]]
    assert (grain.pattern == round(255 / SHADE[1])).all() and grain.gain == pytest.approx(SHADE[1] ** 2.2, rel=0.01)
    assert not grain_of(Swatch("photo", look=Look(albedo_png=png(np.full((1, 1, 3), 0.5))))).flat


@pytest.mark.parametrize(("tiles", "times"), [(1e-12, 1), (0.5, 1), (1.0, 1), (1.01, 2), (2.0, 2), (5.0, 8)])
def test_a_grain_is_magnified_where_it_would_repeat_too_often(tiles: float, times: int) -> None:
    grain = grain_of(PLAIN)
    assert grain.tile_m(tiles * TILES_MAX * grain.size_m) == times * grain.size_m


def test_pictures_are_projected_along_the_main_axis_upright_and_not_mirrored() -> None:
    u, v = np.array([(3.0, 5.0), (4.0, 5.0), (3.0, 7.0)]).T
    for axis, right, up in ((0, 1, 2), (1, 0, 2), (2, 0, 1)):
        for side in (1.0, -1.0):
            corner_m, sign = np.zeros((1, 3, 3)), side * (-1.0 if axis == 1 else 1.0)
            corner_m[0, :, right], corner_m[0, :, up] = sign * u, v
            uv, way = box_uv(corner_m, 0.5)
            np.testing.assert_array_equal(uv, np.stack([u, v], axis=1)[None] / 0.5)
            np.testing.assert_array_equal(way, sign * np.eye(3)[[right]])
