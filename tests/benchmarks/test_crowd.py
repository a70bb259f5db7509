"""Many bodies: the same contact among them, and the same faces through Embree's instances."""

import numpy as np

from hapscene.contact.embree import Search, first_face, new_ray
from hapscene.contact.world import skin_of
from hapscene_benchmarks.case import slide_path, sphere
from hapscene_benchmarks.crowd import SPACING_M, grid
from hapscene_benchmarks.instance import InstanceScene
from hapscene_benchmarks.ray import recorded_rays, time_rays


def test_grid_starts_at_the_origin_and_keeps_its_distance() -> None:
    place = grid(10)
    assert place.shape == (10, 3)
    assert not place[0].any()
    apart = np.linalg.norm(place[:, None] - place, axis=2) + 10.0 * np.eye(10)
    assert apart.min() == SPACING_M


def test_instances_name_the_same_face_and_follow_a_move() -> None:
    mesh = sphere(2)
    search = Search(mesh.vertices_m, mesh.faces, skin_of(mesh))
    instances = InstanceScene(search, grid(10))
    direction = (0.0, 0.6, -0.8)
    alone = first_face(search.handle, new_ray(), (0.01, -0.06, 0.08), direction, 1.0, 0)
    assert alone >= 0
    assert first_face(instances.handle, new_ray(), (0.01, -0.06, 0.08), direction, 1.0, 0) == alone
    instances.move(np.array([0]), np.array([[0.0, 0.0, 5.0]]))
    assert first_face(instances.handle, new_ray(), (0.01, -0.06, 5.08), direction, 1.0, 0) == alone


def test_rays_are_noted_from_the_interpreted_tick() -> None:
    rays, ticks = recorded_rays(1, 60)
    touching = np.linalg.norm(slide_path(60), axis=1) < 0.045
    assert touching.sum() <= ticks <= 60
    assert ticks <= len(rays)
    assert np.allclose(np.linalg.norm(rays[:, 3:6], axis=1), 1.0)
    mesh = sphere(1)
    assert time_rays(Search(mesh.vertices_m, mesh.faces, skin_of(mesh)).handle, rays, 1) > 0.0
