"""The faces across edges: against trimesh's, of meshes whole and in pieces, and where there is not just one."""

import numpy as np
import pytest
import trimesh

from hapscene.scene.neighbours import FAN_MAX, neighbours_of
from hapscene.scene.topology import edges_of, weld, winding_is_mixed


def faces_beyond(vertices_m, faces):
    return neighbours_of(np.asarray(vertices_m, np.float64), np.asarray(faces)).beyond


@pytest.mark.parametrize(
    "mesh",
    [trimesh.creation.icosphere(3), trimesh.creation.box(), trimesh.creation.annulus(1.0, 2.0, 1.0)],
    ids=["sphere", "box", "ring"],
)
def test_as_trimesh_finds_them_joined_or_not(mesh):
    beyond = faces_beyond(mesh.vertices, mesh.faces)
    pairs = {(min(f, g), max(f, g)) for f in range(len(beyond)) for g in beyond[f]}
    assert pairs == set(map(tuple, np.sort(mesh.face_adjacency, axis=1).tolist()))
    for k in range(3):  # across edge k, not another one
        ends = mesh.faces[:, [k, (k + 1) % 3]]
        assert (ends[:, :, None] == mesh.faces[beyond[:, k]][:, None, :]).any(axis=2).all()
    loose = mesh.vertices[mesh.faces].reshape(-1, 3)
    np.testing.assert_array_equal(faces_beyond(loose, np.arange(len(loose)).reshape(-1, 3)), beyond)


def test_zeros_of_both_signs_are_one_place():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, -0.0, 0], [-0.0, -0.0, 0], [0, -1, 0]])
    assert faces_beyond(corners, np.arange(6).reshape(2, 3)).tolist() == [[1, -1, -1], [0, -1, -1]]


@pytest.mark.parametrize(
    "faces",
    [
        [[0, 1, 2], [1, 0, 3], [1, 0, 4]],  # three at an edge
        [[0, 1, 2], [0, 1, 3]],  # wound against each other
        [[0, 1, 2], [0, 1, 2]],  # the same twice
        [[0, 1, 2]],
    ],
)
def test_none_where_there_is_not_just_one(faces):
    vertices = np.random.default_rng(0).normal(size=(5, 3))
    assert (faces_beyond(vertices, np.array(faces)) == -1).all()


@pytest.mark.parametrize("n", [FAN_MAX // 2, FAN_MAX // 2 + 1])
def test_about_a_vertex_of_too_many_edges_none_and_elsewhere_all(n):
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(n)))
    foot = rim - [0.0, 0.0, 1.0]
    k = np.arange(n)
    after = (k + 1) % n
    fan = np.column_stack((np.zeros(n, int), 1 + k, 1 + after))
    wall = np.column_stack((1 + k, 1 + n + k, 1 + after))
    found = neighbours_of(np.vstack(([[0.0, 0.0, 0.0]], rim, foot)), np.vstack((fan, wall)))
    seen = 2 * n <= FAN_MAX
    assert (found.beyond[:n, [0, 2]] == (np.c_[np.roll(k, 1), after] if seen else -1)).all()
    np.testing.assert_array_equal(found.beyond[:n, 1], n + k)
    assert found[1:] == ((False, False) if seen else (None, None))


@pytest.mark.parametrize("seed", range(8))
def test_winding_and_closedness_are_those_of_the_edges(seed):
    rng = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(2)
    faces = mesh.faces[rng.random(len(mesh.faces)) < rng.choice([1.0, 0.99])]
    flip = rng.random(len(faces)) < rng.choice([0.0, 0.01])
    faces = np.where(flip[:, None], faces[:, ::-1], faces)
    faces = np.vstack((faces, faces[: rng.integers(2)], np.tile([0, 0, 1], (rng.integers(2), 1)))).astype(np.int32)
    edges, found = edges_of(faces, weld(mesh.vertices)), neighbours_of(mesh.vertices, faces)
    assert (found.mixed, found.closed) == (winding_is_mixed(edges), edges.closed)
