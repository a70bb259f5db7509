"""Picking against another ray tracer; the bucket against the region that a script paints with."""

import numpy as np
import pytest
from trimesh.creation import annulus, icosphere

from hapscene.paint.pick import middle, pick
from hapscene.paint.session import Session
from hapscene.paint.shape import Shape
from hapscene.scene.region import Facet

from .conftest import make_scene, mesh_of, plate_mesh


def test_what_a_ray_hits() -> None:
    ring = annulus(0.01, 0.02, 0.015, sections=48)
    shape = Shape(mesh_of(ring))
    rng = np.random.default_rng(0)
    origins, ends = rng.normal(size=(300, 3)) * 0.2, rng.normal(size=(300, 3)) * 0.01
    a, b, c = np.moveaxis(shape.corner_m, 1, 0)
    hits = 0
    for origin, end in zip(origins, ends, strict=True):
        d = (end - origin) / np.linalg.norm(end - origin)
        # Möller & Trumbore 1997, over all faces
        h = np.cross(d, c - a)
        det = np.einsum("ij,ij->i", b - a, h)
        s = origin - a
        u = np.einsum("ij,ij->i", s, h) / det
        q = np.cross(s, b - a)
        v, t = q @ d / det, np.einsum("ij,ij->i", q, c - a) / det
        inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        found = shape.pick(origin, 3.0 * d)
        if not inside.any():
            assert found is None or abs(found[1]) < 1.0  # a graze of the rim may be seen either way
            continue
        hits += 1
        assert found is not None
        first = float(t[inside].min())
        assert abs(found[1] - first) < 1e-6
        np.testing.assert_allclose(found[2], origin + first * d, atol=1e-6)
    assert hits > 100


def test_the_point_is_exact_from_afar() -> None:
    shape = Shape(plate_mesh())
    _, distance, p = shape.pick(np.array([0.003, 0.004, 50.0]), np.array([0.0, 0.0, -2.0]))  # type: ignore[misc]
    np.testing.assert_allclose(p, [0.003, 0.004, 0.0005], atol=1e-12)
    assert distance == pytest.approx(50.0 - 0.0005, abs=1e-9)


def test_of_several_bodies_the_nearest(tmp_path) -> None:
    scene = make_scene(tmp_path)
    scene.pose("plate", np.eye(4))
    session = Session(scene)
    p_W = scene.body("ball").X_WB[:3, 3]
    found = session.pick(np.add(p_W, (0.0, 0.0, 1.0)), [0.0, 0.0, -1.0])
    assert found is not None and (found.body, scene.bodies[found.body].name) == (0, "ball")
    below = session.pick([0.0, 0.0, -1.0], [0.0, 0.0, 1.0])
    assert below is not None
    np.testing.assert_allclose(np.linalg.norm(found.nhat_W), 1.0)
    X_WB = scene.bodies[below.body].X_WB
    np.testing.assert_allclose(X_WB[:3, :3] @ below.p_B_m + X_WB[:3, 3], below.p_W_m, atol=1e-12)
    for bad in (np.zeros(3), np.array([np.nan, 0.0, 1.0])):
        assert pick(scene.bodies, session.shapes, np.zeros(3), bad) is None
    assert middle(scene.bodies, session.shapes, 1, 5).face == 5


@pytest.mark.parametrize("angle_rad", [0.0, 0.05, 0.2, 1.6, 3.14])
def test_facets_are_those_of_regions(angle_rad: float) -> None:
    for mesh in (plate_mesh(cells=2), mesh_of(icosphere(subdivisions=2)), mesh_of(annulus(0.01, 0.02, 0.015))):
        shape = Shape(mesh)
        for face in (0, len(mesh.faces) // 2):
            np.testing.assert_array_equal(shape.facet(face, angle_rad), Facet(face, angle_rad).pick(mesh))
