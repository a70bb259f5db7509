"""Geometry of faces: plane, point-over-face test, barycentric coordinates, frames."""

import numpy as np
import pytest
import trimesh

from hapscene.contact.triangle import (
    blend,
    closest_point,
    corners,
    edge_past,
    is_narrow,
    lies_over,
    plane,
    to_body,
    to_body_last,
    to_world,
    turn_to_body,
    weights,
)


def test_plane_points_out_counter_clockwise():
    normal, offset = plane((0.0, 0.0, 2.0), (1.0, 0.0, 2.0), (0.0, 1.0, 2.0))
    assert normal == (0.0, 0.0, 1.0)
    assert offset == 2.0


def test_a_narrow_triangle_is_lower_than_the_least_height_over_its_longest_edge():
    a, b, c = (0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (1.0, 0.5, 0.0)
    assert not is_narrow(a, b, c, 0.49) and is_narrow(a, b, c, 0.51) and is_narrow(c, a, b, 0.51)
    assert is_narrow(a, a, a, 0.0)


def test_corners_equal_the_mesh(world, triangle):
    w = world(triangle)
    np.testing.assert_array_equal(corners(w, w.bodies[0], 0), triangle.vertices)
    assert w.corners_m.ctypes.data % 32 == 0 and w.corners_m.strides[0] == 96  # a face lies in two cache lines


@pytest.mark.parametrize(
    ("x", "y", "margin_m", "over"),
    [
        (0.02, 0.02, 0.0, True),
        (0.051, 0.051, 0.0, False),
        (0.051, 0.051, 0.0015, True),  # 1 mm · √2 past the slanted edge
    ],
)
def test_lies_over(world, triangle, x, y, margin_m, over):
    w = world(triangle)
    for height in (-0.3, 0.0, 1e-6, 5.0):
        assert bool(lies_over(w, w.bodies[0], 0, (x, y, height), margin_m)) is over


def test_frames_of_a_moved_body(world, triangle, turned):
    w = world(triangle)
    body = w.bodies[0]
    body.R_WB, body.p_WB_m = turned, (1.0, 2.0, 3.0)
    p = (0.3, -0.2, 0.1)
    expected = trimesh.transform_points([p], trimesh.transformations.compose_matrix(translate=(1, 2, 3)))[0]
    np.testing.assert_allclose(to_world(body, p), turned @ p + (1.0, 2.0, 3.0))
    np.testing.assert_allclose(to_body(body, to_world(body, p)), p)
    np.testing.assert_allclose(to_body(body, tuple(expected)), turned.T @ p)
    assert to_body_last(body, p) == p  # the last pose is the one at loading
    np.testing.assert_allclose(turn_to_body(body, p), turned.T @ p)
    np.testing.assert_allclose(weights(corners(w, body, 0), (0.03, 0.05, 0.2)), (0.2, 0.3, 0.5))
    body.last_R_WB, body.last_p_WB_m = turned.T, (3.0, 2.0, 1.0)
    np.testing.assert_allclose(to_body_last(body, p), turned @ np.subtract(p, (3.0, 2.0, 1.0)))


def test_closest_points_and_feet_are_those_of_another_library():
    rng = np.random.default_rng(5)
    triangles, points = rng.normal(size=(300, 3, 3)), 1.5 * rng.normal(size=(300, 3))
    expected = trimesh.triangles.closest_point(triangles, points)
    normals = trimesh.triangles.normals(triangles)[0]
    for triangle, p, closest, n in zip(triangles.tolist(), points, expected, normals, strict=True):
        abc, foot = tuple(map(tuple, triangle)), p - n * (n @ (p - triangle[0]))
        np.testing.assert_allclose(closest_point(*abc, tuple(p)), closest, atol=1e-12)
        np.testing.assert_allclose(blend(abc, weights(abc, tuple(p))), foot, atol=1e-9)
        ways = np.roll(triangle, -1, axis=0) - triangle
        past = -np.einsum("ki,ki->k", np.cross(n, ways / np.linalg.norm(ways, axis=1)[:, None]), foot - triangle)
        far = past.max()
        assert edge_past(*abc, tuple(p), 0.0) == (past.argmax() if far > 0.0 else -1)
        assert edge_past(*abc, tuple(p), 1.01 * max(far, 0.0)) == -1
        assert edge_past(*abc, tuple(p), 0.99 * far) == past.argmax() or far <= 0.0
        assert is_narrow(*abc, 1.01 * height_of(ways)) and not is_narrow(*abc, 0.99 * height_of(ways))


def height_of(ways) -> float:
    """Height of a triangle with sides (3, 3) over its longest side."""
    return float(np.linalg.norm(np.cross(ways[0], ways[1])) / np.linalg.norm(ways, axis=1).max())
