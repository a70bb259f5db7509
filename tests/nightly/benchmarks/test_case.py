"""The made path touches as it is meant to."""

import numpy as np
import pytest

from hapscene.constants import TICK_S
from hapscene_benchmarks.case import PRESS_M, RADIUS_M, SLIDE_M_S, START_M, WIGGLES, short, slide_path, sphere


def test_path_approaches_presses_slides_and_leaves() -> None:
    path = slide_path()
    distance_m = np.linalg.norm(path, axis=1)
    assert path.shape == (10_000, 3)
    assert distance_m[[0, -1]] == pytest.approx(START_M)
    slide = slice(1000, 9000)
    depth_m = RADIUS_M - distance_m[slide]
    most_m = sum(a for _, a in WIGGLES)
    assert depth_m.min() >= PRESS_M - most_m - 1e-12
    assert depth_m.max() <= PRESS_M + most_m + 1e-12
    assert depth_m.mean() == pytest.approx(PRESS_M, abs=1e-4)
    assert np.all(np.diff(distance_m[:1000]) < 0.0)  # comes
    assert np.all(np.diff(distance_m[9000:]) > 0.0)  # leaves


def test_slide_has_the_speed_it_says() -> None:
    path = slide_path()[1100:8900]
    direction = path / np.linalg.norm(path, axis=1, keepdims=True)
    speed_m_s = RADIUS_M * np.linalg.norm(np.diff(direction, axis=0), axis=1) / TICK_S
    assert speed_m_s == pytest.approx(SLIDE_M_S, rel=1e-2)


def test_short_path_still_presses() -> None:
    path = slide_path(400)
    assert len(path) == 400
    assert np.linalg.norm(path, axis=1).min() < RADIUS_M - 1e-3


def test_sphere_has_its_faces_on_its_radius() -> None:
    mesh = sphere(2)
    assert len(mesh.faces) == 320
    assert np.linalg.norm(mesh.vertices_m, axis=1) == pytest.approx(RADIUS_M)


@pytest.mark.parametrize(("count", "text"), [(1280, "1 k"), (81_920, "82 k"), (1_310_720, "1.31 M")])
def test_count_as_it_is_spoken(count: int, text: str) -> None:
    assert short(count) == text
