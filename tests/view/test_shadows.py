"""Shadows of a square plate that floats above the ground, compared with its projection along the sun."""

import numpy as np
import pytest

from hapscene.view.shadows import DARK, SUN, ZENITH, DepthPicture, Shadows, _enlarged, _normals
from hapscene.view.triangles import facing, fit_cameras, pose_of

HALF_M = 0.1
"""Half of the side of the plate [m]."""

PX = 400


def plate(direction: tuple[float, float, float], height_m: float) -> DepthPicture:
    """The plate as seen from a direction: the depth of its plane where the ray meets it."""
    corners_m = np.array([(x, y, height_m) for x in (-HALF_M, HALF_M) for y in (-HALF_M, HALF_M)])
    (X_SC,), _, pixel_m = fit_cameras(corners_m, [facing(np.array(direction), (0.0, 1.0, 0.0))], (PX, PX))
    at = (np.arange(PX) + 0.5 - PX / 2) * pixel_m
    x, y = np.meshgrid(at, -at)
    start_m = np.stack([x, y, np.zeros_like(x)], axis=2) @ X_SC[:3, :3].T + X_SC[:3, 3]
    depth_m = (start_m[..., 2] - height_m) / X_SC[2, 2]
    hit_m = start_m - depth_m[..., None] * X_SC[:3, 2]
    inside = (np.abs(hit_m[..., :2]) <= HALF_M).all(axis=2)
    return DepthPicture(np.where(inside, depth_m, np.inf).astype(np.float32), X_SC, pixel_m)


def ground(height_m: float, sun: bool = True) -> np.ndarray:
    """Linear brightness (PX, PX) of 1 m² of ground seen from the zenith, in the light of the sun or of the sky."""
    of_sun, of_sky = plate(SUN, height_m), plate(ZENITH, height_m)
    clear = np.full((PX, PX), np.inf, np.float32)
    of_sun, of_sky = (of_sun, of_sky._replace(depth_m=clear)) if sun else (of_sun._replace(depth_m=clear), of_sky)
    shadows = Shadows(of_sun, of_sky, 0.0, 4 * HALF_M)
    X_SC = pose_of(np.eye(3), (0.0, 0.0, 1.0))
    white = np.full((PX, PX, 3), 255, np.uint8)
    pixels = shadows.cast(white, np.full((PX, PX), np.inf, np.float32), X_SC, 1.0 / PX)
    return (pixels[..., 0] / 255.0) ** 2.2


def column(x_m: float) -> int:
    return round((x_m + 0.5) * PX)


def row(y_m: float) -> int:
    return round((0.5 - y_m) * PX)


@pytest.mark.parametrize("height_m", [0.02, 0.1])
def test_the_shadow_lies_where_the_sun_projects_the_plate(height_m: float) -> None:
    seen = ground(height_m)
    x_m, y_m = -height_m * SUN[0] / SUN[2], -height_m * SUN[1] / SUN[2]
    dark = seen < 1.0 - 0.5 * DARK[0]
    rows, columns = np.nonzero(dark)
    assert columns.mean() / PX - 0.5 == pytest.approx(x_m, abs=0.004)
    assert 0.5 - rows.mean() / PX == pytest.approx(y_m, abs=0.004)
    assert dark.sum() / PX**2 == pytest.approx((2 * HALF_M) ** 2, rel=0.05)
    assert seen[row(y_m), column(x_m)] <= 1.0 - DARK[0] + 0.01
    assert (seen[[0, 0, -1, -1], [0, -1, 0, -1]] == 1.0).all()


def test_a_plate_in_the_sun_does_not_shade_itself() -> None:
    seen = plate(ZENITH, 0.05)
    shadows = Shadows(plate(SUN, 0.05), seen._replace(depth_m=np.full_like(seen.depth_m, np.inf)), 0.0, 4 * HALF_M)
    pixels = shadows.cast(np.full((PX, PX, 3), 255, np.uint8), seen.depth_m, seen.X_SC, seen.pixel_m)
    rows, columns = np.nonzero(np.isfinite(seen.depth_m))
    assert (pixels[rows.min() + 8 : rows.max() - 8, columns.min() + 8 : columns.max() - 8] == 255).all()


def test_normals_are_of_unit_length_and_point_to_the_camera() -> None:
    x, y = np.meshgrid(1e-3 * np.arange(5.0), -1e-3 * np.arange(4.0))
    found = _normals(np.stack([x, y, 0.5 * x - 0.25 * y]))
    normal = np.array([-0.5, 0.25, 1.0]) / np.sqrt(1.3125)
    np.testing.assert_allclose(found, np.broadcast_to(normal[:, None, None], (3, 4, 5)), atol=1e-6)


def test_values_of_squares_of_pixels_do_not_cross_a_step_in_depth() -> None:
    for far_m, between in ((5.0, 1e-3), (1.0, 0.5)):
        depth_m = np.array([[1.0, 1.0, far_m, far_m]] * 2, np.float32)
        found = _enlarged(np.array([[0.0, 1.0]]), depth_m[::2, ::2], depth_m, 1.0)
        np.testing.assert_allclose(found, [[0.0, between, 1.0, 1.0]] * 2, atol=2e-5)


def test_the_sky_is_hidden_beside_a_body_and_less_farther_away() -> None:
    line = ground(0.02, sun=False)[PX // 2]
    beside = [line[column(HALF_M + far_m)] for far_m in (0.01, 0.03, 0.05, 0.08)]
    assert 1.0 - DARK[1] < beside[0] < beside[1] < beside[2] <= beside[3] == 1.0
