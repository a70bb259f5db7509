"""Many bodies on their grid, and the rays that a slide casts."""

import numpy as np

from hapscene.contact.embree import Search
from hapscene.contact.world import skin_of
from hapscene_benchmarks.case import slide_path, sphere
from hapscene_benchmarks.crowd import SPACING_M, grid
from hapscene_benchmarks.ray import recorded_rays, time_rays


def test_grid_starts_at_the_origin_and_keeps_its_distance() -> None:
    place = grid(10)
    assert place.shape == (10, 3)
    assert not place[0].any()
    apart = np.linalg.norm(place[:, None] - place, axis=2) + 10.0 * np.eye(10)
    assert apart.min() == SPACING_M


def test_rays_are_noted_from_the_interpreted_tick() -> None:
    rays, ticks = recorded_rays(1, 60)
    touching = np.linalg.norm(slide_path(60), axis=1) < 0.045
    assert touching.sum() <= ticks <= 60
    assert ticks <= len(rays)
    assert np.allclose(np.linalg.norm(rays[:, 3:6], axis=1), 1.0)
    mesh = sphere(1)
    assert time_rays(Search(mesh.vertices_m, mesh.faces, skin_of(mesh)).handle, rays, 1) > 0.0
