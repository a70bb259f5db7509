"""Welding, edges and winding of simple bodies."""

import numpy as np
import pytest
import trimesh

from hapscene.scene.topology import area_of, edges_of, volume_of, weld, winding_of

BALL = trimesh.creation.icosphere(subdivisions=3)


def soup(mesh):
    return mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3)


def test_weld_merges_exactly_equal_positions():
    vertices = np.array([[0.0, 1, 2], [-0.0, 1, 2], [0, 1, 2 + 1e-15], [5, 5, 5], [0, 1, 2]])
    assert weld(vertices).tolist() == [0, 0, 2, 3, 0]
    rng = np.random.default_rng(0)
    points = rng.integers(0, 4, (2000, 3)).astype(float)
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    np.testing.assert_array_equal(weld(points), first[inverse.ravel()])


@pytest.mark.parametrize("make", [lambda m: (np.array(m.vertices), np.array(m.faces)), soup])
def test_edges_of_a_closed_mesh(make):
    vertices, faces = make(BALL)
    edges = edges_of(faces, weld(vertices))
    assert len(edges.count) == 3 * len(faces) // 2 and (edges.count == 2).all()
    pairs, agree = edges.pairs()
    assert agree.all()
    expected = {tuple(sorted(pair)) for pair in BALL.face_adjacency.tolist()}
    assert {tuple(sorted(pair)) for pair in pairs.tolist()} == expected


@pytest.mark.parametrize("share", [0.05, 0.3, 0.45])
def test_reversed_faces_are_found(share):
    vertices, faces = np.array(BALL.vertices), np.array(BALL.faces)
    chosen = np.random.default_rng(1).random(len(faces)) < share
    faces[chosen] = faces[chosen][:, ::-1]
    edges = edges_of(faces, weld(vertices))
    winding = winding_of(edges, area_of(vertices[faces]))
    np.testing.assert_array_equal(winding.turned, chosen)
    assert not winding.one_sided.any()


def test_moebius_strip_is_one_sided():
    n = 30
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    rim = []
    for s in (-0.3, 0.3):
        reach = 1 + s * np.cos(angle / 2)
        rim.append(np.stack([reach * np.cos(angle), reach * np.sin(angle), s * np.sin(angle / 2)], axis=1))
    vertices = np.concatenate(rim)
    faces = []
    for i in range(n):
        a, b = i, n + i
        c, d = (i + 1, n + i + 1) if i < n - 1 else (n, 0)
        faces += [[a, c, b], [b, c, d]]
    faces = np.array(faces)
    winding = winding_of(edges_of(faces, weld(vertices)), area_of(vertices[faces]))
    assert winding.one_sided.all() and not winding.turned.any()


def test_edges_of_chosen_faces_leave_out_other_and_degenerate_faces():
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 4], [0, 1, 1]])
    edges = edges_of(faces, np.arange(5), np.array([True, True, False, True]))
    assert edges.ends(np.arange(5)).tolist() == [[0, 1], [2, 0], [3, 0], [1, 2], [2, 3]]
    assert edges.count.tolist() == [1, 2, 1, 1, 1] and not edges.closed
    assert edges.count_by_face().tolist() == [[1, 1, 2], [2, 1, 1], [0, 0, 0], [0, 0, 0]]


def test_volume_and_closed():
    far = np.asarray(BALL.vertices) + np.array([100.0, 0.0, 0.0])
    faces = np.asarray(BALL.faces)
    assert volume_of(far, faces) == pytest.approx(BALL.volume, rel=1e-9)
    assert volume_of(far, faces[:, ::-1]) == pytest.approx(-BALL.volume, rel=1e-9)
    edges = edges_of(faces, weld(far))
    assert edges.closed and not edges_of(faces[1:], weld(far)).closed
    assert not edges_of(np.array([[0, 0, 0]]), np.arange(1)).closed
