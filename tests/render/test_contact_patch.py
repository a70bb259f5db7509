"""The force of a round tip, distributed over the vertices of a soft body."""

import math

import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay

import hapscene
from hapscene.errors import SceneError
from hapscene.render.contact_info import spread_force
from tests.virtual_servo import VirtualServo

BALL = trimesh.creation.icosphere(3, radius=0.05)  # edges of 7 mm
TIP_M = 0.004


def pressed(depth_m: float, tip_radius_m: float) -> hapscene.Contact:
    scene = hapscene.Scene()
    scene.add(hapscene.Mesh.from_trimesh(BALL, "m"), name="ball")
    renderer = hapscene.Renderer(scene, ["wall"], tip_radius_m=tip_radius_m)
    outwards = BALL.triangles_center[100] / np.linalg.norm(BALL.triangles_center[100])
    top_m = BALL.triangles_center[100] + tip_radius_m * BALL.face_normals[100]
    for k in range(11):
        contact = renderer.step(top_m + (0.001 - 0.1 * k * (0.001 + depth_m)) * outwards).contact
    assert contact is not None
    return contact


@pytest.mark.parametrize("depth_m", [0.0005, 0.002, 0.0035])
def test_the_radius_is_that_of_hertz(depth_m: float) -> None:
    """From the force: a³ = 3 F r / 4E*, with E* = 3 F / (4 √r d^1.5) of the same indentation."""
    contact = pressed(depth_m, TIP_M)
    force_N = float(np.linalg.norm(contact.f_body_W_N))
    modulus_Pa = 0.75 * force_N / (math.sqrt(TIP_M) * contact.depth_m**1.5)
    assert contact.patch_radius_m == pytest.approx((0.75 * force_N * TIP_M / modulus_Pa) ** (1 / 3), rel=1e-9)


def test_a_point_has_no_patch_and_a_tip_none_wider_than_itself() -> None:
    assert pressed(0.003, 0.0).patch_radius_m == 0.0
    assert pressed(0.009, TIP_M).patch_radius_m == pytest.approx(TIP_M)


@pytest.mark.parametrize("radius_m", [0.0, 1e-5, 0.001, 0.004, 0.012, 0.04])
def test_force_and_moment_are_kept(radius_m: float) -> None:
    rng = np.random.default_rng(3)
    vertices_m = BALL.vertices + 0.002 * rng.normal(size=BALL.vertices.shape)
    for face in rng.integers(len(BALL.faces), size=20).tolist():
        f_N = rng.normal(size=3)
        p_m = rng.dirichlet((1.0, 1.0, 1.0)) @ vertices_m[BALL.faces[face]]
        forces_N = spread_force(vertices_m, BALL.faces, face, p_m=p_m, f_N=f_N, radius_m=radius_m)
        np.testing.assert_allclose(forces_N.sum(axis=0), f_N, atol=1e-12)
        np.testing.assert_allclose(np.cross(vertices_m, forces_N).sum(axis=0), np.cross(p_m, f_N), atol=1e-13)
        reach_m = np.linalg.norm(vertices_m[forces_N.any(axis=1)] - p_m, axis=1).max()
        assert reach_m <= radius_m + BALL.edges_unique_length.max() + 0.02


def test_the_other_side_of_a_thin_body_is_not_loaded() -> None:
    sheet = trimesh.creation.box((0.05, 0.05, 0.001)).subdivide().subdivide().subdivide()
    face = int(sheet.face_normals[:, 2].argmax())
    p_m = sheet.triangles_center[face]
    forces_N = spread_force(sheet.vertices, sheet.faces, face, p_m=p_m, f_N=np.array([0.0, 0.0, -1.0]), radius_m=0.01)
    assert not forces_N[sheet.vertices[:, 2] < 0.0].any()
    assert np.count_nonzero(forces_N[:, 2]) > 8


def test_a_force_beside_the_face_acts_at_its_nearest_point() -> None:
    """Beside the middle of a side, and beside a face without an area."""
    corners = np.array([[1.0, 3.0, 2.0], [3.0, 3.0, 2.0], [2.0, 4.0, 2.0]])
    f_N, face = np.array([0.5, -1.0, 2.0]), np.array([[0, 1, 2]])
    forces_N = spread_force(corners, face, 0, p_m=np.array([2.0, 2.5, 2.3]), f_N=f_N, radius_m=0.0)
    np.testing.assert_allclose(forces_N, [0.5 * f_N, 0.5 * f_N, 0.0 * f_N], atol=1e-12)
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    forces_N = spread_force(line, face, 0, p_m=np.array([0.9, 0.0, 0.0]), f_N=f_N, radius_m=0.1)
    np.testing.assert_allclose(forces_N.sum(axis=0), f_N, atol=1e-12)


