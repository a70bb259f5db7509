"""Placement of the camera."""

import numpy as np
import pytest

from hapscene.view.triangles import MARGIN, facing, fit_cameras, orbit, visible_size


@pytest.mark.parametrize("size", [(800, 600), (300, 900)])
def test_camera_shows_all_points(size: tuple[int, int]) -> None:
    points_m = np.random.default_rng(1).normal(size=(500, 3)) * (0.3, 0.1, 0.05) + (5.0, -2.0, 1.0)
    R_SC = orbit(np.linspace(0, 2 * np.pi, 12, endpoint=False).tolist())
    poses, (x_m, y_m, far_m), pixel_m = fit_cameras(points_m, R_SC, size)
    assert (x_m, y_m) == pytest.approx((pixel_m * size[0] / 2, pixel_m * size[1] / 2))
    seen = np.concatenate([(points_m - X[:3, 3]) @ X[:3, :3] for X in poses])
    reach = np.abs(seen[:, :2]).max(axis=0) / (x_m, y_m)
    assert reach.max() == pytest.approx(1 / MARGIN)
    assert far_m == pytest.approx(2.0 * np.ptp(seen, axis=0).max())
    assert seen[:, 2].max() < -far_m * 1e-4 and seen[:, 2].min() > -far_m
    assert seen[:, 2].min() + seen[:, 2].max() == pytest.approx(-far_m)  # equal distance in front and behind
    assert visible_size(points_m, R_SC) == pytest.approx(tuple(np.ptp(seen[:, :2], axis=0)))


def test_rotation_about_the_vertical() -> None:
    first, quarter = orbit([0.0, np.pi / 2])
    np.testing.assert_allclose(quarter @ first.T, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(first.T @ first, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("up", [None, (0.0, 0.0, 1.0), (0.2, 5.0, 0.1)])
@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (3.0, -4.0, 1.0), (-1e-3, -1e-3, 2e-3)])
def test_facing(direction: tuple[float, ...], up: tuple[float, float, float] | None) -> None:
    R, z = facing(np.array(direction), up), np.array(direction) / np.linalg.norm(direction)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0) and R[:, 2] == pytest.approx(z)
    to = np.array(up) if up is not None else np.eye(3)[np.argmin(np.abs(z))]
    assert R[:, 1] @ to == pytest.approx(np.linalg.norm(to - (to @ z) * z))  # the component perpendicular to z
