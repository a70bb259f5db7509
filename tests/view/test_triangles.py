"""Triangles to draw."""

import numpy as np
import trimesh

from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.view.triangles import scene_solid, tube


def test_tube_lies_at_its_radius_and_ends_where_the_line_ends() -> None:
    t = np.linspace(0, 1, 400)
    line_m = np.column_stack((np.cos(6 * t), np.sin(6 * t), t))
    solid = tube(line_m, 0.01, "#0072B2")
    from scipy.spatial import cKDTree

    distance_m, _ = cKDTree(line_m).query(solid.corner_m)
    assert distance_m.min() > 0.0095 and distance_m.max() < 0.0135
    np.testing.assert_allclose(np.linalg.norm(solid.normal, axis=1), 1.0, atol=1e-9)
    assert np.linalg.norm(solid.corner_m - line_m[-1], axis=1).min() < 0.0101


def test_tube_of_a_point_and_of_a_turning_line() -> None:
    assert len(tube(np.zeros((5, 3)), 0.01, "#000000").corner_m) == 0
    there_and_back = np.array([[0.0, 0, 0], [0, 0, 1], [0, 0, 0]])
    assert np.isfinite(tube(there_and_back, 0.01, "#000000").corner_m).all()


def test_edges_stay_sharp_and_curves_look_smooth() -> None:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((1, 1, 1)), "m"), name="box")
    normal = scene_solid(scene).normal
    np.testing.assert_allclose(np.abs(normal).max(axis=1), 1.0, atol=1e-12)
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.icosphere(3, 0.5), "m"), name="ball")
    solid = scene_solid(scene)
    np.testing.assert_allclose(solid.normal, solid.corner_m / 0.5, atol=0.02)


def test_bodies_stand_at_their_poses() -> None:
    X_WB = np.eye(4)
    X_WB[:3, 3] = 1.0, 2.0, 3.0
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((1, 1, 1)), "m"), name="box", pose=X_WB)
    corner_m = scene_solid(scene).corner_m
    np.testing.assert_allclose((corner_m.min(axis=0) + corner_m.max(axis=0)) / 2, X_WB[:3, 3])
