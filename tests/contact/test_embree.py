"""Embree names the face: none is missed at edges and corners, and the search structure is where the mesh is."""

import numpy as np
import pytest
import trimesh

from hapscene.contact.embree import MITRE, Search, first_face, new_ray, overlap_faces

SKIN_M = 1e-6


def shoot(mesh: trimesh.Trimesh, targets, start) -> np.ndarray:
    """Faces met by rays from `start` to each target and 1 mm beyond, −1 for a miss."""
    search, ray = Search(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32), SKIN_M), new_ray()
    met = []
    for target in np.atleast_2d(targets):
        way = target - start
        length = np.linalg.norm(way)
        origin = tuple(map(float, start - search.center_m))
        met.append(first_face(search.handle, ray, origin, tuple(map(float, way / length)), float(length + 1e-3), 0))
    return np.array(met)


@pytest.mark.parametrize("offset_m", [0.0, 10.0])
def test_no_ray_at_a_shared_edge_or_corner_is_missed(offset_m):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    ball.apply_translation(np.full(3, offset_m))
    edges = ball.vertices[ball.edges_unique]
    share = np.random.default_rng(1).random((len(edges), 1))
    on_edges = edges[:, 0] * share + edges[:, 1] * (1 - share)
    targets = np.concatenate([on_edges, ball.vertices])
    start = np.full(3, offset_m) + 0.2 * np.array([0.3, -0.5, 0.8])
    away = targets - start
    facing = np.einsum("ij,ij->i", away, targets - offset_m) < -0.1 * 0.05 * np.linalg.norm(away, axis=1)
    met = shoot(ball, targets[facing], start)
    assert facing.sum() > 2000
    assert (met >= 0).all()
    normals = ball.face_normals[met]
    assert (np.einsum("ij,ij->i", normals, away[facing]) < 0).all()  # the near side, not the far one


def test_centre_and_radius_of_the_search():
    box = trimesh.creation.box(extents=(0.3, 0.4, 1.2))
    box.apply_translation((10, 0, 0))
    search = Search(np.asarray(box.vertices), np.asarray(box.faces, np.int32), SKIN_M)
    np.testing.assert_allclose(search.center_m, (10, 0, 0))
    assert search.radius_m == pytest.approx(0.65)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    search = Search(ball.vertices * (1.0, 2.0, 3.0), np.asarray(ball.faces, np.int32), SKIN_M)
    assert search.radius_m == pytest.approx(0.3)


def test_overlap_closes_a_crack(triangle):
    """Half a skin past its edge a face is still met; a skin past it is not."""
    skin = SKIN_M
    inside, beyond = [0.03, -0.4 * skin, 0.0], [0.03, -skin, 0.0]
    up = np.array([0.0, 0.0, 0.1])
    assert shoot(triangle, inside, inside + up).tolist() == [0]
    assert shoot(triangle, beyond, beyond + up).tolist() == [-1]


def test_ray_buffer_is_aligned():
    assert all(new_ray().ctypes.data % 16 == 0 for _ in range(8))


def offset_by_numpy(vertices_m: np.ndarray, faces: np.ndarray, center_m: np.ndarray, overlap_m: float) -> np.ndarray:
    """Reference for `overlap_faces` that tests all faces."""
    corners = vertices_m[faces] - center_m
    edges = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(edges, axis=2)
    double_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inradius = double_area / lengths.sum(axis=1)
        opposite = np.roll(lengths, -1, axis=1)
        spoke = corners - (corners * opposite[:, :, None]).sum(axis=1)[:, None] / lengths.sum(axis=1)[:, None, None]
        most = MITRE * overlap_m / np.linalg.norm(spoke, axis=2)
        grown = corners + spoke * np.minimum(overlap_m / inradius[:, None], most)[:, :, None]
        grown[~(double_area / lengths.max(axis=1) >= overlap_m)] = np.nan
    return grown.astype(np.float32).reshape(-1, 3)


@pytest.mark.parametrize("overlap_m", [0.0, 1e-6, 0.3])
def test_overlap_equals_numpy_reference_exactly(overlap_m):
    random = np.random.default_rng(3)
    vertices = np.concatenate([random.normal(size=(60, 3)), random.integers(-2, 3, (40, 3)), np.zeros((2, 3))])
    faces = random.integers(0, len(vertices), (5000, 3)).astype(np.int32)  # some narrow, some without area
    out, center = np.empty((3 * len(faces), 3), np.float32), np.array([0.1, -0.2, 3.0])
    overlap_faces(vertices, faces, center, overlap_m, out)
    np.testing.assert_array_equal(out, offset_by_numpy(vertices, faces, center, overlap_m))
    assert 0 < np.isnan(out[:, 0]).sum() < len(out) / 2
