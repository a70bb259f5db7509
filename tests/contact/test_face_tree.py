"""The tree of cylinders around faces: every face is inside, and no cylinder is larger than it must be."""

import numpy as np
import trimesh

from hapscene.contact.face_tree import FIT_MAX, LEAF_MAX, build_tree, fit_cylinders, way_from_cylinder


def test_cylinders_hold_their_faces_and_halve_them() -> None:
    rng = np.random.default_rng(1)
    mesh = trimesh.creation.icosphere(subdivisions=4)
    corners = (mesh.vertices * (3.0, 2.0, 1.0) + rng.normal(scale=1e-3, size=mesh.vertices.shape))[mesh.faces]
    narrow = corners[:40].copy()
    narrow[:, 2] = 0.5 * (narrow[:, 0] + narrow[:, 1])
    tree, order = build_tree(np.concatenate((narrow, corners)), 1e-9)
    assert np.array_equal(np.sort(order), np.arange(40, 40 + len(corners)))  # the narrow ones are left out
    assert 1.0 < len(tree) // 2 * LEAF_MAX / len(order) <= 2.0
    order -= 40
    check_cylinders(tree, order, corners, sorts=True)
    corners[order[:64]] = corners[order[0], 0]  # as a shape can have them
    fit_cylinders(corners, order, tree)
    check_cylinders(tree, order, corners)


def check_cylinders(tree: np.ndarray, order: np.ndarray, corners: np.ndarray, sorts: bool = False) -> None:
    leaves, count, centers = len(tree) // 2, len(order), corners.mean(axis=1)
    for node in range(1, 2 * leaves):
        width = leaves // 2 ** (node.bit_length() - 1)
        first = node * width - leaves
        start, middle, end = ((first + part * width // 2) * count // leaves for part in range(3))
        faces = order[start:end]
        axis, points = tree[node, 3:6].astype(float), corners[faces].reshape(-1, 3) - tree[node, :3]
        height = points @ axis
        beside = np.linalg.norm(points - height[:, None] * axis, axis=1)
        assert abs(np.linalg.norm(axis) - 1.0) < 1e-6
        over = tree[node, 6:8].astype(float) - (beside.max(), np.abs(height).max())
        assert over.min() >= 0.0
        if len(faces) <= FIT_MAX:
            assert over.max() < 2e-5
            assert abs(height.min() + height.max()) < 1e-5
            normal = np.zeros(3)
            for n in np.cross(*np.diff(corners[faces], axis=1).transpose(1, 0, 2)):
                normal += n if n @ normal >= 0.0 else -n
            assert axis @ normal >= (1.0 - 1e-6) * np.linalg.norm(normal)
        else:
            assert over.max() < 6.0
        if sorts and width > 1:
            size = np.ptp(centers[faces], axis=0)
            lower, upper = (centers[order[a:b], size.argmax()] for a, b in ((start, middle), (middle, end)))
            assert lower.max() <= upper.min()


def test_way_from_a_cylinder_is_the_shortest() -> None:
    rng = np.random.default_rng(2)
    node = np.array((1.0, 2.0, 3.0, 0.36, 0.48, 0.8, 0.5, 0.25), np.float32)
    center, axis, outside = node[:3].astype(float), node[3:6].astype(float), 0
    for p in center + rng.normal(size=(300, 3)):
        height = (p - center) @ axis
        beside = p - center - height * axis
        length = np.linalg.norm(beside)
        nearest = center + np.clip(height, -0.25, 0.25) * axis + beside * min(1.0, 0.5 / length)
        distance, way = way_from_cylinder(node, tuple(p))
        np.testing.assert_allclose(way, p - nearest, atol=1e-6)
        assert abs(distance - np.linalg.norm(p - nearest)) < 1e-6
        outside += distance > 0.0
    assert 200 < outside < 300
