"""Regions, compared with closed forms."""

import math

import numpy as np
import pytest
import trimesh

from hapscene.errors import SceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Box, Sphere, Tube


def of(mesh: trimesh.Trimesh) -> Mesh:
    return Mesh(np.array(mesh.vertices), np.array(mesh.faces))


BALL = of(trimesh.creation.icosphere(subdivisions=5, radius=1.0))


def share(region):
    mask = region.distance_m(BALL.triangles_m.mean(axis=1)) <= 0
    area = 0.5 * np.linalg.norm(np.cross(*np.moveaxis(np.diff(BALL.triangles_m[mask], axis=1), 1, 0)), axis=1)
    return area.sum() / (4 * math.pi)


def test_sphere():
    # A sphere of radius r about a point of the unit sphere cuts off a cap of area π r².
    assert share(Sphere(centre_m=(1, 0, 0), radius_m=0.5)) == pytest.approx(0.25 / 4, abs=0.005)


def test_box():  # Archimedes: the share of a sphere's area is that of its height
    assert share(Box((-2, -2, -0.25), (2, 2, 0.5))) == pytest.approx(0.375, abs=0.01)
    assert share(Box((2, 2, 2), (3, 3, 3))) == 0.0


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Box((0, 0, 1), (1, 1, 0)), "low_m"),
        (lambda: Sphere((0, 0, 0), 0), "radius_m"),
        (lambda: Sphere((0, 0, math.nan), 1), "centre_m"),
        (lambda: Tube(np.zeros((0, 3)), 0.01), "points_m"),
        (lambda: Tube(((0, 0),), 0.01), "points_m"),
        (lambda: Tube(((0, 0, math.nan),), 0.01), "points_m"),
        (lambda: Tube("here", 0.01), "points_m"),
        (lambda: Tube(((0, 0, 0),), -1), "radius_m"),
    ],
)
def test_invalid_region_raises(make, field):
    with pytest.raises(SceneError, match=field):
        make()
