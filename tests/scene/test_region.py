"""Regions, compared with closed forms."""

import math

import numpy as np
import pytest
import trimesh

from hapscene.errors import SceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Box, Facet, PlaneSide, Sphere, Tube


def of(mesh: trimesh.Trimesh) -> Mesh:
    return Mesh(np.array(mesh.vertices), np.array(mesh.faces))


BALL = of(trimesh.creation.icosphere(subdivisions=5, radius=1.0))
CUBE = of(trimesh.creation.box((2, 2, 2)))


def share(mask):
    area = 0.5 * np.linalg.norm(np.cross(*np.moveaxis(np.diff(BALL.triangles_m[mask], axis=1), 1, 0)), axis=1)
    return area.sum() / (4 * math.pi)


def test_plane_side():
    for height in (-0.5, 0.0, 0.6):  # Archimedes: the share of a sphere's area is that of its height
        mask = PlaneSide((0, 0, height), (0, 0, 7)).pick(BALL)
        assert share(mask) == pytest.approx((1 - height) / 2, abs=0.01)


def test_sphere():
    # A sphere of radius r about a point of the unit sphere cuts off a cap of area π r².
    mask = Sphere(centre_m=(1, 0, 0), radius_m=0.5).pick(BALL)
    assert share(mask) == pytest.approx(0.25 / 4, abs=0.005)


def test_box():
    assert share(Box((-2, -2, -0.25), (2, 2, 0.5)).pick(BALL)) == pytest.approx(0.375, abs=0.01)
    assert not Box((2, 2, 2), (3, 3, 3)).pick(BALL).any()


def test_facet_of_a_cube():
    for face in range(12):
        side = Facet(face, math.radians(1)).pick(CUBE)
        assert side.sum() == 2
        np.testing.assert_allclose(CUBE.normals[side], CUBE.normals[[face]].repeat(2, axis=0), atol=1e-15)
        assert Facet(face, math.pi / 2).pick(CUBE).all()


def test_facet_of_a_cylinder():
    cylinder = of(trimesh.creation.cylinder(radius=1, height=3, sections=36))
    barrel = np.abs(cylinder.normals[:, 2]) < 0.5
    start = int(np.flatnonzero(barrel)[0])
    np.testing.assert_array_equal(Facet(start, math.radians(11)).pick(cylinder), barrel)
    assert Facet(start, math.radians(9)).pick(cylinder).sum() == 2


def test_facet_crosses_seams_and_reversed_faces():
    soup = Mesh(CUBE.triangles_m.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert Facet(0, 0.01).pick(soup).sum() == 2
    faces = CUBE.faces.copy()
    other = int(np.flatnonzero(Facet(0, 0.01).pick(CUBE))[1])
    faces[other] = faces[other][::-1]
    assert Facet(0, 0.01).pick(Mesh(CUBE.vertices_m, faces)).sum() == 2


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Box((0, 0, 1), (1, 1, 0)), "low_m"),
        (lambda: Box((0, 0), (1, 1, 0)), "low_m"),
        (lambda: Sphere((0, 0, 0), 0), "radius_m"),
        (lambda: Sphere((0, 0, math.nan), 1), "centre_m"),
        (lambda: PlaneSide((0, 0, 0), (0, 0, 0)), "normal"),
        (lambda: PlaneSide((0, 0, math.nan), (0, 0, 1)), "point_m"),
        (lambda: Tube((), 0.01), "points_m"),
        (lambda: Tube(np.zeros((0, 3)), 0.01), "points_m"),
        (lambda: Facet(0, -1), "angle"),
        (lambda: Facet(12).pick(CUBE), "12"),
    ],
)
def test_invalid_region_raises(make, field):
    with pytest.raises(SceneError, match=field):
        make()