def disc(rings: int, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A disc of concentric rings of vertices; vertex 0 is its centre."""
    angle = [2 * np.pi * np.arange(6 * k) / (6 * k) for k in range(1, rings + 1)]
    ring = [radius_m * k / rings * np.column_stack((np.cos(a), np.sin(a))) for k, a in enumerate(angle, 1)]
    flat = np.vstack([np.zeros((1, 2)), *ring])
    faces = Delaunay(flat).simplices
    one, two = flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]]
    area = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    faces[area < 0.0] = faces[area < 0.0, ::-1]
    return np.column_stack((flat, np.zeros(len(flat)))), faces[np.abs(area) > 1e-12 * radius_m**2]


def sag_m(vertices: np.ndarray, faces: np.ndarray, tension_N_m: float, load_N: np.ndarray, rim_m: float) -> float:
    """Largest displacement of a membrane that is fixed at its rim, by linear finite elements."""
    i, j, weight = [], [], []
    for k in range(3):
        a, b, c = (faces[:, (k + turn) % 3] for turn in range(3))
        u, v = vertices[a] - vertices[c], vertices[b] - vertices[c]
        half = (u * v).sum(axis=1) / np.linalg.norm(np.cross(u, v), axis=1) / 2.0
        i, j, weight = [*i, a, b, a, b], [*j, b, a, a, b], [*weight, -half, -half, half, half]
    stiffness = coo_array((np.hstack(weight), (np.hstack(i), np.hstack(j)))).tocsr()
    free = np.linalg.norm(vertices, axis=1) < rim_m * (1.0 - 1e-9)
    return float(spsolve(tension_N_m * stiffness[free][:, free].tocsc(), load_N[free]).max())


def test_a_membrane_sags_as_in_closed_form_on_every_mesh() -> None:
    """F / 2πT · (ln(R/a) + 4/3 − ln 2) under the pressure of Hertz within a; F / 2πT · ln 2 more per halving of the
    edges under a point load."""
    rim_m, a_m, tension_N_m, force_N = 0.05, 0.006, 60.0, 1.0
    unit_m = force_N / (2.0 * math.pi * tension_N_m)
    exact_m = unit_m * (math.log(rim_m / a_m) + 4 / 3 - math.log(2.0))
    points_m = []
    for rings in (8, 16, 32):  # edges of 6.3, 3.1 and 1.6 mm
        vertices, faces = disc(rings, rim_m)
        face = int(np.flatnonzero((faces == 0).any(axis=1))[0])
        down = np.array([0.0, 0.0, force_N])
        patch = spread_force(vertices, faces, face, p_m=np.zeros(3), f_N=down, radius_m=a_m)[:, 2]
        point = spread_force(vertices, faces, face, p_m=np.zeros(3), f_N=down, radius_m=0.0)[:, 2]
        assert sag_m(vertices, faces, tension_N_m, patch, rim_m) == pytest.approx(exact_m, rel=0.005)
        points_m.append(sag_m(vertices, faces, tension_N_m, point, rim_m))
    np.testing.assert_allclose(np.diff(points_m), unit_m * math.log(2.0), rtol=0.02)
    assert points_m[-1] > 1.8 * exact_m


def test_a_contact_spreads_its_force_over_the_present_shape() -> None:
    """Also on a shape that has moved on since: the force acts at the nearest point of the touched face."""
    contact = pressed(0.003, TIP_M)
    forces_N = contact.vertex_forces_N(BALL.vertices, BALL.faces)
    np.testing.assert_allclose(forces_N.sum(axis=0), contact.f_body_W_N, atol=1e-12)
    moment = np.cross(BALL.vertices, forces_N).sum(axis=0)
    np.testing.assert_allclose(moment, contact.tau_body_W_Nm((0.0, 0.0, 0.0)), atol=1e-9)
    moved_N = contact.vertex_forces_N(BALL.vertices * 0.97, BALL.faces)
    np.testing.assert_allclose(moved_N.sum(axis=0), contact.f_body_W_N, atol=1e-12)
    with pytest.raises(SceneError, match="ball"):
        contact.vertex_forces_N(BALL.vertices, BALL.faces[:50])
    with pytest.raises(SceneError, match=r"\(N, 3\)"):
        contact.vertex_forces_N(BALL.vertices[:, :2], BALL.faces)


def test_a_servo_reports_the_contact() -> None:
    scene = hapscene.Scene()
    scene.add(hapscene.Mesh.from_trimesh(BALL, "m"), name="ball")
    with VirtualServo(scene, "premium-1.5", effects=["wall"], tip_radius_m=TIP_M) as servo:
        assert servo.contact() is None
        servo.start((0.0, 0.0, 0.06))
        servo.advance(1)
        assert servo.contact() is None
        servo.aim((0.0, 0.0, 0.05))
        servo.advance(500)
        contact = servo.contact()
        assert contact is not None and contact.body == "ball"
        assert contact.patch_radius_m == pytest.approx(math.sqrt(TIP_M * servo.state().depth_m))
