"""Adjacency of faces, compared with trimesh."""

import numpy as np
import pytest
import trimesh

from hapscene.scene.topology import neighbours_of


def faces_beyond(vertices_m, faces):
    return neighbours_of(np.asarray(vertices_m, np.float64), np.asarray(faces)).beyond


@pytest.mark.parametrize(
    "mesh",
    [trimesh.creation.icosphere(3), trimesh.creation.box(), trimesh.creation.annulus(1.0, 2.0, 1.0)],
    ids=["sphere", "box", "ring"],
)
def test_adjacency_equals_that_of_trimesh(mesh):
    beyond = faces_beyond(mesh.vertices, mesh.faces)
    pairs = {(min(f, g), max(f, g)) for f in range(len(beyond)) for g in beyond[f]}
    assert pairs == set(map(tuple, np.sort(mesh.face_adjacency, axis=1).tolist()))
    for k in range(3):  # across edge k, not another one
        ends = mesh.faces[:, [k, (k + 1) % 3]]
        assert (ends[:, :, None] == mesh.faces[beyond[:, k]][:, None, :]).any(axis=2).all()
    loose = mesh.vertices[mesh.faces].reshape(-1, 3)
    np.testing.assert_array_equal(faces_beyond(loose, np.arange(len(loose)).reshape(-1, 3)), beyond)


def test_zeros_of_both_signs_are_equal():
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
def test_no_neighbour_at_irregular_edges(faces):
    vertices = np.random.default_rng(0).normal(size=(5, 3))
    assert (faces_beyond(vertices, np.array(faces)) == -1).all()


def test_mixed_and_closed():
    ball = trimesh.creation.icosphere(2)
    turned = ball.faces.copy()
    turned[7] = turned[7][::-1]
    for faces, mixed, closed in ((ball.faces, False, True), (ball.faces[1:], False, False), (turned, True, True)):
        assert neighbours_of(ball.vertices, faces)[1:] == (mixed, closed)
