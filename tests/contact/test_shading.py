"""Force shading: smooth and sharp edges, and the energy that it generates."""

import math

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.contact.shading import corner_normals
from hapscene.render.recording import Recording
from hapscene.scene.mesh import Mesh
from hapscene.surface.swatch import Swatch
from hapscene_evidence.chart.stabiliser import FACET_M, FACET_RAD, RIDGE_RADIUS_M, ridge

BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.05)


def turn_rad(recording: Recording, least_N: float = 0.05) -> float:
    """Return the largest rotation of the force between ticks in which it exceeds `least_N` [rad]."""
    size = np.linalg.norm(recording.f_W_N, axis=1)
    felt = (size[1:] > least_N) & (size[:-1] > least_N)
    if not felt.any():
        return 0.0
    unit = recording.f_W_N / np.maximum(size, 1e-300)[:, None]
    apart = np.linalg.norm(unit[1:] - unit[:-1], axis=1)[felt]
    return float(2.0 * np.arcsin(min(1.0, 0.5 * float(apart.max()))))


def scene(mesh, **keys) -> hapscene.Scene:
    built = hapscene.Scene()
    built.add(mesh, name="body", unit="m", **keys)
    return built


def angle(a, b) -> np.ndarray:
    return np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0))


def test_normals_of_a_ball():
    mesh = Mesh.from_trimesh(BALL, "m")
    shade = corner_normals(mesh, 0.5)
    outward = mesh.vertices_m[mesh.faces] / 0.05
    np.testing.assert_allclose(np.linalg.norm(shade, axis=2), 1.0, rtol=1e-12)
    assert angle(shade, outward).max() < 0.01
    flat = np.cross(outward[:, 1] - outward[:, 0], outward[:, 2] - outward[:, 0])
    assert angle(shade, (flat / np.linalg.norm(flat, axis=1)[:, None])[:, None]).max() > 0.05


def test_coincident_vertices_are_one():
    soup = BALL.vertices[BALL.faces].reshape(-1, 3), np.arange(3 * len(BALL.faces), dtype=np.int32).reshape(-1, 3)
    whole = corner_normals(Mesh.from_trimesh(BALL, "m"), 0.5)
    np.testing.assert_allclose(corner_normals(Mesh(*soup), 0.5), whole, atol=1e-12)


def test_sharp_edges_of_a_box():
    mesh = Mesh.from_trimesh(trimesh.creation.box((1, 2, 3)), "m")
    shade = corner_normals(mesh, math.radians(80.0))
    corner = mesh.vertices_m[mesh.faces]
    flat = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    np.testing.assert_allclose(shade, np.repeat((flat / np.linalg.norm(flat, axis=1)[:, None])[:, None], 3, axis=1))
    rounded = corner_normals(mesh, math.radians(100.0))
    np.testing.assert_allclose(rounded, np.sign(corner) / math.sqrt(3.0), atol=1e-12)


def circle(radius_m: float, count: int = 4000) -> np.ndarray:
    t = np.linspace(0.1, 3.0, count)
    return radius_m * np.c_[np.cos(t), np.sin(t), 0.2 * np.sin(3 * t)]


@pytest.mark.parametrize("pose", [np.eye(4), trimesh.transformations.rotation_matrix(0.7, (1, 2, 3))])
def test_force_direction_is_continuous_on_a_ball(pose):
    path = np.concatenate((circle(0.06, 2), circle(0.047)))[1:] @ pose[:3, :3].T
    built = scene(BALL, pose=pose)
    turns = []
    for crease in (0.0, 0.5):
        recording = hapscene.Renderer(built, ["wall"], crease_rad=crease).run(path)
        assert recording.touching[1:].all()
        turns.append(turn_rad(recording))
        off = angle(recording.nhat_W[5:], recording.p_WP_m[5:] / np.linalg.norm(recording.p_WP_m[5:], axis=1)[:, None])
        np.testing.assert_allclose(np.linalg.norm(recording.nhat_W, axis=1), 1.0, rtol=1e-12)
    assert turns[0] > math.radians(6.0)  # at edges
    assert turns[1] < math.radians(0.7)
    assert off.max() < math.radians(1.5)  # points outwards


