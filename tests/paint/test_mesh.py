"""Picking against another ray tracer; facets of a cube and a cylinder."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.creation import box, cylinder, icosphere

from hapscene.paint.model.mesh import (
    FACING_RAD,
    PaintableMesh,
    pick,
    project_to_surface,
)
from hapscene.paint.model.session import Session
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

from .conftest import hit_at, make_scene, mesh_of, plate_mesh


def test_the_point_is_exact_from_afar() -> None:
    shape = PaintableMesh(plate_mesh())
    _, distance, p = shape.pick(np.array([0.003, 0.004, 50.0]), np.array([0.0, 0.0, -2.0]))  # type: ignore[misc]
    np.testing.assert_allclose(p, [0.003, 0.004, 0.0005], atol=1e-12)
    assert distance == pytest.approx(50.0 - 0.0005, abs=1e-9)


def test_faces_without_area_have_a_positive_one() -> None:
    shape = PaintableMesh(Mesh([[0, 0, 0], [0.3, 0, 0], [0, 0.6, 0]], [[0, 1, 2], [0, 1, 1]]))
    assert shape.area_m2 == pytest.approx([0.09, 0.0], abs=1e-300) and shape.area_m2[1] > 0.0
    assert shape.reach_m == pytest.approx([np.hypot(0.1, 0.4), 0.2])


def test_nearest_of_several_bodies_is_hit(tmp_path) -> None:
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


def facet(mesh: Mesh, face: int, angle_rad: float) -> np.ndarray:
    return PaintableMesh(mesh).facet(face, angle_rad)


def test_facet_of_a_cylinder() -> None:
    barrel_mesh = mesh_of(cylinder(radius=1, height=3, sections=36))
    barrel = np.abs(barrel_mesh.normals[:, 2]) < 0.5
    start = int(np.flatnonzero(barrel)[0])
    np.testing.assert_array_equal(facet(barrel_mesh, start, np.radians(11.0)), barrel)
    assert facet(barrel_mesh, start, np.radians(9.0)).sum() == 2


def test_facet_crosses_seams_and_reversed_faces() -> None:
    cube = mesh_of(box((2, 2, 2)))
    soup = Mesh(cube.triangles_m.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert facet(soup, 0, 0.01).sum() == 2 and facet(soup, 0, np.pi / 2).all()
    faces = cube.faces.copy()
    other = int(np.flatnonzero(facet(cube, 0, 0.01))[1])
    faces[other] = faces[other][::-1]
    assert facet(Mesh(cube.vertices_m, faces), 0, 0.01).sum() == 2


# The brush: what it reaches, against its definition; walls and edges.


def top_face(shape: PaintableMesh, x: float, y: float) -> tuple[int, np.ndarray]:
    found = shape.pick(np.array([x, y, 1.0]), np.array([0.0, 0.0, -1.0]))
    assert found is not None
    return found[0], found[2]


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-0.0199, 0.0199)] * 4), st.floats(0.0005, 0.01))
def test_on_a_plate_it_paints_the_capsule_and_the_way(ends, radius_m) -> None:
    shape = PLATE
    (f, p), (g, q) = top_face(shape, *ends[:2]), top_face(shape, *ends[2:])
    painted = np.zeros(len(shape.normal), bool)
    painted[shape.brush((f, g), np.stack([p, q]), radius_m)] = True
    top = shape.normal[:, 2] > 0.5
    way, off = q - p, shape.centroid_m - p
    t = np.clip(off @ way / max(way @ way, 1e-300), 0.0, 1.0)
    away = np.linalg.norm(off - t[:, None] * way, axis=1)
    clear = np.abs(away - radius_m) > 1e-9  # not on the border, where rounding decides
    assert painted[top & clear & (away < radius_m)].all()
    assert not painted[~top].any()  # neither the back, 1 mm below, nor the rim
    assert (away[painted] < radius_m + shape.reach_m[painted]).all()


PLATE = PaintableMesh(plate_mesh())


def test_along_a_line_it_paints_what_it_paints_along_the_parts() -> None:
    faces, points = zip(*(top_face(PLATE, x, 0.001) for x in (-0.0185, -0.0175, 0.0185)), strict=True)
    whole, one, other = (PLATE.brush(faces[a:b], np.stack(points[a:b]), 2e-4) for a, b in ((0, 3), (0, 2), (1, 3)))
    np.testing.assert_array_equal(whole, np.union1d(one, other))
    assert len(one) < len(other) < len(whole)


def test_round_a_bend_it_paints_as_far_as_it_looks_the_same_way() -> None:
    shape = PaintableMesh(mesh_of(cylinder(radius=0.005, height=0.1, sections=180)))
    found = shape.pick(np.array([1.0, 0.0, 0.001]), np.array([-1.0, 0.0, 0.0]))
    assert found is not None
    face, _, p = found
    painted = shape.brush([face], p[None], 0.2)
    turn = np.arccos(np.clip(shape.normal @ shape.normal[face], -1.0, 1.0))
    np.testing.assert_array_equal(painted, np.flatnonzero(turn <= FACING_RAD))


# Where a ray from the eye falls, and a ring laid on the surface, against closed forms.


TURN = np.array([[0.0, 0.0, 1.0, 0.1], [1.0, 0.0, 0.0, 0.2], [0.0, 1.0, 0.0, 0.3], [0.0, 0.0, 0.0, 1.0]])
"""A pose: (x, y, z) of the body are (y, z, x) of the world."""


def circle(radius_m: float, z_m: float = 0.0, count: int = 24) -> np.ndarray:
    turn = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    return np.stack([radius_m * np.cos(turn), radius_m * np.sin(turn), np.full(count, z_m)], axis=1)


@pytest.fixture
def scene() -> Scene:
    scene = Scene()
    scene.add(mesh_of(icosphere(subdivisions=6, radius=0.02)), name="ball", pose=TURN)
    scene.add(plate_mesh(), name="plate")
    return scene


def in_world(p_B_m: np.ndarray) -> np.ndarray:
    return p_B_m @ TURN[:3, :3].T + TURN[:3, 3]


def test_ring_is_on_the_surface_of_a_ball(scene) -> None:
    shapes = [PaintableMesh(body.mesh) for body in scene.bodies]
    up = TURN[:3, :3] @ np.array([0.0, 0.0, 1.0])
    hit = pick(scene.bodies, shapes, in_world(np.array([0.0, 0.0, 1.0])), -up)
    assert hit is not None
    hit = hit.__class__(**{**vars(hit), "nhat_W": up})  # of the ball, not of a facet
    laid = project_to_surface(scene.bodies[0], shapes[0], hit, in_world(circle(0.01, 0.02)), 0.01)
    height = np.sqrt(0.02**2 - 0.01**2)
    np.testing.assert_allclose(laid, in_world(circle(0.01, height)), atol=2e-5)


def test_beside_the_body_a_ring_stays_in_its_plane(scene) -> None:
    session = Session(scene)
    shapes = session.shapes
    top = int(np.argmax(shapes[1].centroid_m @ [0.0, 0.0, 1.0] + 1e-3 * (shapes[1].centroid_m[:, 0] < -0.019)))
    hit = hit_at(session, 1, top)
    ring = hit.p_W_m + circle(0.005)
    laid = project_to_surface(scene.bodies[1], shapes[1], hit, ring, 0.005)
    np.testing.assert_allclose(laid, ring, atol=1e-9)
    assert (ring[:, 0] < -0.02).any()  # some are beside it