def test_concave_edge_is_smoothed():
    """In a shallow groove with two faces in contact, the direction of the force is continuous."""
    h = 0.01 * math.tan(FACET_RAD / 2.0)
    corners = np.array([[x, y, z] for x, z in ((-0.01, h), (0.0, 0.0), (0.01, h)) for y in (-0.05, 0.05)])
    faces = np.array([(0, 2, 3), (0, 3, 1), (2, 4, 5), (2, 5, 3)], np.int32)
    x = np.linspace(-0.006, 0.006, 3000)
    path = np.column_stack((x, np.full(3000, 0.004), np.abs(x) * math.tan(FACET_RAD / 2.0) - 0.002))
    path[0, 2] = 0.01
    sharp, round_ = (
        hapscene.Renderer(scene(Mesh(corners, faces)), ["wall"], crease_rad=c).run(path) for c in (0.0, 0.5)
    )
    assert (sharp.flags == 0).all() and (round_.flags == 0).all()
    assert turn_rad(round_) < math.radians(0.2)
    np.testing.assert_allclose(angle(round_.nhat_W[1500], np.array([0.0, 0.0, 1.0])), 0.0, atol=1e-3)


def test_shading_keeps_depth_and_force_magnitude():
    path = np.concatenate((circle(0.06, 2), circle(0.047)))[1:]
    flat, shaded = (hapscene.Renderer(scene(BALL), ["wall"], crease_rad=c).run(path) for c in (0.0, 0.5))
    np.testing.assert_array_equal(flat.depth_m, shaded.depth_m)
    size = np.linalg.norm(flat.f_W_N, axis=1)
    np.testing.assert_allclose(np.linalg.norm(shaded.f_W_N, axis=1), size, rtol=1e-12)


def test_shaded_two_sided_sheet_pushes_towards_the_tool():
    sheet = ridge(Swatch("w"))
    mesh = sheet.bodies[0].mesh
    top = RIDGE_RADIUS_M
    below = np.array([[0.003, 0.001, top - 0.002], [0.003, 0.001, top + 0.0005]])
    recording = hapscene.Renderer(scene(mesh, two_sided=True), ["wall"], crease_rad=0.5).run(below)
    assert recording.touching[1]
    assert recording.f_W_N[1, 2] < -0.2


def generated_J(near_m: float, far_m: float, stiffness_N_m: float = 1000.0, steps: int = 2000) -> tuple[float, float]:
    """Return the energy that force shading generates in a closed tour, and its theoretical value [J].

    The tool moves from the centre of a face to its edge at depth `near_m`, then to `far_m`, and back.
    """
    renderer = hapscene.Renderer(
        ridge(Swatch("wall", stiffness_N_m=stiffness_N_m), 3), ("wall",), crease_rad=1.5 * FACET_RAD
    )
    top, edge = RIDGE_RADIUS_M, 0.5 * FACET_M * (1.0 - 1e-9)
    s = np.linspace(0.0, 1.0, steps)
    x = np.concatenate((edge * s, np.full(steps, edge), edge * s[::-1], np.zeros(steps)))
    near, far = np.full(steps, near_m), np.full(steps, far_m)
    depth = np.concatenate((near, near_m + (far_m - near_m) * s, far, far_m + (near_m - far_m) * s))
    path = np.stack((x, np.full(len(x), 0.003), top - depth), axis=1)
    renderer.reset((0.0, 0.003, top + 0.001))
    force = renderer.run(np.concatenate(([[0.0, 0.003, top + 0.0005]], path))).f_W_N[1:]
    made = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(path, axis=0)))
    theory = (1.0 - math.cos(FACET_RAD / 2.0)) * ((near_m - far_m) * FACET_M / FACET_RAD - 0.5 * (near_m**2 - far_m**2))
    return made, stiffness_N_m * theory


@pytest.mark.parametrize(("near_m", "far_m"), [(2e-3, 1e-3), (1e-3, 2e-3), (3e-3, 0.0)])
def test_energy_of_a_closed_tour(near_m, far_m):
    """The tolerance is the difference between interpolating a normal and its angle: δ²/24, 0.3 % at 15°."""
    made, theory = generated_J(near_m, far_m)
    assert abs(made) > 1e-4
    assert made == pytest.approx(theory, rel=1.05 * FACET_RAD**2 / 24.0)


def test_invalid_crease_angle_is_rejected():
    for crease in (-0.1, 4.0, math.nan):
        with pytest.raises(hapscene.HapsceneError, match="crease_rad"):
            hapscene.Renderer(scene(BALL), crease_rad=crease)
